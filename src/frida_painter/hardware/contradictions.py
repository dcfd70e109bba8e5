"""What is wrong between the entries of a workspace file, each of which may be right on its own."""

import itertools
import math
from collections.abc import Iterator

import cv2
import numpy as np

from frida_painter.hardware.motion import STIR_RADIUS
from frida_painter.hardware.sections import Bounds, BrushHeights, CanvasPlace, PaintPlaces, RackPlaces, Travel
from frida_painter.hardware.workspace import BrushRack, Point

_DEEPEST = 0.05  # metres from the lightest touch to the hardest press: no brush bends further
_BRUSH_ROOM = 0.02  # metres that everything keeps from a brush in the rack: what is carried there has a width too
_UNEVEN = 0.03  # metres that the lightest touch may lie from where the canvas is said to be


def contradictions(
    bounds: Bounds | None,
    canvas: CanvasPlace | None,
    brush: BrushHeights | None,
    paint: PaintPlaces | None,
    motion: Travel | None,
    rack: RackPlaces | None = None,
) -> list[str]:
    """A sentence for each contradiction between the sections that could be read; None for one that could not."""
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
    """What lies outside the bounds."""
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
    """Things that overlap: what is stirred in one would be in the other as well."""
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
    """Brushes that overlap, or one that another is drawn against."""
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
    """Brushes in the rack that stand where the hand carries another one: between any two things."""
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
    """Metres along y that are needed to either side; a rag is wiped along x."""
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
    """Whether the circle of radius `room` around a place meets the canvas, seen from above."""
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
