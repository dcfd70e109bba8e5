import itertools

import pytest
import torch

from frida_painter.brush.kinds import FINE, brush_kind
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.motion import Motion
from frida_painter.session.choreography import DRYING, BrushLoad, Choreography, reckon
from frida_painter.session.events import StrokePainted
from frida_painter.session.hand import Hand
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.virtual.studio import FREE, StudioSettings, open_studio
from frida_painter_drivers.sawyer.arm import KINEMATIC_SAWYER
from support.easel import CALIBRATION, WORKSPACE
from support.plans import in_layers, made_up_plan, made_up_strokes

SMALL = CanvasSize(0.12, 0.09)


def a_plan(seed: int, count: int = 24) -> Plan:
    strokes = made_up_strokes(count, seed, SMALL).project(FINE.limits, SMALL)
    palette = Palette.sort_light_to_dark(torch.rand(3, 3, generator=torch.Generator().manual_seed(seed)))
    paint = torch.arange(count) * 3 // count
    return Plan.of(strokes, palette, paint, canvas=SMALL, brush="fine", limits=FINE.limits)


def looks(painted: int, leaves: bool = False) -> int:
    """A look after every eighth stroke, as between batches and for the film."""
    return int(painted % 8 == 0)


@pytest.mark.parametrize(("seed", "arm"), [(0, FREE), (1, FREE), (2, KINEMATIC_SAWYER), (3, KINEMATIC_SAWYER)])
def test_the_time_is_that_of_the_simulated_clock_within_a_tenth_before_and_on_the_way(seed: int, arm: str) -> None:
    plan = a_plan(seed)
    easel = open_studio(SMALL, "fine", seed=seed, settings=StudioSettings(cell=2.0, arm=arm)).easel
    easel.robot.connect()
    easel.camera.connect()
    work = Hand(easel, brush_kind("fine"))
    work.step_aside()
    begun, expected = work.last_motion, work.timetable(plan, looks)
    easel.operator.fill_wells(plan.palette)
    done_at, seen_at = [], begun
    for action in work.prepare(plan, 0, len(plan)):
        work.perform(action)
        if isinstance(action.done, StrokePainted):
            done_at.append(work.last_motion - begun)
            if looks(action.done.done):
                work.step_aside()
                seen_at = easel.camera.capture(work.last_motion).captured_at
    took = max(work.last_motion, seen_at) - begun
    assert expected.total == pytest.approx(took, rel=0.1)
    left = [(took - at, expected.total - after) for at, after in zip(done_at, expected.after, strict=True)]
    assert all(told == pytest.approx(really, rel=0.1, abs=1.0) for really, told in left)


def test_what_takes_time_adds_up_and_grows_stroke_by_stroke() -> None:
    choreography = Choreography(Motion(WORKSPACE, CALIBRATION), FINE)
    table = reckon(made_up_plan(40, 4), choreography, BrushLoad())
    assert table.looks == 0 and min(table.strokes, table.dips, table.washing, table.travel) > 0
    assert table.total == pytest.approx(table.after[-1])
    assert all(one < other for one, other in itertools.pairwise(table.after)) and len(table.after) == 40


def test_looks_take_time_and_a_brush_that_holds_the_paint_saves_it() -> None:
    choreography = Choreography(Motion(WORKSPACE, CALIBRATION), FINE)
    plan = made_up_plan(6, 1)
    plain = reckon(plan, choreography, BrushLoad())
    assert reckon(plan, choreography, BrushLoad(), lambda painted, leaves: 2).looks > 6 * 2 * 0.1
    assert reckon(plan, choreography, BrushLoad(0, 1.0)).dips == 0 < plain.dips
    assert reckon(plan, choreography, BrushLoad(1, 1.0)).washing > 0 == plain.washing


def test_a_layer_dries_before_the_next_one_and_the_brush_is_cleaned_once() -> None:
    choreography = Choreography(Motion(WORKSPACE, CALIBRATION), FINE)
    plan = made_up_plan(6, paint=[0, 0, 1, 0, 0, 1])
    plain, layered = (reckon(in_layers(plan, *layers), choreography, BrushLoad()) for layers in ((6,), (3, 3)))
    assert plain.drying == 0 and layered.drying == DRYING
    assert layered.washing == pytest.approx(plain.washing)
    assert layered.after[3] - layered.after[2] > DRYING > layered.after[2]
    assert layered.total == pytest.approx(layered.after[-1])
    short = reckon(in_layers(plan, 3, 3), choreography, BrushLoad(), drying=60)
    assert short.drying == 60 and short.total == pytest.approx(layered.total - DRYING + 60)


def test_nothing_takes_no_time() -> None:
    choreography = Choreography(Motion(WORKSPACE, CALIBRATION), FINE)
    table = reckon(made_up_plan(6, 1).part(slice(0)), choreography, BrushLoad(), lambda painted, leaves: 1)
    assert table.total == 0 and table.after == table.milestones == ()
