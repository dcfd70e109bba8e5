"""Every experiment of paintings: what it measures and tells of paintings that are made up here."""

import runpy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.system import images
from frida_painter_lab.experiment import Outcome
from frida_painter_lab.goals import SemanticExperiment
from frida_painter_lab.paintings import KNOWN_PLACEMENT, Comparison, Painted, StudioRun
from frida_painter_lab.simulation_gap import CONSTRAINED, DEVIATION, OURS, UNCONSTRAINED, Replanning, Sim2Real
from frida_painter_lab.targets import PHOTOGRAPHS, SHIPPED, Target, load_shipped_targets, load_targets
from support.networks import QuickEncoders
from support.planning import picture

SIZE = (60, 80)


def of_chance(*words: object) -> Tensor:
    seed = sum(map(ord, " ".join(map(str, words))))
    return torch.rand(3, *SIZE, generator=torch.Generator().manual_seed(seed))


class MadeUp:
    """Paints by chance, as the labels of a run decide; each picture is nearer to the last one."""

    def __init__(self) -> None:
        self.painted: list[StudioRun] = []

    def __call__(self, experiment: Comparison, run: StudioRun, notify: Any) -> Painted:
        self.painted.append(run)
        planned = of_chance(run.labels.get("seed"))
        painting = 0.8 * planned + 0.2 * of_chance(*run.labels.values())
        expected = {done: planned + 0.01 * done for done in range(0, run.spec.strokes + 1, 3)}
        return Painted(planned, painting, painting, 1.5, expected)


@pytest.fixture
def studio(monkeypatch: pytest.MonkeyPatch) -> MadeUp:
    made = MadeUp()
    monkeypatch.setattr(Comparison, "paint", lambda self, run, notify: made(self, run, notify))
    monkeypatch.setattr(Comparison, "networks", QuickEncoders())
    monkeypatch.setattr(SemanticExperiment, "seer", QuickEncoders().meaning())
    return made


@pytest.fixture
def target(tmp_path: Path) -> Callable[[str], Target]:
    def made(name: str) -> Target:
        images.save(picture(*SIZE), tmp_path / f"{name}.png")
        return Target.read(tmp_path / f"{name}.png")

    return made


def tables(outcome: Outcome) -> list[list[Any]]:
    return [list(table.rows) for table in outcome.tables]


def test_sim2real_compares_every_rival_with_ours_on_every_target(studio: MadeUp, target: Any) -> None:
    outcome = Sim2Real(quick=True, photos=(target("cat"),), seeds=(3, 4), strokes=20).run()
    means, differences, every = tables(outcome)
    assert [row["painted"] for row in means] == [OURS, UNCONSTRAINED, CONSTRAINED] and len(every) == 2 * 3
    gap = {row["painted"]: row["gap"] for row in means}
    row = next(one for one in differences if (one["painted"], one["measure"]) == (CONSTRAINED, "gap"))
    assert row["difference"] == pytest.approx(gap[CONSTRAINED] - gap[OURS]) and row["better in"].endswith("of 2")
    assert len(differences) == 2 * 3 and outcome.settings["target"] == ["cat"] and set(outcome.pictures) == {"sim2real"}
    assert {run.spec.strokes for run in studio.painted} == {20} and Sim2Real(photos=()).common.strokes == 120


def test_replanning_compares_four_ways_from_one_plan(studio: MadeUp, target: Any) -> None:
    made = Replanning(quick=True, photos=(target("cat"),), seeds=(4,))
    outcome = made.run()
    means, differences, every = tables(outcome)
    assert made.points == [0, 3, 6, 9] and [row["than"] for row in differences] == [
        "without looking", "without looking", "placement known, without looking",
    ]  # fmt: skip
    assert [run.spec.replans for run in studio.painted] == [0, 2, 0, 2]
    assert [run.furniture for run in studio.painted] == [{}, {}, KNOWN_PLACEMENT, KNOWN_PLACEMENT]
    for row in means:
        ends = [one[DEVIATION] for one in every if one["painted"] == row["painted"]]
        assert ends == pytest.approx([(0.01 * done) ** 2 for done in made.points], rel=1e-4, abs=1e-9)
    assert set(outcome.pictures) == {"deviation", "error", "paintings"}


def test_meaning_against_pixels_and_only_a_changed_picture_is_painted_again(
    studio: MadeUp, target: Any, tmp_path: Path
) -> None:
    photo = target("cat")
    made = SemanticExperiment(quick=True, seeds=(3,), photos=(photo,))
    outcome = made.run(tmp_path / "kept")
    assert [run.spec.goal[0].kind for run in studio.painted] == ["image", "semantic"]
    assert [row["measure"] for row in tables(outcome)[1]] == list(SemanticExperiment.MEASURES)[:-1]
    assert replace(made).run(tmp_path / "kept").tables == outcome.tables and len(studio.painted) == 2
    images.save(1 - picture(*SIZE), photo.path)
    replace(made).run(tmp_path / "kept")
    assert len(studio.painted) == 4


def test_what_ships_to_be_painted(tmp_path: Path) -> None:
    assert len(PHOTOGRAPHS) == 8 and len(SHIPPED) >= 5
    found = load_shipped_targets(PHOTOGRAPHS)
    assert all(min(target.picture.shape[1:]) > 200 for target in found)
    assert len({target.path.read_bytes() for target in found}) == 8
    assert np.isfinite(found[-1].picture.numpy()).all()
    with pytest.raises(ConfigError, match="'cat'"):
        load_targets([found[1].path, tmp_path / "cat.jpg"])


def test_the_experiment_in_the_documentation_runs(
    tmp_path: Path, studio: MadeUp, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "experiments.md").read_text(encoding="utf-8")
    script = tmp_path / "gap.py"
    script.write_text(page.partition("```python\n")[2].partition("```")[0])
    runpy.run_path(str(script))
    told = capsys.readouterr().out
    assert "**Means over all paintings**" in told and "| cat | 1 | 10 strokes |" in told and "of 2 |" in told
