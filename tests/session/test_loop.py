import itertools
import math
import random
import threading
import time
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.easel.operator import PersonAsOperator
from frida_painter.errors import (
    CalibrationError,
    Interrupted,
    PaintingPaused,
    PlanError,
    PoseMismatch,
)
from frida_painter.session.choreography import DRYING
from frida_painter.session.events import (
    BrushInHand,
    Dipped,
    Drying,
    LayerBegun,
    Looked,
    Paused,
    Planned,
    PlanningStep,
    Scheduled,
    Stopped,
    StrokePainted,
    TimelapseFrame,
    events_of,
)
from frida_painter.session.journal import Journal
from frida_painter.session.observer import Timelapse
from frida_painter.session.progress import PaintingProgress
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.strokes.palette import Palette
from frida_painter.system.event_log import EventLog
from support.easel import NotingRobot
from support.session import NotingPlanner, SessionSetup


@given(st.integers(1, 2000), st.integers(0, 2500))
def test_batches_sum_up_exactly_and_differ_by_one_at_most_but_for_a_short_first_one(strokes: int, replans: int) -> None:
    batches = EvenlySpaced(replans).batches(strokes)
    assert sum(batches) == strokes
    assert len(batches) == min(replans + 1, strokes)
    even = batches[1:] if replans >= 2 and strokes > 10 * (replans + 1) else batches
    assert max(even) - min(even) <= 1 and min(batches) >= 1
    assert even == batches or (batches[0] == 10 <= min(even))


@given(st.integers(1, 500), st.integers(0, 150), st.randoms(use_true_random=False))
def test_each_frame_of_the_film_is_taken_when_the_hand_leaves_or_before_the_next_ones_turn(
    strokes: int, wanted: int, chance: random.Random
) -> None:
    timelapse, taken, seen = Timelapse(min(wanted, strokes)), 0, []
    for done in range(1, strokes + 1):
        leaves = done == strokes or chance.random() < 0.3
        if timelapse.wants_frame(done, strokes, taken, leaves=leaves):
            taken = timelapse.due(done, strokes)
            seen.append((done, leaves))
    assert taken == min(wanted, strokes) and len(seen) <= taken
    assert not seen or seen[-1][0] == strokes
    if wanted and strokes / min(wanted, strokes) >= 8:
        assert len(seen) == taken, "where there is time to wait, all frames are there"
        assert all(timelapse.due(done, strokes) == number for number, (done, _) in enumerate(seen, 1)), "evenly"
        assert all(leaves or timelapse.due(done + 1, strokes) > timelapse.due(done, strokes) for done, leaves in seen)
    waits = max(8, math.ceil(strokes / max(1, min(wanted, strokes)))) + 1
    between = itertools.pairwise([0, *(done for done, _ in seen)])
    assert all(later - before <= waits + strokes / min(wanted, strokes) for before, later in between)


def test_a_frame_waits_until_the_hand_leaves_for_paint() -> None:
    setup = SessionSetup(12, replans=0, timelapse_frames=3, colors=2)
    setup.run()
    labels = setup.robot.labels()
    after_home = [
        labels[at + 1] for at, label in enumerate(labels) if label == "home" and "stroke" in labels[max(0, at - 1)]
    ]
    assert after_home and not any("stroke" in label for label in after_home)
    assert sum(isinstance(event, TimelapseFrame) for event in setup.heard) == 3


def test_a_resumed_painting_gets_the_frames_of_what_it_still_paints() -> None:
    setup = SessionSetup(12, replans=0, timelapse_frames=6)
    plan, bare = setup.planner.plan(torch.ones(3, 8, 8), 12, 2, lambda step: None), torch.ones(3, 48, 64)
    setup.resume(PaintingProgress.resume(plan, 6, 6, bare, bare))
    frames = [event.done for event in setup.heard if isinstance(event, TimelapseFrame)]
    assert len(frames) == 3 and frames[-1] == 12 and min(frames) >= 8


@pytest.mark.parametrize(("strokes", "replans"), [(1, 0), (1, 4), (3, 1), (7, 3), (5, 50), (12, 11)])
def test_exactly_so_many_strokes_are_painted(strokes: int, replans: int) -> None:
    """Fault F35: unusual counts of strokes and batches."""
    setup = SessionSetup(strokes, replans)
    painting = setup.run()
    assert painting.painted == strokes and painting.rest is not None and len(painting.rest) == 0
    assert setup.painted() == list(range(1, strokes + 1))


def test_events_come_in_the_order_in_which_things_happen() -> None:
    setup = SessionSetup(4, replans=1, colors=2)
    setup.run()
    assert setup.kinds(PlanningStep, BrushInHand, Dipped, Scheduled) == [
        *("Planned", "PaintsWanted", "StrokePainted", "StrokePainted", "Looked", "Planned"),
        *("StrokePainted", "StrokePainted", "Looked", "Finished"),
    ]
    assert [event.paint for event in setup.heard if isinstance(event, Dipped)][:1] == [0]
    phases = [(event.phase, event.iteration) for event in setup.heard if isinstance(event, PlanningStep)]
    assert phases == [("plan", 1), ("plan", 2), ("replan", 1)]
    assert [event.done for event in setup.heard if isinstance(event, Looked | Planned)] == [0, 2, 2, 4]
    looked = [event for event in setup.heard if isinstance(event, Looked)][-1]
    assert looked.expected.mean() == pytest.approx(0.998), "what the last two strokes were to make of it"


def test_what_is_left_is_planned_again_from_what_was_seen_after_each_batch() -> None:
    setup = SessionSetup(10, replans=4)
    setup.run()
    assert setup.planner.asked == [8, 6, 4, 2]
    looks = [event.photograph for event in setup.heard if isinstance(event, Looked)]
    assert all(seen is canvas for seen, canvas in zip(looks, setup.planner.canvases, strict=False))


def test_after_each_batch_the_robot_is_sent_where_strokes_land_as_they_are_meant_to() -> None:
    aimed = SessionSetup(6, replans=2, colors=3)  # of each paint a batch, so that both are painted in one order
    aimed.run()
    assert aimed.planner.located == [2, 2, 2]
    straight = SessionSetup(6, replans=0, colors=3)
    straight.run()
    starts = [
        [motion.position[0] for motion in setup.robot.motions if motion.label.startswith("stroke")]
        for setup in (aimed, straight)
    ]
    moved = [math.dist(one, other) for one, other in zip(*starts, strict=True)]
    assert moved == pytest.approx([0.0, 0.0, 0.001, 0.001, 0.002, 0.002])


def test_the_arm_steps_aside_before_every_look_and_the_brush_ends_clean() -> None:
    setup = SessionSetup(6, replans=2, timelapse_frames=6)
    setup.run()
    labels = setup.robot.labels()
    timelapse_frames = sum(isinstance(event, TimelapseFrame) for event in setup.heard)
    assert 3 <= timelapse_frames <= 6, "at looks, and where the brush is dipped"
    assert labels.count("home") == 1 + timelapse_frames + 3 + 1, "the bare canvas, three looks, the last photograph"
    assert labels[-3:] == ["rinse", "wipe", "home"]


def test_wells_are_filled_once_before_the_first_dip() -> None:
    setup = SessionSetup(5, replans=3, colors=3)
    setup.run()
    assert len(setup.easel.operator.palettes) == 1 and len(setup.easel.operator.palettes[0]) == 3
    assert setup.kinds(PlanningStep).index("PaintsWanted") < setup.kinds(PlanningStep).index("Dipped")


def test_what_was_really_mixed_is_planned_with_before_the_first_stroke() -> None:
    wanted: list[Palette] = []

    def mixed(palette: Palette) -> Palette:
        wanted.append(palette)
        return Palette(palette.color.flip(0) * 0.9)

    setup = SessionSetup(6, replans=1, colors=3, mixed=mixed)
    setup.run()
    plans = [event.plan for event in setup.heard if isinstance(event, Planned)]
    assert torch.equal(plans[1].palette.color, wanted[0].color.flip(0) * 0.9)
    assert all(torch.equal(plan.palette.color, plans[1].palette.color) for plan in plans[1:])
    assert torch.equal(setup.easel.operator.palettes[-1].color, plans[1].palette.color)
    kinds = setup.kinds(BrushInHand, Scheduled, Dipped)
    assert kinds[:7] == [
        "PlanningStep",
        "PlanningStep",
        "Planned",
        "PaintsWanted",
        "PlanningStep",
        "Planned",
        "StrokePainted",
    ]
    assert setup.painted() == [1, 2, 3, 4, 5, 6]


def test_what_is_left_after_a_pause_gets_the_paints_that_were_really_mixed() -> None:
    mixing: list[bool] = []

    def mixed(palette: Palette) -> Palette:
        mixing.append(True)
        return Palette(palette.color * 0.9)

    def leave_out(paused: Paused) -> bool:
        setup.pause_at = lambda event: False
        setup.session.paint_instead(setup.session.rest.part(slice(3)))
        return True

    setup = SessionSetup(5, replans=0, colors=2, mixed=mixed, go_on=leave_out)
    setup.pause_at = lambda event: bool(mixing) and isinstance(event, PlanningStep)
    assert setup.run().painted == 3 and setup.painted() == [1, 2, 3]
    plans = [event.plan for event in setup.heard if isinstance(event, Planned)]
    assert [len(plan) for plan in plans] == [5, 3, 3]
    assert torch.equal(plans[2].palette.color, plans[1].palette.color * 0.9)


@pytest.mark.parametrize("stroke", [1, 4, 5, 9])
def test_a_stop_is_heeded_after_the_stroke_and_everything_is_kept(stroke: int) -> None:
    setup = SessionSetup(9, replans=2, stop_at=lambda event: isinstance(event, StrokePainted) and event.done == stroke)
    painting = setup.run()
    assert painting.painted == stroke and setup.painted() == list(range(1, stroke + 1))
    assert painting.rest is not None and len(painting.rest) == 9 - stroke
    assert painting.photograph.shape[0] == 3
    assert setup.heard[-1] == Stopped()
    assert setup.robot.labels()[-3:] == ["rinse", "wipe", "home"]


def test_what_is_kept_after_a_stop_are_the_strokes_that_were_still_to_come() -> None:
    setup = SessionSetup(9, replans=1, stop_at=lambda event: isinstance(event, StrokePainted) and event.done == 3)
    painting = setup.run()
    first = next(event.plan for event in setup.heard if isinstance(event, Planned))
    assert painting.rest is not None
    assert torch.equal(painting.rest.strokes.position, first.strokes.position[3:])


def test_a_stop_while_planning_paints_nothing() -> None:
    setup = SessionSetup(9, stop_at=lambda event: isinstance(event, PlanningStep))
    painting = setup.run()
    assert painting.painted == 0 and painting.rest is None and setup.painted() == []
    assert setup.kinds() == ["PlanningStep", "Stopped"]


def test_a_stop_while_planning_again_keeps_the_plan_as_it_was() -> None:
    setup = SessionSetup(9, stop_at=lambda event: isinstance(event, PlanningStep) and event.phase == "replan")
    painting = setup.run()
    assert painting.painted == 4 and painting.rest is not None and len(painting.rest) == 5


def test_a_robot_that_lies_ends_the_painting() -> None:
    with pytest.raises(PoseMismatch):
        SessionSetup(4, robot=NotingRobot(astray=0.01)).run()


def test_a_plan_that_was_made_before_is_painted_as_it_is() -> None:
    setup = SessionSetup(6, replans=0, colors=2)
    made = setup.planner.plan(torch.ones(3, 48, 64), 6, 2, lambda step: None)
    setup.session.run(6, 2, made)
    assert setup.painted() == [1, 2, 3, 4, 5, 6]
    planned = [event for event in setup.heard if isinstance(event, Planned)]
    assert planned[0].plan is made and not any(isinstance(event, PlanningStep) for event in setup.heard)


def test_in_a_pause_a_person_may_have_it_look_again_and_paint_something_else() -> None:
    setup = SessionSetup(8, replans=1, pause_at=lambda event: isinstance(event, StrokePainted) and event.done == 2)

    def answer(paused: Paused) -> bool:
        setup.session.look_again()
        assert len(setup.session.rest) == 6
        setup.session.paint_instead(setup.session.rest.part(slice(3)))
        return True

    setup.go_on = answer
    painting = setup.run()
    assert painting.painted == 5 and setup.painted() == [1, 2, 3, 4, 5]
    assert [event.done for event in setup.heard if isinstance(event, Looked)] == [2, 4, 5]
    assert [(event.done, len(event.plan)) for event in setup.heard if isinstance(event, Planned)] == [
        *((0, 8), (2, 6), (2, 3), (4, 1)),
    ]
    assert setup.planner.located == [2, 2, 1]


def test_what_a_person_has_planned_in_a_pause_overtakes_what_was_being_planned() -> None:
    setup = SessionSetup(
        6, replans=1, pause_at=lambda event: isinstance(event, PlanningStep) and event.phase == "replan"
    )

    def answer(paused: Paused) -> bool:
        setup.pause_at = lambda event: False
        setup.session.paint_instead(setup.session.rest.part(slice(1)))
        return True

    setup.go_on = answer
    assert setup.run().painted == 4
    assert setup.painted() == [1, 2, 3, 4]


def test_before_the_first_plan_nothing_is_left_to_be_painted() -> None:
    with pytest.raises(PlanError, match="wait until"):
        _ = SessionSetup(3).session.rest


def layered(replans: int, layers: tuple[int, ...] = (4, 2, 2), **rest: object) -> SessionSetup:
    return SessionSetup(sum(layers), replans, colors=2, planner=NotingPlanner(layers=layers), **rest)  # type: ignore[arg-type]


def test_between_layers_paint_dries_and_then_the_next_one_is_planned_anew_on_what_is_seen() -> None:
    setup = layered(replans=1)
    setup.run()
    kinds = setup.kinds(PlanningStep, BrushInHand, Dipped, Scheduled, Drying)
    strokes = ["StrokePainted"] * 2
    layer = ["Looked", "Planned", "LayerBegun", *strokes]
    assert kinds == ["Planned", "PaintsWanted", "LayerBegun", *strokes, *strokes, *layer, *layer, "Looked", "Finished"]
    assert setup.planner.fresh == [True, True] and setup.planner.asked == [4, 2]
    told = [(event.done, event.left) for event in setup.heard if isinstance(event, Drying)]
    assert told[::20] == [(4, DRYING), (4, 0), (6, 60)] and told[-1] == (6, 0)
    assert sum(setup.easel.operator.dried) == 2 * DRYING


def test_nobody_waits_for_drying_that_a_simulation_does_at_once(tmp_path: Path) -> None:
    journal = Journal.begin(tmp_path, {}, {})
    setup = layered(replans=1, simulated=True, journal=journal)
    setup.run()
    journal.close()
    noted = [event for line in EventLog.read(tmp_path / "journal") for event in events_of(line)]
    assert journal.state.progress.pace == 0.0 and journal.state.progress.doing != "drying"
    assert {event.pace for event in setup.heard if isinstance(event, Scheduled)} == {0.0}
    assert sum(isinstance(event, Drying) and event.left == 0 for event in noted) == 2


def test_a_look_inside_a_layer_does_not_begin_one() -> None:
    setup = layered(replans=3, layers=(5, 3))
    setup.run()
    assert list(zip(setup.planner.asked, setup.planner.fresh, strict=True)) == [
        (6, False), (4, False), (3, True), (2, False)
    ]  # fmt: skip


def test_who_does_not_look_lets_layers_dry_all_the_same() -> None:
    setup = layered(replans=0)
    painting = setup.run()
    assert painting.painted == 8 and setup.planner.asked == []
    assert setup.painted() == list(range(1, 9))
    assert sum(setup.easel.operator.dried) == 2 * DRYING


def test_the_brush_is_clean_and_the_arm_aside_while_paint_dries() -> None:
    setup = layered(replans=0, layers=(2, 2))
    setup.run()
    labels = setup.robot.labels()
    second = labels.index("stroke 3")
    assert labels[second - 6 : second - 1] == [*2 * ["rinse", "wipe"], "home"]


def of_brushes(*brushes: str, **rest: object) -> SessionSetup:
    """Layers of two strokes each, the first of the brush that the easel has."""
    planner = NotingPlanner(layers=(2,) * len(brushes), brushes=brushes)
    return SessionSetup(2 * len(brushes), 1, colors=2, planner=planner, **rest)  # type: ignore[arg-type]


def test_each_layer_is_painted_with_its_brush_which_is_asked_for_when_it_changes() -> None:
    setup = of_brushes("small", "large", "large", "small")
    setup.run()
    assert setup.easel.operator.brushes == ["large", "small"]
    begun = [event for event in setup.heard if isinstance(event, LayerBegun)]
    assert begun == [
        LayerBegun(1, "small"), LayerBegun(2, "large"), LayerBegun(3, "large"), LayerBegun(4, "small")
    ]  # fmt: skip
    kinds = setup.kinds(PlanningStep, BrushInHand, Dipped, Scheduled)
    assert kinds.index("Drying") < kinds.index("LayerBegun", 4) < kinds.index("StrokePainted", 6)
    assert len(setup.easel.operator.palettes) == 1, "all layers have the same paints"
    held = [event.brush for event in setup.heard if isinstance(event, BrushInHand)]
    assert held == ["small", None, "large", None, "small"], "and until somebody has changed it, it is none"
    assert setup.painted() == list(range(1, 9))


def test_a_person_who_never_changes_the_brush_paints_nothing_with_a_wrong_one() -> None:
    setup = of_brushes("small", "large")
    setup.easel.operator.change_brush = lambda brush: PersonAsOperator(lambda question: False).change_brush(brush)
    with pytest.raises(Interrupted, match="The large brush was not there, and nothing was painted with another"):
        setup.run()
    assert setup.painted() == [1, 2]


def test_resumed_inside_a_layer_its_brush_is_asked_for_because_nobody_knows_which_is_there() -> None:
    setup = of_brushes("small", "large")
    plan = setup.planner.plan(torch.ones(3, 8, 8), 4, 2, lambda step: None)
    bare = torch.ones(3, 48, 64)
    setup.resume(PaintingProgress.resume(plan, 3, 2, bare, bare))
    assert setup.easel.operator.brushes == ["large"] and setup.painted() == [4]
    assert setup.easel.operator.dried == []


def test_resumed_after_brush_and_paints_were_there_nothing_is_dried_or_planned_again() -> None:
    setup = of_brushes("small", "large")
    plan = setup.planner.plan(torch.ones(3, 8, 8), 4, 2, lambda step: None)
    bare = torch.ones(3, 48, 64)
    setup.resume(PaintingProgress.resume(plan, 2, 2, bare, bare, wet=0.0))
    assert setup.easel.operator.dried == [] and setup.planner.fresh == []
    assert setup.easel.operator.brushes == ["large"] and setup.painted() == [3, 4]


def test_a_brush_that_nothing_is_known_of_stops_before_anything_moves() -> None:
    setup = of_brushes("small", "large")
    record = replace(setup.easel.calibration, others={})
    setup.hand.easel = replace(setup.easel, calibration=record)
    with pytest.raises(CalibrationError, match="knows the brushes small, and not 'large'; calibrate it as well"):
        setup.run()
    assert setup.painted() == []


def test_resumed_where_a_layer_begins_it_dries_first_and_looks() -> None:
    setup = layered(replans=1, layers=(6, 2))
    plan = setup.planner.plan(torch.ones(3, 8, 8), 8, 2, lambda step: None)
    bare = torch.ones(3, 48, 64)
    setup.resume(PaintingProgress.resume(plan, 6, 4, bare, bare))
    assert setup.kinds(PlanningStep, BrushInHand, Dipped, Scheduled, Drying)[:4] == [
        "Looked", "Planned", "PaintsWanted", "LayerBegun"
    ]  # fmt: skip
    assert setup.planner.fresh == [True] and sum(setup.easel.operator.dried) == DRYING
    assert setup.painted() == [7, 8]


@pytest.mark.parametrize(("wet", "planned_at", "looks"), [(61.5, 4, 2), (0.0, 4, 2), (0.0, 6, 1)])
def test_resumed_in_drying_it_waits_for_the_rest_only_and_looks_where_nobody_has(
    wet: float, planned_at: int, looks: int
) -> None:
    setup = layered(replans=1, layers=(6, 2))
    plan = setup.planner.plan(torch.ones(3, 8, 8), 8, 2, lambda step: None)
    bare = torch.ones(3, 48, 64)
    setup.resume(PaintingProgress.resume(plan, 6, planned_at, bare, bare, wet))
    assert sum(setup.easel.operator.dried) == pytest.approx(wet)
    assert [event.left for event in setup.heard if isinstance(event, Drying)] == ([61.5, 1.5, 0] if wet else [])
    assert setup.painted() == [7, 8] and setup.kinds().count("Looked") == looks
    (first, *_) = (event for event in setup.heard if isinstance(event, Scheduled))
    assert first.drying == wet and first.after[0][1] > wet


def test_a_stop_and_a_pause_are_heard_while_paint_dries(tmp_path: Path) -> None:
    stopped = layered(replans=1, stop_at=lambda event: isinstance(event, Drying) and event.left == DRYING - 60)
    assert stopped.run().painted == 4 and sum(stopped.easel.operator.dried) == 60
    journal = Journal.begin(tmp_path, {}, {})
    paused = layered(
        replans=1, journal=journal, pause_at=lambda event: isinstance(event, Drying) and event.left == DRYING - 120
    )
    with pytest.raises(PaintingPaused):
        paused.run()
    journal.close()
    reopened, history = Journal.reopen(tmp_path)
    reopened.close()
    last = history.sittings.last
    assert last is not None and history.progress.wet() == DRYING - 120
    assert history.progress.wet(last + timedelta(minutes=5)) == pytest.approx(DRYING - 420, abs=1)
    assert history.progress.wet(last + timedelta(hours=5)) == 0


@pytest.mark.parametrize("simulated", [True, False])
def test_a_stop_while_paint_dries_is_heeded_at_once(simulated: bool) -> None:
    began: list[float] = []

    def soon_after_it_begins(event: object) -> bool:
        if isinstance(event, Drying):
            began.append(time.monotonic())
            threading.Timer(0.3, lambda: setattr(setup, "stopping", True)).start()
        return False

    setup = layered(replans=0, layers=(2, 2), stop_at=soon_after_it_begins)
    setup.hand.easel = replace(setup.easel, pace=1.0, simulated=simulated)
    assert setup.run().painted == 2
    assert len(began) == 1 and time.monotonic() - began[0] < 8, "and not ten seconds of the robot's clock"


def test_paint_dries_at_the_easel_s_pace() -> None:
    setup = layered(replans=0, layers=(2, 2))
    setup.hand.easel = replace(setup.easel, pace=0.01, simulated=True)
    setup.hand.drying = 40.0
    before = time.monotonic()
    assert setup.run().painted == 4 and time.monotonic() - before >= 0.4


def test_paint_that_dries_at_once_is_not_waited_for() -> None:
    setup = layered(replans=1, layers=(2, 2))
    setup.hand.drying = 0.0
    assert setup.run().painted == 4 and setup.easel.operator.dried == []
    assert [event.left for event in setup.heard if isinstance(event, Drying)] == [0.0]


def test_a_look_that_fails_when_the_paint_is_dry_pauses_and_nothing_is_painted_before_it(tmp_path: Path) -> None:
    setup = layered(replans=1, layers=(2, 2), journal=Journal.begin(tmp_path, {}, {}))
    setup.camera.script = [(1e6, 1), "raise", "raise", "raise"]
    with pytest.raises(PaintingPaused, match="gave no new photograph"):
        setup.run()
    assert setup.painted() == [1, 2] and sum(setup.easel.operator.dried) == DRYING
    setup.journal.close()
    reopened, history = Journal.reopen(tmp_path)
    reopened.close()
    assert history.progress.wet() == 0 and history.progress.painted == 2


TAN = (0.784, 0.659, 0.471)


PALE = (0.929, 0.890, 0.800)


@pytest.mark.parametrize(("ground", "name"), [(TAN, "#c8a878"), (PALE, "#ede3cc")])
def test_a_canvas_that_was_not_toned_pauses_before_anything_is_planned(
    ground: tuple[float, float, float], name: str
) -> None:
    setup = SessionSetup(3)
    setup.planner.ground = ground
    with pytest.raises(PaintingPaused, match=f"to be {name}, and the canvas shows #ffffff"):
        setup.run()
    assert setup.easel.operator.toned == [ground], "a pale ground is no white paper"
    assert setup.kinds() == ["PaintsWanted", "Paused", "Stopped"] and setup.painted() == []


def test_who_goes_on_all_the_same_paints_on_what_is_there() -> None:
    setup = SessionSetup(3, go_on=lambda paused: True)
    setup.planner.ground = TAN
    assert setup.run().painted == 3
    assert setup.kinds()[:2] == ["PaintsWanted", "Paused"] and len(setup.camera.asked) >= 3
