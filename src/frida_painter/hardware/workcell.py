"""Workspace files: TOML that describes a person's layout. All faults of a file are reported at once."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Self

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from frida_painter import storage
from frida_painter.calibration import BrushRecord, Calibration
from frida_painter.canvas_size import LARGEST_CANVAS, SMALLEST_CANVAS, CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.gateway import FASTEST
from frida_painter.hardware.motion import STIR_RADIUS
from frida_painter.hardware.robot import ArmLength, BrushRack, Point, Workspace
from frida_painter.palette import MAX_COLORS

# Sections of a workspace file, with their entries and the range of each.

MAX_BRUSHES = 16
"""Greatest number of brushes in a rack."""
FARTHEST = 10.0
"""Greatest coordinate in metres; a larger number means a wrong unit."""

Metre = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]
Position = Annotated[tuple[Metre, Metre, Metre], Field(strict=False)]
Side = Annotated[float, Field(ge=SMALLEST_CANVAS, le=LARGEST_CANVAS, allow_inf_nan=False)]
Speed = Annotated[float, Field(gt=0, le=FASTEST, allow_inf_nan=False)]


class Section(BaseModel):
    """Section of a workspace file: unknown entries are refused, types are strict, values are frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Bounds(Section):
    """Box that the tip never leaves."""

    lower: Position
    upper: Position


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

    places: Annotated[dict[str, Position], Field(min_length=1, max_length=MAX_BRUSHES)]
    slide: Annotated[tuple[Metre, Metre], Field(strict=False)]
    lift: Annotated[float, Field(ge=0.005, le=0.5, allow_inf_nan=False)]


class Travel(Section):
    """Hover height, speeds and home position."""

    hover: Annotated[float, Field(ge=0.005, le=0.5, allow_inf_nan=False)]
    painting_speed: Speed
    travel_speed: Speed
    home: Position | None = None


class ArmReach(Section):
    """Reach of the arm around its shoulder; omitted if it reaches every point within the bounds."""

    shoulder: Position
    nearest: Annotated[float, Field(ge=0, le=FARTHEST, allow_inf_nan=False)]
    farthest: Annotated[float, Field(gt=0, le=FARTHEST, allow_inf_nan=False)]


# Contradictions between entries that are each in range.

_DEEPEST = 0.05  # metres from the lightest touch to the hardest press: the most that a brush bends
_BRUSH_ROOM = 0.02  # metres of distance from a brush in the rack, because a carried brush is wide too
_UNEVEN = 0.03  # metres between the lightest touch and the stated height of the canvas


def contradictions(
    bounds: Bounds | None,
    canvas: CanvasPlace | None,
    brush: BrushHeights | None,
    paint: PaintPlaces | None,
    motion: Travel | None,
    rack: RackPlaces | None = None,
) -> list[str]:
    """Returns a sentence for each contradiction between the sections; None stands for an unreadable section."""
    found: list[str] = []
    if bounds:
        upside_down = [
            f"bounds.lower is not below bounds.upper in {axis} ({low:g} and {high:g} m)"
            for axis, low, high in zip("xyz", bounds.lower, bounds.upper, strict=True)
            if not low < high
        ]
        found += upside_down or [*_outside(bounds, canvas, brush, paint, motion, rack)]
    if brush:
        found += _heights(brush, canvas)
    if paint:
        found += _too_near(paint, canvas)
    if rack:
        found += _in_the_rack(rack) or _in_the_way(rack, canvas, paint, motion)
    if motion and motion.painting_speed > motion.travel_speed:
        found.append(
            f"motion.painting_speed ({motion.painting_speed:g} m/s) is above motion.travel_speed "
            f"({motion.travel_speed:g} m/s)"
        )
    return found


def _outside(
    bounds: Bounds,
    canvas: CanvasPlace | None,
    brush: BrushHeights | None,
    paint: PaintPlaces | None,
    motion: Travel | None,
    rack: RackPlaces | None,
) -> Iterator[str]:
    """Yields a sentence for each place outside the bounds."""
    if canvas:
        for name, place in _corners(canvas).items():
            yield from _beyond(bounds, f"the canvas's {name} corner", place)
    if paint:
        for name, place in _places(paint).items():
            room = paint.rag_width / 2 if name == "the rag" else STIR_RADIUS
            yield from _beyond(bounds, f"{name}, with {room * 1000:g} mm around it,", place, (room, _room_across(name)))
    if brush:
        for name, height in (("touch_height", brush.touch_height), ("press_height", brush.press_height)):
            if not bounds.lower[2] <= height <= bounds.upper[2]:
                yield f"brush.{name} ({height:g} m) is outside the bounds in z ({_span(bounds, 2)})"
    if rack:
        for name, place in rack.places.items():
            yield from _beyond(bounds, f"the {name} brush in the rack", place)
            yield from _beyond(bounds, f"the {name} brush, drawn out of its fork,", _front(rack, name))
    if motion:
        tops = [place[2] for place in _places(paint).values()] if paint else []
        tops += [canvas.corner[2]] if canvas else []
        tops += [brush.touch_height] if brush else []
        tops += [place[2] + rack.lift for place in rack.places.values()] if rack else []
        travel = max(tops, default=bounds.lower[2]) + motion.hover
        if not travel <= bounds.upper[2]:
            yield (
                f"motion.hover ({motion.hover:g} m) above the highest thing is at {travel:g} m, above the upper bound "
                f"({bounds.upper[2]:g} m)"
            )
        if motion.home:
            yield from _beyond(bounds, "motion.home", motion.home)
            if tops and not motion.home[2] >= travel:
                yield f"motion.home is at {motion.home[2]:g} m, below the height of travelling ({travel:g} m)"


def _heights(brush: BrushHeights, canvas: CanvasPlace | None) -> Iterator[str]:
    depth = brush.touch_height - brush.press_height
    if not 0 < depth <= _DEEPEST:
        yield (
            f"brush.press_height ({brush.press_height:g} m) is {depth * 1000:g} mm below brush.touch_height "
            f"({brush.touch_height:g} m); it is above 0 to {_DEEPEST * 1000:g} mm below"
        )
    if canvas and not abs(brush.touch_height - canvas.corner[2]) <= _UNEVEN:
        yield (
            f"brush.touch_height ({brush.touch_height:g} m) is more than {_UNEVEN * 1000:g} mm from the canvas "
            f"(canvas.corner, {canvas.corner[2]:g} m)"
        )


def _too_near(paint: PaintPlaces, canvas: CanvasPlace | None) -> Iterator[str]:
    """Yields a sentence for each pair of overlapping things: stirring in one would reach the other."""
    places = _places(paint)
    stirred = {name: place for name, place in places.items() if name != "the rag"}
    for (one, here), (other, there) in itertools.combinations(stirred.items(), 2):
        apart = math.dist(here[:2], there[:2])
        if not apart >= 2 * STIR_RADIUS:
            yield (
                f"{one} and {other} overlap: they are {apart * 1000:.0f} mm apart, and the brush stirs "
                f"{STIR_RADIUS * 1000:g} mm around"
            )
    x, y, _ = paint.rag
    for name, place in stirred.items():
        if abs(place[0] - x) < paint.rag_width / 2 + STIR_RADIUS and abs(place[1] - y) < 2 * STIR_RADIUS:
            yield f"{name} and the rag overlap"
    if canvas:
        for name, place in places.items():
            room = paint.rag_width / 2 if name == "the rag" else STIR_RADIUS
            if _on_canvas(place, canvas, room):
                yield f"{name} overlaps the canvas"


def _in_the_rack(rack: RackPlaces) -> list[str]:
    """Returns a sentence for each pair of brushes that overlap or collide as one leaves its fork."""
    way = math.hypot(*rack.slide)
    if not way >= _BRUSH_ROOM:
        return [
            f"rack.slide is {way * 1000:.0f} mm long; a brush is clear of its fork {_BRUSH_ROOM * 1000:g} mm from its "
            "place or farther"
        ]
    found: list[str] = []
    for one, other in itertools.permutations(rack.places, 2):
        here, there = (np.array(rack.places[name][:2]) for name in (one, other))
        apart = float(np.linalg.norm(there - here))
        if not apart >= _BRUSH_ROOM:
            if f"the {other} and" not in " ".join(found):
                found.append(
                    f"the {one} and the {other} brush stand in one place: they are {apart * 1000:.0f} mm apart, and a "
                    f"brush needs {_BRUSH_ROOM * 1000:g} mm"
                )
            continue
        along = np.array(rack.slide)
        share = np.clip((there - here) @ along / way**2, 0, 1)
        if not np.linalg.norm(there - here - share * along) >= _BRUSH_ROOM:
            found.append(f"the {one} brush is drawn out of its fork against the {other} brush; turn rack.slide")
    return found


def _in_the_way(
    rack: RackPlaces, canvas: CanvasPlace | None, paint: PaintPlaces | None, motion: Travel | None
) -> Iterator[str]:
    """Yields a sentence for each brush in the rack that stands in the way of carried brushes."""
    things = [_front(rack, name) for name in rack.places]
    things += _corners(canvas).values() if canvas else []
    if paint:
        x, y, z = paint.rag
        half = paint.rag_width / 2
        things += [*paint.wells, paint.water, (x - half, y, z), (x + half, y, z)]
    things += [motion.home] if motion and motion.home else []
    hull = cv2.convexHull(np.array([thing[:2] for thing in things], np.float32))
    for name, place in rack.places.items():
        inside = cv2.pointPolygonTest(hull, (float(place[0]), float(place[1])), True)
        if not inside <= -_BRUSH_ROOM + 1e-6:
            yield (
                f"the {name} brush in the rack stands where other brushes are carried past, or less than "
                f"{_BRUSH_ROOM * 1000:g} mm beside it; put the rack at the edge of the table, its forks open to the "
                "things (rack.slide)"
            )


def _front(rack: RackPlaces, brush: str) -> Point:
    return BrushRack(rack.places, rack.slide, rack.lift).front(brush)


def _places(paint: PaintPlaces) -> dict[str, Point]:
    wells = {f"well {number}": place for number, place in enumerate(paint.wells, 1)}
    return {**wells, "the water": paint.water, "the rag": paint.rag}


def _room_across(name: str) -> float:
    """Returns the metres needed on each side along y; none for the rag, which is wiped along x."""
    return 0.0 if name == "the rag" else STIR_RADIUS


def _corners(canvas: CanvasPlace) -> dict[str, Point]:
    cos, sin = math.cos(math.radians(canvas.turn)), math.sin(math.radians(canvas.turn))
    x, y, z = canvas.corner
    ends = {
        "bottom-left": (0.0, 0.0),
        "bottom-right": (canvas.width, 0.0),
        "top-right": (canvas.width, canvas.height),
        "top-left": (0.0, canvas.height),
    }
    return {name: (x + cos * u - sin * v, y + sin * u + cos * v, z) for name, (u, v) in ends.items()}


def _on_canvas(place: Point, canvas: CanvasPlace, room: float) -> bool:
    """Returns True if the circle of radius `room` around a place meets the canvas, seen from above."""
    cos, sin = math.cos(math.radians(canvas.turn)), math.sin(math.radians(canvas.turn))
    x, y = place[0] - canvas.corner[0], place[1] - canvas.corner[1]
    over = np.array([cos * x + sin * y, -sin * x + cos * y])
    nearest = np.clip(over, 0, (canvas.width, canvas.height))
    return float(np.linalg.norm(over - nearest)) < room


def _beyond(bounds: Bounds, name: str, place: Point, room: tuple[float, float] = (0.0, 0.0)) -> Iterator[str]:
    for axis, around in enumerate((*room, 0.0)):
        if not bounds.lower[axis] + around <= place[axis] <= bounds.upper[axis] - around:
            yield f"{name} is outside the bounds in {'xyz'[axis]} ({place[axis]:g} m; {_span(bounds, axis)})"


def _span(bounds: Bounds, axis: int) -> str:
    return f"they reach from {bounds.lower[axis]:g} to {bounds.upper[axis]:g} m"


_MAX_BYTES = 2**18
_ADVICE = "`frida-painter workspace example` prints a whole one with comments"

_SECTIONS: dict[str, type[Section]] = {
    "bounds": Bounds,
    "canvas": CanvasPlace,
    "brush": BrushHeights,
    "paint": PaintPlaces,
    "rack": RackPlaces,
    "motion": Travel,
    "arm": ArmReach,
}
_OPTIONAL = ("rack", "arm")


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
        faults: list[str] = []
        easel = values.get("easel")
        if "easel" not in values:
            faults.append("easel (its name) is missing")
        elif not isinstance(easel, str) or not 1 <= len(easel.strip()) <= 60 or not easel.isprintable():
            faults.append(f"easel is {_shortly(easel)}; it is a name in quotes of 1 to 60 characters")
        known = ", ".join(("easel", *(f"[{section}]" for section in _SECTIONS)))
        faults += [
            f"{_shortly(entry)} is not known; there are {known}"
            for entry in values
            if entry != "easel" and entry not in _SECTIONS
        ]
        read: dict[str, Any] = {}
        for section, model in _SECTIONS.items():
            try:
                read[section] = model.model_validate(values[section]) if section in values else None
            except ValidationError as error:
                read[section] = None
                faults += [_sentence(section, model, fault) for fault in error.errors()]
            if section not in values and section not in _OPTIONAL:
                faults.append(f"[{section}] is missing, with {', '.join(_list_wanted(model))}")
        faults += contradictions(
            read["bounds"], read["canvas"], read["brush"], read["paint"], read["motion"], read["rack"]
        )
        arm = read["arm"]
        if arm and not arm.nearest < arm.farthest:
            faults.append(f"arm.nearest ({arm.nearest:g} m) is not below arm.farthest ({arm.farthest:g} m)")
        if faults:
            raise ConfigError(f"{name} is no workspace: {'; '.join(faults)}. ({advice[0].upper()}{advice[1:]}.)")
        return cls._put_together(str(easel), **read)

    @classmethod
    def _put_together(
        cls,
        easel: str,
        bounds: Bounds,
        canvas: CanvasPlace,
        brush: BrushHeights,
        paint: PaintPlaces,
        rack: RackPlaces | None,
        motion: Travel,
        arm: ArmReach | None,
    ) -> Self:
        workspace = Workspace(
            lower=bounds.lower,
            upper=bounds.upper,
            canvas_origin=canvas.corner,
            canvas_angle=math.radians(canvas.turn),
            wells=paint.wells,
            water=paint.water,
            rag=paint.rag,
            rag_width=paint.rag_width,
            hover=motion.hover,
            painting_speed=motion.painting_speed,
            travel_speed=motion.travel_speed,
            home=motion.home,
            rack=BrushRack(rack.places, rack.slide, rack.lift) if rack else None,
        )
        size = CanvasSize(canvas.width, canvas.height)
        reach = ArmLength(arm.shoulder, arm.nearest, arm.farthest) if arm else None
        return cls(easel, workspace, size, brush.touch_height, brush.press_height, reach)


def example() -> str:
    """Returns a complete, commented workspace file as a template."""
    return (resources.files("frida_painter.hardware") / "examples" / "workspace.toml").read_text(encoding="utf-8")


def _list_wanted(model: type[Section]) -> list[str]:
    return [name for name, field in model.model_fields.items() if field.is_required()]


def _sentence(section: str, model: type[Section], fault: Any) -> str:
    """Returns one of pydantic's faults in plain words."""
    where = section + "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"])
    match fault["type"]:
        case "missing" if isinstance(fault["loc"][-1], int):
            return f"{where} is missing; {_form(fault)}"
        case "missing":
            return f"{where} is missing"
        case "extra_forbidden":
            known = ", ".join(model.model_fields)
            return f"{where[:60]} is not known; [{section}] has {known}"
        case "too_long" if fault["ctx"]["max_length"] <= 3:
            return f"{where} has more than {fault['ctx']['max_length']} numbers; {_form(fault)}"
        case "too_long":
            return f"{where} has more than {fault['ctx']['max_length']} places"
        case "dict_type":
            return f"{where} is {_shortly(fault['input'])}; it names brushes with their places, {{broad = [x, y, z]}}"
        case "too_short":
            return f"{where} is empty; name at least one place"
        case "finite_number" | "greater_than" | "greater_than_equal" | "less_than" | "less_than_equal":
            return f"{where} is {_shortly(fault['input'])}; {_range(model, fault['loc'])}"
        case "tuple_type":
            return f"{where} is {_shortly(fault['input'])}; it is a list of numbers in [ ]"
        case _ if not fault["loc"]:
            return f"{section} is {_shortly(fault['input'])}; write it as a section, [{section}]"
        case _:
            return f"{where} is {_shortly(fault['input'])}; it is a number, {_range(model, fault['loc'])}"


def _form(fault: Any) -> str:
    return "a way is [x, y]" if fault["loc"][0] == "slide" else "a place is [x, y, z]"


def _range(model: type[Section], place: tuple[Any, ...]) -> str:
    """Returns the range of a number in words."""
    field = model.model_fields[place[0]]
    if len(place) > 1:
        return f"allowed is from {-FARTHEST:g} to {FARTHEST:g} metres"
    bounds = {
        name: getattr(part, name) for part in field.metadata for name in ("ge", "gt", "le") if hasattr(part, name)
    }
    least = f"above {bounds['gt']:g}" if "gt" in bounds else f"from {bounds['ge']:g}"
    unit = {"turn": "degrees", "painting_speed": "m/s", "travel_speed": "m/s"}.get(place[0], "metres")
    return f"allowed is {least} to {bounds['le']:g} {unit}"


def _shortly(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
