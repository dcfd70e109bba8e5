"""The pages of a sweep."""

import re
from pathlib import Path
from typing import Any

import pytest
import torch

from frida_painter import images
from frida_painter.errors import TryFailed
from frida_painter.lab.sweeps import runner
from frida_painter.lab.sweeps import runner as sweeps
from frida_painter.lab.sweeps.report import status_of, write_report, write_status_page
from frida_painter.lab.sweeps.runner import SweepOutcome, sweep
from sweep_engine import Here


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SweepOutcome:
    """A sweep of made-up figures, one of whose runs fails."""

    def figures(kind: str, opened: Any, plan: Any, folder: Any) -> dict[str, float]:
        spec = opened.spec
        images.save(torch.full((3, 30, 40), spec.seed / 8), folder.path / "plan.png")
        return {"plan dB": 20 + spec.strokes / 20 + spec.seed + 3 * (spec.brushes == "fine")}

    def fail(assignment: runner.Assignment) -> None:
        if dict(assignment.run.labels) == {"strokes": 4, "brush": "broad", "seed": 3}:
            raise TryFailed("It <exploded>.")

    monkeypatch.setattr(sweeps, "open_engine", lambda *limits, **where: Here(fail))
    monkeypatch.setattr(runner, "_figures", figures)
    settings = {"text": "a lemon", "colors": 2}
    grid = {"strokes": [4, 8, 12], "brush": ["broad", "fine"], "seed": [0, 1, 2, 3]}
    return sweep({"title": "A & B", "settings": settings, "grid": grid}, tmp_path / "sweep")


@pytest.mark.slow
def test_the_report_shows_pictures_curves_tests_and_failures(made: SweepOutcome) -> None:
    path = write_report(status_of(made.folder))
    html = path.read_text()
    assert "<h1>A &amp; B</h1>" in html and "23 of 24 runs done, 1 failed." in html
    assert html.count("<figcaption>") == 23 and "strokes 4, broad, seed 0: 20.2" in html
    assert "It &lt;exploded&gt;." in html and 'http-equiv="refresh"' not in html
    assert re.search(r"<td>brush</td><td>broad → fine</td><td>\+3</td>", html)
    for file in re.findall(r'(?:src|href)="([^"]+)"', html):
        assert (made.folder / file).exists(), file
    chart = images.load(made.folder / "chart-0.png")
    assert chart.shape[0] == 3 and float(chart.std()) > 0.05


def test_the_status_page_loads_itself_again_while_the_sweep_works(made: SweepOutcome) -> None:
    status = status_of(made.folder)
    assert 'http-equiv="refresh"' not in write_status_page(status).read_text()
    working = write_status_page(type(status)(**{**status.__dict__, "working": True})).read_text()
    assert 'http-equiv="refresh"' in working and 'value="1.0000"' in working


def test_a_sweep_without_results_has_a_report_as_well(made: SweepOutcome) -> None:
    for run in made.runs:
        (made.folder / "runs" / run.key / "result.json").unlink(missing_ok=True)
    html = write_report(status_of(made.folder)).read_text()
    assert "0 of 24 runs done, 1 failed, and nobody works on it; run the sweep again to continue." in html
