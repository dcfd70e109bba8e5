"""What calibrating looks like from outside, folded from its feed and nothing else."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from frida_painter.web.calibrate import PROCEDURES


@dataclass
class ProcedureState:
    """One procedure; status: "", "waiting", "busy", "done", "failed" or "stopped" in this or the last calibration.

    sentence, picture: what was found; dated: when it was last entered into the record, None where never;
    fault: why it is to be repeated; old: whether it was long ago.
    """

    name: str
    status: str = ""
    sentence: str = ""
    picture: str | None = None
    dated: str | None = None
    fault: str = ""
    old: bool = False


@dataclass
class CalibrationState:
    """All procedures of an easel. question: what a person is asked, as web/asking.py tells; progress: in words."""

    easel: str = ""
    procedures: dict[str, ProcedureState] = field(
        default_factory=lambda: {name: ProcedureState(name) for name in PROCEDURES}
    )
    question: dict[str, Any] | None = None
    progress: str = ""
    trouble: str = ""
    stopped: bool = False
    version: int = 0

    def hear(self, told: Mapping[str, Any]) -> None:
        """Takes note of one line of the feed; what it does not understand changes nothing."""
        self.version += 1
        try:
            self._hear(told)
        except (KeyError, TypeError, ValueError):
            return

    def shown(self, working: bool) -> dict[str, Any]:
        """All of it as plain values."""
        unfinished = any(each.status in ("waiting", "busy") for each in self.procedures.values())
        vanished = "The calibration ended in the middle of its work, without saying why; is the disk full?"
        return {
            "version": self.version,
            "working": working,
            "easel": self.easel,
            "procedures": [asdict(each) for each in self.procedures.values()],
            "question": self.question if working else None,
            "progress": self.progress if working else "",
            "stopped": self.stopped,
            "trouble": self.trouble or (vanished if unfinished and not working and not self.stopped else ""),
        }

    def _hear(self, told: Mapping[str, Any]) -> None:
        match told["kind"]:
            case "begun":
                self.trouble, self.stopped, self.question, self.progress = "", False, None, ""
                for name, each in self.procedures.items():
                    each.status = "waiting" if name in told["what"] else ""
            case "standing":
                self.easel = str(told["easel"])
                for stands in told["procedures"]:
                    each = self.procedures[stands["name"]]
                    each.dated, each.fault, each.old = stands["dated"], stands["fault"], stands["old"]
            case "procedure":
                self.procedures[told["name"]].status, self.progress = "busy", ""
            case "progress":
                self.progress = str(told["words"])
            case "asked":
                self.question = dict(told["question"])
            case "answered":
                self.question = None
            case "found":
                each = self.procedures[told["name"]]
                each.sentence, each.picture, each.status = str(told["sentence"]), told["picture"], "done"
            case "failed":
                self.trouble = str(told["sentence"])
                self._end("failed")
            case "stopped":
                self.stopped = True
                self._end("stopped")
            case _:
                pass

    def _end(self, how: str) -> None:
        self.question = None
        for each in self.procedures.values():
            if each.status in ("waiting", "busy"):
                each.status = how if each.status == "busy" else ""
