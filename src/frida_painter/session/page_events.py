"""Written events that only the page is told: of plans, of what it shows of a painting, and of calibrating."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class PlanRequested:
    """A person asked for plan number `plan`; wish: the request, as the page sent it."""

    plan: int
    wish: dict[str, Any]


@dataclass(frozen=True)
class PlanningProgress:
    """How far planning is, in [0, 1], and how many seconds it still takes; plan: its number, None in a painting."""

    share: float
    left: float
    plan: int | None = None


@dataclass(frozen=True)
class PlanPreview:
    """A picture of a plan that is being made; plan: its number, None in a painting."""

    picture: str
    plan: int | None = None


@dataclass(frozen=True)
class PlanMade:
    """Plan number `plan` is ready, after `seconds`.

    nearer: by which share of the bare canvas's distance it comes nearer to the goal; prefix: of the names of its
    pictures; frames: after how many strokes there is one; palette: its paints; mixtures: how they are mixed.
    """

    plan: int
    nearer: float
    seconds: float
    prefix: str
    frames: list[int]
    strokes: int
    palette: list[dict[str, Any]]
    mixtures: list[dict[str, Any]]


@dataclass(frozen=True)
class Queued:
    """Plan number `plan` waits for others; job: "plan" where it is to be made, "paint" where it is to be painted."""

    plan: int
    job: str


@dataclass(frozen=True)
class Dequeued:
    """Plan number `plan` waits no longer: it was begun, or else a person took it out."""

    plan: int
    begun: bool


@dataclass(frozen=True)
class RestReplanned:
    """What was left was planned again after `done` strokes; gain: as of Planned; the rest as of PlanMade."""

    done: int
    gain: float
    prefix: str
    frames: list[int]
    strokes: int
    palette: list[dict[str, Any]]


@dataclass(frozen=True)
class PaintingStarted:
    """A person had plan number `plan` painted, of `of` strokes."""

    plan: int
    of: int


@dataclass(frozen=True)
class TakenUp:
    """A person had a painting that broke off gone on with; `done` strokes are painted."""

    done: int


@dataclass(frozen=True)
class Mixing:
    """The wells are being filled."""


@dataclass(frozen=True)
class TimeLeft:
    """Seconds until the last stroke, as they are forecast now."""

    seconds: float


@dataclass(frozen=True)
class PhotographShown:
    """A photograph of the canvas after `done` strokes."""

    picture: str
    done: int


@dataclass(frozen=True)
class LookShown:
    """Pictures of a look after `done` strokes: what was seen, what was expected, and the difference."""

    done: int
    seen: str
    expected: str
    difference: str


@dataclass(frozen=True)
class Considering:
    """The painter does what a person asked for in a pause."""


@dataclass(frozen=True)
class WentOn:
    """A pause is over."""


@dataclass(frozen=True)
class Turns:
    """Robot and person take turns of so many strokes; 0: they do not."""

    strokes: int


@dataclass(frozen=True)
class Remark:
    """Why something could not be done as it was asked for."""

    sentence: str


@dataclass(frozen=True)
class Finishing:
    """Nothing moves any more; film, page and exports are being made."""


@dataclass(frozen=True)
class PaintingKept:
    """All that is kept of a painting is in its folder; whether a film, and one of the arm, is among it."""

    film: bool
    arm: bool = False


@dataclass(frozen=True)
class Asked:
    """A person is asked something, as web/asking.py describes it."""

    question: dict[str, Any]


@dataclass(frozen=True)
class Answered:
    """The question was answered."""


@dataclass(frozen=True)
class Rests:
    """The worker has ended."""


# Written events of a calibration.


@dataclass(frozen=True)
class CalibrationStarted:
    """A person had these procedures begun, in this order."""

    what: list[str]


@dataclass(frozen=True)
class CalibrationStatus:
    """How each procedure stands: its name, when it was done, why it is to be repeated, whether it is old."""

    easel: str
    procedures: list[dict[str, Any]]


@dataclass(frozen=True)
class ProcedureBegan:
    """A procedure is led now."""

    name: str


@dataclass(frozen=True)
class ProcedureProgress:
    """How far a procedure is, in words."""

    words: str


@dataclass(frozen=True)
class ProcedureFound:
    """What a procedure found, and a picture of it if there is one."""

    name: str
    sentence: str
    picture: str | None = None


PageEvent = (
    PlanRequested | PlanningProgress | PlanPreview | PlanMade | RestReplanned | PaintingStarted | TakenUp | Mixing
    | TimeLeft | PhotographShown | LookShown | Considering | WentOn | Turns | Remark | Finishing | PaintingKept | Asked
    | Answered | Rests | Queued | Dequeued
    | CalibrationStarted | CalibrationStatus | ProcedureBegan | ProcedureProgress | ProcedureFound
)  # fmt: skip
