"""Teaching of a stroke on the page: the request with a person's marks, and its state, computed from its feed."""

from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import Field

from frida_painter.session.events import (
    Failed,
    FamilyTaught,
    ProcedureProgress,
    Stopped,
    TeachingStarted,
    Written,
)
from frida_painter.web.painting_state import Truth
from frida_painter.web.studio_folder import Brush, KeptRequest

FAMILY_NAME = r"[a-z][a-z0-9-]{0,29}"
"""Names of families on the page."""
_MIN_MARKS, _MAX_MARKS = 10, 60
_MAX_POINTS = 400  # of a mark; the page sends only those that it needs
_Place = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]
_Press = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
_Seconds = Annotated[float, Field(ge=0, le=600, allow_inf_nan=False)]
_Mark = Annotated[list[tuple[_Place, _Place, _Press, _Seconds]], Field(min_length=1, max_length=_MAX_POINTS)]


class TeachingRequest(KeptRequest):
    """Request to learn a stroke family from marks.

    name: of the family.
    brush: that paints it.
    marks: points (x, y, press, seconds) of each, in mm, y up.
    count: strokes that the virtual studio paints to learn from; 0 for none.
    """

    _name = "the stroke to teach"

    name: str = Field(pattern=rf"^{FAMILY_NAME}$")
    brush: Brush = "fine"
    marks: list[_Mark] = Field(min_length=_MIN_MARKS, max_length=_MAX_MARKS)
    count: int = Field(40, ge=0, le=200)


@dataclass
class TeachingProgress:
    """State of teaching.

    name: of the family that is being learned, or was learned last.
    taught: families that were learned here, by name: sentence, brush and picture of each.
    progress: in words.
    """

    name: str = ""
    taught: dict[str, dict[str, str]] = field(default_factory=dict)
    progress: str = ""
    trouble: str = ""
    stopped: bool = False
    ended: bool = True
    version: int = 0

    def hear(self, event: Written) -> None:
        """Updates the state by an event; other events change nothing."""
        self.version += 1
        match event:
            case TeachingStarted(name):
                self.name, self.progress, self.trouble, self.stopped, self.ended = name, "", "", False, False
            case ProcedureProgress(words):
                self.progress = words
            case FamilyTaught(name, brush, sentence, picture):
                self.taught[name] = {"brush": brush, "sentence": sentence, "picture": picture}
                self.ended = True
            case Failed(reason):
                self.trouble, self.ended = reason, True
            case Stopped():
                self.stopped, self.ended = True, True
            case _:
                pass

    def to_plain(self, truth: Truth) -> dict[str, Any]:
        """Returns the state as plain values; a process that ended without an event is reported as an error."""
        said = "The process that learned the stroke ended without saying why."
        return {
            "version": self.version,
            "working": truth.working,
            "name": self.name,
            "taught": self.taught,
            "progress": self.progress if truth.working else "",
            "stopped": self.stopped,
            "trouble": self.trouble or truth.explain(self.ended, said, "Teach it again."),
        }
