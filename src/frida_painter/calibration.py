"""The calibration record of an easel: what its procedures measured, in one checksummed file."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from frida_painter import storage
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError
from frida_painter.frames import Lens

VERSION = 2
PROCEDURES = ("canvas", "robot", "color", "brush", "strokes")
"""What calibrates an easel, in the order in which it is done."""
OF_A_BRUSH = ("brush", "strokes")
"""Those that look at the brush in the holder."""
_FORMAT = "frida-painter calibration"
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_REPEAT_ALL = "repeat all procedures: frida-painter calibrate all"

Corners = tuple[tuple[float, float], ...]
Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Done:
    """That a procedure was done: when (ISO 8601), as which of all that were ever done here, and what it left over.

    turn counts from 1 and decides what is newer, for clocks are set wrong; residual is in pixels for
    canvas, metres for robot and brush, CIEDE2000 for color, mean absolute error of the magnitude map
    for strokes.
    """

    dated: str
    turn: int
    residual: float


@dataclass(frozen=True)
class LearnedFile:
    """A file that a procedure wrote and that belongs to the record: its path, and the sha256 of its content."""

    path: str
    sha256: str


@dataclass(frozen=True)
class BareCanvas:
    """What the camera saw when the canvas was bare and white; by it a painting may begin on any canvas.

    light: [3, 15], as perception/flatfield.py has it; margin: linear light at places around the canvas, as
    perception/flatfield.py has them, None where nothing was to be seen. Raises CalibrationError.
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
    """What is known at an easel of a brush that is not in its holder now; as in `Calibration`.

    done: when its heights were measured, and when its strokes were, where they were.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    touch_height: float
    press_height: float
    protrusion: float | None = None
    library: LearnedFile | None = None
    weights: LearnedFile | None = None
    done: Mapping[str, Done] = field(default_factory=dict)


@dataclass(frozen=True)
class Calibration:
    """What is known about one easel: where the camera sees the canvas, where the robot really paints.

    easel, brush, camera: their ids; canvas: its size; corners: the canvas's top-left, top-right,
    bottom-right and bottom-left corner in the camera's photograph, (column, row) pixels as seen
    through the lens; photograph: its (rows, columns); lens: its distortion, None where it has none
    or it is not known; placement: homography from where a stroke is meant to be to where the robot
    must be sent, canvas metres; color: affine 3 x 4 map from perceived to true linear light; touch_height,
    press_height: robot z in metres of the lightest touch and the hardest press; protrusion: how far
    the brush protrudes from its holder, metres; library, weights: the strokes that were painted and
    what was learned from them; bare: what a bare canvas looked like, None where none was seen; done: the
    procedures that were done, by name; others: what is known of other brushes, by name. Parts whose procedure was
    never done are the easel's defaults. Raises CalibrationError where a value cannot be true.
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
    done: Mapping[str, Done] = field(default_factory=dict)
    others: Mapping[str, BrushRecord] = field(default_factory=dict)

    def __post_init__(self) -> None:
        corners, placement, color = np.array(self.corners), np.array(self.placement), np.array(self.color)
        if corners.shape != (4, 2) or not np.isfinite(corners).all() or not _turns_clockwise(corners):
            raise CalibrationError(
                f"Canvas corners {self.corners} do not go round the canvas clockwise from the top left; "
                "repeat the canvas calibration."
            )
        if self.lens is not None and not np.isfinite(self.lens.straightened(corners)).all():
            raise CalibrationError(
                f"Through the lens {self.lens.coefficients} no canvas is seen at {self.corners}; "
                "repeat the canvas calibration."
            )
        if placement.shape != (3, 3) or not np.isfinite(placement).all() or not np.linalg.det(placement) > 1e-6:
            raise CalibrationError("The placement homography is singular or mirrored; repeat the robot calibration.")
        if color.shape != (3, 4) or not np.isfinite(color).all():
            raise CalibrationError("The colour correction is not a finite 3 x 4 map; repeat the color calibration.")
        if not -np.inf < self.press_height < self.touch_height < np.inf:
            raise CalibrationError(
                f"The hardest press ({self.press_height} m) is not below the lightest touch ({self.touch_height} m); "
                "repeat the brush calibration."
            )
        if self.protrusion is not None and not 0 <= self.protrusion <= 1:
            raise CalibrationError(
                f"A brush that protrudes by {self.protrusion} m cannot be true; it is from 0 to 1 m; "
                "repeat the brush calibration."
            )
        for name, done in self.done.items():
            if name not in PROCEDURES or not 0 <= done.residual < np.inf:
                raise CalibrationError(f"The record's entry on {name!r} ({done}) cannot be true; {_REPEAT_ALL}")

    def place(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where to send the robot so that it paints at `position`: canvas metres [n, 2] -> [n, 2]."""
        homogeneous = np.c_[position, np.ones(len(position))] @ np.array(self.placement).T
        return homogeneous[:, :2] / homogeneous[:, 2:]

    def height(self, thickness: NDArray[np.float64]) -> NDArray[np.float64]:
        """Robot z [n] in metres for thickness [n]: 0 the lightest touch, 1 the hardest press."""
        return self.touch_height + thickness * (self.press_height - self.touch_height)

    @property
    def depths(self) -> dict[str, float]:
        """Metres from the lightest touch to the hardest press of each brush, by its name."""
        every = {self.brush: self._of_holder, **self.others}
        return {name: one.touch_height - one.press_height for name, one in every.items()}

    def of_brush(self, brush: str) -> Self:
        """The record with another of its brushes in the holder. Raises CalibrationError where it does not know it."""
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
        """The record with that brush in the holder, and the one that was there among the others."""
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
        """What is known of the brush in the holder."""
        mine = {name: done for name, done in self.done.items() if name in OF_A_BRUSH}
        return BrushRecord(self.touch_height, self.press_height, self.protrusion, self.library, self.weights, done=mine)

    def begun_anew(self, default: Self) -> Self:
        """The easel's default record, to calibrate all of it again; what this one knows of other brushes stays.

        When procedures were done stays as well: what is done anew is newer than all that was.
        """
        others, done = dict(self.others), dict(self.done)
        if self.brush != default.brush:
            done = {name: one for name, one in done.items() if name not in OF_A_BRUSH}
            if "brush" in self.done:
                others[self.brush] = self._of_holder
            if default.brush in others:
                done |= others.pop(default.brush).done
        return replace(default, done=done, others=others)

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
        """The record after the canvas procedure; residual: pixels, how far the canvas's edges are from straight."""
        found = replace(
            self, corners=corners, photograph=photograph, camera=camera, canvas=canvas, lens=lens, bare=bare
        )
        return found._having_done("canvas", residual)

    def with_robot(self, placement: Matrix, *, residual: float) -> Self:
        """The record after the robot procedure; residual: metres, between where dots should and did land."""
        return replace(self, placement=placement)._having_done("robot", residual)

    def with_color(self, color: Matrix, *, residual: float) -> Self:
        """The record after the color procedure; residual: CIEDE2000, mean over held-out patches."""
        return replace(self, color=color)._having_done("color", residual)

    def with_brush(
        self, brush: str, touch_height: float, press_height: float, *, protrusion: float | None, residual: float
    ) -> Self:
        """The record after the brush procedure; residual: metres, how exactly the two heights are known."""
        known = self
        if brush != self.brush and "brush" in self.done:
            known = self._holding(brush, self.others.get(brush, BrushRecord(touch_height, press_height)))
        found = replace(known, brush=brush, touch_height=touch_height, press_height=press_height, protrusion=protrusion)
        return found._having_done("brush", residual)

    def with_strokes(self, library: LearnedFile, weights: LearnedFile | None = None, *, residual: float) -> Self:
        """The record after the strokes procedure; residual: mean absolute error of the magnitude map."""
        return replace(self, library=library, weights=weights)._having_done("strokes", residual)

    def _having_done(self, procedure: str, residual: float) -> Self:
        every = [*self.done.values(), *(done for other in self.others.values() for done in other.done.values())]
        turn = 1 + max((done.turn for done in every), default=0)
        done = Done(datetime.now(UTC).isoformat(timespec="seconds"), turn, float(residual))
        return replace(self, done={**self.done, procedure: done})

    def save(self, path: Path) -> None:
        """Writes the record, keeping the one before as `.prev` where it is undamaged. Raises StorageError."""
        if path.exists():
            try:
                type(self).load(path)
            except CalibrationError:
                pass  # What is damaged must not take the place of the last good one.
            else:
                storage.copy(path, previous(path), "a calibration record", storage.MAX_JSON_BYTES)
        storage.write_json(path, {"format": _FORMAT, "version": VERSION, **asdict(self)})

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads a record. Raises CalibrationError, saying what to repeat, where it is damaged or of another version."""
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
    """Where `Calibration.save` keeps the record that was there before."""
    return path.parent / f"{path.name}.prev"  # also of what has no name, such as "."


def _turns_clockwise(corners: NDArray[np.float64]) -> bool:
    """Whether the corners turn to the right at every one, as one sees it (rows go down): convex and in order."""
    side = np.roll(corners, -1, axis=0) - corners
    after = np.roll(side, -1, axis=0)
    return bool((side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0] > 0).all())
