import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.calibration import BrushRecord
from frida_painter.planning.placement import MAX_LOWER, Placement, TouchHeights, gauss_newton, locate, measure_touch
from frida_painter.planning.problem import PlanningProblem
from frida_painter.strokes.strokes import Strokes
from support.easel import CALIBRATION
from support.planning import CANVAS, problem, some_strokes

PROBLEM = problem(64)
ERROR = (0.003, -0.002, math.radians(1.5))
MIDDLE = np.array([CANVAS.width, CANVAS.height]) / 2


def landed(strokes: Strokes, error: tuple[float, float, float], known: Placement | None = None) -> torch.Tensor:
    """The canvas after a robot of that error painted strokes, sent there by what is known."""
    x, y, turn = error
    sent = strokes.position.numpy()
    correction = 0.0
    if known is not None:
        sent = known.correct(CALIBRATION, CANVAS).place(sent.astype(float))
        correction = known.error[2]
    offset = (sent - MIDDLE) @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    position = torch.from_numpy(offset + MIDDLE + (x, y)).float()
    moved = strokes.with_groups(position=position, angle=strokes.angle + turn - correction)
    with torch.no_grad():
        return PROBLEM.render(moved)


def off(placement: Placement, error: tuple[float, float, float] = ERROR) -> tuple[float, float]:
    """How far a placement is off: metres, radians."""
    return math.dist(placement.error[:2], error[:2]), abs(placement.error[2] - error[2])


@pytest.mark.parametrize("error", [ERROR, (-0.004, 0.001, 0.0), (0.0, 0.0, -0.03), (0.0, 0.0, 0.0)])
def test_the_error_of_a_robot_is_found_from_one_batch(error: tuple[float, float, float]) -> None:
    strokes = some_strokes(15, seed=1)
    found = locate(strokes, Placement.unknown(), PROBLEM, landed(strokes, error))
    metres, radians = off(found, error)
    assert metres < 0.0003 and radians < math.radians(0.3)


def test_noise_and_strokes_that_went_wrong_do_not_lead_far_astray() -> None:
    strokes = some_strokes(15, seed=1)
    chance = torch.Generator().manual_seed(0)
    wrong = strokes.with_groups(
        position=strokes.position + 0.001 * torch.randn(15, 2, generator=chance),
        thickness=(strokes.thickness + 0.2).clamp(max=1),
    )
    seen = landed(wrong[[number for number in range(15) if number != 4]], ERROR)
    noisy = (seen + 0.03 * torch.randn(seen.shape, generator=chance)).clamp(0, 1)
    metres, radians = off(locate(strokes, Placement.unknown(), PROBLEM, noisy))
    assert metres < 0.0015 and radians < math.radians(1.5)


def test_what_is_known_is_taken_into_account_when_the_next_strokes_are_seen() -> None:
    first, second = some_strokes(8, seed=1), some_strokes(8, seed=2)
    once = locate(first, Placement.unknown(), PROBLEM, landed(first, ERROR))
    twice = locate(second, once, PROBLEM, landed(second, ERROR, once))
    assert off(twice)[0] < 0.0003 and off(twice)[1] < math.radians(0.3)
    growth = np.linalg.eigvalsh(np.array(twice.information) - np.array(once.information))
    assert growth.min() > 0, "every look adds to what is known"


def test_where_nothing_is_seen_nothing_is_learned() -> None:
    known = Placement((0.001, 0.002, 0.01), Placement.unknown().information)
    white = some_strokes(5).with_groups(color=torch.ones(5, 3))
    for strokes in (white, Strokes.empty()):
        found = locate(strokes, known, PROBLEM, PROBLEM.canvas)
        assert found.error == pytest.approx(known.error)
        assert np.allclose(found.information, known.information)


def test_a_corrected_robot_paints_where_strokes_are_meant_to_be() -> None:
    calibration = replace(CALIBRATION, placement=((1.0, 0.01, 0.002), (-0.01, 1.0, 0.001), (0.1, 0.0, 1.0)))
    meant = np.random.default_rng(0).uniform(0, 0.1, (20, 2))
    x, y, turn = ERROR
    sent = Placement(ERROR, Placement.unknown().information).correct(calibration, CANVAS).place(meant)
    inverse = np.linalg.inv(np.array(calibration.placement))
    homogeneous = np.c_[sent, np.ones(20)] @ inverse.T
    reached = homogeneous[:, :2] / homogeneous[:, 2:] - MIDDLE
    cos, sin = math.cos(turn), math.sin(turn)
    ends = np.stack((cos * reached[:, 0] - sin * reached[:, 1], sin * reached[:, 0] + cos * reached[:, 1]), 1)
    assert np.allclose(ends + MIDDLE + (x, y), meant, atol=1e-12)


NOTHING, STEPS = torch.zeros(2, dtype=torch.float64), torch.full((2,), 0.01, dtype=torch.float64)
X = torch.linspace(0, 3, 60, dtype=torch.float64)
numbers = st.floats(-0.5, 0.5)


def seen(height: float, decay: float) -> torch.Tensor:
    return (1 + height) * torch.exp(-(1 + 0.5 * decay) * X)


@given(height=numbers, decay=numbers)
def test_what_made_the_picture_is_found(height: float, decay: float) -> None:
    picture = seen(height, decay)
    free = torch.eye(2, dtype=torch.float64) * 1e-9
    found, _ = gauss_newton(lambda guess: picture - seen(*guess.tolist()), NOTHING, free, STEPS, 1.0, 30)
    assert found.tolist() == pytest.approx([height, decay], abs=1e-3)


FINER = problem(96)
DEPTH = 0.004
UNKNOWN = TouchHeights.unknown({"small": DEPTH, "large": 0.008})


def marks(strokes: Strokes, lower: float, before: PlanningProblem = FINER) -> torch.Tensor:
    """The canvas after strokes of a brush that touches so many metres lower than it was sent, [3, H, W]."""
    with torch.no_grad():
        return before.render(strokes.with_groups(thickness=(strokes.thickness - lower / DEPTH).clamp(0, 1)))


def some(seed: int, count: int = 24) -> Strokes:
    strokes = some_strokes(count, seed=seed)
    return strokes.with_groups(thickness=0.3 + 0.5 * strokes.thickness)


@pytest.mark.parametrize("lower", [0.001, 0.0004, -0.0008])
def test_a_brush_that_touches_lower_or_higher_is_noticed_from_one_batch(lower: float) -> None:
    strokes = some(1)
    found = measure_touch(strokes, UNKNOWN, FINER, marks(strokes, lower))
    assert found.correction("small") == pytest.approx(lower, rel=0.35, abs=0.0001)
    assert 0.2 < found.correction("large") / lower < 0.8, "it paints on the same canvas"
    before, after = (np.linalg.inv(np.array(one.information)).diagonal() for one in (UNKNOWN, found))
    assert (after < before).all()


@pytest.mark.parametrize("lower", [0.001, 0.0014, 0.0018])
def test_marks_that_are_missing_tell_as_well(lower: float) -> None:
    """Thin strokes that do not touch the canvas leave nothing, which is not what the lightest touch leaves."""
    strokes = some(6)
    strokes = strokes.with_groups(thickness=strokes.thickness - 0.25)
    touches = strokes[strokes.thickness > lower / DEPTH]
    assert 2 < len(touches) < 13 and len(strokes) == 24
    found = measure_touch(strokes, UNKNOWN, FINER, marks(touches, lower))
    assert found.correction("small") == pytest.approx(lower, rel=0.15)


def test_what_is_sent_lower_already_counts() -> None:
    known = UNKNOWN.after("small", 0.001, 0.0001)
    sent = known.correction("small")
    strokes = some(2)
    again = measure_touch(strokes, known, FINER, marks(strokes, 0.001 - sent))
    assert again.correction("small") == pytest.approx(0.001, abs=0.0002)


@pytest.mark.parametrize("paint", [1.0, 0.96])
def test_of_paint_that_is_hardly_seen_on_its_ground_nothing_is_learned(paint: float) -> None:
    """The colours' own errors would be taken for thin marks."""
    strokes = some(3)
    strokes = strokes.with_groups(color=torch.full_like(strokes.color, paint))
    seen = (marks(strokes, 0.0) - FINER.canvas) * 0.6 + FINER.canvas + 0.01
    assert measure_touch(strokes, UNKNOWN, FINER, seen) == UNKNOWN
    dark = strokes.with_groups(color=torch.full_like(strokes.color, 0.3))
    assert measure_touch(dark, UNKNOWN, FINER, marks(dark, 0.0005)) != UNKNOWN


def test_it_is_not_learned_what_makes_strokes_kept_aside_worse() -> None:
    strokes = some(4)
    every_fourth = torch.arange(len(strokes)) % 4 == 3
    thinner = torch.where(every_fourth, strokes.thickness, (strokes.thickness - 0.25).clamp(min=0))
    seen = marks(
        strokes.with_groups(thickness=torch.where(every_fourth, (strokes.thickness + 0.3).clamp(max=1), thinner)), 0
    )
    assert measure_touch(strokes, UNKNOWN, FINER, seen) == UNKNOWN


@pytest.mark.parametrize(
    "strokes", [some(1)[[0, 1, 2]], some(1).with_groups(color=torch.full((24, 3), 0.5))], ids=["three", "grey"]
)
def test_where_nothing_can_be_told_nothing_is_learned(strokes: Strokes) -> None:
    blank = replace(FINER, canvas=torch.full_like(FINER.canvas, 0.5))
    seen = torch.full_like(FINER.canvas, 0.5)
    assert measure_touch(strokes, UNKNOWN, blank, seen).correction("small") == pytest.approx(0, abs=1e-5)


def test_a_brush_of_which_no_heights_are_known_is_left_alone() -> None:
    strokes = some(1)
    nobody = TouchHeights.unknown({})
    assert measure_touch(strokes, nobody, FINER, marks(strokes, 0.001)) is nobody
    assert nobody.correction("small") == 0 and nobody.correct(CALIBRATION) == CALIBRATION


def test_what_seems_too_far_off_is_not_believed() -> None:
    nearly = UNKNOWN.after("small", MAX_LOWER, 0.0003)
    strokes = some(5)
    assert measure_touch(strokes, nearly, FINER, marks(strokes, 0.001)) is nearly
    assert UNKNOWN.after("large", 5 * MAX_LOWER, 0.0003) is UNKNOWN


@pytest.mark.parametrize(
    "damaged",
    [
        {"lower": (0.05, 0.0)},
        {"lower": (math.nan, 0.0)},
        {"lower": (0.0,)},
        {"information": ((1.0,),)},
        {"depths": {"small": DEPTH}},
    ],
)
def test_a_journal_that_would_send_a_brush_into_the_table_is_damaged(damaged: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="brushes"):
        replace(UNKNOWN, **damaged)


def test_records_are_corrected_each_by_its_own() -> None:
    record = replace(CALIBRATION, others={"large": BrushRecord(0.11, 0.10)})
    known = UNKNOWN.after("small", 0.001, 0.0005)
    corrected = known.correct(record)
    lower, other = known.correction("small"), known.correction("large")
    assert 0 < other < lower < 0.001
    assert (corrected.touch_height, corrected.press_height) == (
        CALIBRATION.touch_height - lower,
        CALIBRATION.press_height - lower,
    )
    assert corrected.others["large"].press_height == 0.10 - other
    assert record.depths == {"small": pytest.approx(0.01), "large": pytest.approx(0.01)}
