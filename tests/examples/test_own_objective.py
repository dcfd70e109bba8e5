"""The example that readers are told to start from works as it stands."""

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_an_objective_of_ones_own_shapes_the_painting(tmp_path: Path) -> None:
    example = runpy.run_path(str(ROOT / "examples" / "own_objective.py"))
    photo = ROOT / "examples" / "photographs" / "cat.jpg"
    plain, mirrored = (example["main"](photo, tmp_path / "out.png", 20, 0.1, weight) for weight in (0.001, 1.0))
    assert (tmp_path / "out.png").exists()
    assert mirrored < 0.8 * plain
