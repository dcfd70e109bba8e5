from dataclasses import replace
from pathlib import Path

import pytest

from frida_painter.brush.kinds import brush_kind
from frida_painter.calibration import Calibration, LearnedFile
from frida_painter_calibration.calibrating import CalibrationSetup, record_to_renew
from support.easel import CALIBRATION, stub_easel

BROAD, FINE = replace(CALIBRATION, brush="broad"), replace(CALIBRATION, brush="fine")
LIBRARY = LearnedFile("strokes.npz", "0" * 64)


@pytest.fixture
def record(tmp_path: Path) -> Path:
    """Of an easel whose broad brush was calibrated, with its strokes, and then its fine one."""
    path = tmp_path / "calibration.json"
    known = BROAD.with_robot(BROAD.placement, residual=0.001)
    known = known.with_brush("broad", 0.11, 0.1, protrusion=None, residual=0.001)
    known = known.with_strokes(LIBRARY, LIBRARY, residual=0.1)
    known.with_brush("fine", 0.108, 0.1, protrusion=None, residual=0.001).save(path)
    return path


def test_what_is_learned_of_one_brush_lies_beside_what_was_learned_of_another(tmp_path: Path) -> None:
    def beside(brush: str, name: str) -> str:
        setup = CalibrationSetup(stub_easel(), brush_kind(brush), tmp_path / "cal.json", 0, 9, print)
        return setup.beside(name, "npz").name

    assert beside("fine", "strokes") == "cal-strokes-fine.npz" and beside("broad", "strokes") == "cal-strokes-broad.npz"
    assert beside("fine", "robot") == "cal-robot.npz"


def test_strokes_of_a_brush_are_entered_for_it_whichever_was_calibrated_last(record: Path) -> None:
    known = record_to_renew(record, BROAD, anew=False)
    again = known.with_strokes(LearnedFile("new.npz", "1" * 64), residual=0.05)
    assert again.brush == "broad" and again.library is not None and again.library.path == "new.npz"
    assert again.touch_height == 0.11 and again.others["fine"].touch_height == 0.108
    assert again.others["fine"].library is None


def test_all_of_a_brush_done_anew_leaves_what_is_known_of_the_others(record: Path) -> None:
    anew = record_to_renew(record, FINE, anew=True)
    assert anew.brush == "fine" and anew.touch_height == CALIBRATION.touch_height
    assert anew.others["broad"].library == LIBRARY and anew.others["broad"].touch_height == 0.11
    third = record_to_renew(record, replace(CALIBRATION, brush="medium"), anew=True)
    assert set(third.others) == {"broad", "fine"} and set(third.done) == {"robot"}
    broad = record_to_renew(record, BROAD, anew=True)
    assert set(broad.others) == {"fine"} and set(broad.done) == {"robot", "brush", "strokes"}
    finished = broad.with_brush("broad", 0.12, 0.1, protrusion=None, residual=0.001)
    assert finished.done["brush"].turn == 5 and finished.others["fine"].done["brush"].turn == 4


def test_without_a_record_the_easel_s_own_is_begun_with(tmp_path: Path) -> None:
    assert record_to_renew(tmp_path / "none.json", BROAD, anew=False) == BROAD
    assert isinstance(record_to_renew(tmp_path / "none.json", BROAD, anew=True), Calibration)
