from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Confirm, Jog, JogMove, Measure, lead
from frida_painter.errors import CalibrationError
from frida_painter.hardware.faults import Faults, LightChange, LostFocus
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter_calibration.procedures.brush import ABOVE_FLOOR, brush
from papers import proposed

CANVAS = CanvasSize(0.20, 0.16)
CAMERA = CameraSpec(photograph=(270, 360))


def studio_with(name="broad", seed=0, faults=None, **settings):
    settings = {"cell": 1.0, "camera": CAMERA, **settings}
    studio = open_studio(CANVAS, name, seed=seed, settings=StudioSettings(**settings), faults=faults)
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return studio


@lru_cache(maxsize=2)  # each keeps 60 MB of photographs
def found(name="broad", seed=0, faults=None, **settings):
    """What looking finds, and by how much (m) its two heights are too high."""
    studio = studio_with(name, seed, faults, **settings)
    finding = lead(brush(studio.easel), proposed)
    record = finding.enter(studio.easel.calibration)
    press = studio.touch_height - studio.brush.press_depth / 1000
    return finding, record.touch_height - studio.touch_height, record.press_height - press


@pytest.mark.parametrize(("name", "seed"), [("fine", 0), ("medium", 1), ("broad", 2)])
def test_by_looking_the_lightest_touch_is_found_to_a_third_of_a_millimetre(name, seed):
    """Measured with 8 seeds and photographs of 600 x 800: 0.05 to 0.12 mm too low for each of the brushes."""
    finding, touch_off, press_off = found(name, seed)
    assert abs(touch_off) < 0.0003
    assert abs(press_off) < 1e-6  # the studio's workspace ends a margin below what its brush stands
    assert "where the workspace ends; found in" in finding.sentence
    assert finding.picture.shape == (3, 760, 940) and float(finding.picture.std()) > 0.05


@pytest.mark.parametrize(("rise", "name"), [(0.004, "medium"), (-0.001, "broad")])
def test_it_is_found_where_the_canvas_lies_and_not_where_the_workspace_says(rise, name):
    finding, touch_off, press_off = found(name, seed=3, rise=rise)
    assert abs(touch_off) < 0.0003
    if rise > 0:  # In the studio a tuft spreads until a quarter beyond its hardest press.
        assert "where the mark stops widening" in finding.sentence and abs(press_off) < 0.0035
    else:  # The robot does not reach the hardest press.
        assert press_off == pytest.approx(0.001)


def test_the_record_holds_the_brush_and_nothing_leaves_the_workspace():
    studio, lowest = studio_with(), []
    follow = studio.robot.follow
    studio.robot.follow = lambda waypoints: (lowest.append(waypoints.position[:, 2].min()), follow(waypoints))[1]
    record = lead(brush(studio.easel, name="number 12"), proposed).enter(studio.easel.calibration)
    floor = studio.easel.workspace.lower[2] + ABOVE_FLOOR
    assert floor - 1e-9 <= min(lowest) and record.press_height == pytest.approx(floor)
    assert record.brush == "number 12" and 1e-4 <= record.done["brush"].residual < 5e-4 and record.protrusion == 0
    assert record.height(np.array([0.0, 1.0])).tolist() == [record.touch_height, record.press_height]


LAMPS = tuple(LightChange(number, 3 * ((0.6, 0.9, 0.75)[number % 3],)) for number in range(90))


def test_flickering_light_and_strokes_that_miss_the_paper_are_survived():
    assert abs(found("fine", faults=Faults(light_changes=LAMPS, dropped_touches=frozenset({0, 3, 9})))[1]) < 0.0005


def test_out_of_focus_the_touch_is_right_or_refused():
    try:
        off = found(faults=Faults(lost_focus=(LostFocus(12, blur=0.03),)))[1]
    except CalibrationError as refusal:
        assert "repeat the brush calibration" in str(refusal)
    else:
        assert abs(off) < 0.0006


@pytest.mark.parametrize("first", [0, pytest.param(14, marks=pytest.mark.slow)])
def test_without_paint_nothing_is_made_up(first):
    try:
        camera = CameraSpec(photograph=(360, 480))  # fewer pixels see less of a mark that fades
        _, touch_off, press_off = found(faults=Faults(dry_dips=frozenset(range(first, 200))), camera=camera)
    except CalibrationError as refusal:
        assert "paint" in str(refusal)
    else:
        assert first > 0  # What was in the brush was enough.
        assert abs(touch_off) < 0.0005
        assert abs(press_off) < 1e-6


class Hand:
    """A person who answers no to looking, and then types these moves at the two heights."""

    def __init__(self, *moves):
        self.moves, self.asked = list(moves), []

    def answer(self, question):
        self.asked.append(question)
        if isinstance(question, Measure):
            return 0.085
        if isinstance(question, Confirm):
            return False
        return self.moves.pop(0)


DOWN, OK = JogMove(-0.01), JogMove(settled=True)


def test_a_person_may_set_both_heights_with_jog_keys_and_no_paint():
    studio = studio_with()
    person = Hand(DOWN, DOWN, DOWN, JogMove(0.001), OK, JogMove(-0.004), OK)
    finding = lead(brush(studio.easel), person.answer)
    record = finding.enter(studio.easel.calibration)
    assert record.touch_height == pytest.approx(0.15 - 0.03 + 0.001)
    assert record.press_height == pytest.approx(record.touch_height - 0.004)
    assert record.protrusion == 0.085 and record.done["brush"].residual == 0.0005
    assert finding.picture is None and "as set by hand; set by hand." in finding.sentence
    assert studio.camera.photographs == 0 and studio.balance().drawn == 0
    heights = [question.height for question in person.asked if isinstance(question, Jog)]
    assert heights == pytest.approx([0.15, 0.14, 0.13, 0.12, 0.121, 0.121, 0.117])


def test_jogging_stops_at_the_workspaces_floor_and_below_the_touch():
    studio = studio_with()
    floor = studio.easel.workspace.lower[2]
    person = Hand(JogMove(-0.1), JogMove(-0.03), OK, JogMove(0.02), JogMove(-0.1), JogMove(floor - 0.12), OK)
    record = lead(brush(studio.easel), person.answer).enter(studio.easel.calibration)
    assert (record.touch_height, record.press_height) == pytest.approx((0.12, floor))
    refused = [question for question in person.asked if question.text.startswith("No further")]
    assert len(refused) == 3
    assert all(question.lowest <= question.height <= question.highest for question in person.asked[2:])


def test_the_brush_comes_to_its_place_from_above():
    studio = studio_with()
    paths = []
    follow = studio.robot.follow
    studio.robot.follow = lambda waypoints: (paths.append(waypoints.position), follow(waypoints))[1]
    lead(brush(studio.easel), Hand(JogMove(-0.028), OK, JogMove(-0.005), OK).answer)
    first, second = paths[0], paths[1]
    assert first[0, 2] > studio.touch_height + 0.02 and len(second) == 1
    assert np.abs(first[:, :2] - first[0, :2]).max() < 1e-9


@pytest.mark.parametrize(
    ("moves", "says"),
    [((OK, OK), "not below the lightest touch"), ((JogMove(float("nan")),), "no move"), ((True,), "no move")],
)
def test_heights_that_cannot_be_are_refused(moves, says):
    with pytest.raises(CalibrationError, match=says):
        lead(brush(studio_with().easel), Hand(*moves).answer)


@pytest.mark.parametrize("length", [-0.01, 3.0, float("nan"), True, "8 cm"])
def test_a_protrusion_that_cannot_be_is_refused(length):
    hand = Hand(JogMove(-0.03), OK, JogMove(-0.004), OK)
    with pytest.raises(CalibrationError, match="protrudes"):
        lead(
            brush(studio_with().easel),
            lambda question: length if isinstance(question, Measure) else hand.answer(question),
        )


def test_a_workspace_whose_floor_is_at_the_paper_leaves_no_room_to_press():
    studio = studio_with()
    workspace = studio.easel.workspace
    shallow = replace(workspace, lower=(*workspace.lower[:2], studio.touch_height - 0.0025))
    with pytest.raises(CalibrationError, match="no room"):
        lead(brush(replace(studio.easel, workspace=shallow)), proposed)


def test_a_canvas_at_hover_height_is_refused():
    studio = studio_with(rise=0.02)
    low = replace(studio.easel.workspace, hover=0.015)
    with pytest.raises(CalibrationError, match="already at"):
        lead(brush(replace(studio.easel, workspace=low)), proposed)


def test_a_person_is_asked_for_paper_where_nobody_else_lays_it_and_may_correct_what_was_found():
    studio = studio_with("fine")
    operator, asked, jogs = studio.easel.operator, [], []

    class Helper:
        fill_wells = operator.fill_wells

        def lay_paper(self):
            return False

    def person(question):
        asked.append(question.text)
        if question.text.startswith("Lay"):
            operator.lay_paper()
        if isinstance(question, Jog):
            jogs.append(question)
            return JogMove(0.0005) if len(jogs) == 1 else OK
        return question.proposal

    finding = lead(brush(replace(studio.easel, operator=Helper())), person)
    record = finding.enter(studio.easel.calibration)
    assert sum(text.startswith("Lay") for text in asked) >= 2
    assert abs(jogs[0].height - studio.touch_height) < 0.0003
    assert jogs[0].proposal == OK and jogs[0].picture is not None
    assert record.touch_height == pytest.approx(jogs[0].height + 0.0005)
    assert record.done["brush"].residual == 0.0005 and "as set by hand; found in" in finding.sentence
    with pytest.raises(CalibrationError, match="Without paper"):
        lead(
            brush(replace(studio.easel, operator=Helper())),
            lambda question: question.proposal if not question.text.startswith("Lay") else False,
        )
