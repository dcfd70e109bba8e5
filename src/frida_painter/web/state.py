"""What a painting looks like from outside: everything the page shows of it, folded from the feed and nothing else."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

_MOST_LOOKS = 200


@dataclass
class PlanState:
    """One plan: status is "planning", "ready", "failed" or "stopped"; the rest as the worker tells it."""

    number: int
    wish: dict[str, Any]
    status: str = "planning"
    share: float = 0.0
    left: float | None = None
    growing: str | None = None
    nearer: float = 0.0
    made: dict[str, Any] | None = None


@dataclass
class PaintState:
    """The painting itself; status: "preparing", "mixing", "painting", "planning", "paused", "finishing",
    "finished", "stopped" or "failed".

    plan: the number it was painted from; held: whether it waits for a person, also while it does what they asked for
    in the pause; turn: whether it is the person's turn; turns: strokes after which it is, 0 where nobody takes turns;
    region: what is protected; remark: what could not be done as it was asked; wish: as it was changed in the middle;
    looks: what was seen, expected and planned again, in order; film, arm, kept: whether there is a film, one of a
    simulated arm at work, and all else that is kept of a painting.
    """

    plan: int
    of: int
    status: str = "preparing"
    done: int = 0
    left: float | None = None
    share: float = 0.0
    photograph: str | None = None
    growing: str | None = None
    paint: int | None = None
    reason: str = ""
    looks: list[dict[str, Any]] = field(default_factory=list)
    replanned: dict[str, Any] | None = None
    held: bool = False
    turn: bool = False
    turns: int = 0
    region: dict[str, Any] | None = None
    remark: str = ""
    wish: dict[str, Any] | None = None
    film: bool = False
    arm: bool = False
    kept: bool = False


@dataclass
class PaintingState:
    """A painting from the first wish to the last stroke.

    title, seen: version of this state; working: whether a process is at work; trouble: the last
    sentence about what went wrong, until something else is begun; question: what a person is asked, as
    web/asking.py tells.
    """

    plans: dict[int, PlanState] = field(default_factory=dict)
    painting: PaintState | None = None
    trouble: str = ""
    stopped: bool = False
    question: dict[str, Any] | None = None
    version: int = 0

    def hear(self, told: Mapping[str, Any]) -> None:
        """Takes note of one line of the feed; what it does not understand changes nothing."""
        self.version += 1
        try:
            if told["kind"] in _PLANNING:
                self._hear_planning(told)
            elif told["kind"] in ("asked", "answered"):
                self.question = dict(told["question"]) if told["kind"] == "asked" else None
            elif told["kind"] == "begun":
                self._forget_trouble()
                self.painting = PaintState(told["plan"], told["of"])
            elif self.painting is not None and told["kind"] in _PAINTING:
                self._hear_painting(self.painting, told)
            else:
                self._hear_end(told)
        except (KeyError, TypeError, ValueError):
            return

    def shown(self, working: bool) -> dict[str, Any]:
        """All of it as plain values. A worker that is gone without a word has met an accident."""
        shown = {
            "version": self.version,
            "working": working,
            "stopped": self.stopped,
            "trouble": self.trouble,
            "question": self.question if working else None,
            "plans": [asdict(plan) for plan in self.plans.values()],
            "painting": None if self.painting is None else asdict(self.painting),
        }
        if not working and not self.trouble and not self.stopped and self._unfinished():
            shown["trouble"] = "The painter stopped in the middle of its work, without saying why; is the disk full?"
        return shown

    @property
    def stage(self) -> str:
        """In a word, for the gallery."""
        if self.painting is not None:
            return self.painting.status
        return "planned" if any(plan.status == "ready" for plan in self.plans.values()) else "planning"

    def _unfinished(self) -> bool:
        planning = any(plan.status == "planning" for plan in self.plans.values())
        return planning or (self.painting is not None and self.painting.status not in _ENDS)

    def _forget_trouble(self) -> None:
        self.trouble, self.stopped, self.question = "", False, None

    def _hear_planning(self, told: Mapping[str, Any]) -> None:
        number = int(told["plan"])
        if told["kind"] == "wished":
            self._forget_trouble()
            self.plans[number] = PlanState(number, told["wish"])
            return
        plan = self.plans[number]
        match told["kind"]:
            case "planning":
                plan.share, plan.left = told["share"], told["left"]
            case "sprouting":
                plan.growing = told["picture"]
            case _:
                plan.status, plan.share, plan.left, plan.nearer = "ready", 1.0, None, told["nearer"]
                plan.made = {
                    name: told[name] for name in ("prefix", "frames", "strokes", "palette", "mixtures", "seconds")
                }

    def _hear_painting(self, painting: PaintState, told: Mapping[str, Any]) -> None:
        kind = told["kind"]
        painting.status = _PAINTING[kind] or painting.status
        if kind in ("looked", "resumed", "replanned"):
            painting.remark = ""
        if kind in ("paused", "resumed", "taken up"):
            painting.held = kind == "paused"
        match kind:
            case "taken up":
                self._forget_trouble()
                painting.done, painting.film, painting.kept = told["done"], False, False
            case "dipped":
                painting.paint = told["paint"]
            case "stroke":
                painting.done, painting.of, painting.left = told["done"], told["of"], told["left"]
            case "photograph":
                painting.photograph = told["picture"]
            case "looked":
                painting.growing = None
                names = ("done", "seen", "expected", "difference")
                painting.looks = [*painting.looks[-_MOST_LOOKS:], {name: told[name] for name in names}]
            case "replanning":
                painting.share, painting.left = told["share"], told["left"]
            case "growing":
                painting.growing = told["picture"]
            case "replanned":
                painting.growing, painting.share = None, 0.0
                made = {name: told[name] for name in ("prefix", "frames", "strokes", "palette", "done")}
                painting.replanned = made
                if painting.looks and painting.looks[-1]["done"] == told["done"] and "gain" not in painting.looks[-1]:
                    painting.looks[-1] = {
                        **painting.looks[-1],
                        "gain": told["gain"],
                        "plan": f"{told['prefix']}plan.jpg",
                    }
            case "paused":
                painting.reason, painting.turn = told["reason"], told["turn"]
            case "turns":
                painting.turns = told["strokes"]
            case "region":
                painting.region = {"picture": told["picture"], "only": told["only"]} if told["picture"] else None
            case "changed":
                painting.wish = told["wish"]
            case "remark":
                painting.remark = str(told["sentence"])
            case "finished":
                painting.film, painting.left, painting.kept = told["film"], 0.0, True
                painting.arm = bool(told.get("arm", False))
                if self.stopped:
                    painting.status = "stopped"
            case _:
                pass

    def _hear_end(self, told: Mapping[str, Any]) -> None:
        match told["kind"]:
            case "failed":
                self.trouble = str(told["sentence"])
                self._end("failed")
            case "stopped":
                self.stopped = True
                self._end("stopped")
            case _:
                pass

    def _end(self, how: str) -> None:
        for plan in self.plans.values():
            if plan.status == "planning":
                plan.status = how
        if self.painting is not None and self.painting.status not in _ENDS:
            self.painting.status = how


_PLANNING = ("wished", "planning", "sprouting", "planned")
# What happens during a painting, and what it is about from then on; nothing: what it was before.
_PAINTING = {
    "taken up": "preparing",
    "mixing": "mixing",
    "dipped": "painting",
    "stroke": "painting",
    "photograph": "",
    "looked": "planning",
    "replanning": "planning",
    "growing": "",
    "replanned": "painting",
    "paused": "paused",
    "considering": "planning",
    "resumed": "painting",
    "turns": "",
    "region": "",
    "changed": "",
    "remark": "",
    "finishing": "finishing",
    "finished": "finished",
}
_ENDS = ("finished", "stopped", "failed")
