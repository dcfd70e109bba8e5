import pytest

from frida_painter.lab import replanning
from frida_painter.lab.replanning import BLIND, KNOWN_BLIND, KNOWN_LOOKING, LOOKING
from frida_painter.lab.targets import load_shipped_targets
from frida_painter.runs.spec import RunSpec

pytestmark = pytest.mark.slow

SCALE = RunSpec.of(strokes=12, colors=3, render_height=64, replans=2, effort=0.1, brush="fine", canvas="90x70mm")


@pytest.fixture(scope="module")
def heard():
    return []


@pytest.fixture(scope="module")
def outcome(small_world, heard):
    return replanning.experiment(load_shipped_targets(["coffee"])[0], seeds=(4,), scale=SCALE).run(notify=heard.append)


def points(outcome, way: str) -> list[dict]:
    return [row for row in outcome.tables[1].rows if row["painted"] == way]


@pytest.mark.slow
def test_both_begin_with_the_same_plan_and_are_seen_after_every_batch(outcome):
    looking, blind = points(outcome, LOOKING), points(outcome, BLIND)
    assert [row["strokes"] for row in looking] == [row["strokes"] for row in blind] == [0, 4, 8, 12]
    assert looking[0]["deviation"] == blind[0]["deviation"] == 0
    assert looking[0]["error"] == blind[0]["error"] > 0


def test_they_stray_from_the_plan_and_from_each_other(outcome):
    looking, blind = points(outcome, LOOKING), points(outcome, BLIND)
    deviations = [row["deviation"] for row in blind]
    assert deviations == sorted(deviations) and deviations[-1] > 0
    assert all(a["error"] != b["error"] for a, b in zip(looking[1:], blind[1:], strict=True))


def test_the_summary_is_that_of_the_last_points(outcome):
    for row in outcome.tables[0].rows:
        last = points(outcome, row["painted"])[-1]
        assert row["error at the end"] == pytest.approx(last["error"])
        assert row["deviation at the end"] == pytest.approx(last["deviation"])


def test_what_knowing_the_placement_wins_and_what_planning_again_wins_is_told_apart(outcome):
    similarity = {row["painted"]: row["PSNR, dB"] for row in outcome.tables[0].rows}
    assert len(set(similarity.values())) == 4
    known, again, together = outcome.notes
    assert f"{similarity[KNOWN_BLIND] - similarity[BLIND]:+.2f} dB" in known
    assert f"{similarity[KNOWN_LOOKING] - similarity[KNOWN_BLIND]:+.2f} dB" in again
    assert f"{similarity[LOOKING] - similarity[BLIND]:+.2f} dB" in together


def test_it_draws_two_curves_and_the_paintings(outcome):
    assert set(outcome.pictures) == {"deviation", "error", "paintings"}


def test_progress_never_goes_back(outcome, heard):
    shares = [progress.share for progress in heard]
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1)
