"""Workspace files: TOML that describes a person's layout. All faults of its entries are reported at once."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Self, get_args

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from frida_painter.calibration import BrushRecord, Calibration
from frida_painter.canvas_size import LARGEST_CANVAS, SMALLEST_CANVAS, CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.gateway import FASTEST
from frida_painter.hardware.motion import STIR_RADIUS
from frida_painter.hardware.robot import ArmLength, BrushRack, Point, Workspace
from frida_painter.strokes.palette import MAX_COLORS
from frida_painter.system import storage

# Sections of a workspace file, with their entries and the range of each.

_MAX_BRUSHES = 16
_FARTHEST = 10.0  # metres; a greater coordinate means a wrong unit

Metre = Annotated[float, Field(ge=-_FARTHEST, le=_FARTHEST, allow_inf_nan=False)]
Position = Annotated[tuple[Metre, Metre, Metre], Field(strict=False)]
Side = Annotated[float, Field(ge=SMALLEST_CANVAS, le=LARGEST_CANVAS, allow_inf_nan=False)]
Speed = Annotated[float, Field(gt=0, le=FASTEST, allow_inf_nan=False)]
Hover = Annotated[float, Field(ge=0.005, le=0.5, allow_inf_nan=False)]


class Section(BaseModel):
    """Section of a workspace file: unknown entries are refused, types are strict, values are frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Bounds(Section):
    """Box that the tip never leaves."""

    lower: Position
    upper: Position

    def beyond(
        self, name: str, place: Point, room: Sequence[float] = (0.0, 0.0, 0.0), of: str = "bounds"
    ) -> Iterator[str]:
        """Yields a sentence for each axis along which a place with `room` around it (m) leaves the box.

        name, of: of the place and of the box, for the sentence
        """
        for axis, low, high, here, around in zip("xyz", self.lower, self.upper, place, room, strict=True):
            if not low + around <= here <= high - around:
                yield f"{name} is outside the {of} in {axis} ({here:g} m; they reach from {low:g} to {high:g} m)"

    def upside_down(self, name: str) -> list[str]:
        """Returns a sentence for each axis along which the upper corner is not above the lower one."""
        return [
            f"{name}.lower is not below {name}.upper in {axis} ({low:g} and {high:g} m)"
            for axis, low, high in zip("xyz", self.lower, self.upper, strict=True)
            if not low < high
        ]


class CanvasPlace(Section):
    """Size and position of the canvas; turn in degrees."""

    width: Side
    height: Side
    corner: Position
    turn: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]


class BrushHeights(Section):
    """Robot z of the lightest touch and of the hardest press."""

    touch_height: Metre
    press_height: Metre


class PaintPlaces(Section):
    """Positions of wells, water and rag."""

    wells: Annotated[tuple[Position, ...], Field(strict=False, min_length=1, max_length=MAX_COLORS)]
    water: Position
    rag: Position
    rag_width: Annotated[float, Field(ge=0.01, le=1, allow_inf_nan=False)]


class RackPlaces(Section):
    """Forks for brushes, by the names of the brushes; omitted if a person changes the brush."""

    places: Annotated[dict[str, Position], Field(min_length=1, max_length=_MAX_BRUSHES)]
    slide: Annotated[tuple[Metre, Metre], Field(strict=False)]
    lift: Hover


class Speeds(Section):
    """Speeds in m/s, and the height in metres at which the tip travels above everything."""

    hover: Hover
    painting_speed: Speed
    travel_speed: Speed

    def faults(self) -> Iterator[str]:
        """Yields a sentence if the tip paints faster than it travels."""
        if self.painting_speed > self.travel_speed:
            yield (
                f"motion.painting_speed ({self.painting_speed:g} m/s) is above motion.travel_speed "
                f"({self.travel_speed:g} m/s)"
            )


class Travel(Speeds):
    """Hover height, speeds and home position."""

    home: Position | None = None


class ArmReach(Section):
    """Reach of the arm around its shoulder; omitted if it reaches every point within the bounds."""

    shoulder: Position
    nearest: Annotated[float, Field(ge=0, le=_FARTHEST, allow_inf_nan=False)]
    farthest: Annotated[float, Field(gt=0, le=_FARTHEST, allow_inf_nan=False)]


class _File(Section):
    easel: Annotated[str, Field(min_length=1, max_length=60)]
    bounds: Bounds
    canvas: CanvasPlace
    brush: BrushHeights
    paint: PaintPlaces
    motion: Travel
    rack: RackPlaces | None = None
    arm: ArmReach | None = None


def describe_faults(error: ValidationError, model: type[Section]) -> list[str]:
    """Returns pydantic's faults in plain words, each with the given value and its limits."""
    return [_describe(fault, model) for fault in error.errors()]


def _describe(fault: Any, model: type[Section]) -> str:
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"])[1:80]
    match fault["type"]:
        case "missing":
            return f"{where} is missing"
        case "extra_forbidden":
            section: Any = model.model_fields[str(fault["loc"][0])].annotation if len(fault["loc"]) > 1 else model
            known = next(kind.model_fields for kind in (section, *get_args(section)) if hasattr(kind, "model_fields"))
            return f"{where} is not known; there are {', '.join(known)}"
        case kind:
            said = repr(fault["input"])
            said = said if len(said) <= 40 else f"{said[:37]}..."
            must = fault["msg"].replace("Input should be", "it must be", 1).partition(" or instance of")[0]
            units = " (lengths are metres, speeds m/s, angles degrees)" if "than" in kind else ""
            return f"{where} is {said}; {must}{units}"


_MAX_BYTES = 2**18
_ADVICE = "`frida-painter workspace example` prints a whole one with comments"


@dataclass(frozen=True)
class WorkcellConfig:
    """Content of a workspace file for one easel.

    easel: name of the easel
    touch_height, press_height: robot z in metres, used until the brush is calibrated
    reach: of the arm; None if it reaches every point within the bounds
    """

    easel: str
    workspace: Workspace
    canvas: CanvasSize
    touch_height: float
    press_height: float
    reach: ArmLength | None = None

    def calibration(
        self,
        brush: str,
        photograph: tuple[int, int] = (720, 960),
        camera: str = "camera",
        others: Sequence[str] = (),
    ) -> Calibration:
        """Returns the calibration before any procedure: the canvas fills the photograph.

        photograph: rows and columns
        others: brushes that are put into the holder later
        """
        rows, columns = photograph
        right, bottom = columns - 1.0, rows - 1.0
        return Calibration(
            easel=self.easel,
            brush=brush,
            corners=((0.0, 0.0), (right, 0.0), (right, bottom), (0.0, bottom)),
            photograph=photograph,
            touch_height=self.touch_height,
            press_height=self.press_height,
            camera=camera,
            canvas=self.canvas,
            others={name: BrushRecord(self.touch_height, self.press_height) for name in others},
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads a TOML file. Raises ConfigError, which names each missing, unknown, wrong or contradictory entry."""
        return cls.of(storage.read_toml(path, "a workspace file (TOML)", _MAX_BYTES, _ADVICE), str(path))

    @classmethod
    def of(cls, values: dict[str, Any], name: str, advice: str = _ADVICE) -> Self:
        """Returns the configuration with these entries. Raises ConfigError as `load` does.

        name: for messages
        advice: end of the messages
        """
        try:
            read = _File.model_validate(values)
        except ValidationError as error:
            faults = describe_faults(error, _File)
        else:
            made = cls._put_together(read)
            faults = [*_contradictions(made, read)]
            if not faults:
                return made
        raise ConfigError(f"{name} is no workspace: {'; '.join(faults)}. ({advice[0].upper()}{advice[1:]}.)")

    @classmethod
    def _put_together(cls, read: _File) -> Self:
        canvas = read.canvas
        workspace = Workspace(
            canvas_origin=canvas.corner,
            canvas_angle=math.radians(canvas.turn),
            rack=BrushRack(**dict(read.rack)) if read.rack else None,
            **dict([*read.bounds, *read.paint, *read.motion]),
        )
        size = CanvasSize(canvas.width, canvas.height)
        reach = ArmLength(**dict(read.arm)) if read.arm else None
        return cls(read.easel, workspace, size, read.brush.touch_height, read.brush.press_height, reach)


def example() -> str:
    """Returns a complete, commented workspace file as a template."""
    return (resources.files("frida_painter.hardware") / "examples" / "workspace.toml").read_text(encoding="utf-8")


# Contradictions between entries that are each in range.

DEEPEST = 0.05
"""Greatest way from the lightest touch to the hardest press, metres: the most that a brush bends."""
_BRUSH_ROOM = 0.02  # metres of distance from a brush in the rack, because a carried brush is wide too
_UNEVEN = 0.03  # metres between the lightest touch and the stated height of the canvas


def _contradictions(made: WorkcellConfig, read: _File) -> Iterator[str]:
    """Yields a sentence for each contradiction."""
    place, touch, press = made.workspace, made.touch_height, made.press_height
    if not made.easel.strip() or not made.easel.isprintable():
        yield f"easel is {made.easel!r}; it is a name of printable characters"
    upside_down = read.bounds.upside_down("bounds")
    yield from upside_down or _outside(made, read.bounds)
    if not 0 < touch - press <= DEEPEST:
        yield (
            f"brush.press_height ({press:g} m) is {1000 * (touch - press):g} mm below brush.touch_height ({touch:g} "
            f"m); it is above 0 to {DEEPEST * 1000:g} mm below"
        )
    if not abs(touch - place.canvas_origin[2]) <= _UNEVEN:
        yield (
            f"brush.touch_height ({touch:g} m) is more than {_UNEVEN * 1000:g} mm from the canvas (canvas.corner, "
            f"{place.canvas_origin[2]:g} m)"
        )
    yield from _too_near(place, made.canvas)
    if place.rack is not None:
        yield from _in_the_rack(place.rack) or _in_the_way(place, place.rack, made.canvas)
    yield from read.motion.faults()
    if made.reach is not None and not made.reach.nearest < made.reach.farthest:
        yield f"arm.nearest ({made.reach.nearest:g} m) is not below arm.farthest ({made.reach.farthest:g} m)"


def _outside(made: WorkcellConfig, bounds: Bounds) -> Iterator[str]:
    """Yields a sentence for each place outside the bounds."""
    place = made.workspace
    for name, corner in place.corners(made.canvas).items():
        yield from bounds.beyond(f"the canvas's {name} corner", corner)
    for name, spot in _spots(place).items():
        room, across = (place.rag_width / 2, 0.0) if name == "the rag" else (STIR_RADIUS, STIR_RADIUS)
        yield from bounds.beyond(f"{name}, with {room * 1000:g} mm around it,", spot, (room, across, 0.0))
    for name, height in (("touch_height", made.touch_height), ("press_height", made.press_height)):
        yield from bounds.beyond(f"brush.{name}", (*bounds.lower[:2], height))
    for name, fork in place.rack.places.items() if place.rack else ():
        assert place.rack is not None
        yield from bounds.beyond(f"the {name} brush in the rack", fork)
        yield from bounds.beyond(f"the {name} brush, drawn out of its fork,", place.rack.front(name))
    travel = max(place.top, made.touch_height) + place.hover
    if not travel <= bounds.upper[2]:
        yield (
            f"motion.hover ({place.hover:g} m) above the highest thing is at {travel:g} m, above the upper bound "
            f"({bounds.upper[2]:g} m)"
        )
    if place.home is not None:
        yield from bounds.beyond("motion.home", place.home)
        if not place.home[2] >= travel:
            yield f"motion.home is at {place.home[2]:g} m, below the height of travelling ({travel:g} m)"


def _spots(place: Workspace) -> dict[str, Point]:
    wells = {f"well {number}": well for number, well in enumerate(place.wells, 1)}
    return {**wells, "the water": place.water, "the rag": place.rag}


def _too_near(place: Workspace, canvas: CanvasSize) -> Iterator[str]:
    """Yields a sentence for each pair of overlapping things: stirring in one would reach the other."""
    spots = _spots(place)
    for (one, here), (other, there) in itertools.combinations(spots.items(), 2):
        if other == "the rag":
            across, along = abs(there[0] - here[0]), abs(there[1] - here[1])
            if across < place.rag_width / 2 + STIR_RADIUS and along < 2 * STIR_RADIUS:
                yield f"{one} and the rag overlap"
        elif not (apart := math.dist(here[:2], there[:2])) >= 2 * STIR_RADIUS:
            yield (
                f"{one} and {other} overlap: they are {apart * 1000:.0f} mm apart, and the brush stirs "
                f"{STIR_RADIUS * 1000:g} mm around"
            )
    over = place.to_canvas(np.array([*spots.values()]))
    away = np.linalg.norm(over - np.clip(over, 0, (canvas.width, canvas.height)), axis=1)
    for name, metres in zip(spots, away.tolist(), strict=True):
        if metres < (place.rag_width / 2 if name == "the rag" else STIR_RADIUS):
            yield f"{name} overlaps the canvas"


def _in_the_rack(rack: BrushRack) -> list[str]:
    """Returns a sentence for each pair of brushes that overlap or collide as one leaves its fork."""
    slide = np.array(rack.slide)
    way = float(np.linalg.norm(slide))
    if not way >= _BRUSH_ROOM:
        return [
            f"rack.slide is {way * 1000:.0f} mm long; a brush is clear of its fork {_BRUSH_ROOM * 1000:g} mm from its "
            "place or farther"
        ]
    found: list[str] = []
    for (one, here), (other, there) in itertools.combinations(rack.places.items(), 2):
        beside = np.subtract(there, here)[:2]
        apart = float(np.linalg.norm(beside))
        if not apart >= _BRUSH_ROOM:
            found.append(
                f"the {one} and the {other} brush stand in one place: they are {apart * 1000:.0f} mm apart, and a "
                f"brush needs {_BRUSH_ROOM * 1000:g} mm"
            )
            continue
        for drawn, against, ahead in ((one, other, beside), (other, one, -beside)):
            share = np.clip(ahead @ slide / way**2, 0, 1)
            if not np.linalg.norm(ahead - share * slide) >= _BRUSH_ROOM:
                found.append(f"the {drawn} brush is drawn out of its fork against the {against} brush; turn rack.slide")
    return found


def _in_the_way(place: Workspace, rack: BrushRack, canvas: CanvasSize) -> Iterator[str]:
    """Yields a sentence for each brush in the rack that stands in the way of carried brushes."""
    x, y, z = place.rag
    half = place.rag_width / 2
    things = [*map(rack.front, rack.places), *place.corners(canvas).values(), *place.wells, place.water]
    things += [(x - half, y, z), (x + half, y, z), *([place.home] if place.home else [])]
    hull = cv2.convexHull(np.array([thing[:2] for thing in things], np.float32))
    for name, fork in rack.places.items():
        inside = cv2.pointPolygonTest(hull, (float(fork[0]), float(fork[1])), True)
        if not inside <= -_BRUSH_ROOM + 1e-6:
            yield (
                f"the {name} brush in the rack stands where other brushes are carried past, or less than "
                f"{_BRUSH_ROOM * 1000:g} mm beside it; put the rack at the edge of the table, its forks open to the "
                "things (rack.slide)"
            )
