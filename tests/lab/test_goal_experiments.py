"""The experiments about styles, meaning and sketches, at the scale that only shows that they run."""

import runpy
from pathlib import Path

import numpy as np
import pytest
import torch

from frida_painter import images
from frida_painter.lab import composition, paintings, semantic, sketch, style
from frida_painter.lab.paintings import QUICK
from frida_painter.lab.targets import DRAWINGS, PHOTOGRAPHS, STYLES, Target, load_shipped_targets
from frida_painter.lab.text import PROMPTS
from support.networks import QuickEncoders
from support.planning import picture

pytestmark = pytest.mark.usefixtures("small_world")


@pytest.fixture
def photo(tmp_path: Path) -> Target:
    return target(tmp_path / "photo.png", picture())


@pytest.fixture
def waves(tmp_path: Path) -> Target:
    return target(tmp_path / "waves.png", 1 - picture(60, 60))


def target(path: Path, shown: torch.Tensor) -> Target:
    images.save(shown, path)
    return Target.read(path)


def how(**rest):
    scale = QUICK.with_values(brush="fine", canvas="120x90mm")
    return {"seeds": (3,), "scale": scale, "encoders": QuickEncoders(), **rest}


@pytest.mark.slow
def test_meaning_against_pixels_and_only_a_changed_picture_is_painted_again(
    photo: Target, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def experiment():
        return semantic.experiment([photo], **how(judge=QuickEncoders().meaning()))

    outcome = experiment().run(tmp_path / "kept")
    summary, every = (table.rows for table in outcome.tables)
    assert [row["painted"] for row in summary] == list(semantic.WAYS)
    assert all(0 <= row["edge F-score"] <= 1 and row["feature distance"] > 0 for row in every)
    assert len(outcome.notes) == 4 and all("of 1 times" in note for note in outcome.notes)
    assert outcome.pictures["semantic"].shape[0] == 3
    monkeypatch.setattr(paintings, "PaintingRun", lambda *args, **kwargs: pytest.fail("painted again"))
    assert experiment().run(tmp_path / "kept").tables == outcome.tables
    images.save(1 - picture(), photo.path)
    with pytest.raises(pytest.fail.Exception, match="painted again"):
        experiment().run(tmp_path / "kept")


@pytest.mark.slow
def test_styles_and_their_compositions(photo: Target, waves: Target) -> None:
    outcome = style.experiment([photo], [waves], **how(judge=QuickEncoders().meaning())).run()
    rows = outcome.tables[1].rows
    assert [row["painted"] for row in rows] == list(style.WAYS)
    for row in rows:
        for network in ("VGG16", "Lite1", "colours"):
            assert 0 <= row[f"{network}, relaxed"] <= row[f"{network}, exact"] + 1e-5, "a lower bound"
        assert -1 <= row["strokes like the style's"] <= 1
    assert "1 of 1" in outcome.notes[0] or "0 of 1" in outcome.notes[0]
    assert outcome.notes[2].startswith("Strokes go the way")


@pytest.mark.slow
def test_drawings_with_words(waves: Target, tmp_path: Path) -> None:
    lines = torch.ones(3, 90, 120)
    lines[:, 44:46, 20:100] = 0
    outcome = sketch.experiment([target(tmp_path / "flat-line.png", lines)], waves, tmp_path, **how()).run()
    assert [row["painted by"] for row in outcome.tables[0].rows] == list(sketch.WAYS)
    assert all(0 <= row["edge F-score"] <= 1 for row in outcome.tables[1].rows)
    assert "of that without it" in outcome.notes[0]


@pytest.mark.slow
def test_words_in_a_style_whose_composition_is_kept(waves: Target) -> None:
    outcome = composition.experiment([waves], PROMPTS[:1], **how(judge=QuickEncoders().meaning())).run()
    summary, every = (table.rows for table in outcome.tables)
    assert [row["painted"] for row in summary] == list(composition.WAYS)
    assert [(row["prompt"], row["painted"]) for row in every] == [("a banana", way) for way in composition.WAYS]
    for row in every:
        assert -1 <= row[composition.EDGES] <= 1 <= row["rank"] <= 1000 and row[composition.PROBABILITY] < 0
    assert "of 1 paintings" in outcome.notes[0]


def test_what_ships_to_be_painted() -> None:
    assert len(PHOTOGRAPHS) == 8
    found = load_shipped_targets([*PHOTOGRAPHS, *STYLES, *DRAWINGS])
    assert all(min(target.picture.shape[1:]) > 200 for target in found)
    assert len({target.path.read_bytes() for target in found[:8]}) == 8
    assert np.isfinite(load_shipped_targets(["pear"])[0].picture.numpy()).all()


@pytest.mark.slow
def test_the_experiment_in_the_documentation_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(paintings, "QUICK", QUICK.with_values(brush="fine", canvas="120x90mm"))
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "experiments.md").read_text(encoding="utf-8")
    script = tmp_path / "gap.py"
    script.write_text(page.partition("```python\n")[2].partition("```")[0])
    runpy.run_path(str(script))
    told = capsys.readouterr().out
    assert "**Mean over the seeds**" in told and "| 10 | 1 |" in told
