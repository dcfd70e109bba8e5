import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.planning.placement import gauss_newton

NOTHING, STEPS = torch.zeros(2, dtype=torch.float64), torch.full((2,), 0.01, dtype=torch.float64)
X = torch.linspace(0, 3, 60, dtype=torch.float64)
numbers = st.floats(-0.5, 0.5)


def seen(height: float, decay: float) -> torch.Tensor:
    return (1 + height) * torch.exp(-(1 + 0.5 * decay) * X)


@given(height=numbers, decay=numbers)
def test_what_made_the_picture_is_found(height: float, decay: float) -> None:
    picture = seen(height, decay)
    free = torch.eye(2, dtype=torch.float64) * 1e-9
    found, _ = gauss_newton(lambda guess: picture - seen(*guess.tolist()), NOTHING, free, STEPS, 1.0, 30)
    assert found.tolist() == pytest.approx([height, decay], abs=1e-3)


def test_what_was_known_well_stays_and_pixels_that_err_together_tell_less() -> None:
    def residual(guess: torch.Tensor) -> torch.Tensor:
        return seen(0.5, 0.0) + 0.1 * torch.sin(40 * X) - seen(*guess.tolist())

    sure = torch.eye(2, dtype=torch.float64) * 1e12
    assert gauss_newton(residual, NOTHING, sure, STEPS, 1.0, 5)[0].abs().max() < 1e-6
    unsure = torch.eye(2, dtype=torch.float64)
    one, other = (gauss_newton(residual, NOTHING, unsure, STEPS, alike, 5) for alike in (1.0, 100.0))
    assert one[0][0] > other[0][0] > 0.1, "the prior counts for more"
    assert (torch.linalg.inv(other[1]).diagonal() > torch.linalg.inv(one[1]).diagonal()).all()
