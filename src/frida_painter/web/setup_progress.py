"""Setup of a machine on the page: the request for it, and its state, computed from its feed."""

from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import Field, model_validator

from frida_painter.session.events import Answered, Asked, Failed, Remark, Stopped, Written
from frida_painter.session.setup_events import (
    MachineTold,
    SetupLeft,
    SetupStands,
    SetupStarted,
    SetupStepBegan,
    SetupWritten,
)
from frida_painter.web.painting_state import Truth
from frida_painter.web.studio_folder import Brush, KeptRequest

StepName = Literal["canvas", "touch", "surface", "paint", "trace", "strokes"]
SETUP_STEPS: tuple[StepName, ...] = get_args(StepName)
"""Names of the steps, as in runs/machine_setup.py, which the web process must not load."""
_MAX_REMARKS = 6
_Side = Annotated[float, Field(ge=50, le=2000, allow_inf_nan=False)]


class SetupRequest(KeptRequest):
    """Request for the setup of a machine.

    easel: name of the setup that goes on; None to choose a machine.
    width, height: of the canvas in mm; None to mark three corners.
    brush: in the holder; None for the fine one, or that of the setup that goes on.
    step: the one to repeat.
    anew: True to begin from the start, even if a setup of this machine was left.
    """

    _name = "the machine to set up"

    easel: str | None = Field(None, pattern=r"^[A-Za-z0-9][A-Za-z0-9 _-]{0,60}$")
    width: _Side | None = None
    height: _Side | None = None
    brush: Brush | None = None
    step: StepName | None = None
    anew: bool = False

    @model_validator(mode="after")
    def _has_both_sides(self) -> Self:
        if (self.width is None) != (self.height is None):
            raise ValueError("Give both sides of the canvas, or none: three corners are then marked.")
        return self


@dataclass
class SetupProgress:
    """State of the setup of a machine.

    stands: machine, steps and table, in the form of `SetupStands`; None before a machine was chosen.
    step: name of the current step, "" before the first one.
    facts: what the controller told, in the form of `MachineTold`.
    remarks: the newest sentences of the setup.
    question: open question, in the form of web/painter.py.
    written: files and commands of the finished setup, in the form of `SetupWritten`.
    left: sentence about a setup that was left.
    """

    stands: dict[str, Any] | None = None
    step: str = ""
    facts: list[dict[str, str]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    question: dict[str, Any] | None = None
    written: dict[str, Any] | None = None
    left: str = ""
    trouble: str = ""
    stopped: bool = False
    ended: bool = True
    version: int = 0

    def hear(self, event: Written) -> None:
        """Updates the state by an event; other events change nothing."""
        self.version += 1
        match event:
            case SetupStarted():
                fresh = SetupProgress(stands=self.stands, ended=False, version=self.version)
                self.__dict__.update(fresh.__dict__)
            case SetupStands():
                self.stands = asdict(event)
            case SetupStepBegan(name):
                self.step, self.remarks = name, []
            case MachineTold(facts):
                self.facts = facts
            case Remark(sentence):
                self.remarks = [*self.remarks, sentence][-_MAX_REMARKS:]
            case Asked(question):
                self.question = question
            case Answered():
                self.question = None
            case SetupWritten():
                self.written, self.ended, self.question = asdict(event), True, None
            case SetupLeft(sentence):
                self.left, self.ended, self.question = sentence, True, None
            case Failed(reason):
                self.trouble, self.ended, self.question = reason, True, None
            case Stopped():
                self.stopped, self.ended, self.question = True, True, None
            case _:
                pass

    def to_plain(self, truth: Truth) -> dict[str, Any]:
        """Returns the state as plain values; a process that ended without an event is reported as an error."""
        said = "The setup's process ended in the middle of its work, without saying why."
        return {
            "version": self.version,
            "working": truth.working,
            "stands": self.stands,
            "step": self.step if truth.working else "",
            "facts": self.facts,
            "remarks": self.remarks,
            "question": self.question if truth.working else None,
            "written": self.written,
            "left": self.left,
            "stopped": self.stopped,
            "trouble": self.trouble or truth.explain(self.ended, said, "Continue the setup."),
        }
