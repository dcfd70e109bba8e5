"""Folder of one painting, shared by the page's process and the worker: files, names and their writers.

The page's process writes requests, commands and the stop file; the worker writes all other files.
"""

import json
import os
import re
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from filelock import lock_descriptor
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, ValidationError, model_validator

from frida_painter import storage
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import LIVE_PICTURE, STOP_FILE
from frida_painter.errors import StorageError
from frida_painter.event_log import FEED, EventLog, LogReader
from frida_painter.objectives.objective import Gives, goal_kinds
from frida_painter.runs.spec import AUTO, Focus, Ground, RunSpec, brush_shares
from frida_painter.session.events import PlanningProgress, Written, events_of, record

# Request for a painting from the page: goals with weights and settings, checked before planning.

Identifier = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{32}$")]
Words = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=300)]
_CANVAS: CanvasSize = RunSpec.model_fields["canvas"].default
_LARGEST, _SMALLEST = 2000.0, 60.0  # mm


def _field_like_spec(name: str) -> Any:
    """Returns a field with the default and the limits of RunSpec."""
    field = RunSpec.model_fields[name]
    bounds = {bound: getattr(part, bound) for part in field.metadata for bound in ("ge", "le") if hasattr(part, bound)}
    return Field(field.default, allow_inf_nan=False, **bounds)


def _find_known(kind: str) -> str:
    known = goal_kinds().by_name
    if kind not in known:
        raise ValueError(f"There is no such kind of goal; there are {', '.join(known)}.")
    return kind


Kind = Annotated[str, AfterValidator(_find_known)]


def _shares(text: str) -> str:
    if text:
        brush_shares(text)
    return text


_BRUSH = r"(fine|medium|broad)(:\d{1,3}%)?"
Brushes = Annotated[str, StringConstraints(pattern=rf"^({AUTO}|{_BRUSH}(,{_BRUSH}){{0,7}})?$"), AfterValidator(_shares)]


class _Checked(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class GoalRequest(_Checked):
    """One goal: words or the id of an uploaded picture, depending on its kind.

    weight: its importance.
    """

    kind: Kind
    picture: Identifier | None = None
    words: Words | None = None
    weight: float = Field(1.0, ge=0.01, le=100, allow_inf_nan=False)

    @model_validator(mode="after")
    def _is_one_thing(self) -> Self:
        given, other = (self.words, self.picture) if self._is_of_words else (self.picture, self.words)
        if given is None or other is not None:
            raise ValueError("A goal is either words or a picture; say which words, or choose a picture.")
        if self.words is not None and not self.words.isprintable():
            raise ValueError("The words hold characters that cannot be printed; type them anew.")
        return self

    @property
    def _is_of_words(self) -> bool:
        return goal_kinds()[self.kind].gives is Gives.WORDS

    @property
    def toml(self) -> str:
        """Lines of the goal's table in a goal file; pictures lie beside the file under their ids."""
        value = self.words if self._is_of_words else f"{self.picture}.png"
        return f"{self.kind} = {json.dumps(value, ensure_ascii=False)}\nweight = {self.weight}\n"


class PaintingRequest(_Checked):
    """Request for a painting: goals, goals of the start, and settings; width and height in mm."""

    title: Annotated[str, StringConstraints(strip_whitespace=True, max_length=80)] = ""
    terms: tuple[GoalRequest, ...] = Field(max_length=8)
    initial: tuple[GoalRequest, ...] = Field((), max_length=2)
    strokes: int = _field_like_spec("strokes")
    colors: int = _field_like_spec("colors")
    width: float = Field(_CANVAS.width * 1000, ge=_SMALLEST, le=_LARGEST, allow_inf_nan=False)
    height: float = Field(_CANVAS.height * 1000, ge=_SMALLEST, le=_LARGEST, allow_inf_nan=False)
    brushes: Brushes = ""
    """Brushes of the layers; "" for the default ones."""
    replans: int = _field_like_spec("replans")
    ground: Ground = None
    """Ground; None for the default one."""
    on_canvas: bool = False
    focus: Focus = RunSpec.model_fields["focus"].default
    sharpness: float = _field_like_spec("sharpness")
    drying: float = _field_like_spec("drying")
    minutes: float | None = _field_like_spec("minutes")
    effort: float = _field_like_spec("effort")
    seed: int = _field_like_spec("seed")

    @model_validator(mode="before")
    @classmethod
    def _renewed(cls, given: Any) -> Any:
        """Converts an old request with a single brush."""
        if not isinstance(given, dict) or "brush" not in given:
            return given
        known = {name: value for name, value in given.items() if name != "brush"}
        return {"brushes": given["brush"], **known}

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        if not self.terms:
            raise ValueError("There is nothing to paint yet: give a picture, or words, or draw something.")
        if not self.title.isprintable():
            raise ValueError("The title holds characters that cannot be printed; type it anew.")
        if self.on_canvas and self.ground not in (None, "white"):
            raise ValueError("A canvas that is painted on as it is cannot be toned; choose one of them.")
        if not 1 / 4 <= self.width / self.height <= 4:
            raise ValueError("The canvas is too narrow: its longer side is at most four times the shorter one.")
        return self

    @property
    def pictures(self) -> frozenset[str]:
        """Ids of the needed pictures."""
        return frozenset(term.picture for term in (*self.terms, *self.initial) if term.picture is not None)

    @property
    def toml(self) -> str:
        """Goal file (TOML) of the request for the command line."""
        goals = [f"[[goal]]\n{term.toml}" for term in self.terms]
        return "\n".join(goals + [f"[[initial]]\n{term.toml}" for term in self.initial])


_SHOWN = re.compile(r"[a-z][a-z0-9-]{0,60}\.(png|jpg|mp4|json|svg|csv|gcode|html)")
_MAX_PLANS = 24
_A_MOMENT = 1.0  # seconds


@dataclass(frozen=True)
class PlanFolder:
    """Files of one plan of a painting: its request, the plan and its pictures."""

    path: Path

    @property
    def number(self) -> int:
        """Number of the plan, from 1."""
        return int(self.path.name)

    @property
    def goal(self) -> Path:
        """Goal file (TOML), with its pictures beside it."""
        return self.path / "goal.toml"

    @property
    def plan(self) -> Path:
        """File of the plan."""
        return self.path / "plan.json"

    def request(self) -> PaintingRequest:
        """Returns the request of the plan. Raises StorageError."""
        record = storage.read_json(self.path / "wish.json", "what a person asked for")
        try:
            return PaintingRequest.model_validate(record["wish"])
        except (KeyError, ValidationError) as cause:
            raise StorageError("What was asked for this plan is damaged; make another plan.") from cause


@dataclass(frozen=True)
class PaintingFolder:
    """Folder of one painting."""

    path: Path

    @property
    def feed(self) -> Path:
        """File of the events, one per line; written by the worker."""
        return self.path / "feed.jsonl"

    @property
    def commands(self) -> Path:
        """File of the commands, one per line; written by the page's process."""
        return self.path / "commands.jsonl"

    @property
    def replies(self) -> Path:
        """File of the answers to the worker's questions, one per line; written by the page's process."""
        return self.path / "replies.jsonl"

    @property
    def easel(self) -> Path:
        """Folder of a simulated robot's lock, because each painting has its own simulated robot."""
        return self.path / "easel"

    @property
    def stop(self) -> Path:
        """File that stops the worker when it exists."""
        return self.path / "stop"

    @property
    def robot_stop(self) -> Path:
        """File that makes the robot's process stop the robot, independent of the worker."""
        return self.painting / STOP_FILE

    def stop_now(self) -> None:
        """Stops all work on this painting. Raises OSError."""
        if self.painting.is_dir():
            self.robot_stop.touch()
        self.stop.touch()

    @property
    def camera(self) -> Path:
        """Current picture of a live camera, written by the easel's process."""
        return self.painting / LIVE_PICTURE

    @property
    def painting(self) -> Path:
        """Folder of the painting's results, as on the command line: plan, journal, photographs, film, page."""
        return self.path / "painting"

    @property
    def live(self) -> Path:
        """Folder of pictures that are shown during the work."""
        return self.path / "live"

    def region(self, number: int) -> Path:
        """Returns the file of a region that a person drew, light on dark."""
        return self.live / f"region-{number}.png"

    def change(self, number: int) -> PlanFolder:
        """Returns the folder of a goal that was changed during the painting; it has no plan."""
        return PlanFolder(self.path / "changes" / str(number))

    def keep_region(self, picture: Path) -> int:
        """Copies a drawing of a region into the folder; returns its number. Raises StorageError."""
        number = 1 + sum(1 for _ in self.live.glob("region-*.png"))
        _copy(picture, self.region(number))
        return number

    def begin_change(self, request: PaintingRequest, pictures: Path) -> int:
        """Makes a folder with a request and copies of its `pictures`; returns its number. Raises StorageError."""
        number = 1 + sum(1 for _ in (self.path / "changes").glob("*"))
        _fill(self.change(number), request, pictures)
        return number

    def plans(self) -> list[PlanFolder]:
        """Returns all plans, finished or not, in order."""
        found = (entry for entry in (self.path / "plans").glob("*") if entry.name.isdecimal())
        return sorted(map(PlanFolder, found), key=lambda folder: folder.number)

    def plan(self, number: int) -> PlanFolder:
        """Returns the folder of plan `number`, which need not exist."""
        return PlanFolder(self.path / "plans" / str(number))

    def begin_plan(self, request: PaintingRequest, pictures: Path) -> PlanFolder:
        """Makes the folder of a new plan, with its request and copies of its `pictures`. Raises StorageError."""
        number = max((folder.number for folder in self.plans()), default=0) + 1
        if number > _MAX_PLANS:
            raise StorageError(f"There are {_MAX_PLANS} plans already; choose one of them, or begin a new painting.")
        plan = self.plan(number)
        _fill(plan, request, pictures)
        return plan

    def find_shown(self, place: str, name: str) -> Path | None:
        """Returns the file `name` of a place ("live", "painting", or a plan's number); None if it may not be shown."""
        if not (place in ("live", "painting") or re.fullmatch(r"[1-9]\d?", place)) or not _SHOWN.fullmatch(name):
            return None
        folder = self.plan(int(place)).path if place.isdecimal() else self.path / place
        path = (folder / name).resolve()
        return path if path.is_file() and path.is_relative_to(self.path.resolve()) else None


def require_disk(folder: Path, needed: int) -> None:
    """Raises StorageError, in words for the page, unless the disk of `folder` has `needed` bytes free."""
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise StorageError(f"The studio's disk cannot be looked at ({error.strerror}).") from error
    if free < needed:
        raise StorageError(
            f"The studio's disk has {free // 2**20} MB free, and this needs {needed // 2**20} MB; make room on it."
        )


def _fill(place: PlanFolder, request: PaintingRequest, pictures: Path) -> None:
    storage.new_folder(place.path)
    for name in request.pictures:
        _copy(pictures / f"{name}.png", place.path / f"{name}.png")
    storage.write_text(place.goal, request.toml)
    storage.write_json(place.path / "wish.json", {"wish": request.model_dump(mode="json")})


def _copy(picture: Path, to: Path) -> None:
    if not picture.is_file():
        raise StorageError("A picture of this goal is gone; choose it again.")
    with storage.replacing(to) as temporary:
        shutil.copyfile(picture, temporary)


class WorkerLock:
    """Lock of the one process that works on a painting; it is free when that process ends for any reason.

    The parent takes the lock and hands it to the worker, so that there is no moment without it. This needs a lock
    on a descriptor, which a child inherits; a lock on a path (filelock.FileLock) belongs to one process.
    """

    def __init__(self, folder: PaintingFolder) -> None:
        self._file = os.open(folder.path / ".worker", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)

    def take(self) -> bool:
        """Takes the lock; returns True if it was free. It waits a moment for processes that only check the lock."""
        patience = time.monotonic() + _A_MOMENT
        while not self.try_once():
            if time.monotonic() > patience:
                return False
            time.sleep(0.02)
        return True

    def try_once(self) -> bool:
        """Takes the lock without waiting; returns True if it was free."""
        return lock_descriptor(self._file, blocking=False)

    def fileno(self) -> int:
        """Returns the descriptor for a child process that is to hold the lock too."""
        return self._file

    def release(self) -> None:
        """Releases the lock of this process; a child that holds it too keeps it until its end."""
        os.close(self._file)  # closed, not unlocked, because unlocking would take it from the child too


def working(folder: PaintingFolder) -> bool:
    """Returns True if a worker is at work on the painting."""
    if not (folder.path / ".worker").exists():
        return False
    lock = WorkerLock(folder)
    try:
        return not lock.try_once()
    finally:
        lock.release()


# Request for a calibration from the page.

Procedure = Literal["canvas", "robot", "color", "brush", "strokes"]
PROCEDURES: tuple[Procedure, ...] = get_args(Procedure)
_FILE = "asked.json"
_Side = Annotated[float, Field(ge=60, le=2000, allow_inf_nan=False)]


class CalibrationRequest(BaseModel):
    """Request for a calibration.

    what: procedures, in order.
    brush, width, height, seed: brush, canvas in mm and seed of a simulated easel.
    count: number of strokes in the strokes procedure.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    what: tuple[Procedure, ...] = Field(min_length=1, max_length=5)
    brush: Literal["fine", "medium", "broad"] = "broad"
    width: _Side = 14 * 25.4
    height: _Side = 11 * 25.4
    seed: int = Field(0, ge=0, le=2**31 - 1)
    count: int = Field(60, ge=20, le=1000)

    @model_validator(mode="after")
    def _once_and_in_order(self) -> Self:
        if list(self.what) != [name for name in PROCEDURES if name in self.what]:
            raise ValueError("Each procedure is done once, in the order canvas, robot, color, brush, strokes.")
        return self

    @property
    def whole(self) -> bool:
        """True if all procedures are requested."""
        return self.what == PROCEDURES

    def keep(self, folder: PaintingFolder) -> None:
        """Writes the request into the folder, for the worker. Raises StorageError."""
        storage.write_json(folder.path / _FILE, {"asked": self.model_dump(mode="json")})

    @classmethod
    def load(cls, folder: PaintingFolder) -> Self:
        """Returns the request from the folder. Raises StorageError."""
        record = storage.read_json(folder.path / _FILE, "what is to be calibrated")
        try:
            return cls.model_validate(record["asked"])
        except (KeyError, ValidationError) as cause:
            raise StorageError("What was asked to be calibrated is damaged; ask again.") from cause


# Feed of a painting: its events, for everybody who watches.

_BETWEEN_STEPS = 0.25  # seconds between two reports of progress, as fine as a person can see


@dataclass
class Feed:
    """Writes events for the page. If the disk is full, events are left out; the journal handles that fault."""

    folder: PaintingFolder
    _log: EventLog = field(init=False)
    _told: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self._log = EventLog(self.folder.feed, FEED)

    def tell(self, event: Written) -> None:
        """Writes an event."""
        try:
            self._log.append(record(event))
        except StorageError:
            return

    def step(self, share: float, left: float, plan: int | None = None) -> None:
        """Writes the progress of planning, at most every 0.25 s.

        share: in [0, 1].
        left: remaining seconds.
        plan: plan number, None during a painting.
        """
        now = time.monotonic()
        if now - self._told >= _BETWEEN_STEPS or share >= 1:
            self._told = now
            self.tell(PlanningProgress(round(share, 4), round(left, 1), plan))

    def close(self) -> None:
        """Closes the feed."""
        self._log.close()


class FeedReader:
    """Reads new events from a feed; the file need not exist yet."""

    def __init__(self, path: Path) -> None:
        self._reader = LogReader(path)

    def read(self) -> list[Written]:
        """Returns the events since the last call, in order, without invalid lines."""
        found: list[Written] = []
        for line in self._reader.read():
            try:
                found += events_of(line)
            except (ValueError, KeyError, TypeError):
                continue
        return found
