import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from frida_painter.calibration import BrushRecord
from frida_painter.planning.placement import MAX_LOWER, TouchHeights, measure_touch
from frida_painter.planning.problem import PlanningProblem
from frida_painter.strokes import Strokes
from support.easel import CALIBRATION
from support.planning import problem, some_strokes

PROBLEM = problem(96)
DEPTH = 0.004
UNKNOWN = TouchHeights.unknown({"small": DEPTH, "large": 0.008})


def marks(strokes: Strokes, lower: float, before: PlanningProblem = PROBLEM) -> torch.Tensor:
    """The canvas after strokes of a brush that touches so many metres lower than it was sent, [3, H, W]."""
    with torch.no_grad():
        return before.render(strokes.with_groups(thickness=(strokes.thickness - lower / DEPTH).clamp(0, 1)))


def some(seed: int, count: int = 24) -> Strokes:
    strokes = some_strokes(count, seed=seed)
    return strokes.with_groups(thickness=0.3 + 0.5 * strokes.thickness)


@pytest.mark.parametrize("lower", [0.001, 0.0004, -0.0008])
def test_a_brush_that_touches_lower_or_higher_is_noticed_from_one_batch(lower: float) -> None:
    strokes = some(1)
    found = measure_touch(strokes, UNKNOWN, PROBLEM, marks(strokes, lower))
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
    found = measure_touch(strokes, UNKNOWN, PROBLEM, marks(touches, lower))
    assert found.correction("small") == pytest.approx(lower, rel=0.15)


def test_what_is_sent_lower_already_counts() -> None:
    known = UNKNOWN.after("small", 0.001, 0.0001)
    sent = known.correction("small")
    strokes = some(2)
    again = measure_touch(strokes, known, PROBLEM, marks(strokes, 0.001 - sent))
    assert again.correction("small") == pytest.approx(0.001, abs=0.0002)


def test_marks_that_are_as_they_were_meant_change_next_to_nothing() -> None:
    strokes = some(3)
    noisy = marks(strokes, 0.0) + 0.02 * torch.randn(PROBLEM.canvas.shape, generator=torch.Generator().manual_seed(0))
    found = measure_touch(strokes, UNKNOWN, PROBLEM, noisy.clamp(0, 1))
    assert abs(found.correction("small")) < 0.0001


@pytest.mark.parametrize("paint", [1.0, 0.96])
def test_of_paint_that_is_hardly_seen_on_its_ground_nothing_is_learned(paint: float) -> None:
    """The colours' own errors would be taken for thin marks."""
    strokes = some(3)
    strokes = strokes.with_groups(color=torch.full_like(strokes.color, paint))
    seen = (marks(strokes, 0.0) - PROBLEM.canvas) * 0.6 + PROBLEM.canvas + 0.01
    assert measure_touch(strokes, UNKNOWN, PROBLEM, seen) == UNKNOWN
    dark = strokes.with_groups(color=torch.full_like(strokes.color, 0.3))
    assert measure_touch(dark, UNKNOWN, PROBLEM, marks(dark, 0.0005)) != UNKNOWN


def test_it_is_not_learned_what_makes_strokes_kept_aside_worse() -> None:
    strokes = some(4)
    every_fourth = torch.arange(len(strokes)) % 4 == 3
    thinner = torch.where(every_fourth, strokes.thickness, (strokes.thickness - 0.25).clamp(min=0))
    seen = marks(
        strokes.with_groups(thickness=torch.where(every_fourth, (strokes.thickness + 0.3).clamp(max=1), thinner)), 0
    )
    assert measure_touch(strokes, UNKNOWN, PROBLEM, seen) == UNKNOWN


@pytest.mark.parametrize(
    "strokes", [some(1)[[0, 1, 2]], some(1).with_groups(color=torch.full((24, 3), 0.5))], ids=["three", "grey"]
)
def test_where_nothing_can_be_told_nothing_is_learned(strokes: Strokes) -> None:
    blank = replace(PROBLEM, canvas=torch.full_like(PROBLEM.canvas, 0.5))
    seen = torch.full_like(PROBLEM.canvas, 0.5)
    assert measure_touch(strokes, UNKNOWN, blank, seen).correction("small") == pytest.approx(0, abs=1e-5)


def test_a_brush_of_which_no_heights_are_known_is_left_alone() -> None:
    strokes = some(1)
    nobody = TouchHeights.unknown({})
    assert measure_touch(strokes, nobody, PROBLEM, marks(strokes, 0.001)) is nobody
    assert nobody.correction("small") == 0 and nobody.correct(CALIBRATION) == CALIBRATION


def test_what_seems_too_far_off_is_not_believed() -> None:
    nearly = UNKNOWN.after("small", MAX_LOWER, 0.0003)
    strokes = some(5)
    assert measure_touch(strokes, nearly, PROBLEM, marks(strokes, 0.001)) is nearly
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


def test_many_measurements_weigh_by_how_exact_they_are() -> None:
    known = UNKNOWN
    for _ in range(50):
        known = known.after("small", 0.0005, 0.0003)
    assert known.correction("small") == pytest.approx(0.0005, rel=0.02)
    assert math.sqrt(np.linalg.inv(np.array(known.information))[0, 0]) < 0.00005
