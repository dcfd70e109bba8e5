from pathlib import Path

import pytest
import torch

from frida_painter.calibration import Calibration, WetPaint, previous
from frida_painter.planning.placement import Placement
from frida_painter.runs.painting_folder import keep_learned
from frida_painter.runs.spec import RunSpec
from frida_painter.session.progress import Painting
from support.easel import CALIBRATION, CANVAS
from support.plans import made_up_plan

TRUE_PHOTOGRAPHS = True

PLAN = made_up_plan(4, 2)
FINISHED = Painting(torch.ones(3, 4, 4), 4, PLAN.part(slice(4, None)))
LEARNED = Placement((0.002, -0.001, 0.01), Placement.unknown().information, Placement.unknown({"small": 0.01}).touch)


def spec(record: Path | None, **settings: object) -> RunSpec:
    wanted = {"goal": [{"text": "a lemon"}], "canvas": "120x90mm", "calibration": record, **settings}
    return RunSpec.of(**wanted)


def test_the_next_painting_begins_with_what_this_one_learned(tmp_path: Path) -> None:
    record = tmp_path / "calibration.json"
    CALIBRATION.save(record)
    begun = Calibration.load(record)
    learned = Placement(LEARNED.error, LEARNED.information, LEARNED.touch.after("small", 0.001, 0.00001))
    assert keep_learned(spec(record), begun, learned, FINISHED, lambda: None) == record
    kept = Calibration.load(record)
    assert kept == learned.correct(begun, CANVAS)
    assert kept.press_height == pytest.approx(CALIBRATION.press_height - 0.001, abs=1e-6)
    assert kept.done == begun.done and Calibration.load(previous(record)) == begun


def test_wet_paint_is_kept_beside_it_and_what_is_known_of_it_stays_if_a_painting_shows_none(tmp_path: Path) -> None:
    record, wet = tmp_path / "calibration.json", WetPaint(12.0, 0.2, 300.0)
    CALIBRATION.save(record)
    for found in (wet, None):
        assert keep_learned(spec(record), Calibration.load(record), LEARNED, FINISHED, lambda: found) == record  # noqa: B023
        assert Calibration.load(record).wet == wet


@pytest.mark.parametrize("case", ["no record", "unfinished", "nothing planned", "by hand", "calibrated meanwhile"])
def test_a_record_stays_as_it_is_where_nothing_can_be_told_of_it(case: str, tmp_path: Path) -> None:
    record = tmp_path / "calibration.json"
    CALIBRATION.save(record)
    begun, painting, how = Calibration.load(record), FINISHED, spec(record)
    if case == "no record":
        how = spec(None)
    if case == "unfinished":
        painting = Painting(FINISHED.photograph, 3, PLAN.part(slice(3, None)))
    if case == "nothing planned":
        painting = Painting(FINISHED.photograph, 0, None)
    if case == "by hand":
        how = spec(record, robot="human")
    if case == "calibrated meanwhile":
        CALIBRATION.with_robot(CALIBRATION.placement, residual=0.0).save(record)
    before = record.read_bytes()
    assert keep_learned(how, begun, LEARNED, painting, lambda: None) is None
    assert record.read_bytes() == before
