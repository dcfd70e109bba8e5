"""The eye of the painter: photographs of the easel become pictures of the canvas, straight on and in true colours."""

import contextlib
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.errors import CameraError, ConfigError, FrameRejected, StaleFrame
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import Camera, Frame
from frida_painter.palette import to_lab
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import Color, FlatField, is_evenly, light_by_margin, share_unlike
from frida_painter.perception.frame_check import Expected, FrameCheck
from frida_painter.perception.rectify import rectify, require_photograph, require_some_light, sampling_places
from frida_painter.perception.srgb import light_of_bytes, to_srgb
from frida_painter.plan import WHITE
from frida_painter.session.events import Notify, StrokePainted, TimelapseFrame

# What a painting begins on: a bare canvas, one that was toned, or whatever is there where a person wants that.

TOLERANCE = 20.0
"""CIELAB within which a canvas that a person has toned by hand has the ground that was wanted."""

_SURE = 5.0  # CIELAB within which the camera knows a colour


def has_ground(canvas: Tensor, ground: Color) -> bool:
    """Whether the canvas [3, H, W] has that ground (sRGB), and is not white paper, to which a pale ground is near."""
    from_white = float((to_lab(torch.tensor(ground)) - to_lab(torch.tensor(WHITE))).norm())
    return is_evenly(canvas, ground, min(TOLERANCE, max(_SURE, from_white / 2)))


def _never(sentence: str, canvas: Tensor) -> bool:
    return False


@dataclass(frozen=True)
class CanvasStart:
    """How a painting may begin.

    ground: sRGB in which the bare canvas is toned, or was toned already; on_canvas: whether it begins on what is on
    the canvas; paint_on: asked, with a sentence and the canvas [3, H, W], where something is on it and nobody said
    so.
    """

    ground: Color = WHITE
    on_canvas: bool = False
    paint_on: Callable[[str, Tensor], bool] = _never

    def light(self, photograph: NDArray[np.uint8], picture: Tensor, easel: Easel) -> FlatField:
        """What the light does, by the first photograph [H, W, 3] and the canvas in it [3, h, w], rectified.

        A bare canvas teaches it; with anything on the canvas, the margin and the last bare canvas do. Raises
        ConfigError where something is on the canvas and nobody wants it painted on, or nothing is although it
        should; CalibrationError where no bare canvas is known; FrameRejected.
        """
        record = easel.calibration
        if record.bare is None and not self.on_canvas:
            return FlatField.learn(picture, WHITE)
        try:
            light = light_by_margin(photograph, record, easel.canvas)
        except FrameRejected:
            if self.on_canvas:
                raise
            return FlatField.learn(picture, WHITE)
        canvas = true_color(light.correct(picture), record)
        if is_evenly(canvas, WHITE):
            if self.on_canvas:
                raise ConfigError(
                    "--on-canvas was given, and the canvas is bare; leave it out, or put up the canvas to paint on."
                )
            return FlatField.learn(picture, WHITE)
        if not (self.on_canvas or is_evenly(canvas, self.ground, TOLERANCE)):
            sentence = f"The canvas is not bare: {100 * share_unlike(canvas, WHITE):.0f} % of it is not white."
            if not self.paint_on(sentence, canvas):
                raise ConfigError(
                    f"{sentence} To paint on what is there, say --on-canvas; else put up a bare canvas. Where it "
                    "is bare, repeat the canvas calibration."
                )
        return light


# The canvas for the film: what `rectify`, `FlatField.correct` and `true_color` make of a photograph, in one pass.
#
# Nothing is decided by these pictures, so they need not be equal to the last bit. A film takes many of them
# through one camera: where each sample lies, and how bright the light is there, is computed once.

_TONES = 1 << 16  # of linear light; the coarsest step, in the dark, is 0.05 of one of 255


class FilmView:
    """Pictures of the canvas on a grid, seen by a calibrated camera in a light that is known."""

    def __init__(self, calibration: Calibration, light: FlatField, grid: PixelGrid) -> None:
        self.calibration, self.light, self.grid = calibration, light, grid
        self._column, self._row = sampling_places(calibration, grid)
        white = light.light(grid.rows, grid.columns).permute(1, 2, 0)  # [rows, columns, 3]
        self._brighter = np.ascontiguousarray((1 / white).numpy(), np.float32)
        self._affine = np.array(calibration.color, np.float32)  # [3, 4]
        self._light_of_byte = light_of_bytes(np.arange(256, dtype=np.uint8))[None]
        self._tones = to_srgb(torch.linspace(0, 1, _TONES)).numpy()

    def fits(self, calibration: Calibration, light: FlatField, grid: PixelGrid) -> bool:
        """Whether it was made for these."""
        return self.calibration is calibration and self.light is light and self.grid == grid

    def picture(self, photograph: NDArray[np.uint8]) -> Tensor:
        """The canvas [3, rows, columns], true sRGB in [0, 1], float32, in a photograph [H, W, 3] in sRGB bytes.

        It differs from `true_color(light.correct(rectify(...)))` by less than 1/255. Raises FrameRejected as
        `rectify` does.
        """
        require_photograph(photograph, self.calibration)
        light = np.asarray(cv2.LUT(photograph, self._light_of_byte), np.float32)
        require_some_light(light)
        seen = cv2.remap(light, self._column, self._row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        if seen.shape[:2] != (self.grid.rows, self.grid.columns):
            seen = cv2.resize(seen, (self.grid.columns, self.grid.rows), interpolation=cv2.INTER_AREA)
        even = np.asarray(seen, np.float32)
        np.clip(np.multiply(even, self._brighter, out=even), 0, 1, out=even)
        true = np.asarray(cv2.transform(even, self._affine), np.float32)
        np.clip(true, 0, 1, out=true)
        tones = self._tones[(true * (_TONES - 1) + 0.5).astype(np.uint16)]
        return torch.from_numpy(np.ascontiguousarray(tones.transpose(2, 0, 1)))


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
