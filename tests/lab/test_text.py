import json

import pytest
import torch

from frida_painter.lab import paintings, text
from frida_painter.lab.text import PROMPTS, QUICK, WAYS
from frida_painter.objectives.encoders.classifiers import EfficientNetLite
from support.networks import QuickEncoders, random_lite_tensors

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_world")]


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return tmp_path_factory.mktemp("kept")


def run(kept):
    scale = QUICK.with_values(brush="fine", canvas="120x90mm")
    judge = EfficientNetLite(random_lite_tensors())
    return text.experiment(PROMPTS[:2], scale=scale, encoders=QuickEncoders(), judge=judge).run(kept)


@pytest.fixture(scope="module")
def outcome(kept):
    return run(kept)


@pytest.mark.slow
def test_every_way_is_judged_and_exactly_one_painting_comes_first(outcome):
    summary, every = (table.rows for table in outcome.tables)
    assert len(summary) == len(WAYS) and len(every) == 2
    for row in summary:
        assert 0 <= row["within 5"] <= row["within 50"] <= 1 <= row["median rank"] <= 1000
    for row in every:
        assert 1 <= row["rank"] <= 1000 and 0 <= row["probability"] <= 1
    assert summary[-1]["first among all"] == 0.5, "the same strokes at random for every prompt: chance"
    assert set(outcome.pictures) == {"paintings"}
    assert sum(row["first among all"] for row in every) / 2 <= summary[0]["first among all"] <= 1


def test_numbers_are_the_judges_for_the_photograph(outcome, kept):
    record = json.loads((kept / "a-banana-0.json").read_text())["numbers"]
    logs = torch.tensor([record[f"words {number}"] for number in range(1000)])
    assert float(logs.exp().sum()) == pytest.approx(1, abs=1e-4)
    row = outcome.tables[1].rows[0]
    assert row["rank"] == int((logs > logs[954]).sum()) + 1
    assert row["probability"] == pytest.approx(float(logs[954].exp()), rel=1e-4)


def test_what_was_finished_is_not_painted_again(outcome, kept, monkeypatch):
    monkeypatch.setattr(paintings, "PaintingRun", lambda *args, **kwargs: pytest.fail("it was finished"))
    assert run(kept).tables == outcome.tables
