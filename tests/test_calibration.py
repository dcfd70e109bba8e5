import json
import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.calibration import Calibration, Done, LearnedFile, previous
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError
from frida_painter.frames import Lens
from frida_painter.system import storage

RECORD = Calibration(
    easel="virtual",
    brush="medium",
    corners=((100.0, 50.0), (900.0, 60.0), (890.0, 700.0), (90.0, 690.0)),
    photograph=(760, 1024),
    touch_height=0.012,
    press_height=0.004,
    canvas=CanvasSize(0.4, 0.3),
    camera="webcam 3",
)


FULL = (
    RECORD.with_canvas(
        RECORD.corners, (760, 1024), camera="webcam 4", canvas=CanvasSize(0.3, 0.2), residual=0.4,
        lens=Lens((900.0, 900.0), (511.5, 379.5), (-0.05, 0.01, 0.0, 0.0, 0.0)),
    )
    .with_robot(((1.0, 0.01, 0.002), (-0.01, 1.0, 0.001), (0.0, 0.0, 1.0)), residual=0.0003)
    .with_color(((0.9, 0.0, 0.0, 0.01), (0.0, 0.9, 0.0, 0.01), (0.0, 0.0, 0.9, 0.01)), residual=1.4)
    .with_brush("fine", 0.013, 0.004, protrusion=0.031, residual=0.0005)
    .with_strokes(LearnedFile("library.npz", "ab" * 32), LearnedFile("weights.safetensors", "cd" * 32), residual=0.02)
)  # fmt: skip


@pytest.mark.parametrize("record", [RECORD, FULL])
def test_a_record_comes_back_as_it_was(tmp_path: Path, record: Calibration) -> None:
    record.save(tmp_path / "calibration.json")
    assert Calibration.load(tmp_path / "calibration.json") == record


def test_each_procedure_sets_its_part_its_date_and_its_residual() -> None:
    assert list(FULL.done) == ["canvas", "robot", "color", "brush", "strokes"]
    assert [done.turn for done in FULL.done.values()] == [1, 2, 3, 4, 5]
    assert [done.residual for done in FULL.done.values()] == [0.4, 0.0003, 1.4, 0.0005, 0.02]
    assert (FULL.camera, FULL.canvas, FULL.brush) == ("webcam 4", CanvasSize(0.3, 0.2), "fine")
    again = FULL.with_robot(RECORD.placement, residual=0.0002)
    assert again.done["robot"].turn == 6 and again.done["robot"].residual == 0.0002
    assert again.placement == RECORD.placement and again.corners == FULL.corners
    assert not RECORD.done, "a record is a value"


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
        ({"press_height": -math.inf}, "not below"),
        ({"corners": ((0.0, 0.0), (100.0, 0.0), (30.0, 30.0), (0.0, 100.0))}, "clockwise"),
        ({"lens": Lens((300.0, 300.0), (511.5, 379.5), (-0.9, 0.0, 0.0, 0.0, 0.0))}, "Through the lens"),
        ({"protrusion": -0.01}, "protrudes"),
        ({"protrusion": math.nan}, "protrudes"),
        ({"done": {"canvas": Done("2026-11-21", 1, math.nan)}}, "'canvas'"),
        ({"done": {"walls": Done("2026-11-21", 1, 0.1)}}, "'walls'"),
    ],
)
def test_what_cannot_be_true_is_refused(change: dict[str, object], says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        replace(RECORD, **change)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"format": "plan"}, "of another kind"),
        ({"version": 1}, "of version 1, not .* version 2; repeat all"),
        ({"version": 3}, "of version 3"),
        ({"stranger": 1}, "'stranger' .* calibrate all"),
        ({"photograph": None}, "'photograph'"),
        ({"touch_height": "0.1"}, "'touch_height'"),
        ({"corners": [[0.0, 0.0]]}, "clockwise"),
        ({"done": {"canvas": {"dated": "today", "turn": 1}}}, "'done.canvas.residual'"),
        ({"lens": {"focal": [1, 1], "middle": [0, 0], "coefficients": [9, 0, 0, 0, 0]}}, "repeat the canvas"),
    ],
)
def test_a_foreign_or_old_record_is_refused(tmp_path: Path, change: dict[str, object], says: str) -> None:
    path = tmp_path / "calibration.json"
    RECORD.save(path)
    storage.write_json(path, {**json.loads(path.read_text()), **change})  # with a checksum that is right again
    with pytest.raises(CalibrationError, match=says):
        Calibration.load(path)


def test_a_missing_record_and_one_cut_off_anywhere_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    with pytest.raises(CalibrationError, match="does not exist"):
        Calibration.load(path)
    FULL.save(path)
    whole = path.read_bytes()
    for length in (*range(0, len(whole) - 1, 41), len(whole) - 2):
        path.write_bytes(whole[:length])
        with pytest.raises(CalibrationError, match="calibrate all"):
            Calibration.load(path)


@given(st.data())
def test_a_record_with_any_character_changed_is_refused(tmp_path_factory: pytest.TempPathFactory, data) -> None:
    path = tmp_path_factory.mktemp("record") / "calibration.json"
    FULL.save(path)
    whole = path.read_bytes()
    place = data.draw(st.integers(0, len(whole) - 1))
    other = data.draw(st.integers(33, 126).filter(lambda byte: byte != whole[place]))
    path.write_bytes(whole[:place] + bytes([other]) + whole[place + 1 :])
    with suppress(ValueError):
        if json.loads(path.read_text()) == json.loads(whole):
            return  # white space between its parts, or another way to write the same number
    with pytest.raises(CalibrationError):
        Calibration.load(path)


def test_the_last_good_record_is_kept_where_the_present_one_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    RECORD.save(path)
    FULL.save(path)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(CalibrationError, match=r"the one before is .*calibration\.json\.prev"):
        Calibration.load(path)
    replace(RECORD, brush="broad").save(path)
    assert Calibration.load(previous(path)) == RECORD, "the damaged one did not take its place"
    assert Calibration.load(path).brush == "broad"
