import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter import storage
from frida_painter.calibration import Calibration
from frida_painter.errors import CalibrationError

RECORD = Calibration(
    easel="virtual",
    brush="medium",
    corners=((100.0, 50.0), (900.0, 60.0), (890.0, 700.0), (90.0, 690.0)),
    photograph=(760, 1024),
    touch_height=0.012,
    press_height=0.004,
    residuals={"canvas_px": 0.4},
)


def test_a_record_comes_back_as_it_was(tmp_path: Path) -> None:
    RECORD.save(tmp_path / "calibration.json")
    assert Calibration.load(tmp_path / "calibration.json") == RECORD


def test_the_record_before_is_kept(tmp_path: Path) -> None:
    RECORD.save(tmp_path / "calibration.json")
    replace(RECORD, brush="fine").save(tmp_path / "calibration.json")
    assert Calibration.load(tmp_path / "calibration.json").brush == "fine"
    assert Calibration.load(tmp_path / "calibration.json.prev") == RECORD


@given(st.floats(0, 1))
def test_thickness_is_linear_in_height(thickness: float) -> None:
    heights = RECORD.height(np.array([0.0, thickness, 1.0]))
    assert heights[0] == RECORD.touch_height and heights[2] == pytest.approx(RECORD.press_height)
    assert heights[1] == pytest.approx(0.012 - 0.008 * thickness)


def test_without_a_measurement_strokes_go_where_they_are_meant() -> None:
    position = np.array([[0.0, 0.0], [0.1, 0.2]])
    assert np.array_equal(RECORD.place(position), position)


def test_placement_is_a_homography() -> None:
    matrix = np.array([[1.01, 0.02, 0.003], [-0.02, 0.99, -0.002], [0.05, -0.03, 1.0]])
    found = replace(RECORD, placement=tuple(map(tuple, matrix.tolist()))).place(np.array([[0.1, 0.2]]))
    x, y, scale = matrix @ (0.1, 0.2, 1)
    assert np.allclose(found, [[x / scale, y / scale]])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"corners": RECORD.corners[:3]}, "clockwise"),
        ({"corners": RECORD.corners[::-1]}, "clockwise"),
        ({"corners": ((math.nan, 0.0), *RECORD.corners[1:])}, "clockwise"),
        ({"placement": ((1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))}, "singular or mirrored"),
        ({"placement": ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}, "singular or mirrored"),
        ({"placement": ((math.nan, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}, "singular or mirrored"),
        ({"color": ((1.0, 0.0, 0.0),) * 3}, "3 x 4"),
        ({"press_height": 0.02}, "not below"),
        ({"touch_height": math.nan}, "not below"),
        ({"touch_height": math.inf}, "not below"),
    ],
)
def test_what_cannot_be_true_is_refused(change: dict[str, object], says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        replace(RECORD, **change)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"format": "plan"}, "not a calibration record"),
        ({"version": 2}, "not a calibration record of version 1"),
        ({"stranger": 1}, "part missing"),
        ({"photograph": None}, "part missing"),
        ({"corners": [[0.0, 0.0]]}, "clockwise"),
    ],
)
def test_a_foreign_record_is_refused(tmp_path: Path, change: dict[str, object], says: str) -> None:
    path = tmp_path / "calibration.json"
    RECORD.save(path)
    storage.write_json(path, {**json.loads(path.read_text()), **change})
    with pytest.raises(CalibrationError, match=says):
        Calibration.load(path)


def test_an_edited_or_missing_record_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    with pytest.raises(CalibrationError, match="does not exist"):
        Calibration.load(path)
    RECORD.save(path)
    path.write_text(path.read_text().replace("medium", "broad"))
    with pytest.raises(CalibrationError, match="was changed"):
        Calibration.load(path)
