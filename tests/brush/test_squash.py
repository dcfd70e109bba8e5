import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.brush.table import squash, stretch_sigmoid, unsquash


@given(st.floats(0, 1))
def test_unsquash_undoes_squash(magnitude):
    given_one = torch.tensor(magnitude, dtype=torch.float64)
    torch.testing.assert_close(squash(unsquash(given_one)), given_one, atol=1e-12, rtol=0)


def test_far_from_a_mark_there_is_nothing_at_all():
    assert squash(torch.tensor(-6.0)) == 0
    assert squash(torch.tensor(6.0)) == 1
    assert stretch_sigmoid(torch.tensor(-6.0)) < 0
