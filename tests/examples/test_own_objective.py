"""The example that readers are told to start from works as it stands."""

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_an_objective_of_ones_own_shapes_the_painting(tmp_path: Path) -> None:
    example = runpy.run_path(str(ROOT / "examples" / "own_objective.py"))
    apart = example["main"](ROOT / "examples" / "photographs" / "cat.jpg", tmp_path / "out.png", 12, 0.1)
    assert (tmp_path / "out.png").exists()
    assert apart < 0.05
