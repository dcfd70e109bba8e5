"""Plans, records and settings of 0.3 are read; a stopped painting is refused."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from frida_painter.calibration import Calibration
from frida_painter.errors import StorageError
from frida_painter.runs.painting_folder import read_spec
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import upgrade_record
from frida_painter.strokes.plan import Plan

OLDER = Path(__file__).parents[1] / "older"


def test_a_plan_is_read() -> None:
    plan = Plan.load(OLDER / "plan")
    assert (len(plan.strokes), len(plan.palette), plan.layers[0].brush) == (24, 3, "fine")
    told = json.loads((OLDER / "plan" / "plan.json").read_text())
    assert [plan.canvas.width, plan.canvas.height] == pytest.approx(told["canvas_m"])
    np.testing.assert_allclose(plan.palette.color, told["palette_srgb"], atol=1e-5)


def test_a_calibration_record_is_read() -> None:
    told = json.loads((OLDER / "painting" / "calibration.json").read_text())
    assert Calibration.load(OLDER / "painting" / "calibration.json").brush == told["brush"] == "fine"


def test_every_setting_is_kept() -> None:
    told = json.loads((OLDER / "painting" / "settings.json").read_text())
    kept = read_spec(OLDER / "painting").record()
    assert {name: kept[name] for name in upgrade_record(told)} == upgrade_record(told)


def test_a_painting_is_refused_in_one_sentence_that_names_the_version_that_can_finish_it(tmp_path: Path) -> None:
    stopped = Path(shutil.copytree(OLDER / "painting", tmp_path / "painting"))
    before = sorted((path, path.stat().st_size) for path in stopped.rglob("*"))
    with (
        pytest.raises(StorageError, match=r"finish it with frida-painter 0\.3") as refused,
        PaintingRun.reopen(stopped),
    ):
        pass
    assert str(stopped) in str(refused.value) and "\n" not in str(refused.value)
    assert sorted((path, path.stat().st_size) for path in stopped.rglob("*")) == before
