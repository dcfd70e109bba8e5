"""What somebody sees who stands across the table from the arm: pictures drawn without a screen."""

import importlib
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError
from frida_painter.virtual.sawyer.opengl import NONE, headless_opengl
from frida_painter.virtual.sawyer.surroundings import CANVAS, paper

Picture = NDArray[np.uint8]
Color = NDArray[np.float64]

_MOST_THINGS = 1000
_DISTANCE, _ELEVATION, _AZIMUTH, _OPENING = 1.80, -31.0, 161.0, 37.0


class ArmView:
    """Draws the arm and its table; used in a `with` block, and only in the thread that opened it.

    model: the arm in its surroundings; rows, columns: of the pictures. Raises ConfigError where there
    is no OpenGL.
    """

    def __init__(self, model: mujoco.MjModel, rows: int, columns: int) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._rectangle = mujoco.MjrRect(0, 0, columns, rows)
        self._pixels = np.empty((rows, columns, 3), np.uint8)
        self._open = ExitStack()
        self._drawing: Any = None

    def __enter__(self) -> Self:
        kind = headless_opengl()
        if kind is None:
            raise ConfigError(NONE)
        model = self._model
        model.vis.global_.fovy = _OPENING
        with ExitStack() as stack:
            try:
                context = importlib.import_module(f"mujoco.{kind}").GLContext(
                    self._rectangle.width, self._rectangle.height
                )
                stack.callback(context.free)
                context.make_current()
                self._drawing = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            except (ImportError, AttributeError, RuntimeError, mujoco.FatalError) as cause:
                raise ConfigError(f"{NONE} ({cause})") from cause
            stack.callback(self._drawing.free)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)
            self._open = stack.pop_all()
        self._scene = mujoco.MjvScene(model, maxgeom=_MOST_THINGS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = True
        self._camera = mujoco.MjvCamera()
        self._camera.lookat[:] = (0.40, 0.19, 0.235)
        self._camera.distance, self._camera.elevation, self._camera.azimuth = _DISTANCE, _ELEVATION, _AZIMUTH
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def lay_canvas(self, picture: Picture) -> None:
        """Shows this picture [n, n, 3] on the canvas, n = CANVAS_PIXELS, its first row at the lower edge."""
        mujoco.mjr_uploadTexture(self._model, self._drawing, paper(self._model, CANVAS, picture))

    def tint(self, thing: str, color: Color) -> None:
        """Gives the thing of that name (as "well 3", "bristles") a colour, sRGB [3] in [0, 1]."""
        number = self._model.geom(thing).id
        self._model.geom_rgba[number, :3] = color
        self._model.geom_matid[number] = -1

    def draw(self, angles: NDArray[np.float64]) -> Picture:
        """The arm with its joints at these angles [7]: [rows, columns, 3], valid until the next one is drawn."""
        self._data.qpos[:] = angles
        mujoco.mj_forward(self._model, self._data)
        mujoco.mjv_updateScene(
            self._model, self._data, mujoco.MjvOption(), None, self._camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        mujoco.mjr_render(self._rectangle, self._scene, self._drawing)
        mujoco.mjr_readPixels(self._pixels, None, self._rectangle, self._drawing)
        self._pixels[:] = self._pixels[::-1].copy()  # OpenGL's first row is the lowest
        return self._pixels
