import pytest
import torch

from frida_painter import images
from frida_painter.errors import ConfigError
from frida_painter.lab import paintings, sim2real
from frida_painter.lab.sim2real import FULL, PLANNERS, QUICK
from frida_painter.lab.targets import SHIPPED, load_shipped_targets, load_targets

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_world")]

SCALE = QUICK.with_values(brush="fine", canvas="120x90mm")


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def heard():
    return []


@pytest.fixture(scope="module")
def outcome(kept, heard):
    return sim2real.experiment(load_shipped_targets(["coffee"]), seeds=(3,), scale=SCALE).run(kept, heard.append)


@pytest.mark.slow
def test_every_planner_is_measured_on_every_target(outcome):
    summary, every = (table.rows for table in outcome.tables)
    assert [row["target"] for row in summary] == ["coffee"] * len(PLANNERS)
    assert len(every) == len(PLANNERS) and {row["seed"] for row in every} == {3}
    for row in summary:
        assert 0 < row["gap"] < 1 and row["gap, least"] <= row["gap"] <= row["gap, most"]
    assert summary[0]["gap / ours"] == 1
    assert all(row["gap / ours"] == pytest.approx(row["gap"] / summary[0]["gap"]) for row in summary)


def test_strokes_of_any_size_leave_the_largest_gap(outcome):
    ours, free, _ = (row["gap"] for row in outcome.tables[0].rows)
    assert free > 3 * ours
    assert "1 of 1" in outcome.notes[0]


def test_the_differences_are_those_of_the_pictures(outcome, kept):
    (row, *_) = outcome.tables[1].rows
    simulated, painted = (images.load(kept / f"coffee-3-ours-{name}.png") for name in ("simulated", "painted"))
    assert float((simulated - painted).square().mean()) == pytest.approx(row["gap"], rel=0.02)


def test_what_was_finished_before_an_interruption_is_not_painted_again(outcome, kept, monkeypatch):
    monkeypatch.setattr(paintings, "PaintingRun", None)
    again = sim2real.experiment(load_shipped_targets(["coffee"]), seeds=(3,), scale=SCALE).run(kept)
    assert again.tables == outcome.tables


def test_progress_never_goes_back_and_ends_at_one(outcome, heard):
    shares = [progress.share for progress in heard]
    assert shares == sorted(shares) and shares[-1] == 1.0 and len(shares) > 3 * QUICK.strokes


def test_there_are_five_targets_and_a_persons_own(tmp_path):
    assert len(load_shipped_targets()) == len(SHIPPED) >= 5
    assert all(min(target.picture.shape[1:]) >= FULL.render_height for target in load_shipped_targets())
    images.save(torch.rand(3, 30, 40), tmp_path / "mine.png")
    (mine,) = load_targets([tmp_path / "mine.png"])
    assert mine.name == "mine" and mine.picture.shape == (3, 30, 40)
    with pytest.raises(ConfigError, match="'mine'"):
        load_targets([tmp_path / "mine.png", tmp_path / "elsewhere" / "mine.png"])
