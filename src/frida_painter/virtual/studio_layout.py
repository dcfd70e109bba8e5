"""How the studio is set up: where canvas, paint wells, water and rag stand around an arm."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frida_painter.frames import CanvasSize
from frida_painter.hardware.workspace import Point, Workspace
from frida_painter.palette import MOST_COLORS
from frida_painter.virtual.brushes import BristleBrush

_MM = 1000.0
_WELL_PITCH = 0.045
_MARGIN = 0.06
_HOVER, _HEADROOM = 0.03, 0.15
_RAG_WIDTH = 0.08
_PAINTING_SPEED, _TRAVEL_SPEED = 0.06, 0.25
# The free arm: the canvas's corner and angle in its frame, the wells left of it in so many columns.
_FREE_ORIGIN: Point = (0.25, -0.15, 0.12)
_FREE_ANGLE = math.radians(4)
_FREE_COLUMNS = 4
# The Sawyer: how far before its base the middle of the canvas lies, and how near its edge at most.
_SAWYER_MIDDLE, _SAWYER_NEAREST, _SAWYER_HEIGHT = 0.60, 0.34, 0.05
_SAWYER_ROWS, _SAWYER_FIRST_WELL = 9, 0.28
_SAWYER_ASIDE = 0.25


@dataclass(frozen=True)
class StudioLayout:
    """How the studio is set up around an arm: its workspace, and where the tip waits while the camera looks."""

    workspace: Workspace
    home: Point


def free_layout(canvas: CanvasSize, brush: BristleBrush) -> StudioLayout:
    """Around an arm that gets everywhere: the canvas in front, wells, water and rag left of it."""
    _, y, z = _FREE_ORIGIN
    corners = _around(canvas, _FREE_ORIGIN, _FREE_ANGLE)
    left = float(corners[:, 0].min()) - _WELL_PITCH
    wells = tuple(
        (left - _WELL_PITCH * (i % _FREE_COLUMNS), y + _WELL_PITCH * (i // _FREE_COLUMNS), z)
        for i in range(MOST_COLORS)
    )
    water: Point = (left, y - 0.08, z)
    rag: Point = (left - 0.11, y - 0.08, z)
    home: Point = (rag[0], rag[1], z + 0.10)
    workspace = _workspace(brush, _FREE_ORIGIN, _FREE_ANGLE, corners, wells, water, rag)
    return StudioLayout(replace(workspace, home=home), home)


def sawyer_layout(canvas: CanvasSize, brush: BristleBrush) -> StudioLayout:
    """Around the simulated Sawyer: the canvas across the table from it, as whoever stands opposite sees it.

    The wells are at its right hand, water and rag at its left.
    """
    near = max(_SAWYER_NEAREST, _SAWYER_MIDDLE - canvas.height / 2)
    origin: Point = (near + canvas.height, -canvas.width / 2, _SAWYER_HEIGHT)
    angle = math.pi / 2  # the canvas's lower edge is the one far from the arm
    corners = _around(canvas, origin, angle)
    # Beside a small canvas they keep away from the arm's foot all the same.
    right = min(float(corners[:, 1].min()) - _WELL_PITCH, -_SAWYER_ASIDE)
    left = max(float(corners[:, 1].max()) + 0.07, _SAWYER_ASIDE)
    z = _SAWYER_HEIGHT
    wells = tuple(
        (_SAWYER_FIRST_WELL + _WELL_PITCH * (i % _SAWYER_ROWS), right - _WELL_PITCH * (i // _SAWYER_ROWS), z)
        for i in range(MOST_COLORS)
    )
    water: Point = (0.42, left, z)
    rag: Point = (0.58, left, z)
    home: Point = (0.45, left + 0.08, z + 0.10)
    return StudioLayout(replace(_workspace(brush, origin, angle, corners, wells, water, rag, home), home=home), home)


def _around(canvas: CanvasSize, origin: Point, angle: float) -> NDArray[np.float64]:
    """Corners [4, 2] of the canvas with its margin, in the robot's frame."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array(
        [
            (origin[0] + cos * u - sin * v, origin[1] + sin * u + cos * v)
            for u in (-_MARGIN, canvas.width + _MARGIN)
            for v in (-_MARGIN, canvas.height + _MARGIN)
        ]
    )


def _workspace(
    brush: BristleBrush, origin: Point, angle: float, corners: NDArray[np.float64],
    wells: tuple[Point, ...], water: Point, rag: Point, *others: Point,
) -> Workspace:  # fmt: skip
    """The workspace that holds all of these, with a margin."""
    everything = np.array([*corners, *(place[:2] for place in (*wells, water, rag, *others))])
    lower, upper = everything.min(0) - _MARGIN, everything.max(0) + _MARGIN
    z = origin[2]
    return Workspace(
        lower=(float(lower[0]), float(lower[1]), z - brush.press_depth / _MM - 0.002),
        upper=(float(upper[0]), float(upper[1]), z + _HEADROOM),
        canvas_origin=origin,
        canvas_angle=angle,
        wells=wells,
        water=water,
        rag=rag,
        rag_width=_RAG_WIDTH,
        hover=_HOVER,
        painting_speed=_PAINTING_SPEED,
        travel_speed=_TRAVEL_SPEED,
    )
