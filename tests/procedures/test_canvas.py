from dataclasses import replace

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import PointCorners, lead
from frida_painter.errors import CalibrationError
from frida_painter.hardware.easel import Easel
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, VirtualStudio, open_studio
from frida_painter_calibration.procedures.canvas import POINTING, canvas
from papers import proposed
from support.easel import CALIBRATION, stub_easel


@pytest.fixture(scope="module")
def studio() -> VirtualStudio:
    opened = open_studio(CanvasSize(0.20, 0.15), seed=5, settings=StudioSettings(camera=CameraSpec((600, 800))))
    opened.easel.robot.connect()
    opened.easel.camera.connect()
    return opened


def off(corners, studio: VirtualStudio) -> float:
    return float(np.linalg.norm(np.array(corners) - np.array(studio.camera.corners), axis=1).max())


def ignorant(easel: Easel) -> Easel:
    """The easel with a record that knows nothing of where the canvas is."""
    somewhere = ((10.0, 10.0), (20.0, 10.0), (20.0, 20.0), (10.0, 20.0))
    return replace(easel, calibration=replace(easel.calibration, corners=somewhere, lens=None))


def test_the_proposal_is_right_and_enters_the_record(studio: VirtualStudio) -> None:
    easel = ignorant(studio.easel)
    found = lead(canvas(easel), proposed)
    record = found.enter(easel.calibration)
    assert off(record.corners, studio) < 0.6 and record.lens is not None
    assert "by its edges, each seen over at least" in found.sentence and "barrel" in found.sentence
    assert found.picture is not None and found.picture.shape[0] == 3 and record.bare is not None
    assert (record.camera, record.canvas) == ("virtual camera", CanvasSize(0.20, 0.15))
    assert list(record.done) == ["canvas"] and record.done["canvas"].residual < 0.5


def test_the_corners_that_a_person_gives_override(studio: VirtualStudio) -> None:
    mine = tuple((column + 1.5, row - 1.0) for column, row in studio.camera.corners)
    found = lead(canvas(studio.easel), lambda question: mine)
    record = found.enter(studio.easel.calibration)
    assert record.corners == mine and "where you pointed" in found.sentence
    assert record.lens is not None, "the edges near them still tell the lens"
    assert record.done["canvas"].residual == pytest.approx(np.hypot(1.5, 1.0), abs=0.4), "and how well was pointed"
    elsewhere = ((100.0, 100.0), (700.0, 110.0), (690.0, 500.0), (120.0, 490.0))
    far = lead(canvas(studio.easel), lambda question: elsewhere).enter(studio.easel.calibration)
    assert far.corners == elsewhere and far.done["canvas"].residual == POINTING and far.lens is None


def test_three_corners_are_no_canvas(studio: VirtualStudio) -> None:
    with pytest.raises(CalibrationError, match="3 corners were given; a canvas has four"):
        lead(canvas(studio.easel), lambda question: ((0.0, 0.0), (700.0, 0.0), (700.0, 500.0)))


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (((0.0, 0.0), (0.0, 50.0), (70.0, 50.0), (70.0, 0.0)), "clockwise"),
        (((0.0, 0.0), (70.0, 50.0), (70.0, 0.0), (0.0, 50.0)), "clockwise"),
        (((10.0, 10.0), (10.1, 10.0), (10.1, 50.0), (10.0, 50.0)), "clockwise|coincide"),
        (((0.0, 0.0), (9900.0, 0.0), (9900.0, 50.0), (0.0, 50.0)), "outside the photograph of"),
        (((float("nan"), 0.0), (70.0, 0.0), (70.0, 50.0), (0.0, 50.0)), "cannot be told"),
        (True, "cannot be told"),
    ],
)
def test_corners_that_cannot_be_a_canvass_are_refused(answer, says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        lead(canvas(stub_easel()), lambda question: answer)


def test_where_no_canvas_is_seen_the_reason_is_told_and_a_person_can_point() -> None:
    easel = stub_easel()
    asked = []
    with pytest.raises(CalibrationError, match="cannot be told"):
        lead(canvas(easel), lambda question: asked.append(question))
    (question,) = asked
    assert isinstance(question, PointCorners) and question.proposal is None and "cannot be told" in question.text
    found = lead(canvas(easel), lambda question: CALIBRATION.corners).enter(easel.calibration)
    assert found.corners == CALIBRATION.corners and found.done["canvas"].residual == POINTING
