"""The eye of the painter: photographs of the easel become pictures of the canvas, straight on and in true colours."""

import contextlib
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.errors import CameraError, FrameRejected, StaleFrame
from frida_painter.frames import PixelGrid
from frida_painter.hardware.camera import Camera, Frame
from frida_painter.hardware.easel import Easel
from frida_painter.perception.color import true_color
from frida_painter.perception.film_view import FilmView
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.frame_check import Expected, FrameCheck
from frida_painter.perception.rectify import rectify
from frida_painter.session.canvas_start import CanvasStart
from frida_painter.session.events import Notify, StrokePainted, TimelapseFrame

PHOTOGRAPH_ROWS = 864
"""Height in pixels of the canvas in a look by which something is decided."""
TIMELAPSE_ROWS = 540
_ATTEMPTS = 3
_BETWEEN = 0.5  # seconds before a frame that was refused is taken again: a hand goes away


class Photographer:
    """Asks a camera until it gives a photograph that is newer than all before it."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._last_sequence = -1

    def photograph(self, last_motion: float) -> Frame:
        """A photograph taken after `last_motion` (s of the robot's clock), never one that was seen before.

        It is tried three times. Raises StaleFrame, or whatever else the camera complained of last.
        """
        trouble: CameraError | None = None
        for _ in range(_ATTEMPTS):
            trouble = None
            try:
                frame = self._camera.capture(last_motion)
            except StaleFrame:
                continue
            except CameraError as complaint:
                trouble = complaint
                continue
            if frame.captured_at > last_motion and frame.sequence > self._last_sequence:
                self._last_sequence = frame.sequence
                return frame
        raise trouble or StaleFrame(
            f"The camera was asked {_ATTEMPTS} times and gave no new photograph taken after the arm's last motion "
            f"(at {last_motion:.1f} s). Look whether the camera is still connected, then start again."
        )


class CanvasObserver:
    """Looks at the canvas of an easel.

    The first look teaches it the `light` of the room, unless that is known from before, as `start` says, and what
    a `good` photograph is like. wait: lets seconds pass.
    """

    def __init__(
        self,
        easel: Easel,
        start: CanvasStart | None = None,
        light: FlatField | None = None,
        *,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self.easel = easel
        self._start = start or CanvasStart()
        self.light = light
        self.good: FrameCheck | None = None
        self._wait = wait
        self._photographer = Photographer(easel.camera)
        self._last_image: NDArray[np.uint8] | None = None
        self._film_view: FilmView | None = None

    def look(self, last_motion: float, rows: int) -> Tensor:
        """The canvas [3, rows, columns] in sRGB as it is after `last_motion` (s of the robot's clock), to be shown.

        Raises CameraError where the camera gives no photograph newer than that, or none of the canvas.
        """
        return self.see(self.photograph(last_motion).image, rows)

    def film(self, photograph: NDArray[np.uint8], rows: int) -> Tensor:
        """The canvas in a photograph for the film, by which nothing may be decided: within 1/255 of `see`, but sooner.

        Raises FrameRejected as `see` does.
        """
        calibration = self.easel.calibration
        if self.light is None:  # `see` learns it
            return self.see(photograph, rows)
        grid = PixelGrid.of_height(self.easel.canvas, rows)
        if self._film_view is None or not self._film_view.fits(calibration, self.light, grid):
            self._film_view = FilmView(calibration, self.light, grid)
        return self._film_view.picture(photograph)

    def examine(
        self, last_motion: float, rows: int, expected: Expected | None = None, *, doubtful: bool = False
    ) -> tuple[Frame, Tensor]:
        """A look by which something is decided: the photograph is taken again until it may be trusted.

        expected: what should be seen, None where that is not known; doubtful: whether a photograph is trusted in which
        nothing tells where the canvas lies, because a person has looked. On a simulated easel that nobody can look at
        the third such one is. Raises FrameRejected, with the reason, where the third photograph may not be trusted
        either (FrameDoubtful where a person has to look), and CameraError as `look` does.
        """
        for attempt in range(1, _ATTEMPTS + 1):
            frame = self.photograph(last_motion)
            trusting = doubtful or (self.easel.simulated and attempt == _ATTEMPTS)
            try:
                canvas = self.see(frame.image, rows)
                self._require_good(frame.image, canvas, expected, doubtful=trusting)
            except (FrameRejected, StaleFrame):
                if attempt == _ATTEMPTS:
                    raise
                self._wait(_BETWEEN)
            else:
                self._last_image = frame.image
                return frame, canvas
        raise AssertionError("the last attempt returns or raises")

    def see(self, photograph: NDArray[np.uint8], rows: int) -> Tensor:
        """The canvas [3, rows, columns] in a photograph [H, W, 3]. Raises FrameRejected."""
        grid = PixelGrid.of_height(self.easel.canvas, rows)
        picture = rectify(photograph, self.easel.calibration, grid)
        if self.light is None:
            self.light = self._start.light(photograph, picture, self.easel)
        return true_color(self.light.correct(picture), self.easel.calibration)

    def learn_good(self, photograph: NDArray[np.uint8], last: NDArray[np.uint8] | None = None) -> None:
        """From now on photographs are compared with these: an earlier run took this one first, and `last` last."""
        self.good = FrameCheck.learn(photograph, self.easel.calibration, self.easel.canvas, last)

    def photograph(self, last_motion: float) -> Frame:
        """A photograph taken after the last motion, never one that was seen before; tried three times.

        Raises StaleFrame, or whatever else the camera complained of last.
        """
        return self._photographer.photograph(last_motion)

    def _require_good(
        self, photograph: NDArray[np.uint8], canvas: Tensor, expected: Expected | None, *, doubtful: bool
    ) -> None:
        if self.good is None:
            self.learn_good(photograph)
            return
        frozen = self._last_image is not None and np.array_equal(photograph, self._last_image)
        if frozen and expected is not None and expected.changes(self.easel.canvas):
            raise StaleFrame(
                "The camera gave the very same photograph as before, byte for byte, although strokes were painted "
                "since. Look whether it still works, and start it again."
            )
        self.good = self.good.require(photograph, canvas, expected, doubtful=doubtful)


_PATIENCE = 8  # strokes after a frame's turn, for which the hand leaves the canvas though it still has paint


@dataclass(frozen=True)
class Timelapse:
    """Timelapse frames: pictures for the film, taken evenly over a painting, by which nothing is decided.

    frames: how many the film gets at most.
    """

    frames: int = 0

    def due(self, done: int, of: int) -> int:
        """How many frames the film has after stroke `done` of `of`, if each is taken in its turn."""
        return done * self.frames // of if of else 0

    def wants_frame(self, done: int, of: int, taken: int, *, leaves: bool) -> bool:
        """Whether the film gets a frame after stroke `done` of `of`, so many having been due when the last was taken.

        A frame costs the way aside and back. So it waits until the hand `leaves` the canvas anyway, for paint or for a
        look, but no longer than until the turn of the next one, or eight strokes where turns are closer; a frame whose
        turn passes meanwhile is left out.
        """
        if self.due(done, of) <= taken:
            return False
        turn = -(-(taken + 1) * of // self.frames)
        return leaves or (self.due(done + 1, of) > taken + 1 and done + 1 - turn >= _PATIENCE)


class FrameDeveloper:
    """Makes timelapse frames of photographs in a thread of its own, while the robot paints on; in a `with` block.

    One photograph is in hand at a time. `notify` hears of its frame, in the thread that takes photographs, when the
    next one is taken, when it is waited for, or when the block ends.
    """

    def __init__(self, observer: CanvasObserver, notify: Notify) -> None:
        self._observer, self._notify = observer, notify
        self._thread = ThreadPoolExecutor(1, "timelapse")
        self._in_hand: tuple[StrokePainted, Future[Tensor]] | None = None

    def take(self, painted: StrokePainted, last_motion: float) -> None:
        """Photographs the canvas after a stroke, the arm having moved aside by `last_motion`, if the camera can."""
        with contextlib.suppress(CameraError):
            photograph = self._observer.photograph(last_motion).image
            self.wait()
            self._in_hand = painted, self._thread.submit(self._observer.film, photograph, TIMELAPSE_ROWS)

    def wait(self) -> None:
        """Until the frame in hand is made and told of; one in which the canvas is not to be seen is left out."""
        if self._in_hand is not None:
            (painted, frame), self._in_hand = self._in_hand, None
            with contextlib.suppress(CameraError):
                self._notify(TimelapseFrame(frame.result(), painted.done, painted.of, painted.color))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.wait()
        finally:
            self._thread.shutdown()
