"""What calibrating looks like from outside, folded from its feed and nothing else."""

from dataclasses import asdict, dataclass, field
from typing import Any

from frida_painter.session.events import Failed, Stopped, Written
from frida_painter.session.page_events import (
    Answered,
    Asked,
    CalibrationStarted,
    CalibrationStatus,
    ProcedureBegan,
    ProcedureFound,
    ProcedureProgress,
)
from frida_painter.web.calibration_request import PROCEDURES


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

    def hear(self, event: Written) -> None:
        """Takes note of an event; one that does not concern it changes nothing."""
        self.version += 1
        try:
            self._hear(event)
        except (KeyError, TypeError):  # of a procedure that there is no more
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

    def _hear(self, event: Written) -> None:
        match event:
            case CalibrationStarted(what):
                self.trouble, self.stopped, self.question, self.progress = "", False, None, ""
                for name, each in self.procedures.items():
                    each.status = "waiting" if name in what else ""
            case CalibrationStatus(easel, procedures):
                self.easel = easel
                for stands in procedures:
                    each = self.procedures[stands["name"]]
                    each.dated, each.fault, each.old = stands["dated"], stands["fault"], stands["old"]
            case ProcedureBegan(name):
                self.procedures[name].status, self.progress = "busy", ""
            case ProcedureProgress(words):
                self.progress = words
            case Asked(question):
                self.question = question
            case Answered():
                self.question = None
            case ProcedureFound(name, sentence, picture):
                each = self.procedures[name]
                each.sentence, each.picture, each.status = sentence, picture, "done"
            case Failed(reason):
                self.trouble = reason
                self._end("failed")
            case Stopped():
                self.stopped = True
                self._end("stopped")
            case _:
                pass

    def _end(self, how: str) -> None:
        self.question = None
        for each in self.procedures.values():
            if each.status in ("waiting", "busy"):
                each.status = how if each.status == "busy" else ""
