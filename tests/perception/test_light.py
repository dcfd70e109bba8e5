import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.system.images import to_linear, to_srgb


@given(st.floats(0, 1))
def test_there_and_back_changes_nothing(value):
    given_one = torch.tensor(value, dtype=torch.float64)
    torch.testing.assert_close(to_srgb(to_linear(given_one)), given_one, atol=1e-6, rtol=0)


def test_middle_grey_is_a_fifth_of_the_light():
    torch.testing.assert_close(to_linear(torch.tensor(0.5)), torch.tensor(0.21404), atol=1e-4, rtol=0)


def test_more_light_than_white_is_white():
    assert to_srgb(torch.tensor(1.7)) == to_srgb(torch.tensor(1.0))
    assert to_srgb(torch.tensor(-0.1)) == 0
