"""Turn policies: they decide how the robot answers what a person painted on its canvas.

A policy is found by its name through entry points (registry.TURN_POLICIES). It gets what the person painted, and
returns the answer: a part of the canvas to leave free or to paint in, or other strokes for the rest of the plan.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import PersonStroke
from frida_painter.perception.frame_check import MARK, find_painted
from frida_painter.registry import TURN_POLICIES, parts
from frida_painter.session.plan_keeper import touches
from frida_painter.strokes.family import Taught
from frida_painter.strokes.palette import to_lab
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes

Keep = Literal["welcome", "protect"]
"""Fate of a person's paint: the beginning of the painting, or a part that no stroke may touch."""
Mask = NDArray[np.bool_]
_MARGIN = 0.004  # metres around a person's paint that are protected with it
_ENCLOSED = 0.002  # least share of the canvas that a closed line encloses


# Spirit of a person's drawing: the properties of their strokes, and strokes of the robot that have the same
#
# These are colours, directions, lengths, bends, press, and the rhythm: the way from each stroke to the next one.
# Strokes that are not known, as at a real easel, are traced in the paint that the person added.

_BESIDE = 0.006  # metres by which a stroke begins beside the place that the rhythm gives it
_TURNED = 0.15  # radians by which its direction differs from that of the person's stroke
_TRIES, _ANYWHERE = 24, 96  # places that are tried for a stroke, in the rhythm and anywhere else that is free
_MOVED = 0.01  # metres by which a stroke may be moved onto the canvas
_USUAL_PRESS = 0.5  # of traced strokes, whose press is unknown


@dataclass(frozen=True)
class StrokeSpirit:
    """Properties that a stroke of the robot takes from a stroke of a person.

    start [2]: in canvas metres.
    angle: direction in radians, counter-clockwise. length, bend: metres. press: in [0, 1].
    color: sRGB.
    """

    start: NDArray[np.float64]
    angle: float
    length: float
    bend: float
    press: float
    color: tuple[float, float, float]

    @classmethod
    def of(cls, stroke: PersonStroke, color: tuple[float, float, float]) -> "StrokeSpirit":
        """Returns the properties of a stroke whose way is known."""
        along = stroke.place[-1] - stroke.place[0]
        length = max(float(np.linalg.norm(along)), 1e-3)
        across = np.array([-along[1], along[0]]) / length
        bow = (stroke.place - stroke.place[0]) @ across
        bend = float(bow[np.abs(bow).argmax()]) / 0.75  # of a Bezier curve whose middle lies 3/4 of the way out
        angle = float(np.arctan2(along[1], along[0]))
        return cls(stroke.place[0], angle, length, bend, float(stroke.press.mean()), color)


def trace_strokes(painted: Mask, seen: Tensor, size: CanvasSize) -> list[StrokeSpirit]:
    """Returns a stroke for each connected part of added paint, from left to right.

    painted [H, W]: True where the paint is. seen [3, H, W]: the canvas with it.
    A part is taken for one stroke along its longest direction; strokes that cross are one part.
    """
    count, labels = cv2.connectedComponents(painted.astype(np.uint8), connectivity=8)
    pitch = np.array([size.width / painted.shape[1], size.height / painted.shape[0]])
    picture = seen.permute(1, 2, 0).numpy()
    found = []
    for number in range(1, count):
        rows, columns = np.nonzero(labels == number)
        place = np.c_[columns + 0.5, painted.shape[0] - rows - 0.5] * pitch
        middle = place.mean(0)
        _, _, axes = np.linalg.svd(place - middle, full_matrices=False)
        along = axes[0] * (1 if tuple(axes[0]) > (0.0, 0.0) else -1)  # a right-handed hand goes to the right
        across = np.array([-along[1], along[0]])
        way, aside = (place - middle) @ along, (place - middle) @ across
        first, last = np.percentile(way, [1, 99])
        inner = np.abs(way - (first + last) / 2) < 0.15 * max(last - first, 1e-6)
        ends = np.abs(way - (first + last) / 2) > 0.4 * (last - first)
        end = float(np.median(aside[ends])) if ends.any() else 0.0
        bow = float(np.median(aside[inner])) - end if inner.any() and ends.any() else 0.0
        red, green, blue = np.median(picture[rows, columns], axis=0).tolist()
        start, angle = middle + first * along + end * across, math.atan2(along[1], along[0])
        found.append(
            StrokeSpirit(start, angle, max(float(last - first), 1e-3), bow / 0.75, _USUAL_PRESS, (red, green, blue))
        )
    return sorted(found, key=lambda each: float(each.start[0]))


def continue_drawing(spirit: Sequence[StrokeSpirit], rest: Plan, count: int, clear: Mask | None, seed: int) -> Plan:
    """Returns strokes in the spirit of a person's, as many as `rest` has in each layer, or `count` if it has none.

    rest: strokes that they replace, for canvas, brushes and paints.
    clear [H, W]: True for a place without strokes. None: all places are free.

    Each stroke follows one of the person's, chosen by chance. It begins where the one before it began, after a way as
    between two strokes of the person, and the chain begins at their last stroke. If that leads over the edge, the
    chain begins anew at a place chosen by chance, and turns back.
    Raises ConfigError if there is no room for a stroke.
    """
    random = np.random.default_rng(seed)
    chain = _Chain(spirit, rest.canvas, clear, random)
    strokes, paints, layers = [Strokes.empty()], [torch.zeros(0, dtype=torch.long)], []
    for part, layer in zip(rest.by_layer(), rest.layers, strict=True):
        chosen = [spirit[int(random.integers(len(spirit)))] for _ in range(len(part) if len(rest) else count)]
        placed, colors = [], []
        for number, one in enumerate(chosen):
            stroke = chain.place(one, layer.limits, part.strokes[[number]].taught if len(part) else None)
            if stroke is not None:
                placed.append(stroke)
                colors.append(one.color)
        first, end = layer.paints
        wanted = torch.tensor(colors).reshape(-1, 3)
        paint = first + torch.cdist(to_lab(wanted), to_lab(rest.palette.color[first:end])).argmin(1)
        if placed:
            strokes.append(Strokes.join(*placed).with_groups(color=rest.palette.color[paint]))
        paints.append(paint)
        layers.append(replace(layer, strokes=len(placed)))
    if not any(layer.strokes for layer in layers):
        raise ConfigError("There is no free place left for a stroke; remove the protection, or paint elsewhere.")
    return replace(rest, strokes=Strokes.join(*strokes), paint=torch.cat(paints), layers=tuple(layers))


class _Chain:
    """Places strokes one after another, in the rhythm of a person's strokes."""

    def __init__(
        self, spirit: Sequence[StrokeSpirit], size: CanvasSize, clear: Mask | None, random: np.random.Generator
    ) -> None:
        starts = np.array([each.start for each in spirit])
        self._ways = np.diff(starts, axis=0) if len(starts) > 1 else np.full((1, 2), 0.3 * spirit[0].length)
        self._here, self._size, self._clear, self._random = starts[-1], size, clear, random
        self._heading = np.ones(2)  # -1 along an axis where the chain has turned back

    def place(self, like: StrokeSpirit, limits: StrokeLimits, taught: Taught | None) -> Strokes | None:
        """Returns one stroke at the next place; None if no free place is found."""
        corner, clear = np.array([self._size.width, self._size.height]), self._clear
        ways = self._heading * self._ways[self._random.integers(len(self._ways), size=_TRIES)]
        chain = self._here + ways + self._random.normal(0, _BESIDE, (_TRIES, 2))
        if clear is None or clear.all():
            anywhere = self._random.uniform(size=(_ANYWHERE, 2)) * corner
        else:
            places = np.argwhere(~clear)
            row, column = (places[self._random.integers(len(places), size=_ANYWHERE)] + 0.5).T
            anywhere = np.c_[column / clear.shape[1], 1 - row / clear.shape[0]] * corner
        tried = np.concatenate([chain, anywhere])
        angle = like.angle + self._random.normal(0, _TURNED, len(tried))
        every = torch.ones(len(tried))
        strokes = Strokes(
            torch.from_numpy(tried).float(), torch.from_numpy(angle).float(), like.length * every, like.bend * every,
            like.press * every, torch.zeros(len(tried), 3), None if taught is None else taught[[0] * len(tried)],
        ).project(limits, self._size)  # fmt: skip
        free = np.ones(len(tried), np.bool_) if clear is None else ~touches(strokes, clear, self._size)
        if not free.any():
            return None
        moved = np.linalg.norm(strokes.position.numpy() - tried, axis=1)  # onto the canvas
        whole = free & (moved < _MOVED)
        at = int((whole if whole.any() else free).argmax())
        if at >= _TRIES:  # the rhythm led over the edge, or into what is to stay free
            over = (chain < 0).any(0) | (chain > corner).any(0)
            self._heading = np.where(over, -self._heading, self._heading)
        self._here = strokes.position[at].double().numpy()
        return strokes[[at]]


# Policies


@dataclass(frozen=True)
class TurnTaken:
    """Turn of a person.

    before, after [3, H, W]: canvas at the looks before and after it.
    painted [H, W]: True where the person's paint is.
    strokes, colors: the person's strokes of this turn and of earlier ones, and their paints (sRGB), as far as they are
    known; empty at a real easel.
    rest: strokes that the robot still has.
    seed: for random choices.
    count: strokes of the answer in a painting without a goal; 0 in one with a goal, whose rest is the answer.
    room: greatest count.
    clear [H, W]: True where the answer may not paint; None for no such part.
    """

    before: Tensor
    after: Tensor
    painted: Mask
    strokes: tuple[PersonStroke, ...]
    colors: tuple[tuple[float, float, float], ...]
    rest: Plan
    seed: int = 0
    count: int = 0
    room: int = 0
    clear: Mask | None = None


@dataclass(frozen=True)
class TurnAnswer:
    """Answer to a turn.

    forbidden [H, W]: True on the part of the canvas that no later stroke may touch; None for no such part.
    rest: strokes to paint instead of the rest; None to replan it for the goal.
    sentence: for the person.
    """

    sentence: str
    forbidden: Mask | None = None
    rest: Plan | None = None


@dataclass(frozen=True)
class TurnPolicy:
    """Way to answer a person's turn.

    name: under which it is registered.
    title: for the page.
    answer: raises ConfigError, with a sentence, if there is no answer of this kind to that turn.
    own_keep: True if the policy itself says which part of the canvas is painted, so that it is not asked about.
    """

    name: str
    title: str
    answer: Callable[[TurnTaken], TurnAnswer]
    own_keep: bool = False


def find_turn_policy(name: str) -> TurnPolicy:
    """Returns the policy of that name. Raises ConfigError if there is none, PluginError if it cannot be loaded."""
    known = parts(TURN_POLICIES)
    if name not in known:
        raise ConfigError(f"There is no way of taking turns {name[:40]!r}; take one of {', '.join(known)}.")
    return known[name].load(TurnPolicy)


def answer_turn(
    policy: TurnPolicy, keep: Keep, turn: TurnTaken, size_metres: float, protected: Mask | None = None
) -> TurnAnswer:
    """Returns the answer of a policy, with the person's paint protected if they want that.

    size_metres: height of the canvas.
    protected [H, W]: True where earlier turns, or a region that the person drew, forbid strokes.
    Without a goal, the rest of the answer continues the drawing. No stroke of the answer touches a forbidden part.
    """
    protects = keep == "protect" and not policy.own_keep
    clear = None if policy.own_keep else protected
    if protects:
        clear = _union(clear, _grow(turn.painted, _MARGIN / size_metres * turn.painted.shape[0]))
    answer = policy.answer(replace(turn, clear=clear))
    forbidden, rest = _union(clear, answer.forbidden), answer.rest
    if rest is None and turn.count:
        rest = continue_drawing(_find_spirit(turn), turn.rest, turn.count, forbidden, turn.seed)
    elif rest is not None and forbidden is not None and len(rest):
        rest = rest.part(np.flatnonzero(~touches(rest.strokes, forbidden, rest.canvas)).tolist())
    return TurnAnswer(answer.sentence, forbidden if protects or answer.forbidden is not None else None, rest)


def answer_usually(turn: TurnTaken) -> Plan | None:
    """Returns the answer if nobody chose a policy: the drawing is continued if there is no goal, else None."""
    return answer_turn(CONTINUE, "welcome", turn, turn.rest.canvas.height).rest if turn.count else None


def _union(one: Mask | None, other: Mask | None) -> Mask | None:
    if one is None or other is None:
        return one if other is None else other
    return one | other


def take_turn(
    before: Tensor,
    after: Tensor,
    strokes: tuple[PersonStroke, ...],
    colors: tuple[tuple[float, float, float], ...],
    rest: Plan,
    seed: int,
    count: int = 0,
    room: int = 0,
) -> TurnTaken:
    """Returns a person's turn, with their paint found in the difference of two looks."""
    painted = find_painted(before, after) if strokes else find_painted(before, after, MARK)
    return TurnTaken(before, after, painted, strokes, colors, rest, seed, count, room)


def _alternate(turn: TurnTaken) -> TurnAnswer:
    if turn.count:
        return _continue(turn)  # there is no goal to go on with
    return TurnAnswer("The robot goes on with its goal, from what is on the canvas now.")


def _fill(turn: TurnTaken) -> TurnAnswer:
    """Paints only inside the lines that the person closed."""
    line = _grow(turn.painted, 1.5).astype(np.uint8)
    outside = np.pad(line, 1)
    cv2.floodFill(outside, None, (0, 0), 1)
    inside = (outside[1:-1, 1:-1] == 0) & (line == 0)
    if inside.mean() < _ENCLOSED:
        raise ConfigError("Your lines enclose nothing to fill in; close a line, then let the robot answer.")
    return TurnAnswer("The robot paints only inside your line.", ~inside)


def _side(turn: TurnTaken) -> TurnAnswer:
    """Paints on the half of the canvas on which the person painted least."""
    if not turn.painted.any():
        raise ConfigError("Nothing of yours is seen on the canvas; paint on one side, then let the robot answer.")
    rows, columns = turn.painted.shape
    row, column = np.argwhere(turn.painted).mean(0) / (rows, columns) - 0.5
    forbidden = np.zeros_like(turn.painted)
    if abs(column) >= abs(row):
        forbidden[:, slice(columns // 2) if column < 0 else slice(columns // 2, None)] = True
        mine = "right" if column < 0 else "left"
    else:
        forbidden[slice(rows // 2) if row < 0 else slice(rows // 2, None)] = True
        mine = "lower" if row < 0 else "upper"
    return TurnAnswer(f"The robot answers on the {mine} side.", forbidden)


def _continue(turn: TurnTaken) -> TurnAnswer:
    """Paints the rest in the spirit of the person's strokes: their colours, directions, lengths, press and rhythm."""
    made = continue_drawing(_find_spirit(turn), turn.rest, turn.count, turn.clear, turn.seed)
    return TurnAnswer("The robot continues your drawing in its spirit.", None, made)


def _find_spirit(turn: TurnTaken) -> list[StrokeSpirit]:
    """Returns the properties of the person's strokes, known or traced. Raises ConfigError if there are none."""
    if turn.strokes:
        return [StrokeSpirit.of(stroke, color) for stroke, color in zip(turn.strokes, turn.colors, strict=True)]
    traced = trace_strokes(turn.painted, turn.after, turn.rest.canvas)
    if not traced:
        raise ConfigError("Nothing of yours is seen on the canvas; paint something, then let the robot answer.")
    return traced


def _grow(mask: Mask, pixels: float) -> Mask:
    side = 2 * max(1, round(pixels)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return cv2.dilate(mask.astype(np.uint8), disc).astype(np.bool_)


ALTERNATE = TurnPolicy("alternate", "The robot goes on with its goal", _alternate)
CONTINUE = TurnPolicy("continue", "Continue what I began, in its spirit", _continue)
FILL = TurnPolicy("fill", "Fill in what I closed", _fill, own_keep=True)
SIDE = TurnPolicy("side", "Answer on the other side", _side, own_keep=True)
