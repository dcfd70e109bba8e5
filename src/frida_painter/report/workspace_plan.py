"""A workspace drawn to scale, as one sees the table from above."""

import math

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.frames import CanvasSize
from frida_painter.hardware.motion import STIR_RADIUS
from frida_painter.hardware.workspace import BrushRack, Point, Workspace
from frida_painter.sheet import INK, PAPER, SOFT, Sheet

_LONGEST = 1100  # pixels of the longer side of the bounds
_MARGIN, _HEAD, _FOOT = 90, 110, 110
_TABLE, _EDGE = (243, 239, 231), (160, 154, 144)
_WATER, _RAG, _WELL, _HOME = (187, 213, 224), (226, 214, 190), (250, 247, 240), (178, 58, 44)
_BRUSH = (96, 84, 66)


def workspace_plan(workspace: Workspace, canvas: CanvasSize, title: str) -> Tensor:
    """The bounds with canvas, wells, water, rag and home in them, sRGB [3, H, W] in [0, 1]; x right, y up."""
    return _Drawing(workspace, canvas, title).sheet.tensor()


class _Drawing:
    """A sheet of paper whose scale is that of the bounds."""

    def __init__(self, workspace: Workspace, canvas: CanvasSize, title: str) -> None:
        lower, upper = np.array(workspace.lower[:2]), np.array(workspace.upper[:2])
        self._scale = _LONGEST / float((upper - lower).max())
        width, height = (round(float(side) * self._scale) for side in upper - lower)
        self.sheet = Sheet(max(width, 620) + 2 * _MARGIN, height + _HEAD + _FOOT)
        self._draw = self.sheet.draw
        self._corner = (_MARGIN, _HEAD + height)
        self._lower = lower
        self._text(_MARGIN, 34, title, 36, INK, "la")
        note = "The table from above; metres in the robot's frame. Dashed: how far the brush stirs."
        if workspace.rack:
            note += " Brown: brushes in the rack, and how they are drawn out."
        self._text(_MARGIN, self.sheet.image.height - 34, note, 19, SOFT, "ls")
        self._draw.rectangle((*self._at(lower[0], upper[1]), *self._at(upper[0], lower[1])), fill=_TABLE, outline=_EDGE)
        self._rule(upper)
        self._canvas(workspace, canvas)
        self._rag(workspace)
        self._round(workspace.water, "water", _WATER)
        for number, well in enumerate(workspace.wells, 1):
            self._round(well, str(number), _WELL)
        if workspace.rack:
            self._rack(workspace.rack)
        if workspace.home:
            self._home(workspace.home)

    def _canvas(self, workspace: Workspace, canvas: CanvasSize) -> None:
        ends = np.array([(0, 0), (canvas.width, 0), (canvas.width, canvas.height), (0, canvas.height)], float)
        corners: NDArray[np.float64] = workspace.to_robot(ends, np.zeros(4))
        self._draw.polygon([self._at(x, y) for x, y, _ in corners], fill=PAPER, outline=INK, width=2)
        x, y, _ = workspace.to_robot(np.array([[canvas.width, canvas.height]]) / 2, np.zeros(1))[0]
        self._text(*self._at(x, y), "canvas", 26, SOFT, "ms")
        self._text(*self._at(x, y), str(canvas), 20, SOFT, "ma")
        self._text(*self._at(*corners[0, :2]), "  bottom left", 16, SOFT, "ld")

    def _rag(self, workspace: Workspace) -> None:
        x, y, _ = workspace.rag
        half = workspace.rag_width / 2
        self._draw.rectangle((*self._at(x - half, y + half / 2), *self._at(x + half, y - half / 2)), fill=_RAG)
        left, right = self._at(x - half, y), self._at(x + half, y)
        self._draw.line((*left, *right), fill=SOFT, width=2)
        self._text(*self._at(x, y), "rag", 19, INK, "ms")

    def _round(self, place: Point, name: str, fill: tuple[int, int, int]) -> None:
        """A well or the water, with the circle in which it is stirred."""
        x, y = self._at(*place[:2])
        outer, stirred = 2 * STIR_RADIUS * self._scale, STIR_RADIUS * self._scale
        self._draw.ellipse((x - outer, y - outer, x + outer, y + outer), fill=fill, outline=_EDGE, width=2)
        for start in range(0, 360, 30):
            self._draw.arc((x - stirred, y - stirred, x + stirred, y + stirred), start, start + 15, fill=_EDGE, width=2)
        self._text(x, y, name, 19, INK, "mm")

    def _rack(self, rack: BrushRack) -> None:
        """Each brush in its fork, and the way on which it is drawn out."""
        radius = STIR_RADIUS * self._scale
        for brush, (x, y, _) in rack.places.items():
            column, row = self._at(x, y)
            self._draw.line((column, row, *self._at(*rack.front(brush)[:2])), fill=_BRUSH, width=3)
            self._draw.ellipse((column - radius, row - radius, column + radius, row + radius), fill=_BRUSH)
            away = 1 if rack.slide[1] > 0 else -1  # the name is on the side of the fork that is closed
            self._text(column, row + away * (radius + 12), brush, 19, INK, "mm")

    def _home(self, place: Point) -> None:
        x, y = self._at(*place[:2])
        self._draw.line((x - 10, y, x + 10, y), fill=_HOME, width=3)
        self._draw.line((x, y - 10, x, y + 10), fill=_HOME, width=3)
        self._text(x + 14, y, "home", 19, _HOME, "lm")

    def _rule(self, upper: NDArray[np.float64]) -> None:
        """Metres along the two lower edges, every tenth."""
        for axis in (0, 1):
            first = math.ceil(self._lower[axis] * 10 - 1e-9)
            for tenth in range(first, math.floor(upper[axis] * 10 + 1e-9) + 1):
                at = [float(self._lower[0]), float(self._lower[1])]
                at[axis] = tenth / 10
                x, y = self._at(*at)
                end = (x, y + 8) if axis == 0 else (x - 8, y)
                self._draw.line((x, y, *end), fill=_EDGE, width=2)
                anchor = "ma" if axis == 0 else "rm"
                offset = (x, y + 12) if axis == 0 else (x - 12, y)
                self._text(*offset, f"{tenth / 10:g}", 16, SOFT, anchor)

    def _at(self, x: float, y: float) -> tuple[float, float]:
        left, bottom = self._corner
        return left + (x - self._lower[0]) * self._scale, bottom - (y - self._lower[1]) * self._scale

    def _text(self, x: float, y: float, text: str, size: int, fill: tuple[int, int, int], anchor: str) -> None:
        self.sheet.text((x, y), text, size, fill, anchor)
