import math
import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Confirm, PointCorners, lead
from frida_painter.errors import CalibrationError, FrameRejected
from frida_painter.hardware.faults import Bump, Faults, LightChange, LostFocus
from frida_painter.session.observer import CanvasObserver
from frida_painter.strokes.palette import difference
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter_calibration.procedures.color import WORST_MEAN, color
from frida_painter_calibration.procedures.robot import robot
from papers import proposed

CANVAS = CanvasSize(0.28, 0.21)
CAMERA = CameraSpec(photograph=(600, 800))


def studio_with(seed=0, camera=CAMERA, faults=None, canvas=CANVAS, **settings):
    settings = StudioSettings(cell=1.0, camera=camera, **settings)
    studio = open_studio(canvas, "broad", seed=seed, settings=settings, faults=faults)
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return studio


def calibrated(easel, answer=proposed):
    """The finding, and what entered the record: the map, and what it leaves."""
    finding = lead(color(easel), answer)
    record = finding.enter(easel.calibration)
    return finding, np.array(record.color), record.done["color"].residual


@lru_cache(maxsize=2)  # each keeps photographs
def found(**studio):
    return calibrated(studio_with(**studio).easel)


def test_on_the_usual_studio_patches_never_seen_come_out_right():
    finding, _, residual = found(seed=0, camera=CameraSpec())
    said = re.search(r"at worst (.*), .*; as photographed they were (.*) off, in even light (.*)\.", finding.sentence)
    worst, photographed, even = map(float, said.groups())
    assert f"{residual:.1f} CIEDE2000" in finding.sentence
    assert residual < 0.8 < 1.0 < even < 3.5 < photographed < 5  # 2.5 are promised; measured: 0.46 to 0.63
    assert residual < worst < 3


def test_after_the_robot_procedure_a_small_canvas_is_bare_again():
    studio = studio_with(canvas=CanvasSize(0.16, 0.12))
    lead(robot(studio.easel), proposed)
    assert calibrated(studio.easel)[2] < 2.5
    assert studio.table.checker is None


def painted_squares(studio):
    """Puts squares of dry colour on the canvas; returns their middles in a picture of 200 rows, and their sRGB."""
    chance = np.random.default_rng(5)
    colors = chance.uniform(0.05, 0.95, (24, 3))
    canvas = studio.canvas
    places = []
    for number, srgb in enumerate(colors):
        row, column = divmod(number, 6)
        bottom, left = (
            int((0.1 + 0.2 * row) * canvas.ground.shape[0]),
            int((0.05 + 0.15 * column) * canvas.ground.shape[1]),
        )
        reach = int(0.12 * canvas.ground.shape[0])
        canvas.ground[bottom : bottom + reach, left : left + reach] = ((srgb + 0.055) / 1.055) ** 2.4
        places.append(((bottom + reach / 2) / canvas.ground.shape[0], (left + reach / 2) / canvas.ground.shape[1]))
    canvas._changed[:] = True
    return places


def test_the_painter_sees_the_canvas_as_it_is():
    """With the bands leaking into each other, of 24 colours that are not the checker's; CIEDE2000."""
    errors = {}
    for calibrated in (False, True):
        studio = studio_with(camera=replace(CAMERA, bleed=0.08))
        easel = studio.easel
        if calibrated:
            easel = replace(easel, calibration=lead(color(easel), proposed).enter(easel.calibration))
        observer = CanvasObserver(easel)
        observer.look(easel.robot.home().finished_at, 200)
        places = painted_squares(studio)
        seen, truth = observer.look(easel.robot.home().finished_at, 200), studio.truth(200)
        off = []
        for up, across in places:
            row, column = round(200 * (1 - up)), round(truth.shape[2] * across)
            one, other = (
                picture[:, row - 3 : row + 4, column - 3 : column + 4].mean((1, 2)) for picture in (seen, truth)
            )
            off.append(float(difference(one, other)))
        errors[calibrated] = sum(off) / len(off)
    assert errors[True] < 1.0
    assert errors[False] > 3 * errors[True]


def test_a_checker_that_lies_upside_down_or_askew_is_read_all_the_same():
    studio = studio_with()
    straight = calibrated(studio.easel)[1]
    for turn in (math.pi, math.pi / 2, -1.0):
        studio.lay_checker((0.15, 0.1), turn, 0.12)
        _, affine, residual = calibrated(studio.easel)
        assert residual < 0.8 and np.abs(affine - straight).max() < 0.03


def test_corners_given_by_a_person_may_begin_anywhere_and_run_either_way():
    studio = studio_with()
    wanted = calibrated(studio.easel)[1]
    for change in (lambda c: c[2:] + c[:2], lambda c: (c[3], c[2], c[0], c[1])):

        def person(question, change=change):
            return change(question.proposal) if isinstance(question, PointCorners) else question.proposal

        assert np.abs(calibrated(studio.easel, person)[1] - wanted).max() < 0.01


@pytest.mark.parametrize(
    "change",
    [LightChange(0, (0.8, 0.6, 0.4)), LightChange(0, (0.7, 0.7, 0.7), (-0.3, 0.1))],
)
def test_another_light_is_taken_out(change):
    _, affine, residual = found(faults=Faults(light_changes=(change,)))
    assert residual < 0.9 and np.abs(affine - found()[1]).max() < 0.04


@pytest.mark.parametrize(("blur", "first"), [(0.004, 0), (0.006, 0), (0.008, 0), (0.02, 0)])
def test_out_of_focus_the_map_is_right_or_refused(blur, first):
    faults = Faults(lost_focus=(LostFocus(first, blur=blur),))
    if blur <= 0.004:
        assert found(faults=faults)[2] < 0.8
        return
    try:
        affine = found(faults=faults)[1]
    except CalibrationError as refusal:
        assert "focus" in str(refusal)
    else:
        assert blur < 0.012 and np.abs(affine - found()[1]).max() < 0.03


def test_a_photograph_that_is_too_bright_or_too_dark_is_refused():
    with pytest.raises(CalibrationError, match=r"overexposed.*white"):
        found(faults=Faults(light_changes=(LightChange(0, (1.25, 1.25, 1.25)),)))
    with pytest.raises(CalibrationError, match="too dark"):
        found(faults=Faults(light_changes=(LightChange(0, (0.05, 0.05, 0.05)),)))


def test_no_checker_and_no_answer_are_refused_with_what_to_do():
    studio = studio_with()
    studio.lay_checker((2.0, 2.0), 0.0, 0.1)
    with pytest.raises(CalibrationError, match="No colour checker was found"):
        lead(color(studio.easel), proposed)
    with pytest.raises(CalibrationError, match="No colour checker was found"):
        lead(color(studio_with().easel), lambda question: ((0.0, 1.0), (2.0, math.nan)))


def test_corners_that_are_not_the_checkers_are_refused():
    def person(question):
        if isinstance(question, PointCorners):
            return tuple((0.6 * column + 100, 0.6 * row) for column, row in question.proposal)
        return question.proposal

    with pytest.raises(CalibrationError, match="color calibration"):
        lead(color(studio_with().easel), person)


def test_a_chart_of_other_colours_is_refused():
    studio = studio_with()
    checker = studio.easel.operator.checker
    studio.easel.operator.checker = replace(checker, looks=checker.looks ** np.array([0.6, 1.4, 1.0], np.float32))
    with pytest.raises(CalibrationError, match=f"at most {WORST_MEAN:g}"):
        lead(color(studio.easel), proposed)


def test_a_card_that_hides_the_canvas_is_refused():
    studio = studio_with(canvas=CanvasSize(0.1, 0.07))
    studio.lay_checker((0.05, 0.035), 0.0, 0.1)
    with pytest.raises(FrameRejected, match="covers all but"):
        lead(color(studio.easel), proposed)


def test_a_camera_without_fault_is_left_as_it_is_or_made_no_worse():
    finding, affine, residual = found(camera=CameraSpec.ideal(600, 800))
    assert residual <= float(re.search(r"in even light (.*)\.", finding.sentence)[1]) + 0.05
    assert np.abs(affine - np.eye(3, 4)).max() < 0.03


class Person:
    """Lays the checker down when asked to, on an easel whose operator does not."""

    def __init__(self, studio):
        self.studio, self.asked = studio, []

    def lay_paper(self):
        return False

    def lay_checker(self):
        return False

    def take_checker_away(self):
        return False

    def answer(self, question):
        self.asked.append(question)
        if isinstance(question, Confirm):
            self.studio.table.checker = self.studio.easel.operator.checker if question.text.startswith("Lay") else None
        return question.proposal


def test_a_person_is_asked_to_lay_the_checker_down_and_to_take_it_away():
    studio = studio_with()
    person = Person(studio)
    assert calibrated(replace(studio.easel, operator=person), person.answer)[2] < 0.8
    assert [type(question) for question in person.asked] == [Confirm, PointCorners, Confirm]
    assert person.asked[1].picture.shape == (3, 600, 800)
    with pytest.raises(CalibrationError, match="Without a colour checker"):
        lead(color(replace(studio.easel, operator=person)), lambda question: "Lay" not in question.text)


def test_a_canvas_that_was_knocked_meanwhile_does_not_spoil_the_colours():
    after = found(faults=Faults(bumps=(Bump(0, (0.003, 0.0)),)))[1]
    assert np.abs(after - found()[1]).max() < 0.03
