"""From drawn strokes to a plan: brush and press for each width, brush strokes along each path, paints, and an order.

Nothing is improved: a system is judged by its own strokes. Remarks tell each change that a brush needs.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import KINDS, StrokeModel
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import HandInError
from frida_painter.mixing.recipe import PaintSet
from frida_painter.planning.mixable import make_mixable
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Layer, Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes
from frida_painter.system.storage import count_of
from frida_painter_lab.benchmark.hand_in import DrawnStroke, HandIn, Points, draw
from frida_painter_lab.benchmark.suite import Budget
from frida_painter_lab.soft_strokes import MarkSizes

_ROWS = 256  # of the picture in which colours under transparent paint are found
_ROUND_END = 3**0.5 / 2  # share of the radius at which a round end is half as wide as the line
_OFF = 0.25  # of its width, by which a brush stroke may leave the path before it is split
_MIN_OFF = 0.0008  # metres
_STRAIGHT = 0.75  # least distance of the ends as a share of the way, for one brush stroke
_MAX_LAYERS = 4
_APART = 1.0  # CIEDE2000
_MOVED = 0.001  # metres that count as moved
_NARROW = 1.25  # factor by which a mark may be wider than wanted before that is told
_OVERHANG = 0.15  # share of a mark by which a path may be wider before it is painted in one more lane
_WORTH = 0.03  # mean logarithm of widths by which a further brush must come nearer
_OVER = 0.05  # share of the longest stroke by which a part may be longer, and is then cut
_DOT = 1e-6  # metres: half the length of a path that is a point


@dataclass(frozen=True)
class PathPiece:
    """Brush stroke for a part of a drawn stroke.

    source: number of the drawn stroke
    brush: name of the brush
    width: of the mark, metres
    start [2], angle, length, bend, thickness: as in Strokes
    """

    source: int
    brush: str
    width: float
    start: NDArray[np.float64]
    angle: float
    length: float
    bend: float
    thickness: float


@dataclass(frozen=True)
class Brush:
    """Brush with the sizes of its marks and its limits on this canvas."""

    name: str
    limits: StrokeLimits
    sizes: MarkSizes

    def width_error(self, width: float) -> float:
        """Returns how far the nearest mark is from a width, as a logarithm of their ratio."""
        return abs(math.log(width / min(max(width, self.sizes.width[0]), self.sizes.width[-1])))


def fit_hand_in(
    drawing: HandIn, budget: Budget, seed: int, models: Mapping[str, StrokeModel] | None = None
) -> tuple[Plan, tuple[str, ...]]:
    """Returns the plan of drawn strokes within a budget of strokes and paints, and remarks on all changes.

    seed: for the clusters of colours
    models: stroke models by brush; None: those of the project

    Each width becomes the brush and the press whose mark is nearest to it. A path becomes brush strokes: it is split
    where it is longer than the brush's longest stroke or leaves the arc of a stroke. Transparent paint gets the colour
    that it shows. Colours become at most `budget.paints` that can be mixed. Strokes that do not touch may change
    places, so that paints and brushes change rarely. Raises HandInError if nothing can be painted.
    """
    if drawing.plan is not None:
        return _within_budget(drawing.plan, budget)
    brushes = find_brushes(drawing.canvas, models)
    for names in _brush_sets(drawing.strokes, brushes):
        chosen = [_choose(stroke.width, [brushes[name] for name in names]) for stroke in drawing.strokes]
        pairs = enumerate(zip(drawing.strokes, chosen, strict=True))
        every = itertools.chain.from_iterable(_pieces(number, *pair) for number, pair in pairs)
        pieces = list(itertools.islice(every, budget.strokes + 1))
        if not pieces:
            raise HandInError("None of the strokes has a length; give each at least two points that differ.")
        whole, pieces = len(pieces) <= budget.strokes, pieces[: budget.strokes]
        color, told = _colors(drawing, pieces)
        plan, remarks = assemble(pieces, color, brushes, drawing, budget.paints, seed)
        if len(plan.layers) <= _MAX_LAYERS:
            break
    painted = pieces[-1].source + 1
    if not whole:
        told.append(
            f"The budget of {budget.strokes} brush strokes was used up by {painted} of {len(drawing.strokes)} strokes, "
            "from the first on."
        )
    elif len(pieces) > len(drawing.strokes):
        told.append(f"{count_of(len(drawing.strokes), 'stroke')} became {len(pieces)} brush strokes.")
    told += remarks
    fitted = list(zip(drawing.strokes[:painted], chosen, strict=False))
    if thin := sum(stroke.width * _NARROW < brush.sizes.width[0] for stroke, brush in fitted):
        told.append(f"{count_of(thin, 'stroke')} thinner than any mark of the brushes got the thinnest.")
    if wide := sum(stroke.width > (1 + _OVERHANG) * brush.sizes.width[-1] for stroke, brush in fitted):
        told.append(f"{count_of(wide, 'stroke')} wider than any mark became lanes, side by side.")
    return plan, (*drawing.remarks, *told)


def assemble(
    pieces: Sequence[PathPiece], color: Tensor, brushes: Mapping[str, Brush], drawing: HandIn, paints: int, seed: int
) -> tuple[Plan, list[str]]:
    """Returns the plan of brush strokes on the canvas and ground of a drawing, and remarks on paints and places.

    color [n, 3]: wanted sRGB of each
    paints: greatest number of paints
    """
    weight = torch.tensor([piece.length * piece.width for piece in pieces])
    palette, paint, remarks = _palette(color, weight, paints, seed)
    order, runs = _schedule(pieces, paint)
    pieces, paint = [pieces[index] for index in order], paint[order]
    numbers = ("angle", "length", "bend", "thickness")
    column = {name: torch.tensor([getattr(piece, name) for piece in pieces]).float() for name in numbers}
    position = torch.from_numpy(np.stack([piece.start for piece in pieces])).float()
    wanted = Strokes(position, **column, color=palette.color[paint], taught=None)
    parts, at = list[Strokes](), 0
    for brush, count in runs:
        parts.append(wanted[at : at + count].project(brushes[brush].limits, drawing.canvas))
        at += count
    fitted = Strokes.join(*parts)
    if moved := int(((fitted.position - wanted.position).norm(dim=1) > _MOVED).sum()):
        remarks.append(
            f"{count_of(moved, 'brush stroke')} moved by more than {_MOVED * 1000:g} mm to lie on the canvas."
        )
    layers = tuple(Layer(count, brush, brushes[brush].limits, (0, len(palette))) for brush, count in runs)
    return Plan(fitted, palette, paint, drawing.canvas, layers, drawing.ground), remarks


def _within_budget(plan: Plan, budget: Budget) -> tuple[Plan, tuple[str, ...]]:
    """Returns the first strokes of a plan that the budget allows. Raises HandInError if it has too many paints."""
    if len(plan.palette) > budget.paints:
        raise HandInError(
            f"The plan has {len(plan.palette)} paints, and the budget is {budget.paints}; plan it with fewer "
            "(--colors), and the same in all layers (--no-new-paints)."
        )
    if len(plan) <= budget.strokes:
        return plan, ()
    remark = f"The budget is {budget.strokes} strokes: the first of {len(plan)} are painted."
    return plan.part(slice(0, budget.strokes)), (remark,)


def find_brushes(size: CanvasSize, models: Mapping[str, StrokeModel] | None = None) -> dict[str, Brush]:
    """Returns the brushes of the project, or those of the given stroke models, for this canvas."""
    known = models or {kind.name: load_stroke_model(kind.name) for kind in KINDS}
    return {name: Brush(name, model.limits.within(size), MarkSizes.of(model)) for name, model in known.items()}


def _brush_sets(strokes: Sequence[DrawnStroke], brushes: Mapping[str, Brush]) -> list[tuple[str, ...]]:
    """Returns sets of brushes to try: all, the best two, the best one; fewer brushes need fewer layers."""

    def error(names: tuple[str, ...]) -> float:
        return sum(min(brushes[name].width_error(stroke.width) for name in names) for stroke in strokes)

    found = [min(itertools.combinations(brushes, count), key=error) for count in range(len(brushes), 0, -1)]
    kept = [found[-1]]
    for names in reversed(found[:-1]):  # a further brush must be worth its change
        if error(names) < error(kept[0]) - _WORTH * len(strokes):
            kept.insert(0, names)
    return kept


def _choose(width: float, brushes: Sequence[Brush]) -> Brush:
    """Returns the brush with the mark nearest to a width; of several, the one that paints it with a middle press."""

    def cost(brush: Brush) -> tuple[float, float]:
        press = float(np.interp(width, brush.sizes.width, brush.sizes.thickness))
        return round(brush.width_error(width), 3), abs(press - 0.5)

    return min(brushes, key=cost)


def _pieces(number: int, stroke: DrawnStroke, brush: Brush) -> Iterator[PathPiece]:
    """Yields the brush strokes along a path, in its direction; a wide path is painted in lanes, side by side."""
    path = stroke.points[np.r_[True, np.any(np.diff(stroke.points, axis=0) != 0, axis=1)]]
    if len(path) == 1:  # a dot
        path = np.stack((path[0] - (_DOT, 0), path[0] + (_DOT, 0)))
    width = min(max(stroke.width, brush.sizes.width[0]), brush.sizes.width[-1])
    for lane in _lanes(path, stroke.width, width):
        yield from _along(number, lane, width, brush)


def _lanes(path: Points, width: float, lane: float) -> list[Points]:
    """Returns lines beside each other that cover a path of that width with marks as wide as a lane."""
    count = math.ceil(width / lane - _OVERHANG)
    if count <= 1:
        return [path]
    steps = np.diff(path, axis=0)
    tangents = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    corners = np.concatenate((tangents[:1], tangents[:-1] + tangents[1:], tangents[-1:]))
    corners /= np.maximum(np.linalg.norm(corners, axis=1, keepdims=True), 1e-9)
    normals = np.stack((-corners[:, 1], corners[:, 0]), -1)
    lanes = []
    for offset in np.linspace(-0.5, 0.5, count) * (width - lane):
        beside = path + offset * normals
        beyond = math.sqrt(width**2 / 4 - offset**2) - lane / 2  # the ends of the whole path are round
        lanes.append(np.concatenate((beside[:1] - beyond * tangents[:1], beside, beside[-1:] + beyond * tangents[-1:])))
    return lanes


def _along(number: int, path: Points, width: float, brush: Brush) -> Iterator[PathPiece]:
    """Yields the brush strokes along a path whose marks are `width` metres wide."""
    walked = np.r_[0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
    sizes = brush.sizes
    thickness = float(np.interp(width, sizes.width, sizes.thickness))
    before, behind = (float(np.interp(thickness, sizes.thickness, reach)) for reach in (sizes.before, sizes.behind))
    reach = before + behind - _ROUND_END * width  # by how much a mark is longer than a line with round ends
    shortest, longest = brush.limits.length
    off = max(_OFF * width, _MIN_OFF)
    spans = [(0.0, float(walked[-1]))]
    while spans:
        first, last = spans.pop(0)
        angle, chord, bend, missed, middle = _arc(path, walked, first, last)
        hooked = abs(bend) > brush.limits.bend[1] or chord < _STRAIGHT * (last - first)
        parts = max(math.ceil((chord - reach) / longest - _OVER), 2 if missed > off or hooked else 1)
        if parts > 1 and last - first > 2 * shortest:
            spans[:0] = itertools.pairwise(np.linspace(first, last, parts + 1).tolist())
            continue
        length = min(max(chord - reach, shortest), longest)
        bend = min(max(bend, brush.limits.bend[0]), brush.limits.bend[1])
        along = np.array([math.cos(angle), math.sin(angle)])
        start = middle + along * ((before - behind) / 2 - length / 2)
        yield PathPiece(number, brush.name, width, start, angle, length, bend, thickness)


def _arc(
    path: Points, walked: NDArray[np.float64], first: float, last: float
) -> tuple[float, float, float, float, NDArray[np.float64]]:
    """Fits the arc of a brush stroke to a part of a path between two distances along it.

    Returns its angle, the distance of its ends, its bend, the largest distance of the path from it, and the middle of
    its ends. At parameter t the arc is 3 t (1 - t) bend aside of the straight line.
    """
    steps = np.linspace(first, last, 17)
    points = np.stack([np.interp(steps, walked, path[:, axis]) for axis in range(2)], -1)
    step = points[-1] - points[0]
    chord = float(np.hypot(*step))
    angle = math.atan2(step[1], step[0])
    along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    offset = points - points[0]
    t = (offset @ along / chord).clip(0, 1) if chord > 0 else np.zeros(len(points))
    shape, aside = 3 * t * (1 - t), offset @ across
    weight = float(shape @ shape)
    bend = float(shape @ aside) / weight if weight > 1e-12 else 0.0
    return angle, chord, bend, float(np.abs(aside - bend * shape).max()), (points[0] + points[-1]) / 2


def _colors(drawing: HandIn, pieces: Sequence[PathPiece]) -> tuple[Tensor, list[str]]:
    """Returns the colour [n, 3] of each piece, and remarks."""
    strokes = drawing.strokes[: pieces[-1].source + 1]
    source = torch.tensor([piece.source for piece in pieces])
    if all(stroke.opacity == 1 for stroke in strokes):
        return torch.tensor([stroke.color for stroke in strokes])[source], []
    columns = round(_ROWS * drawing.canvas.width / drawing.canvas.height)
    shown = draw(HandIn(drawing.canvas, strokes, drawing.ground), _ROWS, columns)[1]
    return torch.from_numpy(shown)[source], ["Paint is opaque: transparent strokes got the colours that they show."]


def _palette(color: Tensor, weight: Tensor, paints: int, seed: int) -> tuple[Palette, Tensor, list[str]]:
    """Returns at most `paints` paints that can be mixed, the paint of each stroke, and remarks."""
    different, remarks = torch.unique(color, dim=0), list[str]()
    if len(different) <= paints:
        palette = Palette.sort_light_to_dark(different)
    else:
        palette = Palette.cluster(color, weight, paints, seed)
        remarks.append(f"{count_of(len(different), 'colour')} became {count_of(paints, 'paint')}.")
    paint = palette.nearest(color)
    acrylics = PaintSet.of("acrylics")
    assert acrylics is not None
    uses = torch.bincount(paint, minlength=len(palette)).float()
    mixable = make_mixable(palette.color, uses, acrylics, _APART)
    if mixable.changes:
        remarks.append(f"{count_of(len(mixable.changes), 'paint')} changed, so that all can be mixed.")
    paint = mixable.number[paint]
    lightest = Palette.sort_light_to_dark(mixable.color[torch.unique(paint)])
    return lightest, lightest.nearest(mixable.color[paint]), remarks


def _schedule(pieces: Sequence[PathPiece], paint: Tensor) -> tuple[list[int], list[tuple[str, int]]]:
    """Returns an order with few changes of brush and paint, and its runs (brush, number of strokes).

    Two strokes that touch keep their order, unless brush and paint are the same.
    """
    low, high = np.split(np.stack([_bounds(piece) for piece in pieces]), 2, axis=1)
    brushes, wells, numbers = [piece.brush for piece in pieces], paint.tolist(), np.arange(len(pieces))
    touch = ((low[:, None] <= high[None]) & (high[:, None] >= low[None])).all(-1)
    kinds, colors = np.unique(brushes, return_inverse=True)[1], np.array(wells)
    same = (kinds[:, None] == kinds[None]) & (colors[:, None] == colors[None])
    after = touch & ~same & (numbers[:, None] > numbers[None])  # the row waits for the column
    waiting = after.sum(1)
    free = {index for index in range(len(pieces)) if waiting[index] == 0}
    order, runs = list[int](), list[tuple[str, int]]()
    brush, well = "", -1
    while free:
        fitting = [index for index in free if brushes[index] == brush]
        if not fitting:
            brush = brushes[min(free)]
            fitting = [index for index in free if brushes[index] == brush]
            runs.append((brush, 0))
            well = -1
        of_well = [index for index in fitting if wells[index] == well]
        if not of_well:
            well = wells[min(fitting)]
            of_well = [index for index in fitting if wells[index] == well]
        here = pieces[order[-1]].start if order else np.zeros(2)
        chosen = min(of_well, key=lambda index: (float(np.hypot(*(pieces[index].start - here))), index))
        free.remove(chosen)
        order.append(chosen)
        runs[-1] = (brush, runs[-1][1] + 1)
        for index in np.flatnonzero(after[:, chosen]):
            waiting[index] -= 1
            if waiting[index] == 0:
                free.add(int(index))
    return order, runs


def _bounds(piece: PathPiece) -> NDArray[np.float64]:
    """Returns left, bottom, right and top of a brush stroke's mark."""
    along = np.array([math.cos(piece.angle), math.sin(piece.angle)]) * piece.length
    aside = np.array([-math.sin(piece.angle), math.cos(piece.angle)]) * 0.75 * piece.bend
    points = np.stack((piece.start, piece.start + along, piece.start + along / 2 + aside))
    return np.concatenate((points.min(0) - piece.width / 2, points.max(0) + piece.width / 2))
