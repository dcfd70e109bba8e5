"""The film of the arm at work: it begins at leisure and goes faster and faster, and the canvas grows.

Pictures are drawn and encoded in a thread of their own, for OpenGL belongs to one thread, and so that
the arm need not wait. Whoever moves the arm hands over what was seen, as plain arrays.
"""

import queue
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import FridaError
from frida_painter.virtual.arm import Course
from frida_painter.virtual.paint import BANDS, to_srgb
from frida_painter.virtual.sawyer.inset import Inset
from frida_painter.virtual.sawyer.reel import Reel
from frida_painter.virtual.sawyer.surroundings import CANVAS_PIXELS, Surroundings, fill
from frida_painter.virtual.sawyer.view import ArmView
from frida_painter.virtual.table import Table

_ROWS, _COLUMNS = 540, 960
# Seconds of work from picture to picture at first, for so many pictures, and how that grows from then on.
_AT_LEISURE, _PICTURES, _GROWTH = 0.25, 96, 1.02
_WAITING = 4  # pictures that may be waiting to be drawn
_HELD_UP = 6.0  # so many times longer than it takes may a motion be held up by its pictures; others are left out
_CLEAN = np.array([0.78, 0.66, 0.48])  # sRGB of bristles without paint
_DRY = 0.5  # microlitres: a brush with less looks clean
_MM = 1000.0


@dataclass(frozen=True)
class Moment:
    """What is in one picture: the joints' angles [7], the canvas [n, n, 3], paint of brush and wells, sRGB."""

    angles: NDArray[np.float64]
    canvas: NDArray[np.uint8]
    bristles: NDArray[np.float64]
    wells: tuple[NDArray[np.float64], ...]


class ArmFilm:
    """Films an arm: `open` before it moves, `watch` its motions, `close`. What goes wrong never stops the arm.

    path: of the film, which is there after `close` if there was OpenGL, disk and a motion to see; where a
    film was begun there, it goes on. surroundings, table: what the arm stands before. Raises ConfigError where
    the arm's meshes cannot be used.
    """

    def __init__(self, path: Path, surroundings: Surroundings, table: Table) -> None:
        self._path, self._table = path, table
        self._model = surroundings.model()
        self._inset = Inset(surroundings.canvas, _ROWS, _COLUMNS)
        self._moments: queue.Queue[Moment | None] = queue.Queue(_WAITING)
        self._now, self._next, self._count = 0.0, 0.0, 0
        self._canvas = self._look()
        self._angles: NDArray[np.float64] | None = None  # of the joints now
        self._thread: threading.Thread | None = None
        self._ready, self._over = threading.Event(), threading.Event()

    def open(self) -> None:
        """Has everything drawn that is needed, so that nothing holds up the arm, or a stop, once it moves."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._shoot, name="film of the arm", daemon=True)
            self._thread.start()
            self._ready.wait()

    def watch(self, course: Course) -> None:
        """Sees a motion that has just been made, with what it left on the canvas."""
        began, self._now = self._now, self._now + course.seconds
        self._angles = None if course.angles is None else course.angles[-1]
        if course.angles is None or self._thread is None or self._next > self._now or self._over.is_set():
            return
        before, self._canvas = self._canvas, self._look()
        period = course.seconds / max(1, len(course.angles) - 1)
        latest = time.monotonic() + _HELD_UP * (1 + course.seconds)
        while self._next <= self._now and not self._over.is_set():
            index = min(len(course.angles) - 1, round((self._next - began) / period)) if period else 0
            canvas = self._in_between(before, self._canvas, course.places[: index + 1])
            self._hand_over(Moment(course.angles[index], canvas, self._bristles(), self._wells()), latest)
            self._next += _AT_LEISURE * _GROWTH ** max(0, self._count - _PICTURES)
            self._count += 1

    def close(self) -> None:
        """Ends the film after what was seen so far, with a picture of how it is now."""
        if self._thread is not None and self._thread.is_alive():
            if self._angles is not None:
                now = Moment(self._angles, self._look(), self._bristles(), self._wells())
                self._hand_over(now, time.monotonic() + _HELD_UP)
            self._moments.put(None)
            self._thread.join()
        self._over.set()

    def _hand_over(self, moment: Moment, latest: float) -> None:
        """Waits for room until then (by the monotonic clock); afterwards the picture is left out."""
        while not self._over.is_set():
            try:
                self._moments.put(moment, timeout=min(0.2, max(0.0, latest - time.monotonic())))
            except queue.Full:
                if time.monotonic() < latest:
                    continue
            return

    def _shoot(self) -> None:
        """Draws and encodes until there is nothing more to come."""
        try:
            self._draw_all()
        except FridaError:
            pass  # The painting is what counts; that a film is not there is seen by its absence.
        finally:
            self._over.set()
            self._ready.set()

    def _draw_all(self) -> None:
        model = self._model
        pixels = np.empty((_ROWS, _COLUMNS, 3), np.uint8)
        with ArmView(model, _ROWS, _COLUMNS) as view:
            reel = Reel(self._path, pixels)
            self._count = reel.count
            shown: NDArray[np.uint8] | None = None
            filled = 0
            view.draw(model.key("neutral").qpos)
            self._ready.set()
            while (moment := self._moments.get()) is not None:
                for well in range(filled, len(moment.wells)):
                    fill(model, well)
                filled = max(filled, len(moment.wells))
                for well, color in enumerate(moment.wells):
                    view.tint(f"well {well}", color)
                view.tint("bristles", moment.bristles)
                if shown is not moment.canvas:
                    view.lay_canvas(moment.canvas)
                    shown = moment.canvas
                pixels[:] = view.draw(moment.angles)
                self._inset.hang(moment.canvas, pixels)
                reel.send()
            reel.finish()

    def _look(self) -> NDArray[np.uint8]:
        """The canvas as it is, [n, n, 3] sRGB, its first row at the lower edge."""
        seen = np.asarray(to_srgb(self._table.canvas.reflectance()) * 255 + 0.5, np.uint8)
        return np.asarray(cv2.resize(seen, (CANVAS_PIXELS, CANVAS_PIXELS), interpolation=cv2.INTER_AREA), np.uint8)

    def _in_between(
        self, before: NDArray[np.uint8], after: NDArray[np.uint8], places: NDArray[np.float64]
    ) -> NDArray[np.uint8]:
        """The canvas while the brush is on its way: as after the motion where the brush has been."""
        canvas, tuft = self._table.canvas, self._table.tuft
        on_canvas = self._table.on_canvas(places)
        touching = on_canvas[:, 2] > 0
        if not touching.any():
            return before
        if not touching[-1]:
            return after
        pixels = on_canvas[touching, :2] / (canvas.width, canvas.height) * CANVAS_PIXELS
        mask = np.zeros(before.shape[:2], np.uint8)
        reach = round((tuft.brush.hard_radius + 1) / canvas.width * CANVAS_PIXELS)
        cv2.polylines(mask, [pixels.round().astype(np.int32)], False, 255, 2 * reach)
        return np.where(mask[..., None] > 0, after, before)

    def _bristles(self) -> NDArray[np.float64]:
        tuft = self._table.tuft
        if tuft.volume < _DRY:
            return _CLEAN
        return _masstone(tuft.pigment.sum(0) / tuft.volume)

    def _wells(self) -> tuple[NDArray[np.float64], ...]:
        return tuple(_masstone(paint) for paint in self._table.paints)


def _masstone(paint: NDArray[np.float64]) -> NDArray[np.float64]:
    """sRGB [3] of a paint (K, S of each band) where it is thick."""
    ratio = paint[:BANDS] / paint[BANDS:]
    return to_srgb(1 + ratio - np.sqrt(ratio**2 + 2 * ratio))
