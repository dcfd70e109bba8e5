from dataclasses import replace

import pytest

from frida_painter.brush.kinds import BrushKind, Dip
from frida_painter.hardware.motion import Motion
from frida_painter.session.choreography import BrushLoad, Choreography
from frida_painter.session.events import Dipped, StrokePainted
from support.easel import CALIBRATION, WORKSPACE
from support.plans import SMALL_LIMITS, plan_of_paints

BRUSH = BrushKind("small", SMALL_LIMITS, 0.008)
CHOREOGRAPHY = Choreography(Motion(WORKSPACE, CALIBRATION), BRUSH)
LARGEST = 0.03 * 0.008


def test_between_two_dips_no_more_is_painted_than_a_dip_holds_unless_by_one_stroke() -> None:
    since, strokes, dips = 0.0, 0, 0
    load = BrushLoad()
    for action in CHOREOGRAPHY.actions(plan_of_paints(30 * [0], 0.017, 0.3), load, 0, 30):
        if isinstance(action.done, Dipped):
            since, strokes, dips = 0.0, 0, dips + 1
        else:
            since, strokes = since + load.left - action.load.left, strokes + 1
            assert strokes == 1 or since <= 0.6 * LARGEST + 1e-12
        load = action.load
    assert 1 < dips < 30


def test_where_strokes_are_counted_every_so_many_get_a_dip() -> None:
    counted = Choreography(CHOREOGRAPHY.motion, replace(BRUSH, known_dip=Dip.of_strokes(4)))
    told = [type(action.done) for action in counted.actions(plan_of_paints(10 * [0], 0.03, 1.0), BrushLoad(), 0, 10)]
    four = [Dipped, *4 * [StrokePainted]]
    assert told == [*four, *four, *four[:3]]


def test_every_action_tells_what_it_leaves_on_the_brush() -> None:
    actions = list(CHOREOGRAPHY.actions(plan_of_paints([0, 1], 0.01, 0.0), BrushLoad(), 0, 2))
    assert [action.load.paint for action in actions] == [0, 0, 1, 1]
    full = 0.6 * LARGEST
    left = [action.load.left for action in actions]
    assert left == pytest.approx([full, full - 0.01 * 0.008 / 4] * 2)


def test_a_brush_that_holds_the_paint_needs_no_dip() -> None:
    held = BrushLoad(1, 0.6 * LARGEST)
    # above its start, the stroke, and up
    assert [len(action.motions) for action in CHOREOGRAPHY.actions(plan_of_paints([1], 0.01, 0.0), held, 0, 1)] == [3]
    assert len(list(CHOREOGRAPHY.actions(plan_of_paints([1], 0.01, 0.0), BrushLoad(1, 0.0), 0, 1))) == 2
