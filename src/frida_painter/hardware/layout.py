"""Layout of a machine's table during its setup: proposed from a preset, then corrected by a person's marks.

Every layout is a whole workspace, so that it can be checked and drawn at any step. A layout is written as a workspace
file (TOML).
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from frida_painter.canvas_size import SMALLEST_CANVAS, CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.motion import STIR_RADIUS
from frida_painter.hardware.preset import Preset
from frida_painter.hardware.robot import Point, Workspace
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.palette import MAX_COLORS

# Proposal of wells, water and rag in a strip beside the canvas. Metres.

_STRIP = 0.036  # width of the strip that they need
_RAG = 0.030  # width of a small rag
_FIRST = 0.020  # from the end of the strip to the rag
_TO_WATER, _TO_WELLS = 0.034, 0.026
_NARROWEST, _WIDEST = 0.022, 0.035  # between two wells
_END = 0.012
_EDGE = 0.005  # around a proposed canvas
_BELOW = 0.002  # from the lowest wanted height to the floor of the workspace
_MAX_SKEW = math.radians(2.0)  # of a marked canvas from a right angle
_MAX_OFF = 0.003  # of a marked edge from the stated size of the canvas


@dataclass(frozen=True)
class PaintSpots:
    """Positions of wells, water and rag, metres of the robot's frame, and the length of a wipe along x."""

    wells: tuple[Point, ...]
    water: Point
    rag: Point
    rag_width: float = _RAG


@dataclass(frozen=True)
class Layout:
    """Layout of a table. Lengths in metres of the robot's frame.

    easel: name under which the calibration is kept
    lower, upper: corners of the box that the tip reaches, as the preset or the machine says
    canvas, corner, turn: size, bottom-left corner and degrees from the robot's x axis to the lower edge
    touch, press: robot z of the lightest touch and the hardest press
    paint: wells, water and rag
    hover, painting_speed, travel_speed, home: as in a workspace
    uneven: the lowest and the highest point of the canvas, metres above the place where the touch was found
    """

    easel: str
    lower: Point
    upper: Point
    canvas: CanvasSize
    corner: Point
    turn: float
    touch: float
    press: float
    paint: PaintSpots
    hover: float
    painting_speed: float
    travel_speed: float
    home: Point
    uneven: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def propose(cls, preset: Preset, easel: str = "", canvas: CanvasSize | None = None) -> Self:
        """Returns a layout that fits into the area of a machine's preset.

        easel: name of the easel; "" for the preset's
        canvas: its size; None for the largest that leaves room for wells
        Raises ConfigError if the canvas and a strip for wells do not fit into the area.
        """
        if preset.area is None or preset.motion is None:
            raise ConfigError(f"The preset {preset.name} is for a person's hand, which needs no workspace.")
        lower, upper, lift = preset.area.lower, preset.area.upper, preset.lift
        room = upper[0] - lower[0] - _STRIP - 2 * _EDGE, upper[1] - lower[1] - 2 * _EDGE
        if canvas is None:
            if min(room) < SMALLEST_CANVAS:
                raise ConfigError(f"The area of the preset {preset.name} has no room for a canvas beside the wells.")
            canvas = CanvasSize(*(math.floor(side * 1000 + 1e-6) / 1000 for side in room))
        corner = upper[0] - _EDGE - canvas.width, lower[1] + (upper[1] - lower[1] - canvas.height) / 2, lift.touch
        motion = preset.motion
        home = lower[0] + _EDGE, upper[1] - _EDGE, min(lift.touch + 2 * motion.hover, upper[2])
        layout = cls(
            easel or preset.name, lower, upper, canvas, corner, 0.0, lift.touch, lift.press, PaintSpots((), home, home),
            motion.hover, motion.painting_speed, motion.travel_speed, home,
        )  # fmt: skip
        return layout.with_proposed_paint()

    @property
    def workspace(self) -> Workspace:
        """Layout as a workspace whose bounds are the whole box, unchecked."""
        return Workspace(
            self.lower, self.upper, self.corner, math.radians(self.turn), self.paint.wells, self.paint.water,
            self.paint.rag, self.paint.rag_width, self.hover, self.painting_speed, self.travel_speed, self.home,
        )  # fmt: skip

    @property
    def travel_height(self) -> float:
        """Robot z at which the tip travels: above everything that is known, and within the box."""
        return min(max(self.touch + self.uneven[1], self.workspace.top) + self.hover, self.upper[2])

    def corners(self) -> dict[str, Point]:
        """Returns the corners of the canvas by name: bottom-left, bottom-right, top-right and top-left."""
        return self.workspace.corners(self.canvas)

    def with_canvas(self, left: Point, right: Point, top: Point | None, size: CanvasSize | None = None) -> Self:
        """Returns the layout with a marked canvas; its size is measured unless it is known.

        left, right, top: bottom-left, bottom-right and top-left corner; top may be None if the size is known
        Raises ConfigError if the corners are no rectangle, do not fit the size, or leave no room for the wells.
        """
        along = np.subtract(right, left)[:2]
        width = float(np.linalg.norm(along))
        if not width >= SMALLEST_CANVAS:
            raise ConfigError(
                f"The two lower corners are {width * 1000:.1f} mm apart; a canvas is at least "
                f"{SMALLEST_CANVAS * 1000:g} mm wide. Mark them again."
            )
        angle = math.atan2(along[1], along[0])
        height = size.height if size is not None else 0.0
        if top is not None:
            up = np.subtract(top, left)[:2]
            height = float(np.linalg.norm(up))
            skew = (math.atan2(up[1], up[0]) - angle - math.pi / 2 + math.pi) % (2 * math.pi) - math.pi
            if not abs(skew) <= _MAX_SKEW:
                raise ConfigError(
                    f"The marked edges meet at {90 + math.degrees(skew):.1f} degrees; a canvas has right angles, "
                    "within 2 degrees. Mark bottom left, bottom right and top left in this order."
                )
        true = size or CanvasSize(round(width, 4), round(height, 4))
        for name, measured, said in (("lower", width, true.width), ("left", height, true.height)):
            if not abs(measured - said) <= _MAX_OFF:
                raise ConfigError(
                    f"The {name} edge was marked {measured * 1000:.1f} mm long, and the canvas was said to have "
                    f"{said * 1000:g} mm there. Mark the corners again, or say the true size (--canvas)."
                )
        found = replace(self, canvas=true, corner=left, turn=math.degrees(angle))
        try:
            found.workcell()
        except ConfigError:
            return found.with_proposed_paint()
        return found

    def with_touch(self, touch: float, press: float) -> Self:
        """Returns the layout with measured heights of the lightest touch and the hardest press."""
        return replace(self, touch=touch, press=press, corner=(*self.corner[:2], touch))

    def with_paint(self, wells: Sequence[Point], water: Point, rag: Point) -> Self:
        """Returns the layout with marked wells, water and rag. Raises ConfigError if they overlap something."""
        found = replace(self, paint=replace(self.paint, wells=tuple(wells), water=water, rag=rag))
        found.workcell()
        return found

    def with_proposed_paint(self) -> Self:
        """Returns the layout with wells, water and rag in the widest free strip beside the canvas.

        Raises ConfigError if no strip is wide enough.
        """
        faults = ""
        for spots in self._strips():
            found = replace(self, paint=spots)
            try:
                found.workcell()
            except ConfigError as error:
                faults = faults or str(error)
                continue
            return found
        raise ConfigError(
            f"The canvas ({self.canvas}) leaves no strip of {_STRIP * 1000:g} mm for wells, water and rag within the "
            f"area; take a smaller canvas or put it nearer to an edge.{' ' + faults if faults else ''}"
        )

    def _strips(self) -> Iterator[PaintSpots]:
        """Yields the spots in each strip that is wide enough, the widest strip first."""
        corners = np.array([*self.corners().values()])[:, :2]
        low, high = corners.min(0), corners.max(0)
        lower, upper = np.array(self.lower[:2]), np.array(self.upper[:2])
        free = [(float(low[axis] - lower[axis]), axis, lower[axis]) for axis in (0, 1)]
        free += [(float(upper[axis] - high[axis]), axis, high[axis]) for axis in (0, 1)]
        for width, across, start in sorted(free, key=lambda strip: -strip[0]):
            if width < _STRIP - 1e-6:
                continue
            beside = start + (width - _STRIP / 2 if start in high else _STRIP / 2)  # at the edge of the table
            along = 1 - across
            spots = list(self._in_a_row(float(lower[along]), float(upper[along])))
            if len(spots) > 2:
                z = self.touch
                places = [(beside, spot, z) if across == 0 else (spot, beside, z) for spot in spots]
                rag, water, *wells = [(float(x), float(y), float(z)) for x, y, z in places]
                yield PaintSpots(tuple(wells), water, rag)

    @staticmethod
    def _in_a_row(start: float, end: float) -> Iterator[float]:
        """Yields the places of rag, water and wells along a strip."""
        water = start + _FIRST + _TO_WATER
        yield from (start + _FIRST, water)
        first, last = water + _TO_WELLS, end - _END
        count = min(MAX_COLORS, math.floor((last - first) / _NARROWEST + 1e-6) + 1)
        if count >= 1:
            pitch = min(_WIDEST, (last - first) / max(count - 1, 1))
            yield from (first + pitch * number for number in range(count))

    def values(self) -> dict[str, Any]:
        """Returns the entries of the workspace file, lengths in hundredths of a millimetre."""
        paint, (deepest, highest) = self.paint, self.uneven
        lowest = min(self.press + min(deepest, 0.0), paint.water[2], paint.rag[2], *(z for *_, z in paint.wells))
        floor = max(self.lower[2], lowest - _BELOW)
        top = max(self.touch + max(highest, 0.0), self.workspace.top)
        home = *self.home[:2], max(self.home[2], min(top + self.hover, self.upper[2]))
        canvas = {"width": self.canvas.width, "height": self.canvas.height, "corner": self.corner, "turn": self.turn}
        places = {"wells": paint.wells, "water": paint.water, "rag": paint.rag, "rag_width": paint.rag_width}
        speeds = {"painting_speed": self.painting_speed, "travel_speed": self.travel_speed}
        entries = {
            "easel": self.easel,
            "bounds": {"lower": (*self.lower[:2], floor), "upper": self.upper},
            "canvas": canvas,
            "brush": {"touch_height": self.touch, "press_height": self.press},
            "paint": places,
            "motion": {"hover": self.hover, **speeds, "home": home},
        }
        return _rounded(entries)

    def draft(self) -> str:
        """Returns a workspace file for the setup of the machine; its bounds are the whole box."""
        return self._toml({**self.values(), "bounds": _rounded({"lower": self.lower, "upper": self.upper})})

    def workcell(self) -> WorkcellConfig:
        """Returns the layout as a workspace. Raises ConfigError, which names every contradiction."""
        return WorkcellConfig.of(self.values(), "What was marked", "mark it again, or move it on the table")

    def toml(self) -> str:
        """Returns the workspace file, with the comments that a person needs to change it."""
        return self._toml(self.values())

    @staticmethod
    def _toml(values: dict[str, Any]) -> str:
        """Returns entries of a workspace as TOML; takes the name out of them."""
        lines = [
            "# Written by `frida-painter setup`. Metres of the robot's own frame, z up; places are those of the tip.",
            f"easel = {json.dumps(values.pop('easel'), ensure_ascii=False)}",
        ]
        for section, entries in values.items():
            lines += ["", f"# {_MEANINGS[section]}", f"[{section}]"]
            lines += [f"{name} = {_written(value)}" for name, value in entries.items()]
        return "\n".join((*lines, ""))


_MEANINGS = {
    "bounds": "The tip never leaves this box.",
    "canvas": "Size; bottom-left corner; degrees from the robot's x axis to the lower edge.",
    "brush": "Robot z of the lightest touch and of the hardest press.",
    "paint": f"The tip in each well, in the water and on the rag. The brush stirs {STIR_RADIUS * 1000:g} mm around.",
    "motion": "hover: above the highest thing. Speeds in m/s. home: where the robot waits.",
}


def _written(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    return repr(float(value))


def _rounded(value: Any) -> Any:
    """Returns entries with lists in place of tuples, and numbers of five decimals."""
    if isinstance(value, dict):
        return {name: _rounded(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [*map(_rounded, value)]
    return value if isinstance(value, str) else round(float(value), 5) + 0.0
