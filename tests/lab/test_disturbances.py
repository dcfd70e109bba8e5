import numpy as np
import pytest
import torch

from frida_painter.lab import disturbances
from frida_painter.lab.disturbances import BLIND, LOOKING, WAYS, wrong_color
from frida_painter.lab.paintings import UNDISTURBED
from frida_painter.lab.targets import load_shipped_targets
from frida_painter.palette import difference
from frida_painter.runs.spec import RunSpec

SCALE = RunSpec.of(strokes=12, colors=3, render_height=64, replans=2, effort=0.1, brush="fine", canvas="90x70mm")


@pytest.fixture(scope="module")
def outcome(small_world):
    return disturbances.experiment(load_shipped_targets(["coffee"]), seeds=(4,), scale=SCALE).run()


def similarity(outcome, name: str) -> list[float]:
    (row,) = (row for row in outcome.tables[0].rows if row["disturbance"] == name)
    return [row[way] for way in WAYS]


@pytest.mark.slow
def test_every_disturbance_shows_in_the_painting(outcome):
    names = [one.name for one in disturbances.disturbances(4, 12)]
    assert [row["disturbance"] for row in outcome.tables[0].rows] == names and len(names) == 5
    for name in names[1:]:
        pairs = zip(similarity(outcome, name), similarity(outcome, UNDISTURBED.name), strict=True)
        assert all(disturbed != usual for disturbed, usual in pairs), name


@pytest.mark.slow
def test_the_note_tells_the_mean_of_the_gains(outcome):
    gains = [row[LOOKING] - row[BLIND] for row in outcome.tables[0].rows[1:]]
    assert f"Looks win {np.mean(gains):+.2f} dB in the mean of the disturbances" in outcome.notes[0]
    assert set(outcome.pictures) == {"disturbances-coffee"}


@pytest.mark.parametrize("color", [[0.5, 0.4, 0.3], [0.02, 0.02, 0.02], [1.0, 1.0, 1.0], [0.9, 0.1, 0.1]])
def test_a_wrong_paint_is_off_by_what_was_said(color):
    wanted = torch.tensor(color)
    wrong = wrong_color(wanted, 8.0, np.random.default_rng(1))
    assert float(difference(wrong, wanted)) == pytest.approx(8, abs=0.3)
    assert bool(((wrong >= 0) & (wrong <= 1)).all())
    assert not torch.equal(wrong, wrong_color(wanted, 8.0, np.random.default_rng(2)))
