"""Strokes from an SVG document of any program, without running or fetching anything that it names.

A first pass by expat refuses all that is no drawing: entities, scripts, pictures, references to other files, documents
of absurd size or depth. Then svgelements resolves units, transforms and styles.
"""

import io
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from xml.parsers import expat

import cv2
import numpy as np

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import HandInError
from frida_painter.strokes.plan import WHITE
from frida_painter.system.storage import count_of
from frida_painter_lab.benchmark.hand_in import (
    MAX_POINTS,
    MAX_STROKES,
    Color,
    DrawnStroke,
    HandIn,
    Points,
    require_strokes,
)

_MAX_ELEMENTS = 60_000
_MAX_DEPTH = 64
_MAX_PATH = 2**18  # characters of one attribute
_PER_INCH = 96.0  # pixels of CSS
_METRES = 0.0254 / _PER_INCH
_PIXELS = {
    "": 1.0, "px": 1.0, "mm": _PER_INCH / 25.4, "cm": _PER_INCH / 2.54, "in": _PER_INCH, "pt": _PER_INCH / 72,
    "pc": _PER_INCH / 6,
}  # fmt: skip
_SIDES = (1e-2, 1e6)  # pixels
_SAME = 0.001  # metres by which a page may differ from the canvas
_ASPECT = 0.01  # share by which the proportions of a page without units may differ
_GROUND = 0.99  # share of each side of the page that a ground covers
_STEPS = np.arange(1, 17) / 16  # parameters of the points of a curve
_FULL = 0.75  # least share of its rectangle that a filled shape covers: an ellipse covers 0.785
_HATCH = 0.016  # metres between the strokes that fill a shape, at most: a mark of the broad brush
_OVERLAP = 1.25  # width of these strokes, relative to the distance between them
_COLOR = re.compile(r"black|#(?:[0-9a-f]{3,4}|[0-9a-f]{6}|[0-9a-f]{8})|(?:rgb|hsl)a?\([\s\d.,%/+-]+\)", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_LENGTH = re.compile(rf"\s*({_NUMBER.pattern})\s*([a-z%]*)\s*")
_NOT_FINITE = re.compile(r"(?<![a-z])(?:nan|inf(?:inity)?)(?![a-z])", re.IGNORECASE)
_ELSEWHERE = re.compile(r"url\(\s*[\"']?(?!#)")
_SHAPES = frozenset(("path", "line", "polyline", "polygon", "rect", "circle", "ellipse"))
_MEASURES = frozenset((
    "d", "points", "transform", "viewBox", "style", "x", "y", "width", "height", "x1", "y1", "x2", "y2", "cx", "cy",
    "r", "rx", "ry", "stroke-width", "opacity", "stroke-opacity", "fill-opacity",
))  # fmt: skip
"""Attributes with numbers; svgelements takes one that is not finite for 0 or 1."""
_REFUSED = {
    "script": "a script", "foreignObject": "foreign content", "image": "a picture", "use": "a reference (use)",
    "animate": "an animation", "animateMotion": "an animation", "animateTransform": "an animation",
    "set": "an animation", "iframe": "a frame", "text": "text", "pattern": "a pattern", "mask": "a mask",
    "marker": "a marker", "symbol": "a symbol",
}  # fmt: skip


def read_svg(content: bytes, name: str, canvas: CanvasSize) -> HandIn:
    """Reads strokes from an SVG document. Raises HandInError; ConfigError if the extra is missing.

    A page in millimetres or inches has the size of the canvas; one in pixels is scaled to it. A first rectangle that
    fills the page is the ground. A filled rectangle or ellipse is a stroke along its longer side, as wide as the other;
    other filled shapes are hatched. Parts beyond the page are cut off, as on every screen.
    """
    document = _inspect(content, name)
    registry.require("benchmark", "svgelements", "Reading an SVG hand-in")
    import svgelements

    across, down = document.width * _METRES, document.height * _METRES
    if document.physical and not max(abs(across - canvas.width), abs(down - canvas.height)) <= _SAME:
        raise HandInError(
            f"The page of {name} is {across * 1000:.1f} x {down * 1000:.1f} mm, and this picture is painted on "
            f"{canvas}; draw it in that size, or without units of length."
        )
    if not document.physical and not abs(across / down * canvas.height / canvas.width - 1) <= _ASPECT:
        raise HandInError(
            f"The page of {name} is {document.width:g} x {document.height:g}, which has other proportions than the "
            f"canvas of {canvas}; draw it in those."
        )
    try:
        drawing = svgelements.SVG.parse(io.BytesIO(content), reify=True, width=document.width, height=document.height)
        shapes = [one for one in drawing.elements() if isinstance(one, svgelements.Shape)]
    except (ValueError, TypeError, AttributeError, IndexError, KeyError, ZeroDivisionError, RecursionError) as error:
        raise HandInError(
            f"{name} has a path, a transform or a style that is no SVG; check its commands and numbers."
        ) from error
    ground, strokes, remarks = _draw(shapes, document, canvas)
    corner, inside, cut, lost = np.array([canvas.width, canvas.height]), list[DrawnStroke](), 0, 0
    for stroke in strokes:
        within = ((stroke.points >= 0) & (stroke.points <= corner)).all()
        if within or not np.isfinite(stroke.points).all():  # the check of all strokes names a point that is not finite
            inside.append(stroke)
            continue
        parts = _clip(stroke.points, corner)
        cut, lost = cut + bool(parts), lost + (not parts)
        inside += [replace(stroke, points=part) for part in parts]
    if lost > len(strokes) / 2:
        raise HandInError(
            f"{lost} of {len(strokes)} strokes of {name} lie off its page of {canvas}; check its units and viewBox."
        )
    require_strokes(inside, name, canvas)
    beyond = ((cut, "lost what lay beyond the edge of the page"), (lost, "left out: beside the page"))
    told = [f"{count_of(count, 'stroke')} {what}." for count, what in beyond if count]
    return HandIn(canvas, tuple(inside), ground, remarks=(*told, *remarks))


@dataclass
class _Inspector:
    """First pass over a document: refuses all that is no drawing, and reads the size of the page.

    width, height: of the page in pixels of CSS, which are a 96th of an inch
    physical: True if that size has a unit of length
    """

    name: str
    width: float = field(default=0.0, init=False)
    height: float = field(default=0.0, init=False)
    physical: bool = field(default=False, init=False)
    depth: int = field(default=0, init=False)
    count: int = field(default=0, init=False)
    shapes: int = field(default=0, init=False)
    numbers: int = field(default=0, init=False)
    clipped: int = field(default=0, init=False)
    in_style: bool = field(default=False, init=False)

    def refuse(self, what: str) -> HandInError:
        return HandInError(f"{self.name} has {what}, which is not read; hand in paths alone, with their strokes.")

    def doctype(self, _name: str, _system: str | None, _public: str | None, internal: int) -> None:
        if internal:
            raise self.refuse("a DOCTYPE with declarations")

    def entity(self, *_: object) -> None:
        raise self.refuse("entities")

    def instruction(self, target: str, _data: str) -> None:
        if target != "xml":
            raise self.refuse(f"the instruction {target[:30]}")

    def start(self, tag: str, attributes: Mapping[str, str]) -> None:
        local = tag.rpartition(":")[2]
        self.depth, self.count = self.depth + 1, self.count + 1
        if self.depth > _MAX_DEPTH:
            raise self.refuse(f"elements in more than {_MAX_DEPTH} others")
        if self.count > _MAX_ELEMENTS:
            raise self.refuse(f"more than {_MAX_ELEMENTS:,} elements")
        if self.count == 1:
            if local != "svg":
                raise HandInError(f"{self.name} is no SVG: its root is {local[:30]!r}; hand in an SVG document.")
            self._read_page(attributes)
        elif local == "svg":
            raise self.refuse("another SVG within it")
        if local in _REFUSED:
            raise self.refuse(_REFUSED[local])
        self.shapes += local in _SHAPES
        if self.shapes > MAX_STROKES:
            raise HandInError(f"{self.name} has more than {MAX_STROKES:,} strokes; the largest budget is 1,000.")
        self.in_style = local == "style"
        for key, value in attributes.items():
            self._check_attribute(key.rpartition(":")[2], value)

    def end(self, _tag: str) -> None:
        self.depth -= 1
        self.in_style = False

    def text(self, data: str) -> None:
        if self.in_style and ("@import" in data or _ELSEWHERE.search(data)):
            raise self.refuse("a style from elsewhere")

    def _check_attribute(self, key: str, value: str) -> None:
        if len(value) > _MAX_PATH:
            raise self.refuse(f"an attribute {key[:30]} of more than {_MAX_PATH:,} characters")
        if key.lower().startswith("on"):
            raise self.refuse(f"a script ({key[:30]})")
        if (key == "href" and not value.startswith("#")) or _ELSEWHERE.search(value):
            raise self.refuse("a reference to another file")
        if key in _MEASURES and _NOT_FINITE.search(value):
            raise HandInError(f"{self.name} has the {key} {value[:30]!r}, which is not finite; give finite numbers.")
        if key in ("d", "points"):  # counted before anything is built of them
            self.numbers += len(_NUMBER.findall(value))
            if self.numbers > 2 * MAX_POINTS:
                raise HandInError(f"{self.name} has more than {MAX_POINTS:,} points; make its paths simpler.")
        self.clipped += key == "clip-path" or (key == "style" and "clip-path" in value)

    def _read_page(self, attributes: Mapping[str, str]) -> None:
        told = attributes.get("viewBox", "").strip()
        box = re.split(r"[\s,]+", told) if told else []
        if told and not (len(box) == 4 and all(map(_NUMBER.fullmatch, box))):
            raise HandInError(f"The viewBox of {self.name} is {told[:40]!r}; it has four numbers.")
        view, found, units = [float(side) for side in box[2:]], list[float](), list[str]()
        for index, key in enumerate(("width", "height")):
            match = _LENGTH.fullmatch(attributes.get(key, ""))
            if match is None or match[2] == "%":
                if not view:
                    raise HandInError(
                        f"{self.name} has neither {key} nor viewBox; give the page the proportions of the canvas."
                    )
                found.append(view[index])
                units.append("")
            elif match[2] in _PIXELS:
                found.append(float(match[1]) * _PIXELS[match[2]])
                units.append(match[2])
            else:
                raise HandInError(f"The {key} of {self.name} is in {match[2]!r}; use mm, cm, in, pt, pc or px.")
        if not all(_SIDES[0] <= side <= _SIDES[1] for side in (*found, *view)):
            raise HandInError(
                f"The page of {self.name} has a side beyond {_SIDES[0]:g} to {_SIDES[1]:g} pixels; give it the size of "
                "the canvas."
            )
        (self.width, self.height), self.physical = found, not {"", "px"} & set(units)


def _inspect(content: bytes, name: str) -> _Inspector:
    """Returns what a first pass found in a document. Raises HandInError if it is cut off or is no drawing."""
    inspector, parser = _Inspector(name), expat.ParserCreate()
    parser.StartDoctypeDeclHandler = inspector.doctype
    parser.EntityDeclHandler = inspector.entity
    parser.ProcessingInstructionHandler = inspector.instruction
    parser.StartElementHandler = inspector.start
    parser.EndElementHandler = inspector.end
    parser.CharacterDataHandler = inspector.text
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise HandInError(
            f"{name} is cut off or is no XML ({expat.ErrorString(error.code)}, line {error.lineno}); hand in the whole "
            "file."
        ) from error
    except LookupError as error:
        raise HandInError(f"{name} is in an unknown encoding; save it in UTF-8.") from error
    return inspector


def _draw(
    shapes: Sequence[Any], document: _Inspector, canvas: CanvasSize
) -> tuple[Color, list[DrawnStroke], list[str]]:
    """Returns the ground, the strokes of all shapes of svgelements, and remarks. Raises HandInError."""
    name, scale = document.name, (canvas.width / document.width, canvas.height / document.height)
    ground, strokes, points, ignored, bars, hatched = WHITE, list[DrawnStroke](), 0, 0, 0, 0
    for number, shape in enumerate(shapes, 1):
        if str(shape.values.get("visibility", "visible")).strip() != "visible":
            continue
        outlined, full = (_shows(shape, part, number, name) for part in ("stroke", "fill"))
        if number == 1 and full and not outlined and _fills(shape, document):
            ground = _color(shape.fill)
            continue
        lines = [line * (scale[0], -scale[1]) + (0, canvas.height) for line in _lines_of(shape)]
        given, by_default = shape.values.get("fill"), (None, "none", "black")
        if outlined:
            width = float(1.0 if shape.implicit_stroke_width is None else shape.implicit_stroke_width) * sum(scale) / 2
            found = [(line, width) for line in lines if len(line) > 1]
            ignored += full and given != "black"
        else:
            found = list(_bars_of([line for line in lines if len(line) > 2])) if full else []
            if not found and given in by_default:
                raise HandInError(
                    f"Shape {number} of {name} has no stroke colour and fills nothing; a brush paints strokes, so give "
                    "each path a stroke and a stroke-width."
                )
            bars, hatched = bars + (len(found) == 1), hatched + (len(found) > 1)
        paint, told = shape.stroke if outlined else shape.fill, str(shape.values.get("opacity", "1"))
        try:
            opacity = float(told.rstrip("%")) / (100 if told.endswith("%") else 1)
        except ValueError as error:
            raise HandInError(f"Shape {number} of {name} has the opacity {told[:20]!r}; it is a number.") from error
        strokes += [DrawnStroke(*line, _color(paint), paint.opacity * opacity) for line in found]
        points += sum(len(line) for line, _ in found)
        if len(strokes) > MAX_STROKES or points > MAX_POINTS:
            raise HandInError(
                f"{name} has more than {MAX_STROKES:,} strokes or {MAX_POINTS:,} points; the largest budget is 1,000 "
                "strokes."
            )
    counts = (
        (bars, "filled shape", "{} painted along the longer side."),
        (hatched, "filled shape", "{} hatched, in strokes side by side."),
        (document.clipped, "element", "The clip path of {} was ignored."),
        (ignored, "stroke", "The fill of {} was ignored; only outlines are painted."),
    )
    return ground, strokes, [told.format(count_of(count, what)) for count, what, told in counts if count]


def _shows(shape: Any, part: str, number: int, name: str) -> bool:
    """Returns True if the stroke or fill of a shape shows a colour. Raises HandInError for an unknown colour."""
    paint, told = getattr(shape, part), str(shape.values.get(part, "black"))
    if paint is None or paint.value is None or not paint.opacity > 0:
        return False
    if _color(paint) == (0, 0, 0) and not _COLOR.fullmatch(told.strip()):  # svgelements takes an unknown one for black
        raise HandInError(
            f"Shape {number} of {name} has the {part} {told[:30]!r}, which is no colour; write it like #aa3311."
        )
    return True


def _color(paint: Any) -> Color:
    return paint.red / 255, paint.green / 255, paint.blue / 255


def _fills(shape: Any, page: _Inspector) -> bool:
    """Returns True if a shape covers the page."""
    box = shape.bbox()
    if box is None:
        return False
    across, down = min(box[2], page.width) - max(box[0], 0.0), min(box[3], page.height) - max(box[1], 0.0)
    return bool(across >= _GROUND * page.width and down >= _GROUND * page.height)


def _lines_of(shape: Any) -> list[Points]:
    """Returns the parts of a shape that are drawn in one go, as points [k, 2] in pixels of the page."""
    import svgelements

    path = svgelements.Path(shape)
    path.reify()
    lines = list[list[tuple[float, float]]]()
    for segment in path:
        if isinstance(segment, svgelements.Move) or not lines:
            if segment.end is not None:
                lines.append([(segment.end.x, segment.end.y)])
        elif segment.start is not None and segment.end is not None:
            straight = isinstance(segment, svgelements.Line | svgelements.Close)
            lines[-1] += [(segment.end.x, segment.end.y)] if straight else map(tuple, segment.npoint(_STEPS).tolist())
    return [np.array(line, np.float64) for line in lines]


def _bars_of(outlines: Sequence[Points]) -> Iterator[tuple[Points, float]]:
    """Yields lines and their widths in metres that fill a shape.

    A rectangle or an ellipse, at any angle, is one along its longer side. Any other shape is hatched in that
    direction. Holes stay bare (the even-odd rule).
    """
    if not outlines or not all(np.isfinite(outline).all() for outline in outlines):
        return
    middle, sides, degrees = cv2.minAreaRect((np.concatenate(outlines) * 1000).astype(np.float32))
    long, short = max(sides) / 1000, min(sides) / 1000
    if not short > 0:
        return
    angle = np.deg2rad(degrees + (0 if sides[0] >= sides[1] else 90))
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    center = np.array(middle) / 1000
    if len(outlines) == 1 and cv2.contourArea((outlines[0] * 1000).astype(np.float32)) / 1e6 >= _FULL * long * short:
        half = (long - short) / 2 * along
        yield np.stack((center - half, center + half)), short
        return
    count = max(2, math.ceil(short / _HATCH))
    width = short / count
    for offset in (np.arange(count) - (count - 1) / 2) * width:
        crossings = list[float]()
        for outline in outlines:
            place, side = (outline - center) @ along, (outline - center) @ across - offset
            following, beyond = np.roll(place, -1), np.roll(side, -1)
            crosses = (side > 0) != (beyond > 0)
            share = side[crosses] / (side[crosses] - beyond[crosses])
            crossings += (place[crosses] + share * (following[crosses] - place[crosses])).tolist()
        crossings.sort()
        for start, end in zip(crossings[::2], crossings[1::2], strict=False):
            inset = min(width / 4, (end - start) / 2)  # the ends of a stroke are round, and slanting edges are not
            yield center + offset * across + np.outer((start + inset, end - inset), along), _OVERLAP * width


def _clip(points: Points, corner: Points) -> list[Points]:
    """Returns the parts of a line between (0, 0) and a corner; each straight piece is clipped (Liang, Barsky 1984)."""
    parts, joined = list[list[Points]](), False
    for start, end in itertools.pairwise(points):
        step = end - start
        first, last = 0.0, 1.0
        for axis in range(2):
            if step[axis] != 0:
                one, other = sorted((-start[axis] / step[axis], (corner[axis] - start[axis]) / step[axis]))
                first, last = max(first, one), min(last, other)
            elif not 0 <= start[axis] <= corner[axis]:
                last = -1.0
        if first < last:
            if first > 0 or not joined:
                parts.append([start + first * step])
            parts[-1].append(start + last * step)
        joined = first < last
    return [np.array(part).clip(0, corner) for part in parts]
