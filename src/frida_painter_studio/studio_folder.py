"""Folder of one painting, shared by the page's process and the worker: files, names and their writers.

The page's process writes requests and the stop file; the worker writes all other files. The painting itself lies in
a folder of its own, as one that was begun at a terminal: with its journal, its inbox, and the pictures for the page.
"""

import contextlib
import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, StringConstraints, create_model, model_validator

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import JOURNAL, LIVE, LIVE_PICTURE, REGIONS, STOP_FILE
from frida_painter.errors import ConfigError, StorageError
from frida_painter.planning.fields import brush_shares, family_shares
from frida_painter.runs.spec import RunSpec, without_former
from frida_painter.runs.variant_settings import VARIANTS, variant_of
from frida_painter.session.events import Event, events_of, time_of
from frida_painter.system import locks, storage
from frida_painter.system.event_log import LogReader
from frida_painter.system.operating_system import write_at
from frida_painter_studio.at_page import FEED_FILE, Feed
from frida_painter_studio.form import CONTROLS, SETTINGS, USUAL_VALUES
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_together.commands import GoalRequest, goal_items, pictures_of, tidy
from frida_painter_together.inbox import KeptRequest

# Request for a painting from the page: goals with weights and settings, checked before planning.

_CANVAS: CanvasSize = RunSpec.model_fields["canvas"].default
Side = Annotated[float, Field(ge=60, le=2000, allow_inf_nan=False)]
"""Side of a canvas, mm."""


def _require_brush(name: str) -> str:
    known = registry.parts(registry.STROKE_MODELS)
    if name not in known:
        raise ValueError(f"Brush {name[:60]!r} is not known; brushes are {', '.join(known)}.")
    return name


Brush = Annotated[str, StringConstraints(max_length=400), AfterValidator(_require_brush)]


class CanvasSides(BaseModel):
    """Sides of a canvas in mm; by default, those of `RunSpec`."""

    width: Side = _CANVAS.width * 1000
    height: Side = _CANVAS.height * 1000

    @property
    def size(self) -> CanvasSize:
        """Size of the canvas."""
        return CanvasSize(self.width / 1000, self.height / 1000)


def _type_of(name: str) -> Any:
    """Returns the type of a setting in a request: as in `RunSpec`, but a page names no file of this machine."""
    options = CONTROLS[name].options
    return Literal[tuple(options)] if options else RunSpec.model_fields[name].rebuild_annotation()


_TYPED: dict[str, Any] = {name: (_type_of(name), RunSpec.model_fields[name].default) for name in SETTINGS}
_Settings: Any = create_model("_Settings", __base__=(KeptRequest, CanvasSides), **_TYPED)


class PaintingRequest(_Settings):  # type: ignore[misc]  # made from `RunSpec`
    """Request for a plan: goals, goals of the start, sides of the canvas in mm, the settings of the form, a variant."""

    _name, _key, _file = "what a person asked for", "wish", "wish.json"

    title: Annotated[str, BeforeValidator(tidy), StringConstraints(max_length=80)] = ""
    variant: Annotated[str, StringConstraints(max_length=60)] = ""
    terms: tuple[GoalRequest, ...] = Field((), max_length=8)
    initial: tuple[GoalRequest, ...] = Field((), max_length=2)

    @model_validator(mode="before")
    @classmethod
    def _without_blanks(cls, given: Any) -> Any:
        """Returns the given fields of the form, without settings of 0.3 that are fixed now."""
        if not isinstance(given, dict):
            return given
        return {name: value for name, value in without_former(given).items() if value != ""}

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        if not self.terms and not self.together:
            raise ValueError("There is nothing to paint yet: give a picture, or words, or draw something.")
        for name, _ in brush_shares(self.brushes) if self.brushes else ():
            _require_brush(name)
        if self.variant not in ("", *VARIANTS):
            raise ValueError(f"There is no variant {self.variant!r} of a plan; choose {', '.join(VARIANTS)} or none.")
        if not 1 / 4 <= self.width / self.height <= 4:
            raise ValueError("The canvas is too narrow: its longer side is at most four times the shorter one.")
        return self

    @property
    def pictures(self) -> frozenset[str]:
        """Ids of the needed pictures."""
        return pictures_of(*self.terms, *self.initial)

    def goals(self, pictures: Path) -> dict[str, Any]:
        """Returns the goals in the form of RunSpec; `pictures` as in GoalRequest.item."""
        return goal_items(pictures, self.terms, self.initial)

    def spec(self, easel: WebAppEasel, pictures: Path, families: Path) -> RunSpec:
        """Returns the description of the requested painting at an easel. Raises ConfigError.

        pictures: as in GoalRequest.item.
        families: folder of the taught stroke families.
        """
        wanted = {name: getattr(self, name) for name in SETTINGS} | self.goals(pictures) | easel.settings
        # The page chose the canvas in the picture's proportions, or the person another one.
        wanted |= {"title": self.title or "Untitled", "canvas": self.size, "fit": "crop"}
        wanted["colors"] = min(self.colors, self.strokes)
        wanted["replans"] = min(self.replans, self.strokes - 1) if easel.has_camera else 0
        if self.strokes_of:
            known = dict.fromkeys(registry.parts(registry.STROKE_FAMILIES)) | find_families(families)
            shares = family_shares(self.strokes_of)
            for name in (name for name, _ in shares if name not in known):
                named = ", ".join(known)
                raise ConfigError(f"There is no stroke family {name[:60]!r}; choose one of {named}, or teach it.")
            wanted["strokes_of"] = ",".join(f"{known[name] or name}:{100 * share:g}%" for name, share in shares)
        spec = RunSpec.of(**wanted, calibration=easel.known)
        own = {name for name in SETTINGS if getattr(self, name) not in USUAL_VALUES[name]}
        return variant_of(spec, self.variant, own)

    def variants(self) -> list[Self]:
        """Returns a request for each variant. Raises ConfigError."""
        if self.together:
            raise ConfigError("A drawing without a goal has no variants; set a goal, or draw together.")
        return [self.model_copy(update={"variant": name}) for name in VARIANTS]


def find_families(folder: Path) -> dict[str, Path]:
    """Returns the files of the stroke families that were taught in a studio, by name."""
    return {file.stem: file for file in storage.list_files(folder, "*.safetensors")}


FAMILIES = "families"
"""Name of the folder of taught stroke families in the studio's folder."""
PICTURES = "pictures"
"""Name of the folder of uploaded pictures in the studio's folder."""
MAKING_SUFFIX = ".making.json"
"""End of the name of a file that records how the picture of the same name was made from words."""
_PLACES = {LIVE: LIVE, REGIONS: REGIONS, "painting": ".", "sketchbook": "sketchbook"}
_SHOWN = re.compile(r"[a-z][a-z0-9-]{0,60}\.(png|jpg|mp4|json|svg|csv|gcode|html)")
_MAX_PLANS = 24
_A_MOMENT = 1.0  # seconds
_LOCKS = ".workers"
_LONGEST_JOB = 20
PLAN_JOB, PAINT_JOB, RESUME_JOB = "plan", "paint", "resume"
"""Jobs of the painter; while it plans, no robot moves."""
QueuedJob = Literal["plan", "paint"]
"""Job that waits in the studio's queue."""


@dataclass(frozen=True)
class PlanFolder:
    """Files of one plan of a painting: its request, the plan and its pictures."""

    path: Path

    @property
    def number(self) -> int:
        """Number of the plan, from 1."""
        return int(self.path.name)

    @property
    def plan(self) -> Path:
        """File of the plan."""
        return self.path / "plan.json"

    @property
    def settings(self) -> Path:
        """File of the settings with which the plan is painted; hidden, because it names files of this machine."""
        return self.path / ".settings.json"

    def request(self) -> PaintingRequest:
        """Returns the request of the plan. Raises StorageError."""
        return PaintingRequest.load(self.path)


class _Inside:
    """Path inside the folder of a painting, as an attribute of `PaintingFolder`."""

    def __init__(self, *parts: str) -> None:
        self._parts = parts

    def __get__(self, folder: "PaintingFolder", kind: type | None = None) -> Path:
        return folder.path.joinpath(*self._parts)


@dataclass(frozen=True)
class PaintingFolder:
    """Folder of one painting, or of a job."""

    path: Path

    feed = _Inside(FEED_FILE)
    """File of the events, one per line; written by the worker."""
    easel = _Inside("easel")
    """Folder of a simulated robot's lock, because each painting has its own simulated robot."""
    stop = _Inside("stop")
    """File that stops the worker when it exists."""

    @property
    def is_of_terminal(self) -> bool:
        """True if the painting was begun at the terminal: this is its folder."""
        return (self.path / JOURNAL).is_file()

    @property
    def painting(self) -> Path:
        """Folder of the painting, as on the command line: plan, journal, photographs, film, page."""
        return self.path if self.is_of_terminal else self.path / "painting"

    @property
    def robot_stop(self) -> Path:
        """File that makes the robot's process stop the robot, independent of the worker."""
        return self.painting / STOP_FILE

    @property
    def camera(self) -> Path:
        """Current picture of a live camera, written by the easel's process."""
        return self.painting / LIVE_PICTURE

    @property
    def pictures(self) -> Path:
        """Folder of the studio's uploaded pictures, which are named by their ids."""
        return self.path.parent / PICTURES

    @property
    def families(self) -> Path:
        """Folder of the studio's taught stroke families."""
        return self.path.parent / FAMILIES

    def stop_now(self) -> None:
        """Stops all work on this painting. Raises OSError."""
        if self.painting.is_dir() and find_job(self) != PLAN_JOB:  # the robot has its own process
            self.robot_stop.touch()
        self.stop.touch()

    def plans(self) -> list[PlanFolder]:
        """Returns all plans, finished or not, in order."""
        found = (entry for entry in (self.path / "plans").glob("*") if entry.name.isdecimal())
        return sorted(map(PlanFolder, found), key=lambda folder: folder.number)

    def plan(self, number: int) -> PlanFolder:
        """Returns the folder of plan `number`, which need not exist."""
        return PlanFolder(self.path / "plans" / str(number))

    def begin_plans(self, requests: Sequence[PaintingRequest], pictures: Path) -> list[PlanFolder]:
        """Makes the folders of new plans, each with its request and copies of its `pictures`. Raises StorageError."""
        made = max((folder.number for folder in self.plans()), default=0)
        if made + len(requests) > _MAX_PLANS:
            raise StorageError(f"There are {made} plans of at most {_MAX_PLANS}; choose one, or begin a new painting.")
        plans = [self.plan(number) for number, _ in enumerate(requests, made + 1)]
        for plan, request in zip(plans, requests, strict=True):
            storage.new_folder(plan.path)
            copy_pictures(request.pictures, pictures, plan.path)
            request.keep(plan.path)
        return plans

    def find_shown(self, place: str, name: str) -> Path | None:
        """Returns the file `name` of a place; None if it may not be shown.

        place: "live", "regions", "painting", "sketchbook", or a plan's number.
        """
        if self.is_of_terminal and (place, name) == ("0", "plan.jpg"):
            place, name = "painting", "plan.png"
        if not (place in _PLACES or re.fullmatch(r"[1-9]\d?", place)) or not _SHOWN.fullmatch(name):
            return None
        of_job = place == LIVE and not (self.painting / LIVE).is_dir()
        inside = self.path if of_job else self.painting
        folder = self.plan(int(place)).path if place.isdecimal() else inside / _PLACES[place]
        path = (folder / name).resolve()
        return path if path.is_file() and path.is_relative_to(self.path.resolve()) else None


def copy_pictures(names: Set[str], pictures: Path, folder: Path) -> None:
    """Copies uploaded pictures, and the records of their makings, from `pictures` into a folder. Raises StorageError.

    names: their ids.
    """
    for file in (f"{name}{suffix}" for name in names for suffix in (".png", MAKING_SUFFIX)):
        if file.endswith(".png") or (pictures / file).is_file():
            storage.copy(pictures / file, folder / file, "a picture of this goal", storage.MAX_BYTES)


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


class WorkerLock:
    """Lock of the one process that works on a painting; it is free when that process ends for any reason.

    Its file lies in the studio's folder and not in the painting's own: the lock holds, and is seen, even after the
    painting's folder was deleted.

    The parent takes the lock and hands it to the worker, so that there is no moment without it.
    """

    def __init__(self, folder: PaintingFolder) -> None:
        self._folder, place = folder, _lock_file(folder)
        place.parent.mkdir(mode=0o700, exist_ok=True)
        self._file = locks.open_lock(place)

    def take(self) -> bool:
        """Takes the lock; returns True if it was free, and if no terminal is at work on the painting.

        It waits a moment for processes that only check the lock.
        """
        taken = self.try_once(_A_MOMENT) and not _is_painted(self._folder)
        if taken:
            self.sign("")  # the job of the worker before
        return taken

    def try_once(self, seconds: float = 0.0) -> bool:
        """Takes the lock; returns True if it came free in time and its painting was not deleted meanwhile."""
        return locks.take(self._file, seconds) and os.fstat(self._file).st_nlink > 0

    def sign(self, job: str) -> None:
        """Writes the job into the file of this lock, for `find_job`."""
        with contextlib.suppress(OSError):  # a full disk: the lock holds without it
            os.ftruncate(self._file, 0)
            write_at(self._file, job.encode(), 0)

    def fileno(self) -> int:
        """Returns the descriptor for a child process that is to hold the lock too."""
        return self._file

    def hand(self, process: "subprocess.Popen[bytes]") -> None:
        """Leaves the lock to a process that has inherited it."""
        locks.Held(self._file).hand(process)

    def release(self) -> None:
        """Releases the lock of this process; a child that holds it too keeps it until its end."""
        os.close(self._file)  # closed, not unlocked, because unlocking would take it from the child too


def _lock_file(folder: PaintingFolder) -> Path:
    return folder.path.parent / _LOCKS / folder.path.name


def forget_lock(folder: PaintingFolder) -> None:
    """Removes the lock file of a deleted painting."""
    _lock_file(folder).unlink(missing_ok=True)


def find_job(folder: PaintingFolder) -> str:
    """Returns the job of the worker here, "" if it is not known, or if it or a terminal paints. Old ones have none."""
    try:
        return "" if _is_painted(folder) else _lock_file(folder).read_bytes()[:_LONGEST_JOB].decode(errors="replace")
    except OSError:
        return ""


def find_work(root: Path) -> list[PaintingFolder]:
    """Returns all folders of a studio on which a worker or a terminal is at work, also deleted ones. Raises OSError.

    A folder at which nobody can look counts as one: a stop must reach all others too.
    """
    names = {each.name for each in (root / _LOCKS).iterdir()} if (root / _LOCKS).is_dir() else set()
    names |= {journal.parent.name for journal in root.glob(f"*/{JOURNAL}")}
    return [folder for name in sorted(names) if _may_work(folder := PaintingFolder(root / name))]


def _may_work(folder: PaintingFolder) -> bool:
    try:
        return working(folder)
    except OSError:
        return True


def working(folder: PaintingFolder) -> bool:
    """Returns True if a worker or a terminal is at work on the painting."""
    return locks.is_held(_lock_file(folder)) or _is_painted(folder)


def _is_painted(folder: PaintingFolder) -> bool:
    """Returns True if a process, whoever started it, holds the journal of the painting."""
    return locks.is_held(folder.painting / JOURNAL)


def tell_once(folder: PaintingFolder, event: Event) -> None:
    """Writes one event for the page."""
    feed = Feed(folder.path)
    feed.tell(event)
    feed.close()


def read_events(log: LogReader) -> Iterator[tuple[Event, datetime | None]]:
    """Yields the new events of a feed or a journal in order, each with the time at which it was written, if any."""
    for line in log.stream():
        with contextlib.suppress(ValueError, KeyError, TypeError):
            for event in events_of(line):
                yield event, time_of(line)
