"""Every experiment of paintings: what it measures and tells of paintings that are made up here."""

import runpy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.system import images
from frida_painter_lab import goals
from frida_painter_lab.experiment import Outcome
from frida_painter_lab.goals import (
    PROMPTS,
    JudgedExperiment,
    SemanticExperiment,
    SketchExperiment,
    StyleExperiment,
    TextExperiment,
)
from frida_painter_lab.paintings import PLACEMENT, Comparison, Painted, StudioRun
from frida_painter_lab.simulation_gap import (
    CONSTRAINED,
    DEVIATION,
    OURS,
    RUNGS,
    SIMILARITY,
    UNCONSTRAINED,
    Ladder,
    Replanning,
    Sim2Real,
)
from frida_painter_lab.targets import DRAWINGS, PHOTOGRAPHS, SHIPPED, STYLES, Target, load_shipped_targets, load_targets
from support.networks import QuickEncoders
from support.planning import CANVAS, picture, some_strokes

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
        plan = SimpleNamespace(strokes=some_strokes(6), canvas=CANVAS)
        painting = 0.8 * planned + 0.2 * of_chance(*run.labels.values())
        expected = {done: planned + 0.01 * done for done in range(0, run.spec.strokes + 1, 3)}
        opened: Any = SimpleNamespace(forecast=lambda plan: SimpleNamespace(expected=6.5), spec=run.spec)
        return Painted(opened, plan, planned, painting, painting, 1.5, expected)  # type: ignore[arg-type]


@pytest.fixture
def studio(monkeypatch: pytest.MonkeyPatch) -> MadeUp:
    made = MadeUp()
    monkeypatch.setattr(Comparison, "paint", lambda self, run, notify: made(self, run, notify))
    monkeypatch.setattr(Comparison, "networks", QuickEncoders())
    monkeypatch.setattr(JudgedExperiment, "seer", QuickEncoders().meaning())
    monkeypatch.setattr(
        goals,
        "_paint_floors",
        lambda painted: {name: of_chance(name) for name in (goals.PIXELS, goals.BEGUN, goals.RANDOM)},
    )
    return made


@pytest.fixture
def target(tmp_path: Path) -> Callable[[str], Target]:
    def made(name: str) -> Target:
        shown = torch.ones(3, *SIZE)
        shown[:, 29:31, 10:70] = 0
        images.save(shown if name == "flat-line" else picture(*SIZE), tmp_path / f"{name}.png")
        return Target.read(tmp_path / f"{name}.png")

    return made


def tables(outcome: Outcome) -> list[list[Any]]:
    return [list(table.rows) for table in outcome.tables]


def test_sim2real_compares_every_rival_with_ours_on_every_target(studio: MadeUp, target: Any) -> None:
    outcome = Sim2Real(quick=True, photos=(target("cat"),), seeds=(3, 4)).run()
    means, differences, every = tables(outcome)
    assert [row["painted"] for row in means] == [OURS, UNCONSTRAINED, CONSTRAINED] and len(every) == 2 * 3
    gap = {row["painted"]: row["gap"] for row in means}
    row = next(one for one in differences if (one["painted"], one["measure"]) == (CONSTRAINED, "gap"))
    assert row["difference"] == pytest.approx(gap[CONSTRAINED] - gap[OURS]) and row["better in"].endswith("of 2")
    assert len(differences) == 2 * 3 and outcome.settings["target"] == ["cat"] and set(outcome.pictures) == {"sim2real"}


def test_replanning_compares_four_ways_from_one_plan(studio: MadeUp, target: Any) -> None:
    made = Replanning(quick=True, photo=target("cat"), seeds=(4,))
    outcome = made.run()
    means, differences, every = tables(outcome)
    assert made.points == [0, 3, 6, 9] and [row["than"] for row in differences] == [
        "without looking", "without looking", "placement known, without looking",
    ]  # fmt: skip
    assert [run.spec.replans for run in studio.painted] == [0, 2, 0, 2]
    assert [run.without for run in studio.painted] == [(), (), (PLACEMENT,), (PLACEMENT,)]
    for row in means:
        ends = [one[DEVIATION] for one in every if one["painted"] == row["painted"]]
        assert ends == pytest.approx([(0.01 * done) ** 2 for done in made.points], rel=1e-4, abs=1e-9)
    assert set(outcome.pictures) == {"deviation", "error", "paintings"}


def test_every_rung_of_the_ladder_is_compared_with_one_above(studio: MadeUp, target: Any) -> None:
    outcome = Ladder(quick=True, photos=(target("cat"),), seeds=(4,), strokes=20).run()
    means, differences, every = tables(outcome)
    assert [row["painted"] for row in means] == [rung.name for rung in RUNGS] and len(every) == len(RUNGS)
    assert {run.spec.strokes for run in studio.painted} == {20}
    similarity = {row["painted"]: row[SIMILARITY] for row in means}
    for row in differences:
        assert row["difference"] == pytest.approx(similarity[row["painted"]] - similarity[row["than"]])
    assert len(differences) == len(RUNGS) - 1


def test_words_are_ranked_among_all_classes_and_exactly_one_painting_comes_first(studio: MadeUp) -> None:
    outcome = TextExperiment(quick=True, seeds=(3,)).run()
    summary, every = tables(outcome)
    assert len(summary) == len(goals.TEXT_WAYS) and [row["prompt"] for row in every] == [p.words for p in PROMPTS[:2]]
    for row in summary:
        assert 0 <= row["within 5"] <= row["within 50"] <= 1 <= row["median rank"] <= 1000
    assert summary[-1]["first among all"] == 0.5, "the same picture for every prompt: chance"
    run = studio.painted[0]
    shown = 0.8 * of_chance(3) + 0.2 * of_chance(*run.labels.values())
    logs = QuickEncoders().meaning().logits(images.fit(shown, 260, 260)[None]).log_softmax(1)[0].detach()
    assert every[0]["rank, words"] == int((logs > logs[954]).sum()) + 1
    assert every[0]["probability"] == pytest.approx(float(logs[954].exp()), rel=1e-4)


def test_styles_are_judged_by_features_that_nobody_optimised(studio: MadeUp, target: Any) -> None:
    outcome = StyleExperiment(quick=True, seeds=(3,), photos=(target("cat"),), styles=(target("waves"),)).run()
    for row in tables(outcome)[2]:
        assert (
            all(row[name] >= 0 for name in ("VGG16", "Lite1", "colours")) and -1 <= row["strokes like the style's"] <= 1
        )
    assert [len(run.spec.goal) for run in studio.painted] == [1, 2, 2] and len(studio.painted[2].spec.initial) == 1


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


def test_drawings_are_painted_in_four_ways(studio: MadeUp, target: Any) -> None:
    drawings, style = (target("flat-line"),), target("waves")
    outcome = SketchExperiment(quick=True, seeds=(3,), drawings=drawings, style=style).run()
    assert all(0 <= row["edge F-score"] <= 1 for row in tables(outcome)[0])
    assert [len(run.spec.goal) for run in studio.painted] == [1, 1, 2, 3]
    assert studio.painted[0].spec.goal[0].value == "a flat line" and len(studio.painted[1].spec.initial) == 1


def test_what_ships_to_be_painted(tmp_path: Path) -> None:
    assert len(PHOTOGRAPHS) == 8 and len(SHIPPED) >= 5
    found = load_shipped_targets([*PHOTOGRAPHS, *STYLES, *DRAWINGS])
    assert all(min(target.picture.shape[1:]) > 200 for target in found)
    assert len({target.path.read_bytes() for target in found[:8]}) == 8
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
