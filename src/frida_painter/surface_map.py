"""Height map of an uneven canvas, as part of a calibration record."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from frida_painter.errors import CalibrationError

if TYPE_CHECKING:
    from frida_painter.canvas_size import CanvasSize

MAX_UNEVENNESS = 0.02
"""Greatest height of a point of the canvas above or below the place of the brush calibration, metres."""
MAX_LINES = 65
"""Greatest number of lines of a map's grid, along each side."""
MAX_SLOPE = 0.25
"""Greatest slope between two neighbouring points, metres per metre; a steeper step tears the bristles."""
_SAME = 0.0015  # metres by which a map may differ from the canvas
_REMEDY = "measure the map again: frida-painter calibrate surface"

Line = Annotated[tuple[float, ...], Field(strict=False)]


@dataclass(frozen=True)
class SurfaceMap:
    """Heights of a canvas on a grid, relative to the place at which the brush was calibrated.

    across, up: positions of the grid's lines in canvas metres, ascending, from edge to edge of the canvas
    offset: metres, positive is higher; one row for each line in `up`, from the bottom
    dated: day of the measurement, ISO 8601

    Between the lines the height is bilinear; beyond the edges it is that of the edge. Raises CalibrationError if the
    map has a hole, or its numbers cannot be true.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    across: Line
    up: Line
    offset: Annotated[tuple[Line, ...], Field(strict=False)]
    dated: str = ""

    def __post_init__(self) -> None:
        for name, lines in (("across", self.across), ("up", self.up)):
            steps = np.diff(lines)
            if not (2 <= len(lines) <= MAX_LINES and np.isfinite(lines).all() and (steps > 0).all()):
                raise CalibrationError(
                    f"The height map's lines {name} are {_shorten(lines)}; they are 2 to {MAX_LINES} ascending numbers "
                    f"of metres. {_capital(_REMEDY)}."
                )
        if len(self.offset) != len(self.up) or any(len(row) != len(self.across) for row in self.offset):
            raise CalibrationError(
                f"The height map has rows of {_shorten([len(row) for row in self.offset])} heights; it needs "
                f"{len(self.up)} rows of {len(self.across)}. {_capital(_REMEDY)}."
            )
        offset = self._array
        wrong = ~(np.abs(offset) <= MAX_UNEVENNESS)
        if wrong.any():
            row, column = np.argwhere(wrong)[0]
            what = "has a hole" if not np.isfinite(offset[row, column]) else f"says {offset[row, column] * 1000:.1f} mm"
            raise CalibrationError(
                f"The height map {what} at {self.across[column] * 1000:.0f}, {self.up[row] * 1000:.0f} mm of the "
                f"canvas; allowed are {-MAX_UNEVENNESS * 1000:g} to {MAX_UNEVENNESS * 1000:g} mm. {_capital(_REMEDY)}."
            )
        if not self.steepest <= MAX_SLOPE:
            raise CalibrationError(
                f"The height map has a step of {self.steepest * 1000:.0f} mm per metre; allowed are "
                f"{MAX_SLOPE * 1000:g}. Flatten the canvas, then {_REMEDY}."
            )

    @property
    def _array(self) -> NDArray[np.float64]:
        return np.array(self.offset, np.float64)

    @property
    def highest(self) -> float:
        """Greatest offset, metres."""
        return float(self._array.max())

    @property
    def lowest(self) -> float:
        """Least offset, metres."""
        return float(self._array.min())

    @property
    def steepest(self) -> float:
        """Greatest slope between two neighbouring points of the grid, metres per metre."""
        along = np.abs(np.diff(self._array, axis=1)) / np.diff(self.across)
        beyond = np.abs(np.diff(self._array, axis=0)) / np.diff(self.up)[:, None]
        return float(max(along.max(), beyond.max()))

    def at(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the offsets [k] in metres at positions [k, 2] in canvas metres."""
        column, right = _between(np.array(self.across), position[:, 0])
        row, upper = _between(np.array(self.up), position[:, 1])
        offset = self._array
        lower = offset[row, column] * (1 - right) + offset[row, column + 1] * right
        return (
            lower * (1 - upper) + (offset[row + 1, column] * (1 - right) + offset[row + 1, column + 1] * right) * upper
        )

    def require_covers(self, canvas: "CanvasSize") -> None:
        """Raises CalibrationError unless the map reaches from edge to edge of the canvas."""
        ends = (self.across[0], self.across[-1], self.up[0], self.up[-1])
        wanted = (0.0, canvas.width, 0.0, canvas.height)
        if not all(abs(end - edge) <= _SAME for end, edge in zip(ends, wanted, strict=True)):
            raise CalibrationError(
                f"The height map reaches from {ends[0] * 1000:.0f} to {ends[1] * 1000:.0f} mm across and from "
                f"{ends[2] * 1000:.0f} to {ends[3] * 1000:.0f} mm up, and the canvas is {canvas}; {_REMEDY}."
            )

    @classmethod
    def of_points(
        cls,
        canvas: "CanvasSize",
        across: Sequence[float],
        up: Sequence[float],
        offset: NDArray[np.float64],
        dated: str = "",
    ) -> Self:
        """Returns the map of a canvas from points inside it; the edges follow by straight lines through the last two.

        across, up: lines of the grid of points, in canvas metres, ascending
        offset [len(up), len(across)]: metres
        Raises CalibrationError if a point is missing, or the map cannot be true.
        """
        cls(tuple(map(float, across)), tuple(map(float, up)), tuple(tuple(map(float, row)) for row in offset))
        wide = _extend(np.array(across), offset.T, canvas.width).T
        full = _extend(np.array(up), wide, canvas.height)
        return cls(
            (0.0, *map(float, across[1:-1]), canvas.width),
            (0.0, *map(float, up[1:-1]), canvas.height),
            tuple(tuple(round(float(metres), 6) for metres in row) for row in full),
            dated,
        )


def _extend(lines: NDArray[np.float64], values: NDArray[np.float64], side: float) -> NDArray[np.float64]:
    """Returns values [k, m] with the first and the last row moved to 0 and `side`, along straight lines."""
    found = values.astype(np.float64).copy()
    found[0] -= (values[1] - values[0]) / (lines[1] - lines[0]) * lines[0]
    found[-1] += (values[-1] - values[-2]) / (lines[-1] - lines[-2]) * (side - lines[-1])
    return found


def _between(lines: NDArray[np.float64], place: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Returns for each place the index of the line before it, and its share of the way to the next line."""
    inside = np.clip(place, lines[0], lines[-1])
    before = np.clip(np.searchsorted(lines, inside, side="right") - 1, 0, len(lines) - 2)
    return before, (inside - lines[before]) / (lines[before + 1] - lines[before])


def _shorten(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values[:6]) + (", ..." if len(values) > 6 else "")


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]
