"""The experiments about styles, meaning and sketches, at the scale that only shows that they run."""

import numpy as np
import pytest
import torch

from frida_painter.experiments import composition, goal_paintings, semantic, sketch, style
from frida_painter.experiments.goal_paintings import QUICK
from frida_painter.experiments.targets import DRAWINGS, PHOTOGRAPHS, STYLES, Target, shipped
from frida_painter.experiments.text import PROMPTS
from frida_painter.frames import CanvasSize
from marks import coarse_table
from networks import QuickEncoders
from scenes import picture

CANVAS = CanvasSize(0.12, 0.09)
PHOTO = Target("photo", picture())


@pytest.fixture(autouse=True)
def coarse_brush(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goal_paintings, "cached_table", coarse_table)


def how(**rest):
    return {"brush": "fine", "canvas": CANVAS, "seeds": (3,), "scale": QUICK, "encoders": QuickEncoders(), **rest}


def test_meaning_against_pixels() -> None:
    outcome = semantic.run([PHOTO], **how(judge=QuickEncoders().meaning()))
    summary, every = (table.rows for table in outcome.tables)
    assert [row["painted"] for row in summary] == list(semantic.WAYS)
    assert all(0 <= row["edge F-score"] <= 1 and row["feature distance"] > 0 for row in every)
    assert len(outcome.notes) == 4 and all("of 1 times" in note for note in outcome.notes)
    assert outcome.pictures["semantic"].shape[0] == 3


def test_what_was_painted_is_not_painted_again(tmp_path, monkeypatch) -> None:
    judge = QuickEncoders().meaning()
    one = semantic.run([PHOTO], **how(judge=judge, keep=tmp_path))
    monkeypatch.setattr(goal_paintings.Bench, "paint", None)
    same = semantic.run([PHOTO], **how(judge=judge, keep=tmp_path))
    assert same.tables == one.tables


@pytest.mark.slow
def test_styles_and_their_compositions() -> None:
    styles = [Target("waves", 1 - picture(60, 60))]
    outcome = style.run([PHOTO], styles, **how(judge=QuickEncoders().meaning()))
    rows = outcome.tables[1].rows
    assert [row["painted"] for row in rows] == list(style.WAYS)
    for row in rows:
        for network in ("VGG16", "Lite1", "colours"):
            assert 0 <= row[f"{network}, relaxed"] <= row[f"{network}, exact"] + 1e-5, "a lower bound"
    assert "1 of 1" in outcome.notes[0] or "0 of 1" in outcome.notes[0]


@pytest.mark.slow
def test_drawings_with_words() -> None:
    lines = torch.ones(3, 90, 120)
    lines[:, 44:46, 20:100] = 0
    outcome = sketch.run([Target("flat-line", lines)], **how())
    assert [row["painted by"] for row in outcome.tables[0].rows] == list(sketch.WAYS)
    assert all(0 <= row["edge F-score"] <= 1 for row in outcome.tables[1].rows)


def test_words_in_a_style_whose_composition_is_kept() -> None:
    outcome = composition.run(
        [Target("waves", 1 - picture(60, 60))], prompts=PROMPTS[:1], **how(judge=QuickEncoders().meaning())
    )
    summary, every = (table.rows for table in outcome.tables)
    assert [row["painted"] for row in summary] == list(composition.WAYS)
    assert [(row["prompt"], row["painted"]) for row in every] == [("a banana", way) for way in composition.WAYS]
    for row in every:
        assert -1 <= row[composition.EDGES] <= 1 <= row["rank"] <= 1000 and row[composition.PROBABILITY] < 0
    assert "of 1 paintings" in outcome.notes[0]


def test_what_ships_to_be_painted() -> None:
    assert len(PHOTOGRAPHS) == 8
    for target in shipped([*PHOTOGRAPHS, *STYLES, *DRAWINGS]):
        assert min(target.picture.shape[1:]) > 200 and len(target.fingerprint) == 64
    assert len({target.fingerprint for target in shipped(PHOTOGRAPHS)}) == 8
    assert np.isfinite(shipped(["pear"])[0].picture.numpy()).all()
