import pytest

from frida_painter.lab import ladder
from frida_painter.lab.ladder import BLIND, KNOWN, KNOWN_MAX, MARKS, PLANNED, RUNGS
from frida_painter.lab.paintings import CAMERA
from frida_painter.lab.targets import load_shipped_targets
from frida_painter.runs.spec import RunSpec
from frida_painter.virtual.camera import CameraSpec
from support.small_world import PHOTOGRAPH

pytestmark = pytest.mark.slow

SCALE = RunSpec.of(strokes=14, colors=3, render_height=64, effort=0.05, brush="fine", canvas="90x70mm", replans=0)


@pytest.fixture(scope="module")
def heard():
    return []


@pytest.fixture(scope="module")
def outcome(small_world, heard):
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(CAMERA.furniture, "camera", CameraSpec.ideal(*PHOTOGRAPH))
        return ladder.experiment(load_shipped_targets(["coffee"]), seeds=(4,), scale=SCALE).run(notify=heard.append)


@pytest.mark.slow
def test_every_rung_has_its_line_and_is_compared_with_one_above_it(outcome):
    lines = outcome.tables[0].rows
    assert [line["picture"] for line in lines] == [rung.name for rung in RUNGS]
    similarity = {}
    for line in lines:
        if line["over"] != "-":
            assert line["wins"] == pytest.approx(line["mean"] - similarity[line["over"]])
        similarity[line["picture"]] = line["mean"]
    assert len(set(similarity.values())) > len(RUNGS) / 2


def test_the_gains_of_placement_and_of_planning_again_are_told_apart(outcome):
    similarity = {line["picture"]: line["mean"] for line in outcome.tables[0].rows}
    note = outcome.notes[1]
    assert f"placement from the start wins {similarity[KNOWN] - similarity[BLIND]:+.2f} dB" in note
    assert f"looks wins {similarity[KNOWN_MAX] - similarity[KNOWN]:+.2f} dB where the placement is known" in note


def test_losses_are_those_to_the_plan_and_part_of_them_lies_near_borders_of_paints(outcome):
    (plan,), (marks,) = (
        [row for row in outcome.tables[2].rows if row["painting"] == name] for name in (PLANNED, MARKS)
    )
    assert plan["loss"] == plan["loss near borders of paints"] == 0
    assert 0 < plan["canvas near borders of paints"] < 1
    errors = [10 ** (-row["PSNR, dB"] / 10) for row in (marks, plan)]
    assert marks["loss"] == pytest.approx(errors[0] - errors[1], abs=1e-5)


def test_the_sheet_shows_the_photograph_and_every_picture(outcome):
    assert set(outcome.pictures) == {"ladder-coffee"}
    wide, tall = 330, 260
    lines = -(-len(RUNGS) // 5)  # what is expected of the plan is no picture, and the photograph is one
    assert outcome.pictures["ladder-coffee"].shape[1] >= lines * tall * 0.9
    assert outcome.pictures["ladder-coffee"].shape[2] >= 5 * wide


def test_progress_never_goes_back(heard):
    shares = [progress.share for progress in heard]
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1)
