"""Turn policies: they decide how the robot answers what a person painted on its canvas.

A policy is found by its name through entry points (registry.TURN_POLICIES). It gets what the person painted, and
returns the answer: a part of the canvas to leave free or to paint in, or other strokes for the rest of the plan.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import PersonStroke
from frida_painter.perception.frame_check import MARK, find_painted
from frida_painter.plan import Plan
from frida_painter.registry import TURN_POLICIES, parts
from frida_painter.session.spirit import StrokeSpirit, continue_drawing, touches, trace_strokes

Keep = Literal["welcome", "protect"]
"""Fate of a person's paint: the beginning of the painting, or a part that no stroke may touch."""
_MARGIN = 0.004  # metres around a person's paint that are protected with it
_ENCLOSED = 0.002  # least share of the canvas that a closed line encloses


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
    painted: NDArray[np.bool_]
    strokes: tuple[PersonStroke, ...]
    colors: tuple[tuple[float, float, float], ...]
    rest: Plan
    seed: int = 0
    count: int = 0
    room: int = 0
    clear: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class TurnAnswer:
    """Answer to a turn.

    forbidden [H, W]: True on the part of the canvas that no later stroke may touch; None for no such part.
    rest: strokes to paint instead of the rest; None to replan it for the goal.
    sentence: for the person.
    """

    sentence: str
    forbidden: NDArray[np.bool_] | None = None
    rest: Plan | None = None


@dataclass(frozen=True)
class TurnPolicy:
    """Way to answer a person's turn.

    name: under which it is registered.
    title: for the page.
    answer: raises ConfigError, with a sentence, if there is no answer of this kind to that turn.
    """

    name: str
    title: str
    answer: Callable[[TurnTaken], TurnAnswer]
    own_keep: bool = field(default=False)
    """True if the policy itself says which part of the canvas is painted, so that it is not asked about."""


def find_turn_policy(name: str) -> TurnPolicy:
    """Returns the policy of that name. Raises ConfigError if there is none, PluginError if it cannot be loaded."""
    known = parts(TURN_POLICIES)
    if name not in known:
        raise ConfigError(f"There is no way of taking turns {name[:40]!r}; take one of {', '.join(known)}.")
    return known[name].load(TurnPolicy)


def answer_turn(
    policy: TurnPolicy,
    keep: Keep,
    turn: TurnTaken,
    size_metres: float,
    protected: NDArray[np.bool_] | None = None,
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
        rest = continue_drawing(find_spirit(turn), turn.rest, turn.count, forbidden, turn.seed)
    elif rest is not None and forbidden is not None and len(rest):
        rest = rest.part(np.flatnonzero(~touches(rest.strokes, forbidden, rest.canvas)).tolist())
    changes = protects or answer.forbidden is not None
    return TurnAnswer(answer.sentence, forbidden if changes else None, rest)


def answer_usually(turn: TurnTaken) -> Plan | None:
    """Returns the answer if nobody chose a policy: the drawing is continued if there is no goal, else None."""
    return answer_turn(CONTINUE, "welcome", turn, turn.rest.canvas.height).rest if turn.count else None


def _union(one: NDArray[np.bool_] | None, other: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
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
        forbidden[:, : columns // 2] = column < 0
        forbidden[:, columns // 2 :] = column >= 0
        mine = "right" if column < 0 else "left"
    else:
        forbidden[: rows // 2] = row < 0
        forbidden[rows // 2 :] = row >= 0
        mine = "lower" if row < 0 else "upper"
    return TurnAnswer(f"The robot answers on the {mine} side.", forbidden)


def _continue(turn: TurnTaken) -> TurnAnswer:
    """Paints the rest in the spirit of the person's strokes: their colours, directions, lengths, press and rhythm."""
    made = continue_drawing(find_spirit(turn), turn.rest, turn.count, turn.clear, turn.seed)
    return TurnAnswer("The robot continues your drawing in its spirit.", None, made)


def find_spirit(turn: TurnTaken) -> list[StrokeSpirit]:
    """Returns the properties of the person's strokes, known or traced. Raises ConfigError if there are none."""
    if turn.strokes:
        return [StrokeSpirit.of(stroke, color) for stroke, color in zip(turn.strokes, turn.colors, strict=True)]
    traced = trace_strokes(turn.painted, turn.after, turn.rest.canvas)
    if not traced:
        raise ConfigError("Nothing of yours is seen on the canvas; paint something, then let the robot answer.")
    return traced


def _grow(mask: NDArray[np.bool_], pixels: float) -> NDArray[np.bool_]:
    side = 2 * max(1, round(pixels)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return cv2.dilate(mask.astype(np.uint8), disc).astype(np.bool_)


ALTERNATE = TurnPolicy("alternate", "The robot goes on with its goal", _alternate)
CONTINUE = TurnPolicy("continue", "Continue what I began, in its spirit", _continue)
FILL = TurnPolicy("fill", "Fill in what I closed", _fill, own_keep=True)
SIDE = TurnPolicy("side", "Answer on the other side", _side, own_keep=True)
