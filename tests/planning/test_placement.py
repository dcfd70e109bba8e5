import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from frida_painter.planning.placement import Placement, locate
from frida_painter.strokes import Strokes
from support.easel import CALIBRATION
from support.planning import CANVAS, problem, some_strokes

PROBLEM = problem(64)
ERROR = (0.003, -0.002, math.radians(1.5))
MIDDLE = np.array([CANVAS.width, CANVAS.height]) / 2


def landed(strokes: Strokes, error: tuple[float, float, float], known: Placement | None = None) -> torch.Tensor:
    """The canvas after a robot of that error painted strokes, sent there by what is known."""
    x, y, turn = error
    sent = strokes.position.numpy()
    correction = 0.0
    if known is not None:
        sent = known.correct(CALIBRATION, CANVAS).place(sent.astype(float))
        correction = known.error[2]
    offset = (sent - MIDDLE) @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    position = torch.from_numpy(offset + MIDDLE + (x, y)).float()
    moved = strokes.with_groups(position=position, angle=strokes.angle + turn - correction)
    with torch.no_grad():
        return PROBLEM.render(moved)


def off(placement: Placement, error: tuple[float, float, float] = ERROR) -> tuple[float, float]:
    """How far a placement is off: metres, radians."""
    return math.dist(placement.error[:2], error[:2]), abs(placement.error[2] - error[2])


@pytest.mark.parametrize("error", [ERROR, (-0.004, 0.001, 0.0), (0.0, 0.0, -0.03), (0.0, 0.0, 0.0)])
def test_the_error_of_a_robot_is_found_from_one_batch(error: tuple[float, float, float]) -> None:
    strokes = some_strokes(15, seed=1)
    found = locate(strokes, Placement.unknown(), PROBLEM, landed(strokes, error))
    metres, radians = off(found, error)
    assert metres < 0.0003 and radians < math.radians(0.3)


def test_noise_and_strokes_that_went_wrong_do_not_lead_far_astray() -> None:
    strokes = some_strokes(15, seed=1)
    chance = torch.Generator().manual_seed(0)
    wrong = strokes.with_groups(
        position=strokes.position + 0.001 * torch.randn(15, 2, generator=chance),
        thickness=(strokes.thickness + 0.2).clamp(max=1),
    )
    seen = landed(wrong[[number for number in range(15) if number != 4]], ERROR)
    noisy = (seen + 0.03 * torch.randn(seen.shape, generator=chance)).clamp(0, 1)
    metres, radians = off(locate(strokes, Placement.unknown(), PROBLEM, noisy))
    assert metres < 0.0015 and radians < math.radians(1.5)


def test_what_is_known_is_taken_into_account_when_the_next_strokes_are_seen() -> None:
    first, second = some_strokes(8, seed=1), some_strokes(8, seed=2)
    once = locate(first, Placement.unknown(), PROBLEM, landed(first, ERROR))
    twice = locate(second, once, PROBLEM, landed(second, ERROR, once))
    assert off(twice)[0] < 0.0003 and off(twice)[1] < math.radians(0.3)
    growth = np.linalg.eigvalsh(np.array(twice.information) - np.array(once.information))
    assert growth.min() > 0, "every look adds to what is known"


def test_where_nothing_is_seen_nothing_is_learned() -> None:
    known = Placement((0.001, 0.002, 0.01), Placement.unknown().information)
    white = some_strokes(5).with_groups(color=torch.ones(5, 3))
    for strokes in (white, Strokes.empty()):
        found = locate(strokes, known, PROBLEM, PROBLEM.canvas)
        assert found.error == pytest.approx(known.error)
        assert np.allclose(found.information, known.information)


def test_a_corrected_robot_paints_where_strokes_are_meant_to_be() -> None:
    calibration = replace(CALIBRATION, placement=((1.0, 0.01, 0.002), (-0.01, 1.0, 0.001), (0.1, 0.0, 1.0)))
    meant = np.random.default_rng(0).uniform(0, 0.1, (20, 2))
    x, y, turn = ERROR
    sent = Placement(ERROR, Placement.unknown().information).correct(calibration, CANVAS).place(meant)
    inverse = np.linalg.inv(np.array(calibration.placement))
    homogeneous = np.c_[sent, np.ones(20)] @ inverse.T
    reached = homogeneous[:, :2] / homogeneous[:, 2:] - MIDDLE
    cos, sin = math.cos(turn), math.sin(turn)
    ends = np.stack((cos * reached[:, 0] - sin * reached[:, 1], sin * reached[:, 0] + cos * reached[:, 1]), 1)
    assert np.allclose(ends + MIDDLE + (x, y), meant, atol=1e-12)


def test_before_anything_was_seen_the_calibration_stays() -> None:
    assert np.allclose(Placement.unknown().correct(CALIBRATION, CANVAS).placement, CALIBRATION.placement)
