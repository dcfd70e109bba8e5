"""Pictures of the canvas that people take, for paintings without a camera: the folder `looks` of a painting.

A picture that is put there, with any program or by `frida-painter look`, counts as a look. It waits there until the
painter takes it between two strokes, and then goes on to `looks/used` or `looks/refused`.
"""

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.weights import load_models_of
from frida_painter.calibration import Corners
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import JOURNAL
from frida_painter.errors import CalibrationError, ConfigError, FrameRejected, ImageError, StorageError
from frida_painter.perception.snapshot import Snapshot, find_corners, read_snapshot
from frida_painter.session import resuming
from frida_painter.session.events import Notify, Remark, StrokeLeftOut, StrokePainted, events_of, time_of
from frida_painter.session.fold import PaintingState
from frida_painter.session.open_loop import bare_paper
from frida_painter.system import images, picture_file, storage
from frida_painter.system.event_log import EventLog

if TYPE_CHECKING:
    from frida_painter.session.loop import PaintingSession

LOOKS = "looks"
USED, REFUSED = "used", "refused"
_BETWEEN, _STILL = 0.5, 0.3  # seconds between two looks into the folder; age of a file that is written no more


@dataclass(frozen=True)
class GivenPicture:
    """Picture that waits to be taken for a look.

    corners: of the canvas, as a person pointed at them; None if they are still to be found
    """

    path: Path
    corners: Corners | None = None

    def load(self) -> NDArray[np.uint8]:
        """Returns the picture [H, W, 3], upright. Raises ImageError."""
        return images.to_uint8(images.load(self.path))

    def read(self, canvas: CanvasSize, ground: tuple[float, float, float], expected: Tensor) -> Snapshot:
        """Returns the canvas in the picture, if it looks as expected [3, H, W].

        ground: colour (sRGB) below the strokes
        Raises FrameRejected and CalibrationError if it is another canvas or cannot be found, ImageError.
        """
        photograph = self.load()
        corners = self.corners or find_corners(photograph, canvas)
        return read_snapshot(photograph, corners, canvas, bare_paper(canvas, ground), expected)

    def look(self, session: "PaintingSession", journal: Path) -> None:
        """Takes the picture for a look at the canvas, and has the rest planned again.

        Raises ConfigError before the first plan, FrameRejected and CalibrationError, with the reason, if it does not
        show this canvas, and ImageError.
        """
        planner = session.planner
        if session.open_loop is None or session.so_far is None:
            raise ConfigError("Nothing is painted yet; give a picture when there is something to see on the canvas.")
        done = self.count_strokes(journal, session.so_far.painted)
        seen = self.read(planner.size, planner.ground, session.open_loop.expect(done))
        session.open_loop.look_at(seen.canvas, done)

    def count_strokes(self, journal: Path, painted: int) -> int:
        """Returns the number of strokes on the canvas when the picture was taken, by its own date.

        painted: number of strokes now, for a picture without a date
        Raises ImageError.
        """
        taken = picture_file.exposure_time(self.path)
        if taken is None:
            return painted
        done = 0
        for record in EventLog.read(journal):
            if (at := time_of(record)) is not None and at.timestamp() <= taken:
                painted_or_not = [one for one in events_of(record) if isinstance(one, StrokePainted | StrokeLeftOut)]
                done = max([done, *(event.done for event in painted_or_not)])
        return min(done, painted)


class LookFolder:
    """Folder `looks` of one painting."""

    def __init__(self, painting: Path) -> None:
        self.path = painting / LOOKS
        self._next = 0.0
        self._stays = set[tuple[Path, int]]()  # pictures that could not be moved, with their times

    def take_next(self) -> GivenPicture | None:
        """Returns the picture that waits longest; None if there is none. Looks every half second at most."""
        now = time.monotonic()
        if now < self._next:
            return None
        self._next = now + _BETWEEN
        with contextlib.suppress(OSError):
            files = [file for file in self.path.iterdir() if file.suffix.lower() in picture_file.SUFFIXES]
            files = [file for file in files if (file, file.stat().st_mtime_ns) not in self._stays]
            ages = {file: time.time() - file.stat().st_mtime for file in files if file.name[0] != "."}
            waiting = sorted((file for file, age in ages.items() if not 0 <= age < _STILL), key=lambda one: -ages[one])
            if waiting:
                return GivenPicture(waiting[0], _read_corners(waiting[0]))
        return None

    def take(self, look: Callable[[GivenPicture], None], notify: Notify) -> None:
        """Has a `look` taken at the picture that waits longest, if any; tells why it does not count."""
        if (given := self.take_next()) is None:
            return
        try:
            look(given)
        except (ImageError, CalibrationError, FrameRejected) as refusal:
            self.file_away(given, REFUSED)
            notify(Remark(f"{given.path.name} does not count as a look. {refusal}"))
        else:
            self.file_away(given, USED)

    def put(self, picture: Path, corners: Corners | None) -> Path:
        """Copies a picture into the folder, with the corners that a person pointed at; returns the copy.

        Raises StorageError.
        """
        copy = storage.find_unused(self.path / storage.file_name(f"{time.strftime('%Y%m%d-%H%M%S')}-{picture.name}"))
        if corners is not None:
            storage.write_json(_corners_file(copy), {"corners": [list(corner) for corner in corners]})
        storage.copy(picture, copy, "a picture of the canvas", storage.MAX_BYTES)
        return copy

    def file_away(self, given: GivenPicture, where: str) -> None:
        """Moves a picture to `used` or `refused`, beside others of its name; one that stays is not taken again."""
        with contextlib.suppress(OSError):
            self._stays.add(known := (given.path, given.path.stat().st_mtime_ns))
            (self.path / where).mkdir(exist_ok=True)
            corners = _corners_file(given.path)
            for file in (given.path, *([corners] if corners.exists() else [])):
                file.rename(storage.find_unused(self.path / where / file.name))
            self._stays.remove(known)


def is_finished(folder: Path) -> bool:
    """Returns True if the painting in `folder` is complete; a painter may be at work. Raises StorageError."""
    return PaintingState.of_journal(EventLog.read(folder / JOURNAL), folder).end.finished


def check_picture(folder: Path, given: GivenPicture) -> Snapshot:
    """Returns the canvas in a picture, if it is the one of the painting in `folder`; no painter need be at work.

    Raises ConfigError if the painting has no strokes yet, FrameRejected and CalibrationError if it is another canvas
    or cannot be found, ImageError, StorageError and PlanError.
    """
    history = PaintingState.of_journal(EventLog.read(folder / JOURNAL), folder)
    kept = resuming.load_kept_plan(folder, history)
    if kept is None or not history.progress.painted:
        raise ConfigError(
            f"{storage.abridge(folder)} has no strokes yet; give a picture when there is something to see."
        )
    done = given.count_strokes(folder / JOURNAL, history.progress.painted)
    plan = kept.plan
    _, expected = resuming.resume_open_loop(folder, kept, done, history.progress.left_out, load_models_of(plan))
    return given.read(plan.canvas, plan.ground, expected)


def _corners_file(picture: Path) -> Path:
    return picture.with_name(f"{picture.name}.corners.json")


def _read_corners(picture: Path) -> Corners | None:
    """Returns the corners beside a picture; None if there are none that can be read."""
    try:
        told = storage.read_json(_corners_file(picture), "the corners of a canvas")["corners"]
        corners = tuple((float(column), float(row)) for column, row in told)
    except (StorageError, KeyError, TypeError, ValueError):
        return None
    return corners if len(corners) == 4 else None
