"""The film of the arm at work: it starts slowly and gets faster and faster.

A separate thread draws and encodes the pictures, because an OpenGL context belongs to one thread, and so that the
arm need not wait. It gets each moment as plain arrays.
"""

import contextlib
import ctypes.util
import importlib
import os
import queue
import sys
import threading
import time
from contextlib import ExitStack, closing
from pathlib import Path
from typing import NamedTuple

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, FridaError
from frida_painter.hardware.robot import Workspace
from frida_painter.system import video
from frida_painter.system.video import RATE, VideoEncoder
from frida_painter.virtual.paint import BANDS, to_srgb
from frida_painter.virtual.robot import Course, Watcher
from frida_painter.virtual.tabletop import Table
from frida_painter_drivers.sawyer.surroundings import CANVAS, CANVAS_PIXELS, fill, make_model, paper

# OpenGL without a screen: the available kind, and what to install if there is none.

_KINDS = {"egl": "EGL", "osmesa": "OSMesa"}

NONE = (
    "The arm is not filmed, for there is no OpenGL that draws without a screen; on Debian and Ubuntu say: "
    "apt install libegl1 libgl1-mesa-dri"
)


def headless_opengl() -> str | None:
    """Returns MuJoCo's name of the available OpenGL ("egl", "osmesa", "cgl"); None if there is none.

    The environment variable MUJOCO_GL has priority.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    if wanted in (*_KINDS, "cgl"):
        return wanted
    if sys.platform == "darwin":
        return "cgl"
    return next((kind for kind, library in _KINDS.items() if ctypes.util.find_library(library)), None)


# View of the arm from across the table, drawn without a screen.

Picture = NDArray[np.uint8]

_MAX_THINGS = 1000
_DISTANCE, _ELEVATION, _AZIMUTH, _OPENING = 1.80, -31.0, 161.0, 37.0


class ArmView:
    """Renderer of the arm and its table, used only in the thread that opened it.

    model: arm in its surroundings
    rows, columns: size of the pictures

    Raises ConfigError if there is no OpenGL.
    """

    def __init__(self, model: mujoco.MjModel, rows: int, columns: int) -> None:
        kind = headless_opengl()
        if kind is None:
            raise ConfigError(NONE)
        self._model, self._data = model, mujoco.MjData(model)
        self._rectangle = mujoco.MjrRect(0, 0, columns, rows)
        self._pixels = np.empty((rows, columns, 3), np.uint8)
        model.vis.global_.fovy = _OPENING
        with ExitStack() as stack:
            try:
                context = importlib.import_module(f"mujoco.{kind}").GLContext(columns, rows)
                stack.callback(context.free)
                context.make_current()
                self._drawing = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            except (ImportError, AttributeError, RuntimeError, mujoco.FatalError) as cause:
                raise ConfigError(f"{NONE} ({cause})") from cause
            stack.callback(self._drawing.free)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)
            self.close = stack.pop_all().close
        self._scene = mujoco.MjvScene(model, maxgeom=_MAX_THINGS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = True
        self._camera = mujoco.MjvCamera()
        self._camera.lookat[:] = (0.40, 0.19, 0.235)
        self._camera.distance, self._camera.elevation, self._camera.azimuth = _DISTANCE, _ELEVATION, _AZIMUTH

    def lay_canvas(self, picture: Picture) -> None:
        """Shows a picture [n, n, 3] on the canvas, n = CANVAS_PIXELS, with its first row at the lower edge."""
        mujoco.mjr_uploadTexture(self._model, self._drawing, paper(self._model, CANVAS, picture))

    def tint(self, thing: str, color: NDArray[np.float64]) -> None:
        """Gives a named object (such as "well 3" or "bristles") a colour, sRGB [3] in [0, 1]."""
        number = self._model.geom(thing).id
        self._model.geom_rgba[number, :3] = color
        self._model.geom_matid[number] = -1

    def draw(self, angles: NDArray[np.float64]) -> Picture:
        """Returns the view for joint angles [7]: [rows, columns, 3], valid until the next call."""
        self._data.qpos[:] = angles
        mujoco.mj_forward(self._model, self._data)
        mujoco.mjv_updateScene(
            self._model, self._data, mujoco.MjvOption(), None, self._camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        mujoco.mjr_render(self._rectangle, self._scene, self._drawing)
        mujoco.mjr_readPixels(self._pixels, None, self._rectangle, self._drawing)
        self._pixels[:] = self._pixels[::-1].copy()  # OpenGL's first row is the lowest
        return self._pixels


# A film in progress, stored in pieces: a crash loses at most two seconds, and the next run continues it.

_PIECE = 2 * RATE  # pictures
_HELD = 2 * RATE  # at the end


class Reel:
    """Film in progress: takes pictures until `finish`, which joins those of this and all earlier runs.

    path: of the film; its pieces are in a hidden folder beside it
    pixels: array [rows, columns, 3] that contains each new picture
    count: number of pictures so far, including earlier runs

    Raises StorageError.
    """

    def __init__(self, path: Path, pixels: NDArray[np.uint8]) -> None:
        self._path, self._pixels = path, pixels
        self._folder = path.with_name(f".{path.stem}")
        self._pieces = sorted(self._folder.glob("[0-9]*.mp4"))  # named by the number of its first picture
        self._earlier = len(self._pieces)
        self.count = int(self._pieces[-1].stem) + video.count(self._pieces[-1]) if self._pieces else 0
        self._encoder: VideoEncoder | None = None
        self._taken = 0  # in this piece

    def send(self) -> None:
        """Adds the current content of the array as the next picture."""
        if self._encoder is None:
            piece = self._folder / f"{self.count:06}.mp4"
            self._encoder = VideoEncoder(piece, self._pixels, RATE)
            self._pieces.append(piece)
            self._taken = 0
        self._encoder.send()
        self.count += 1
        self._taken += 1
        if self._taken == _PIECE:
            self._put_away()

    def finish(self) -> None:
        """Writes the film, which holds its last picture for a while, unless there is nothing new."""
        self._put_away()
        if len(self._pieces) == self._earlier:
            return
        end = self._folder / "end.mp4"
        resting = VideoEncoder(end, self._pixels, RATE)
        for _ in range(_HELD):
            resting.send()
        resting.finish()
        try:
            video.join([*self._pieces, end], self._path)
        finally:
            with contextlib.suppress(OSError):
                end.unlink()

    def _put_away(self) -> None:
        if self._encoder is not None:
            self._encoder.finish()
            self._encoder = None


# Inset: the painting seen from the front, in a corner of the film, with nothing in front of it.

_LARGEST = 0.30  # of the film's columns
_MARGIN = 0.035
_BORDER, _SHADOW = 7, 4  # pixels
_SHADE = 0.88


def hang_inset(size: CanvasSize, canvas: Picture, pixels: Picture) -> None:
    """Draws the canvas into the upper right corner of a picture [rows, columns, 3].

    canvas: [n, n, 3], with its first row at the lower edge
    """
    scale = _LARGEST * pixels.shape[1] / max(size.width, size.height)
    width, height = round(size.width * scale), round(size.height * scale)
    top = round(_MARGIN * pixels.shape[1]) + _BORDER
    left = pixels.shape[1] - top - width

    def around(border: int, shift: int = 0) -> Picture:
        """Returns the part of the picture with the canvas and a border of pixels, shifted down and right."""
        first, second = top - border + shift, left - border + shift
        return pixels[first : first + height + 2 * border, second : second + width + 2 * border]

    shadow = around(_BORDER + 1, _SHADOW)
    shadow[:] = (shadow * _SHADE).astype(np.uint8)
    around(_BORDER + 1)[:] = 190  # its edge, grey
    around(_BORDER)[:] = 250  # its mount
    around(0)[:] = cv2.resize(canvas[::-1], (width, height), interpolation=cv2.INTER_AREA)


_ROWS, _COLUMNS = 540, 960
# Seconds of work between pictures at first, the number of pictures for which that lasts, and its growth afterwards.
_AT_LEISURE, _PICTURES, _GROWTH = 0.25, 96, 1.02
_WAITING = 4  # greatest number of pictures that wait to be drawn
_HELD_UP = 6.0  # factor by which pictures may delay a motion; further pictures are left out
_CLEAN = np.array([0.78, 0.66, 0.48])  # sRGB of bristles without paint
_DRY = 0.5  # microlitres; a brush with less looks clean


class FilmMoment(NamedTuple):
    """Content of one picture.

    angles: of the joints [7]
    canvas: [n, n, 3]
    bristles, wells: colours of the paint on the brush and in the wells, sRGB
    """

    angles: NDArray[np.float64]
    canvas: NDArray[np.uint8]
    bristles: NDArray[np.float64]
    wells: tuple[NDArray[np.float64], ...]


class ArmFilm(Watcher):
    """Film of an arm: `open` before it moves, `watch` its motions, `close`. Failures never stop the arm.

    path: of the film; an earlier film there is continued
    workspace, canvas, table: of the arm

    The film exists after `close` if there was OpenGL, disk space and a motion to see.
    """

    def __init__(self, path: Path, workspace: Workspace, canvas: CanvasSize, table: Table) -> None:
        self._path, self._size, self._table = path, canvas, table
        self._model = make_model(workspace, canvas)
        self._moments: queue.Queue[FilmMoment | None] = queue.Queue(_WAITING)
        self._now, self._next, self._count = 0.0, 0.0, 0
        self._canvas = self._look()
        self._angles: NDArray[np.float64] | None = None  # current angles of the joints
        self._thread: threading.Thread | None = None
        self._ready, self._over = threading.Event(), threading.Event()

    def open(self) -> None:
        """Prepares the drawing, so that nothing delays the arm, or a stop, once it moves."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._shoot, name="film of the arm", daemon=True)
            self._thread.start()
            self._ready.wait()

    def watch(self, course: Course) -> None:
        """Films a motion that has just been made, with its marks on the canvas."""
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
            self._hand_over(course.angles[index], canvas, latest)
            self._next += _AT_LEISURE * _GROWTH ** max(0, self._count - _PICTURES)
            self._count += 1

    def close(self) -> None:
        """Ends the film with a picture of the current state."""
        if self._thread is not None and self._thread.is_alive():
            if self._angles is not None:
                self._hand_over(self._angles, self._look(), time.monotonic() + _HELD_UP)
            self._moments.put(None)
            self._thread.join()
        self._over.set()

    def _hand_over(self, angles: NDArray[np.float64], canvas: Picture, latest: float) -> None:
        """Hands over a picture; waits for room until `latest` (monotonic clock), and drops it after that."""
        tuft = self._table.tuft
        bristles = _CLEAN if tuft.volume < _DRY else _masstone(tuft.pigment.sum(0) / tuft.volume)
        moment = FilmMoment(angles, canvas, bristles, tuple(map(_masstone, self._table.paints)))
        while not self._over.is_set():
            try:
                self._moments.put(moment, timeout=min(0.2, max(0.0, latest - time.monotonic())))
            except queue.Full:
                if time.monotonic() < latest:
                    continue
            return

    def _shoot(self) -> None:
        model = self._model
        try:
            with closing(ArmView(model, _ROWS, _COLUMNS)) as view:
                pixels = np.empty((_ROWS, _COLUMNS, 3), np.uint8)
                reel = Reel(self._path, pixels)
                self._count = reel.count
                shown: Picture | None = None
                view.draw(model.key("neutral").qpos)
                self._ready.set()
                while (moment := self._moments.get()) is not None:
                    for well, color in enumerate(moment.wells):
                        fill(model, well)
                        view.tint(f"well {well}", color)
                    view.tint("bristles", moment.bristles)
                    if shown is not moment.canvas:
                        view.lay_canvas(moment.canvas)
                        shown = moment.canvas
                    pixels[:] = view.draw(moment.angles)
                    hang_inset(self._size, moment.canvas, pixels)
                    reel.send()
                reel.finish()
        except FridaError:
            pass  # The painting has priority; a missing film is its own message.
        finally:
            self._over.set()
            self._ready.set()

    def _look(self) -> NDArray[np.uint8]:
        """Returns the current canvas, [n, n, 3] sRGB, with its first row at the lower edge."""
        seen = np.asarray(to_srgb(self._table.canvas.reflectance()) * 255 + 0.5, np.uint8)
        return np.asarray(cv2.resize(seen, (CANVAS_PIXELS, CANVAS_PIXELS), interpolation=cv2.INTER_AREA), np.uint8)

    def _in_between(
        self, before: NDArray[np.uint8], after: NDArray[np.uint8], places: NDArray[np.float64]
    ) -> NDArray[np.uint8]:
        """Returns the canvas during a motion: the new state along the brush's path so far, the old one elsewhere."""
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


def _masstone(paint: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the sRGB [3] of a thick layer of paint (K, S of each band)."""
    ratio = paint[:BANDS] / paint[BANDS:]
    return to_srgb(1 + ratio - np.sqrt(ratio**2 + 2 * ratio))
