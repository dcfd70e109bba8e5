"""The example of learning learns: in tiny sizes, and with what people install for it."""

import json
import runpy
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "learning" / "learn_to_paint.py"

pytestmark = pytest.mark.usefixtures("small_world")


def test_it_trains_and_writes_its_chart_and_scores(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    it = runpy.run_path(str(EXAMPLE))
    it["SETTINGS"].update(strokes=4, rows=16, canvas="9x7cm", brush="fine", paints=2)
    it["main"](512, [0], tmp_path / "learned")
    found = json.loads((tmp_path / "learned.json").read_text())
    for scores in found["scores"].values():
        assert set(scores) == {"random", "greedy", "planner", "learned"}
        assert all(0 < score < 60 for each in scores.values() for score in each)
    assert [steps for steps, _ in found["curves"][0]] == [256, 512]
    assert (tmp_path / "learned.png").stat().st_size > 1000
