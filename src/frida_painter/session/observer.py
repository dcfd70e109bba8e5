"""Observer: turns photographs of the easel into rectified pictures of the canvas in true colours."""

import contextlib
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.errors import CalibrationError, CameraError, ConfigError, FrameRejected, StaleFrame
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import Camera, Frame
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import Color, FlatField, is_evenly, light_by_margin, share_unlike
from frida_painter.perception.frame_check import Expected, FrameCheck
from frida_painter.perception.rectify import rectify, require_photograph, require_some_light, sampling_places
from frida_painter.registry import Later
from frida_painter.session.events import Notify, StrokePainted, TimelapseFrame
from frida_painter.strokes.palette import to_lab
from frida_painter.strokes.plan import WHITE
from frida_painter.system import images
from frida_painter.system.images import light_of_bytes, to_srgb

_find_camera_motion = Later("frida_painter.perception.markers:find_camera_motion")  # few tables have markers

# Start of a painting: on a bare canvas, on a toned one, or on a canvas with a painting.

TOLERANCE = 20.0
"""Largest difference in CIELAB between a canvas toned by hand and the wanted ground."""

_SURE = 5.0  # accuracy of the camera in CIELAB


def has_ground(canvas: Tensor, ground: Color) -> bool:
    """Returns True if the canvas [3, H, W] has that ground (sRGB), and is not just white paper."""
    from_white = float((to_lab(torch.tensor(ground)) - to_lab(torch.tensor(WHITE))).norm())
    return is_evenly(canvas, ground, min(TOLERANCE, max(_SURE, from_white / 2)))


@dataclass(frozen=True)
class CanvasStart:
    """Allowed start of a painting.

    ground: sRGB of the ground, to be toned or already there.
    on_canvas: True if the canvas has a painting, which the new one begins on.
    paint_on: called with a sentence and the canvas [3, H, W] if something is on it unexpectedly; returns True to
    paint on.
    """

    ground: Color = WHITE
    on_canvas: bool = False
    paint_on: Callable[[str, Tensor], bool] = lambda sentence, canvas: False

    def light(self, photograph: NDArray[np.uint8], picture: Tensor, easel: Easel) -> FlatField:
        """Returns the light in the room, from the first photograph [H, W, 3] and the rectified canvas in it [3, h, w].

        A bare canvas shows the light directly. Otherwise it is found from the margin and the last bare canvas.
        Raises ConfigError if something is on the canvas and nobody accepts that, or if a bare canvas is there with
        `on_canvas`. Raises CalibrationError if no bare canvas is known, and FrameRejected.
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


# Canvas pictures for the film: `rectify`, `FlatField.correct` and `true_color` in one pass, to bytes.
#
# Film frames decide nothing, so they need not be exactly equal. Sampling positions and light are computed once for
# all frames of a camera.


class FilmView:
    """Pictures of the canvas on a grid, for a calibrated camera and a known light."""

    def __init__(self, calibration: Calibration, light: FlatField, grid: PixelGrid) -> None:
        self.calibration, self.light, self.grid = calibration, light, grid
        self._places = sampling_places(calibration, grid)
        self._seen = np.empty((*self._places[0].shape, 3), np.float32)
        white = light.light(grid.rows, grid.columns).permute(1, 2, 0)  # [rows, columns, 3]
        self._brighter = np.ascontiguousarray((1 / white).numpy(), np.float32)
        self._affine = np.array(calibration.color, np.float32)  # [3, 4]
        self._light_of_byte = light_of_bytes(np.arange(256, dtype=np.uint8))[None]
        self._tones = images.to_uint8(to_srgb(torch.linspace(0, 1, 256) ** 2).expand(1, 1, -1)).reshape(1, -1)

    def fits(self, calibration: Calibration, light: FlatField, grid: PixelGrid) -> bool:
        """Returns True if the view was made for these inputs."""
        return self.calibration is calibration and self.light is light and self.grid == grid

    def picture(self, photograph: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Returns the canvas [rows, columns, 3] in a photograph [H, W, 3], both in true sRGB bytes.

        It differs from `true_color(light.correct(rectify(...)))` by less than 2/255.
        Raises FrameRejected like `rectify`.
        """
        require_photograph(photograph, self.calibration)
        require_some_light(photograph)
        light = cv2.LUT(photograph, self._light_of_byte)
        seen = cv2.remap(light, *self._places, cv2.INTER_LINEAR, self._seen, cv2.BORDER_REPLICATE)
        if seen.shape[:2] != (self.grid.rows, self.grid.columns):
            seen = cv2.resize(seen, (self.grid.columns, self.grid.rows), interpolation=cv2.INTER_AREA)
        even = np.asarray(cv2.multiply(seen, self._brighter, dst=seen))
        true = np.asarray(cv2.transform(np.minimum(even, 1, out=even), self._affine))
        roots = cv2.sqrt(np.maximum(true, 0, out=true), dst=true)  # in bytes, they are as fine as sRGB
        return np.asarray(cv2.LUT(cv2.convertScaleAbs(roots, alpha=255), self._tones), np.uint8)


PHOTOGRAPH_ROWS = 864
"""Height in pixels of the canvas in a look for decisions."""
TIMELAPSE_ROWS = 960
_ATTEMPTS = 3
_BETWEEN = 0.5  # seconds before a rejected frame is taken again, for example until a hand has left


class Photographer:
    """Asks a camera for a photograph until it is newer than all earlier ones."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._last_sequence = -1

    def photograph(self, last_motion: float) -> Frame:
        """Returns a new photograph, taken after `last_motion` (seconds of the robot's clock).

        The camera is asked up to three times. Raises StaleFrame, or the last error of the camera.
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

    The first look learns the `light` of the room, unless it is known from an earlier run, and the features of a
    `good` photograph.
    start: allowed start of the painting.
    wait: waits for a number of seconds.
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
        self._camera_moved = ""

    @property
    def moved(self) -> tuple[str, ...]:
        """Sentences on motions that the printed markers told: of the camera, which is taken out, and of the canvas."""
        return tuple(filter(None, (self._camera_moved, self.good.moved if self.good else "")))

    def look(self, last_motion: float, rows: int) -> Tensor:
        """Returns the canvas [3, rows, columns] in sRGB, for display.

        last_motion: seconds of the robot's clock; the photograph is newer.
        Raises CameraError if the camera gives no newer photograph, or none that shows the canvas.
        """
        return self.see(self.photograph(last_motion).image, rows)

    def film(self, photograph: NDArray[np.uint8], rows: int) -> NDArray[np.uint8]:
        """Returns the canvas in a photograph for the film, sRGB bytes [rows, columns, 3]; not for decisions.

        It is within 2/255 of `see`, but faster.

        Raises FrameRejected like `see`.
        """
        calibration = self.easel.calibration
        if self.light is None:  # `see` learns it
            return images.to_uint8(self.see(photograph, rows))
        grid = PixelGrid.of_height(self.easel.canvas, rows)
        if self._film_view is None or not self._film_view.fits(calibration, self.light, grid):
            self._film_view = FilmView(calibration, self.light, grid)
        return self._film_view.picture(photograph)

    def examine(
        self, last_motion: float, rows: int, expected: Expected | None = None, *, doubtful: bool = False
    ) -> tuple[Frame, Tensor]:
        """Takes a photograph for a decision, again if necessary, until it can be trusted.

        expected: expected canvas, None if unknown.
        doubtful: True if a photograph without any cue to the canvas position is trusted, because a person has
        looked. On a simulated easel, the third one is trusted anyway.
        Returns the frame and the canvas [3, rows, columns].
        Raises FrameRejected, with the reason, if the third photograph cannot be trusted either (FrameDoubtful if a
        person must look). Raises CameraError like `look`.
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
        """Returns the canvas [3, rows, columns] in a photograph [H, W, 3]. Raises FrameRejected."""
        grid = PixelGrid.of_height(self.easel.canvas, rows)
        picture = rectify(photograph, self.easel.calibration, grid)
        if self.light is None:
            self.light = self._start.light(photograph, picture, self.easel)
        return true_color(self.light.correct(picture), self.easel.calibration)

    def learn_good(self, photograph: NDArray[np.uint8], last: NDArray[np.uint8] | None = None) -> None:
        """Learns the features of a good photograph from the first one of an earlier run, and from the `last` one."""
        self.good = FrameCheck.learn(photograph, self.easel.calibration, self.easel.canvas, last)

    def photograph(self, last_motion: float) -> Frame:
        """Returns a new photograph, taken after the last motion; the camera is asked up to three times.

        If the camera was moved over the printed markers, the photograph is returned as from its calibrated place, and
        `moved` says so. Raises StaleFrame, or the last error of the camera.
        """
        frame = self._photographer.photograph(last_motion)
        record, motion = self.easel.calibration, None
        with contextlib.suppress(CalibrationError):  # a photograph that is refused later has a better reason
            motion = _find_camera_motion(frame.image, record) if record.markers else None
        self._camera_moved = "" if motion is None else motion.sentence
        if motion is None or not self._camera_moved:
            return frame
        way, shape = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, frame.image.shape[1::-1]
        back = cv2.warpPerspective(frame.image, motion.view, shape, flags=way, borderMode=cv2.BORDER_REPLICATE)
        return replace(frame, image=np.asarray(back, np.uint8))

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


_PATIENCE = 8  # strokes after a frame is due for which the film waits until the hand leaves the canvas anyway


@dataclass(frozen=True)
class Timelapse:
    """Timelapse frames: pictures for the film, taken evenly over a painting; they decide nothing.

    frames: largest number of frames of the film.
    """

    frames: int = 0

    def due(self, done: int, of: int) -> int:
        """Returns the number of frames that are due after stroke `done` of `of`."""
        return done * self.frames // of if of else 0

    def wants_frame(self, done: int, of: int, taken: int, *, leaves: bool) -> bool:
        """Returns True if the film takes a frame after stroke `done` of `of`.

        taken: number of frames that were due when the last frame was taken.
        leaves: True if the hand leaves the canvas now anyway, for paint or for a look.

        A frame costs a trip of the arm, so it waits until the hand leaves the canvas anyway. It waits at most until
        the next frame is due, or eight strokes if frames are due more often. Frames that become due meanwhile are
        left out.
        """
        if self.due(done, of) <= taken:
            return False
        turn = -(-(taken + 1) * of // self.frames)
        return leaves or (self.due(done + 1, of) > taken + 1 and done + 1 - turn >= _PATIENCE)


class FrameDeveloper:
    """Makes timelapse frames from photographs in its own thread while the robot paints; used in a `with` block.

    It works on one photograph at a time. `notify` receives the frame in the calling thread: at the next `take`, at
    `wait`, or at the end of the block.
    """

    def __init__(self, observer: CanvasObserver, notify: Notify) -> None:
        self._observer, self._notify = observer, notify
        self._thread = ThreadPoolExecutor(1, "timelapse")
        self._in_hand: tuple[StrokePainted, Future[NDArray[np.uint8]]] | None = None

    def take(self, painted: StrokePainted, last_motion: float) -> None:
        """Takes a photograph after a stroke, with the arm at home since `last_motion`.

        Leaves it out if the camera fails.
        """
        with contextlib.suppress(CameraError):
            photograph = self._observer.photograph(last_motion).image
            self.wait()
            self._in_hand = painted, self._thread.submit(self._observer.film, photograph, TIMELAPSE_ROWS)

    def wait(self) -> None:
        """Waits for the current frame and reports it; a frame without a visible canvas is left out."""
        if self._in_hand is not None:
            (painted, frame), self._in_hand = self._in_hand, None
            with contextlib.suppress(CameraError):
                self._notify(TimelapseFrame(painted.done, painted.of, painted.color, photograph=frame.result()))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.wait()
        finally:
            self._thread.shutdown()
