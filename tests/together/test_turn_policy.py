"""Answers of the robot to a person who painted: each policy on a small canvas."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import PersonStroke
from frida_painter.perception.frame_check import find_painted
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes
from frida_painter_together.policies import TurnTaken, answer_turn, find_turn_policy, take_turn, touches, trace_strokes

SIZE = CanvasSize(0.12, 0.09)
ROWS, COLUMNS = 90, 120
RED, BLUE = (0.8, 0.2, 0.1), (0.1, 0.2, 0.7)


def plan(strokes: int = 12) -> Plan:
    limits = StrokeLimits((0.01, 0.05), (-0.02, 0.02))
    each = torch.full((strokes,), 0.02)
    made = Strokes(torch.full((strokes, 2), 0.03), each * 0, each, each * 0, each * 0 + 0.5, torch.zeros(strokes, 3))
    paint = torch.zeros(strokes, dtype=torch.long)
    return Plan.of(made, Palette(torch.tensor([BLUE, RED])), paint, brush="fine", limits=limits, canvas=SIZE)


def stroke(number: int, start: tuple[float, float], end: tuple[float, float], press: float = 0.3) -> PersonStroke:
    place = np.linspace(start, end, 9)
    zero = np.zeros(9)
    return PersonStroke(number, "fine", 1, place, zero + press, zero, zero)


def turn(mask: np.ndarray, *strokes: PersonStroke) -> TurnTaken:
    before = torch.ones(3, ROWS, COLUMNS)
    after = before.clone()
    after[:, torch.from_numpy(mask)] = torch.tensor(RED)[:, None]
    return take_turn(before, after, strokes, (RED,) * len(strokes), plan(), 3)


def ring() -> np.ndarray:
    row, column = np.mgrid[:ROWS, :COLUMNS]
    off = np.hypot(row - 40, column - 40)
    return np.asarray((off > 20) & (off < 26))


def test_paint_is_found_between_two_looks_and_noise_is_not() -> None:
    mask = ring()
    before = torch.ones(3, ROWS, COLUMNS)
    noise = 0.012 * torch.randn(3, ROWS, COLUMNS, generator=torch.Generator().manual_seed(1))
    after = before.clone()
    after[:, torch.from_numpy(mask)] = torch.tensor(RED)[:, None]
    found = find_painted(before + noise, after - noise)
    around = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert (found & mask).sum() > 0.97 * mask.sum() and not (found & ~around).any()
    assert not find_painted(before + noise, before - noise).any()


def test_a_closed_line_is_filled_in_and_an_open_one_is_refused() -> None:
    answer = answer_turn(find_turn_policy("fill"), "protect", turn(ring()), SIZE.height)
    assert answer.forbidden is not None
    assert not answer.forbidden[40, 40] and answer.forbidden[5, 5] and answer.forbidden[40, 62]
    open_line = ring() & (np.arange(COLUMNS) > 40)
    with pytest.raises(ConfigError, match="enclose nothing"):
        answer_turn(find_turn_policy("fill"), "welcome", turn(open_line), SIZE.height)


@pytest.mark.parametrize(("rows", "columns", "free"), [
    (slice(20, 60), slice(5, 20), (45, 100)), (slice(20, 60), slice(100, 115), (45, 10)),
    (slice(2, 12), slice(40, 80), (80, 60)), (slice(78, 88), slice(40, 80), (10, 60)),
])  # fmt: skip
def test_it_answers_on_the_other_side(rows: slice, columns: slice, free: tuple[int, int]) -> None:
    mask = np.zeros((ROWS, COLUMNS), np.bool_)
    mask[rows, columns] = True
    answer = answer_turn(find_turn_policy("side"), "welcome", turn(mask), SIZE.height)
    assert answer.forbidden is not None and not answer.forbidden[free]
    assert answer.forbidden[mask].all() and answer.forbidden.mean() == 0.5


def test_what_a_person_painted_is_protected_or_welcomed_as_they_choose() -> None:
    policy = find_turn_policy("alternate")
    assert answer_turn(policy, "welcome", turn(ring()), SIZE.height).forbidden is None
    protected = answer_turn(policy, "protect", turn(ring()), SIZE.height).forbidden
    assert protected is not None and protected[ring()].all() and not protected[40, 40]


def test_it_continues_in_the_spirit_of_the_strokes() -> None:
    strokes = [stroke(number, (0.02 + 0.01 * number, 0.02), (0.04 + 0.01 * number, 0.04)) for number in range(1, 5)]
    policy = find_turn_policy("continue")
    rest = answer_turn(policy, "welcome", turn(ring(), *strokes), SIZE.height).rest
    assert rest is not None and len(rest) == 12
    assert set(rest.paint.tolist()) == {1}, "in the paint that is nearest to the person's"
    assert rest.strokes.angle.numpy() == pytest.approx(np.pi / 4, abs=0.6)
    assert rest.strokes.length.numpy() == pytest.approx(0.0283, abs=1e-3)
    assert rest.strokes.thickness.numpy() == pytest.approx(0.3, abs=1e-6)
    again = answer_turn(policy, "welcome", turn(ring(), *strokes), SIZE.height).rest
    assert again is not None and again.digest == rest.digest, "the same turn has the same answer"


def test_strokes_that_nobody_noted_are_traced_in_the_paint() -> None:
    mask = np.zeros((ROWS, COLUMNS), np.uint8)
    for column in (20, 60):
        cv2.line(mask, (column, 60), (column + 24, 42), 1, 5)
    spirit = trace_strokes(mask > 0, turn(mask > 0).after, SIZE)
    assert [each.start for each in spirit] == [pytest.approx((x, 0.03), abs=3e-3) for x in (0.02, 0.06)]
    assert [each.angle for each in spirit] == pytest.approx([math.atan2(18, 24)] * 2, abs=0.1)
    assert [each.length for each in spirit] == pytest.approx([0.03] * 2, abs=6e-3)
    assert spirit[0].color == pytest.approx(RED, abs=1e-4)
    rest = answer_turn(find_turn_policy("continue"), "welcome", turn(mask > 0), SIZE.height).rest
    assert rest is not None and set(rest.paint.tolist()) == {1}
    with pytest.raises(ConfigError, match="Nothing of yours is seen"):
        answer_turn(find_turn_policy("continue"), "welcome", turn(mask > 1), SIZE.height)


def test_the_continued_drawing_keeps_clear_of_what_is_protected() -> None:
    strokes = [stroke(number, (0.02 + 0.01 * number, 0.02), (0.04 + 0.01 * number, 0.04)) for number in range(1, 5)]
    earlier = np.zeros((ROWS, COLUMNS), np.bool_)
    earlier[:, 80:] = True
    taken = turn(ring(), *strokes)
    answer = answer_turn(find_turn_policy("continue"), "protect", taken, SIZE.height, earlier)
    assert answer.rest is not None and len(answer.rest) == 12 and answer.forbidden is not None
    assert not touches(answer.rest.strokes, ring() | earlier, SIZE).any()
    with pytest.raises(ConfigError, match="no free place"):
        answer_turn(find_turn_policy("continue"), "protect", taken, SIZE.height, np.ones_like(earlier))


@pytest.mark.parametrize("name", ["alternate", "continue", "fill", "side"])
def test_without_a_goal_every_policy_continues_the_drawing(name: str) -> None:
    begun = replace(turn(ring(), stroke(1, (0.03, 0.05), (0.05, 0.05))), rest=plan(0), count=5, room=9)
    answer = answer_turn(find_turn_policy(name), "welcome", begun, SIZE.height)
    assert answer.rest is not None and len(answer.rest) == 5 and set(answer.rest.paint.tolist()) == {1}
    if answer.forbidden is not None:
        assert not touches(answer.rest.strokes, answer.forbidden, SIZE).any()


def test_every_policy_of_ours_is_found_by_its_name_and_no_other() -> None:
    assert [find_turn_policy(name).name for name in registry.OUR_PARTS[registry.TURN_POLICIES]] == [
        "alternate", "continue", "fill", "side",
    ]  # fmt: skip
    with pytest.raises(ConfigError, match="no way of taking turns 'dance'"):
        find_turn_policy("dance")
