"""Strokes from an SVG document of any program, without running or fetching anything that it names.

A first pass by expat refuses all that is no drawing: entities, scripts, pictures, references to other files, documents
of absurd size or depth. Then svgelements resolves units, transforms and styles.
"""

import hashlib
import io
import itertools
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

import cv2
import numpy as np

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import HandInError
from frida_painter.plan import WHITE
from frida_painter.storage import count_of
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
_COLOR = re.compile(r"black|#(?:[0-9a-f]{3,4}|[0-9a-f]{6}|[0-9a-f]{8})|(?:rgb|hsl)a?\([\s\d.,%/+-]+\)", re.IGNORECASE)
_PHYSICAL = {"mm": _PER_INCH / 25.4, "cm": _PER_INCH / 2.54, "in": _PER_INCH, "pt": _PER_INCH / 72, "pc": _PER_INCH / 6}
_LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([a-z%]*)\s*")
_SIDES = (1e-2, 1e6)  # pixels
_SAME = 0.001  # metres by which a page may differ from the canvas
_ASPECT = 0.01  # share by which the proportions of a page without units may differ
_GROUND = 0.99  # share of each side of the page that a ground covers
_CURVE_STEPS = 16
_STEPS = np.arange(1, _CURVE_STEPS + 1) / _CURVE_STEPS
_FULL = 0.75  # least share of its rectangle that a filled shape covers: an ellipse covers 0.785
_HATCH = 0.016  # metres between the strokes that fill a shape, at most: a mark of the broad brush
_OVERLAP = 1.25  # width of these strokes, relative to the distance between them
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_NOT_FINITE = re.compile(r"(?<![a-z])(?:nan|inf(?:inity)?)(?![a-z])", re.IGNORECASE)
_SHAPES = frozenset(("path", "line", "polyline", "polygon", "rect", "circle", "ellipse"))
_PLACES = ("d", "points", "transform", "viewBox", "style", "x", "y", "width", "height", "x1", "y1", "x2", "y2")
_MEASURES = {*_PLACES, "cx", "cy", "r", "rx", "ry", "stroke-width", "opacity", "stroke-opacity", "fill-opacity"}
"""Attributes with numbers; svgelements takes one that is not finite for 0 or 1."""
_REFUSED = {
    "script": "a script",
    "foreignObject": "foreign content",
    "image": "a picture",
    "use": "a reference (use)",
    "animate": "an animation",
    "animateMotion": "an animation",
    "animateTransform": "an animation",
    "set": "an animation",
    "iframe": "a frame",
    "text": "text",
    "pattern": "a pattern",
    "mask": "a mask",
    "marker": "a marker",
    "symbol": "a symbol",
}


def read_svg(content: bytes, name: str, canvas: CanvasSize) -> HandIn:
    """Reads strokes from an SVG document. Raises HandInError; ConfigError if the extra is missing.

    A page in millimetres or inches has the size of the canvas; one in pixels is scaled to it. A first rectangle that
    fills the page is the ground. A filled rectangle or ellipse is a stroke along its longer side, as wide as the other;
    other filled shapes are hatched.
    Parts beyond the page are cut off, as on every screen.
    """
    document = _inspect(content, name)
    page = document.page
    registry.require("benchmark", "svgelements", "Reading an SVG hand-in")
    import svgelements

    scale = page.scale_to(canvas, name)
    try:
        drawing = svgelements.SVG.parse(io.BytesIO(content), reify=True, width=page.width, height=page.height)
        elements = [one for one in drawing.elements() if isinstance(one, svgelements.Shape)]
    except (ValueError, TypeError, AttributeError, IndexError, KeyError, ZeroDivisionError, RecursionError) as error:
        raise HandInError(
            f"{name} has a path, a transform or a style that is no SVG; check its commands and numbers."
        ) from error
    ground, strokes, filled, bars, hatched, points = WHITE, list[DrawnStroke](), 0, 0, 0, 0
    for number, shape in enumerate(elements, 1):
        if str(shape.values.get("visibility", "visible")).strip() != "visible":
            continue
        before = len(strokes)
        for part, paint in (("stroke", shape.stroke), ("fill", shape.fill)):
            if _is_paint(paint) and not _is_known(str(shape.values.get(part, "black")), paint):
                raise HandInError(
                    f"Shape {number} of {name} has the {part} {str(shape.values[part])[:30]!r}, which is no colour; "
                    "write it like #aa3311."
                )
        if _is_paint(shape.stroke):
            filled += int(_is_paint(shape.fill) and shape.values.get("fill") != "black")  # black: by default
            strokes += _strokes_of(shape, number, name, canvas, scale)
        elif number == 1 and _is_paint(shape.fill) and _fills(shape, page):
            ground = _color(shape.fill)
        else:
            found = list(_bars_of(shape, scale, canvas)) if _is_paint(shape.fill) else []
            if not found and shape.values.get("fill") in (None, "none", "black"):
                raise HandInError(
                    f"Shape {number} of {name} has no stroke colour and fills nothing; a brush paints strokes, so give "
                    "each path a stroke and a stroke-width."
                )
            opacity = shape.fill.opacity * _opacity(shape, number, name)
            strokes += [DrawnStroke(*bar, _color(shape.fill), opacity) for bar in found]
            bars += int(len(found) == 1)
            hatched += int(len(found) > 1)
        points += sum(len(stroke.points) for stroke in strokes[before:])
        if len(strokes) > MAX_STROKES or points > MAX_POINTS:
            raise HandInError(
                f"{name} has more than {MAX_STROKES:,} strokes or {MAX_POINTS:,} points; the largest budget is 1,000 "
                "strokes."
            )
    inside, cut, lost = _cut(strokes, canvas)
    if lost > len(strokes) / 2:
        raise HandInError(
            f"{lost} of {len(strokes)} strokes of {name} lie off its page of {canvas}; check its units and viewBox."
        )
    require_strokes(inside, name, canvas)
    remarks = [
        *([f"{count_of(cut, 'stroke')} lost what lay beyond the edge of the page."] if cut else []),
        *([f"{count_of(lost, 'stroke')} left out: beside the page."] if lost else []),
        *([f"{count_of(bars, 'filled shape')} painted along the longer side."] if bars else []),
        *([f"{count_of(hatched, 'filled shape')} hatched, in strokes side by side."] if hatched else []),
        *([f"The clip path of {count_of(document.clipped, 'element')} was ignored."] if document.clipped else []),
        *([f"The fill of {count_of(filled, 'stroke')} was ignored; only outlines are painted."] if filled else []),
    ]
    return HandIn(canvas, hashlib.sha256(content).hexdigest(), tuple(inside), ground, remarks=tuple(remarks))


@dataclass
class _Page:
    """Page of a document in pixels of CSS, which are a 96th of an inch.

    physical: True if its size has a unit of length
    """

    width: float = 0.0
    height: float = 0.0
    physical: bool = False

    def scale_to(self, canvas: CanvasSize, name: str) -> tuple[float, float]:
        """Returns metres to the pixel, across and down. Raises HandInError if the page is not the canvas."""
        if self.physical:
            across, down = self.width * _METRES, self.height * _METRES
            if not max(abs(across - canvas.width), abs(down - canvas.height)) <= _SAME:
                raise HandInError(
                    f"The page of {name} is {across * 1000:.1f} x {down * 1000:.1f} mm, and this picture is painted on "
                    f"{canvas}; draw it in that size, or without units of length."
                )
        elif not abs(self.width / self.height * canvas.height / canvas.width - 1) <= _ASPECT:
            raise HandInError(
                f"The page of {name} is {self.width:g} x {self.height:g}, which has other proportions than the canvas "
                f"of {canvas}; draw it in those."
            )
        return canvas.width / self.width, canvas.height / self.height


@dataclass
class _Inspector:
    """First pass over a document: refuses all that is no drawing, and reads the size of the page."""

    name: str
    page: _Page = field(default_factory=_Page)
    depth: int = 0
    count: int = 0
    shapes: int = 0
    numbers: int = 0
    clipped: int = 0
    in_style: bool = False

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
        if self.in_style and re.search(r"@import|url\(\s*[\"']?(?!#)", data):
            raise self.refuse("a style from elsewhere")

    def _check_attribute(self, key: str, value: str) -> None:
        if len(value) > _MAX_PATH:
            raise self.refuse(f"an attribute {key[:30]} of more than {_MAX_PATH:,} characters")
        if key.lower().startswith("on"):
            raise self.refuse(f"a script ({key[:30]})")
        if (key == "href" and not value.startswith("#")) or re.search(r"url\(\s*[\"']?(?!#)", value):
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
        box = re.split(r"[\s,]+", told)
        if told and not (len(box) == 4 and all(map(_LENGTH.fullmatch, box))):
            raise HandInError(f"The viewBox of {self.name} is {told[:40]!r}; it has four numbers.")
        sides = [float(side) for side in box[2:]] if len(box) == 4 and all(map(_LENGTH.fullmatch, box)) else []
        found: list[tuple[float, bool]] = []
        for index, key in enumerate(("width", "height")):
            match = _LENGTH.fullmatch(attributes.get(key, ""))
            unit = match[2] if match else "%"
            if match is None or unit == "%":
                if not sides:
                    raise HandInError(
                        f"{self.name} has neither {key} nor viewBox; give the page the proportions of the canvas."
                    )
                found.append((sides[index], False))
            elif unit in _PHYSICAL:
                found.append((float(match[1]) * _PHYSICAL[unit], True))
            elif unit in ("", "px"):
                found.append((float(match[1]), False))
            else:
                raise HandInError(f"The {key} of {self.name} is in {unit!r}; use mm, cm, in, pt, pc or px.")
        if not all(_SIDES[0] <= side <= _SIDES[1] for side in (*(side for side, _ in found), *sides)):
            raise HandInError(
                f"The page of {self.name} has a side beyond {_SIDES[0]:g} to {_SIDES[1]:g} pixels; give it the size of "
                "the canvas."
            )
        self.page = _Page(found[0][0], found[1][0], all(physical for _, physical in found))


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


def _is_paint(color: Any) -> bool:
    """Returns True if a stroke or fill of svgelements shows a colour."""
    return color is not None and color.value is not None and color.opacity > 0


def _is_known(text: str, color: Any) -> bool:
    """Returns True if the text of a paint is a colour; svgelements takes an unknown one for black."""
    return bool(_COLOR.fullmatch(text.strip())) or (color.red, color.green, color.blue) != (0, 0, 0)


def _color(color: Any) -> Color:
    return color.red / 255, color.green / 255, color.blue / 255


def _path(shape: Any) -> Any:
    """Returns the path of a shape in pixels of the page, with its transform applied."""
    import svgelements

    path = svgelements.Path(shape)
    path.reify()
    return path


def _fills(shape: Any, page: _Page) -> bool:
    """Returns True if a shape covers the page."""
    box = shape.bbox()
    if box is None:
        return False
    across = min(box[2], page.width) - max(box[0], 0.0)
    down = min(box[3], page.height) - max(box[1], 0.0)
    return bool(across >= _GROUND * page.width and down >= _GROUND * page.height)


def _strokes_of(
    shape: Any, number: int, name: str, canvas: CanvasSize, scale: tuple[float, float]
) -> Iterator[DrawnStroke]:
    """Yields a stroke for each part of a shape that is drawn in one go. Raises HandInError."""
    opacity = shape.stroke.opacity * _opacity(shape, number, name)
    given = shape.implicit_stroke_width
    width = float(1.0 if given is None else given) * (scale[0] + scale[1]) / 2
    for points in _parts_of(_path(shape)):
        if len(points) > 1:
            place = np.stack((points[:, 0] * scale[0], canvas.height - points[:, 1] * scale[1]), -1)
            yield DrawnStroke(place, width, _color(shape.stroke), opacity)


def _bars_of(shape: Any, scale: tuple[float, float], canvas: CanvasSize) -> Iterator[tuple[Points, float]]:
    """Yields lines and their widths in metres that fill a shape.

    A rectangle or an ellipse, at any angle, is one along its longer side. Any other shape is hatched in that
    direction. Holes stay bare (the even-odd rule).
    """
    outlines = [
        np.stack((part[:, 0] * scale[0], canvas.height - part[:, 1] * scale[1]), -1)
        for part in _parts_of(_path(shape))
        if len(part) > 2
    ]
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
        crossed = sorted(
            itertools.chain.from_iterable(_crossings(one - center, along, across, offset) for one in outlines)
        )
        for start, end in zip(crossed[::2], crossed[1::2], strict=False):
            inset = min(width / 4, (end - start) / 2)  # the ends of a stroke are round, and slanting edges are not
            yield center + offset * across + np.outer((start + inset, end - inset), along), _OVERLAP * width


def _crossings(outline: Points, along: Points, across: Points, offset: float) -> list[float]:
    """Returns the places along a line, at an offset from the origin, at which it crosses a closed outline."""
    place, side = outline @ along, outline @ across - offset
    following, beyond = np.roll(place, -1), np.roll(side, -1)
    crosses = (side > 0) != (beyond > 0)
    share = side[crosses] / (side[crosses] - beyond[crosses])
    found: list[float] = (place[crosses] + share * (following[crosses] - place[crosses])).tolist()
    return found


def _parts_of(path: Any) -> list[Points]:
    """Returns the parts of a path that are drawn in one go, as points [k, 2] in pixels of the page."""
    import svgelements

    parts = list[list[tuple[float, float]]]()
    for segment in path:
        if isinstance(segment, svgelements.Move) or not parts:
            if segment.end is not None:
                parts.append([(segment.end.x, segment.end.y)])
            continue
        if segment.start is None or segment.end is None:
            continue
        straight = isinstance(segment, svgelements.Line | svgelements.Close)
        parts[-1] += [(segment.end.x, segment.end.y)] if straight else map(tuple, segment.npoint(_STEPS).tolist())
    return [np.array(part, np.float64) for part in parts]


def _opacity(shape: Any, number: int, name: str) -> float:
    """Returns the opacity of a shape or its group. Raises HandInError."""
    told = str(shape.values.get("opacity", "1"))
    try:
        return float(told.rstrip("%")) / (100 if told.endswith("%") else 1)
    except ValueError as error:
        raise HandInError(f"Shape {number} of {name} has the opacity {told[:20]!r}; it is a number.") from error


def _cut(strokes: list[DrawnStroke], canvas: CanvasSize) -> tuple[list[DrawnStroke], int, int]:
    """Returns the parts of the strokes on the canvas, the number that were cut, and the number that lie beside it."""
    inside, cut, lost = list[DrawnStroke](), 0, 0
    for stroke in strokes:
        runs = list(_runs_inside(stroke.points, canvas))
        whole = len(runs) == 1 and runs[0] is stroke.points
        cut += int(bool(runs) and not whole)
        lost += int(not runs)
        inside += [DrawnStroke(run, stroke.width, stroke.color, stroke.opacity) for run in runs]
    return inside, cut, lost


def _runs_inside(points: Points, canvas: CanvasSize) -> Iterator[Points]:
    """Yields the parts of a line that lie on the canvas; each straight piece is clipped (Liang and Barsky 1984)."""
    high = np.array([canvas.width, canvas.height])
    if not np.isfinite(points).all() or ((points >= 0) & (points <= high)).all():
        yield points  # the check of all strokes names a point that is not finite
        return
    run = list[np.ndarray[Any, np.dtype[np.float64]]]()
    for start, end in itertools.pairwise(points):
        step = end - start
        first, last = 0.0, 1.0
        for axis in range(2):
            if step[axis] == 0:
                if not 0 <= start[axis] <= high[axis]:
                    last = -1.0
                continue
            one, other = sorted((-start[axis] / step[axis], (high[axis] - start[axis]) / step[axis]))
            first, last = max(first, one), min(last, other)
        if first >= last:
            if len(run) > 1:
                yield np.array(run)
            run = []
            continue
        if first > 0 or not run:
            if len(run) > 1:
                yield np.array(run)
            run = [(start + first * step).clip(0, high)]
        run.append((start + last * step).clip(0, high))
        if last < 1:
            yield np.array(run)
            run = []
    if len(run) > 1:
        yield np.array(run)
