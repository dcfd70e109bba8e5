import pytest
import torch

from frida_painter.experiments import replanning
from frida_painter.experiments.replanning import BLIND, LOOKING
from frida_painter.experiments.scale import PlanningScale
from frida_painter.experiments.targets import shipped
from frida_painter.frames import CanvasSize
from marks import coarse_table

pytestmark = pytest.mark.slow

SCALE = PlanningScale(strokes=12, colors=3, rows=64, looks=3, effort=0.1)


@pytest.fixture(scope="module")
def heard():
    return []


@pytest.fixture(scope="module")
def outcome(heard):
    threads = torch.get_num_threads()
    torch.set_num_threads(2)  # sums in another order give another plan, and this one is known to be seen well
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(replanning, "cached_table", coarse_table)
        found = replanning.run(
            shipped(["coffee"])[0], brush="fine", canvas=CanvasSize(0.09, 0.07), seeds=(4,), scale=SCALE,
            notify=heard.append,
        )  # fmt: skip
    torch.set_num_threads(threads)
    return found


def points(outcome, way: str) -> list[dict]:
    return [row for row in outcome.tables[1].rows if row["painted"] == way]


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


def test_it_draws_two_curves_and_the_paintings(outcome):
    assert set(outcome.pictures) == {"deviation", "error", "paintings"}


def test_progress_never_goes_back(outcome, heard):
    shares = [progress.share for progress in heard]
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1)
