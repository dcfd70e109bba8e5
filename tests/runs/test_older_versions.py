"""Plans, stopped paintings, records, journals and settings of 0.3 are read."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from frida_painter.calibration import Calibration
from frida_painter.errors import StorageError
from frida_painter.plan import Plan
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import upgrade_record
from frida_painter.session.controls import Controls

TRUE_PHOTOGRAPHS = True

OLDER = Path(__file__).parents[1] / "older"


@pytest.fixture
def stopped(tmp_path: Path) -> Path:
    """A copy of the painting that was stopped in its fourth stroke of 24."""
    return Path(shutil.copytree(OLDER / "painting", tmp_path / "painting"))


def test_a_plan_is_read() -> None:
    plan = Plan.load(OLDER / "plan")
    assert (len(plan.strokes), len(plan.palette), plan.layers[0].brush) == (24, 3, "fine")
    told = json.loads((OLDER / "plan" / "plan.json").read_text())
    assert [plan.canvas.width, plan.canvas.height] == pytest.approx(told["canvas_m"])
    np.testing.assert_allclose(plan.palette.color, told["palette_srgb"], atol=1e-5)


def test_a_calibration_record_is_read() -> None:
    told = json.loads((OLDER / "painting" / "calibration.json").read_text())
    assert Calibration.load(OLDER / "painting" / "calibration.json").brush == told["brush"] == "fine"


def test_every_setting_is_kept(stopped: Path) -> None:
    told = json.loads((stopped / "settings.json").read_text())
    with PaintingRun.reopen(stopped) as run:
        kept = run.spec.record()
    for name, value in upgrade_record(told).items():
        assert kept[name] == value or name == "pace", name  # a painting is resumed at another pace


def test_a_stopped_painting_is_resumed_to_its_last_stroke(stopped: Path) -> None:
    with PaintingRun.reopen(stopped) as run:
        assert run.history is not None and run.history.painted == 3
        run.controls = Controls(answer=lambda question: question.proposal)
        outcome = run.resume()
    assert outcome.painting is not None and outcome.painting.painted == 24
    assert (stopped / "painting.png").is_file() and (stopped / "index.html").is_file()


def test_a_painting_whose_journal_has_another_version_is_refused_in_one_sentence(stopped: Path) -> None:
    journal = stopped / "journal"
    journal.write_bytes(journal.read_bytes().replace(b'"version": 2, "kind"', b'"version": 9, "kind"', 1))
    before = sorted((path, path.stat().st_size) for path in stopped.rglob("*"))
    with pytest.raises(StorageError) as refused, PaintingRun.reopen(stopped):
        pass
    assert str(journal) in str(refused.value) and "\n" not in str(refused.value)
    assert sorted((path, path.stat().st_size) for path in stopped.rglob("*")) == before
