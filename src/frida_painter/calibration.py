"""Calibration record of an easel: results of its calibration procedures in one checksummed file."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError
from frida_painter.frames import Lens
from frida_painter.system import storage

VERSION = 2
PROCEDURES = ("canvas", "robot", "color", "brush", "strokes")
"""Calibration procedures in the order in which they are done."""
OF_A_BRUSH = ("brush", "strokes")
"""Procedures that belong to the brush in the holder."""
_FORMAT = "frida-painter calibration"
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_REPEAT_ALL = "repeat all procedures: frida-painter calibrate all"

Corners = tuple[tuple[float, float], ...]
Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Done:
    """Record of one finished procedure.

    dated: time in ISO 8601
    turn: counter from 1 over all procedures of this easel. It decides which one is newer, because clocks may be
    wrong.
    residual: remaining error. Pixels for canvas, metres for robot and brush, CIEDE2000 for color, mean absolute
    error of the magnitude map for strokes.
    """

    dated: str
    turn: int
    residual: float


@dataclass(frozen=True)
class LearnedFile:
    """File that a procedure wrote for the record: its path and the sha256 of its content."""

    path: str
    sha256: str


@dataclass(frozen=True)
class BareCanvas:
    """Camera measurements of the bare white canvas; with them a painting may begin on any canvas.

    light [3, 15]: illumination, see perception/flatfield.py
    margin: linear light at places around the canvas, see perception/flatfield.py. None for a place that was not
    visible.
    Raises CalibrationError if a value cannot be true.
    """

    light: Matrix
    margin: tuple[tuple[float, float, float] | None, ...]

    def __post_init__(self) -> None:
        light, margin = np.array(self.light), np.array([place for place in self.margin if place is not None])
        if light.shape != (3, 15) or not np.isfinite(light).all() or not ((margin > 0) & (margin <= 1)).all():
            raise CalibrationError(
                "What the record says of the bare canvas cannot be true; put up a bare canvas, and repeat the canvas "
                "calibration."
            )


@dataclass(frozen=True)
class BrushRecord:
    """Calibration of a brush that is not in the holder now; fields as in `Calibration`.

    done: records of its brush and strokes procedures, if they were done
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    touch_height: float
    press_height: float
    protrusion: float | None = None
    library: LearnedFile | None = None
    weights: LearnedFile | None = None
    done: Mapping[str, Done] = field(default_factory=dict)


@dataclass(frozen=True)
class WetPaint:
    """Exchange of paint between a brush and wet paint on the canvas, learned from photographs of a painting.

    rate: share of its paint that a brush exchanges with a full wet mark, for each metre at first
    share: share of the wet paint below that mixes with the mark where it lies
    drying: seconds until a full mark has set
    Raises CalibrationError if a number is out of range.
    """

    BOUNDS: ClassVar[Mapping[str, tuple[float, float]]] = MappingProxyType(
        {"rate": (0.0, 100.0), "share": (0.0, 1.0), "drying": (1.0, 1e5)}
    )

    rate: float
    share: float
    drying: float

    def __post_init__(self) -> None:
        for name, (least, most) in self.BOUNDS.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise CalibrationError(
                    f"Wet paint with the {name} {value:g} was given; it is from {least:g} to {most:g}."
                )


# Height map of an uneven canvas

MAX_UNEVENNESS = 0.02
"""Greatest height of a point of the canvas above or below the place of the brush calibration, metres."""
MAX_LINES = 65
"""Greatest number of lines of a map's grid, along each side."""
MAX_SLOPE = 0.25
"""Greatest slope between two neighbouring points, metres per metre; a steeper step tears the bristles."""
_SAME = 0.0015  # metres by which a map may differ from the canvas

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
        if (fault := self._find_fault()) is not None:
            raise CalibrationError(f"The height map {fault} Measure it again: frida-painter calibrate surface")

    def _find_fault(self) -> str | None:
        for name, lines in (("across", self.across), ("up", self.up)):
            steps = np.diff(lines)
            if not (2 <= len(lines) <= MAX_LINES and np.isfinite(lines).all() and (steps > 0).all()):
                return f"has the lines {name} {_shorten(lines)}; they are 2 to {MAX_LINES} ascending numbers of metres."
        if len(self.offset) != len(self.up) or any(len(row) != len(self.across) for row in self.offset):
            rows = _shorten([len(row) for row in self.offset])
            return f"has rows of {rows} heights; it needs {len(self.up)} rows of {len(self.across)}."
        offset = np.array(self.offset, np.float64)
        wrong = ~(np.abs(offset) <= MAX_UNEVENNESS)
        if wrong.any():
            row, column = np.argwhere(wrong)[0]
            what = "has a hole" if not np.isfinite(offset[row, column]) else f"says {offset[row, column] * 1000:.1f} mm"
            return (
                f"{what} at {self.across[column] * 1000:.0f}, {self.up[row] * 1000:.0f} mm of the canvas; allowed are "
                f"{-MAX_UNEVENNESS * 1000:g} to {MAX_UNEVENNESS * 1000:g} mm."
            )
        if not self.steepest <= MAX_SLOPE:
            return (
                f"has a step of {self.steepest * 1000:.0f} mm per metre; allowed are {MAX_SLOPE * 1000:g}: flatten the "
                "canvas."
            )
        return None

    @property
    def highest(self) -> float:
        """Greatest offset, metres."""
        return max(map(max, self.offset))

    @property
    def lowest(self) -> float:
        """Least offset, metres."""
        return min(map(min, self.offset))

    @property
    def steepest(self) -> float:
        """Greatest slope between two neighbouring points of the grid, metres per metre."""
        along = np.abs(np.diff(self.offset, axis=1)) / np.diff(self.across)
        beyond = np.abs(np.diff(self.offset, axis=0)) / np.diff(self.up)[:, None]
        return float(max(along.max(), beyond.max()))

    def at(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the offsets [k] in metres at positions [k, 2] in canvas metres."""
        from scipy.interpolate import RegularGridInterpolator  # loaded here because few canvases are uneven

        inside = np.clip(position, (self.across[0], self.up[0]), (self.across[-1], self.up[-1]))
        surface = RegularGridInterpolator((self.up, self.across), np.array(self.offset), bounds_error=False)
        return np.asarray(surface(inside[:, ::-1]), np.float64)

    def require_covers(self, canvas: CanvasSize) -> None:
        """Raises CalibrationError unless the map reaches from edge to edge of the canvas."""
        ends = (self.across[0], self.across[-1], self.up[0], self.up[-1])
        wanted = (0.0, canvas.width, 0.0, canvas.height)
        if not all(abs(end - edge) <= _SAME for end, edge in zip(ends, wanted, strict=True)):
            raise CalibrationError(
                f"The height map reaches from {ends[0] * 1000:.0f} to {ends[1] * 1000:.0f} mm across and from "
                f"{ends[2] * 1000:.0f} to {ends[3] * 1000:.0f} mm up, and the canvas is {canvas}; measure the map "
                "again: frida-painter calibrate surface"
            )

    @classmethod
    def of_points(
        cls,
        canvas: CanvasSize,
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
        full = _extend(up, _extend(across, offset.T, canvas.width).T, canvas.height)
        return cls(
            (0.0, *map(float, across[1:-1]), canvas.width),
            (0.0, *map(float, up[1:-1]), canvas.height),
            tuple(tuple(round(metres, 6) for metres in row) for row in full.tolist()),
            dated,
        )


def _extend(lines: Sequence[float], values: NDArray[np.float64], side: float) -> NDArray[np.float64]:
    """Returns values [k, m] with the first and the last row moved to 0 and `side`, along straight lines."""
    found = values.astype(np.float64).copy()
    found[0] -= (values[1] - values[0]) / (lines[1] - lines[0]) * lines[0]
    found[-1] += (values[-1] - values[-2]) / (lines[-1] - lines[-2]) * (side - lines[-1])
    return found


def _shorten(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values[:6]) + (", ..." if len(values) > 6 else "")


@dataclass(frozen=True)
class Calibration:
    """Calibration of one easel: the canvas in the camera's photograph, and corrections of the robot.

    easel, brush, camera: ids
    canvas: size of the canvas
    corners: top-left, top-right, bottom-right and bottom-left corner of the canvas in the distorted photograph,
    (column, row) in pixels
    photograph: (rows, columns) of the photograph
    lens: distortion; None if there is none or it is unknown
    placement: homography from the intended position to the commanded position, canvas metres
    color: affine 3 x 4 map from perceived to true linear light

    touch_height, press_height: robot z in metres of the lightest touch and the hardest press
    protrusion: length of the brush outside its holder in metres
    library, weights: stroke library of the painted strokes, and the stroke model learned from it
    bare: measurements of a bare canvas; None if there are none
    markers: number and corners of each printed marker around the canvas, in pixels of the photograph
    surface: height map of an uneven canvas; None if it is flat
    wet: how wet paints mix on the canvas; None if no painting has shown it
    done: finished procedures by name
    others: calibrations of other brushes by name

    A part without its procedure has the easel's default. Raises CalibrationError if a value cannot be true.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    easel: str
    brush: str
    corners: Corners
    photograph: tuple[int, int]
    touch_height: float
    press_height: float
    placement: Matrix = _IDENTITY
    color: Matrix = tuple((*row, 0.0) for row in _IDENTITY)
    camera: str = "camera"
    canvas: CanvasSize | None = None
    lens: Lens | None = None
    protrusion: float | None = None
    library: LearnedFile | None = None
    weights: LearnedFile | None = None
    bare: BareCanvas | None = None
    markers: Matrix = ()
    surface: SurfaceMap | None = None
    wet: WetPaint | None = None
    done: Mapping[str, Done] = field(default_factory=dict)
    others: Mapping[str, BrushRecord] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if (fault := self._find_fault()) is not None:
            raise CalibrationError(fault)
        if self.surface is not None and self.canvas is not None:
            self.surface.require_covers(self.canvas)

    def _find_fault(self) -> str | None:
        corners, placement, color = np.array(self.corners), np.array(self.placement), np.array(self.color)
        if corners.shape != (4, 2) or not np.isfinite(corners).all() or not _turns_clockwise(corners):
            return (
                f"Canvas corners {self.corners} do not go round the canvas clockwise from the top left; "
                "repeat the canvas calibration."
            )
        if self.lens is not None and not np.isfinite(self.lens.undistort(corners)).all():
            return (
                f"Through the lens {self.lens.coefficients} no canvas is seen at {self.corners}; "
                "repeat the canvas calibration."
            )
        if placement.shape != (3, 3) or not np.isfinite(placement).all() or not np.linalg.det(placement) > 1e-6:
            return "The placement homography is singular or mirrored; repeat the robot calibration."
        if not all(len(row) == 9 and np.isfinite(row).all() for row in self.markers):
            return "The record's markers are not numbers with four corners each; repeat the canvas calibration."
        if color.shape != (3, 4) or not np.isfinite(color).all():
            return "The colour correction is not a finite 3 x 4 map; repeat the color calibration."
        if not -np.inf < self.press_height < self.touch_height < np.inf:
            return (
                f"The hardest press ({self.press_height} m) is not below the lightest touch ({self.touch_height} m); "
                "repeat the brush calibration."
            )
        if self.protrusion is not None and not 0 <= self.protrusion <= 1:
            return (
                f"A brush that protrudes by {self.protrusion} m cannot be true; it is from 0 to 1 m; "
                "repeat the brush calibration."
            )
        for name, done in self.done.items():
            if name not in PROCEDURES or not 0 <= done.residual < np.inf:
                return f"The record's entry on {name!r} ({done}) cannot be true; {_REPEAT_ALL}"
        return None

    def place(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns where to send the robot so that it paints at `position`: canvas metres [n, 2] -> [n, 2]."""
        homogeneous = np.c_[position, np.ones(len(position))] @ np.array(self.placement).T
        return homogeneous[:, :2] / homogeneous[:, 2:]

    def height(self, thickness: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns robot z [n] in metres for thickness [n]: 0 is the lightest touch, 1 the hardest press."""
        return self.touch_height + thickness * (self.press_height - self.touch_height)

    def unevenness(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the offsets [n] of the surface in metres at positions [n, 2] in canvas metres; 0 if it is flat."""
        return np.zeros(len(position)) if self.surface is None else self.surface.at(position)

    @property
    def highest_touch(self) -> float:
        """Robot z of the lightest touch at the highest point of the canvas, metres."""
        return self.touch_height + (0.0 if self.surface is None else max(self.surface.highest, 0.0))

    def with_surface(self, surface: SurfaceMap | None) -> Self:
        """Returns the record with a height map; None for a flat canvas. Raises CalibrationError if it is too small."""
        return replace(self, surface=surface)

    @property
    def depths(self) -> dict[str, float]:
        """Distance from the lightest touch to the hardest press in metres, by brush."""
        every = {self.brush: self._of_holder, **self.others}
        return {name: one.touch_height - one.press_height for name, one in every.items()}

    def of_brush(self, brush: str) -> Self:
        """Returns the record with another known brush in the holder.

        Raises CalibrationError if the brush is unknown.
        """
        if brush == self.brush:
            return self
        if brush not in self.others:
            known = ", ".join((self.brush, *self.others))
            raise CalibrationError(
                f"The calibration record knows the brushes {known}, and not {brush!r}; calibrate it as well: "
                f"frida-painter calibrate brush --brush {brush}"
            )
        return self._holding(brush, self.others[brush])

    def _holding(self, brush: str, chosen: BrushRecord) -> Self:
        """Returns the record with that brush in the holder and the present brush among the others."""
        left = self._of_holder
        return replace(
            self,
            brush=brush,
            touch_height=chosen.touch_height,
            press_height=chosen.press_height,
            protrusion=chosen.protrusion,
            library=chosen.library,
            weights=chosen.weights,
            done={**{name: done for name, done in self.done.items() if name not in left.done}, **chosen.done},
            others={**{name: one for name, one in self.others.items() if name != brush}, self.brush: left},
        )

    @property
    def _of_holder(self) -> BrushRecord:
        """Calibration of the brush in the holder."""
        mine = {name: done for name, done in self.done.items() if name in OF_A_BRUSH}
        return BrushRecord(self.touch_height, self.press_height, self.protrusion, self.library, self.weights, done=mine)

    def start_anew(self, default: Self) -> Self:
        """Returns the easel's default record for a complete new calibration.

        Calibrations of other brushes stay. The records of finished procedures stay too, so that new ones count
        as newer.
        """
        others, done = dict(self.others), dict(self.done)
        if self.brush != default.brush:
            done = {name: one for name, one in done.items() if name not in OF_A_BRUSH}
            if "brush" in self.done:
                others[self.brush] = self._of_holder
            if default.brush in others:
                done |= others.pop(default.brush).done
        surface = self.surface if self.canvas == default.canvas else None
        return replace(default, done=done, others=others, surface=surface)

    def with_canvas(
        self,
        corners: Corners,
        photograph: tuple[int, int],
        *,
        camera: str,
        canvas: CanvasSize,
        residual: float,
        lens: Lens | None = None,
        bare: BareCanvas | None = None,
    ) -> Self:
        """Returns the record after the canvas procedure.

        residual: deviation of the canvas edges from straight lines, in pixels
        """
        surface = self.surface if canvas == self.canvas else None
        found = replace(
            self, corners=corners, photograph=photograph, camera=camera, canvas=canvas, lens=lens, bare=bare,
            surface=surface, markers=(),
        )  # fmt: skip
        return found._with_done("canvas", residual)

    def with_robot(self, placement: Matrix, *, residual: float) -> Self:
        """Returns the record after the robot procedure.

        residual: distance between intended and painted dots, in metres
        """
        return replace(self, placement=placement)._with_done("robot", residual)

    def with_color(self, color: Matrix, *, residual: float) -> Self:
        """Returns the record after the color procedure.

        residual: mean CIEDE2000 over held-out patches
        """
        return replace(self, color=color)._with_done("color", residual)

    def with_brush(
        self, brush: str, touch_height: float, press_height: float, *, protrusion: float | None, residual: float
    ) -> Self:
        """Returns the record after the brush procedure.

        residual: accuracy of the two heights, in metres
        """
        known = self
        if brush != self.brush and "brush" in self.done:
            known = self._holding(brush, self.others.get(brush, BrushRecord(touch_height, press_height)))
        found = replace(known, brush=brush, touch_height=touch_height, press_height=press_height, protrusion=protrusion)
        return found._with_done("brush", residual)

    def with_strokes(self, library: LearnedFile, weights: LearnedFile | None = None, *, residual: float) -> Self:
        """Returns the record after the strokes procedure.

        residual: mean absolute error of the magnitude map
        """
        return replace(self, library=library, weights=weights)._with_done("strokes", residual)

    def _with_done(self, procedure: str, residual: float) -> Self:
        every = [*self.done.values(), *(done for other in self.others.values() for done in other.done.values())]
        turn = 1 + max((done.turn for done in every), default=0)
        done = Done(datetime.now(UTC).isoformat(timespec="seconds"), turn, float(residual))
        return replace(self, done={**self.done, procedure: done})

    def save(self, path: Path) -> None:
        """Writes the record and keeps an undamaged older one as `.prev`. Raises StorageError."""
        if path.exists():
            try:
                type(self).load(path)
            except CalibrationError:
                pass  # A damaged record must not replace the last good one.
            else:
                storage.copy(path, previous(path), "a calibration record", storage.MAX_JSON_BYTES)
        storage.write_json(path, {"format": _FORMAT, "version": VERSION, **asdict(self)})

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads a record.

        Raises CalibrationError if it is damaged or of another version; the message says what to repeat.
        """
        try:
            record = storage.read_json(path, "a calibration record", CalibrationError)
        except CalibrationError as damage:
            if not path.exists():
                raise
            aid = f"the one before is {previous(path)}; " if previous(path).exists() else ""
            raise CalibrationError(f"{damage} Or {aid}{_REPEAT_ALL}") from damage
        kind, version = record.pop("format", None), record.pop("version", None)
        if kind != _FORMAT or version != VERSION:
            what = f"of version {version!r}" if kind == _FORMAT else "of another kind"
            raise CalibrationError(f"{path} is {what}, not a calibration record of version {VERSION}; {_REPEAT_ALL}")
        try:
            return TypeAdapter(cls).validate_json(json.dumps(record), strict=True)
        except ValidationError as cause:
            fault = cause.errors()[0]
            part = ".".join(map(str, fault["loc"]))
            raise CalibrationError(
                f"{path} is a calibration record whose part {part!r} is not as it must be ({fault['msg'].lower()}); "
                f"{_REPEAT_ALL}"
            ) from cause


def previous(path: Path) -> Path:
    """Returns the path at which `Calibration.save` keeps the older record."""
    return path.parent / f"{path.name}.prev"  # also works for a path without a name, like "."


def _turns_clockwise(corners: NDArray[np.float64]) -> bool:
    """Returns True if the corners form a convex polygon in clockwise order on screen (rows go down)."""
    side = np.roll(corners, -1, axis=0) - corners
    after = np.roll(side, -1, axis=0)
    return bool((side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0] > 0).all())
