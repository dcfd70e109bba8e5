import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.strokes.palette import ciede2000, difference

# G. Sharma, W. Wu, E. Dalal (2005), table 1: L1 a1 b1, L2 a2 b2, CIEDE2000.
PUBLISHED = """
50.0000 2.6772 -79.7751 50.0000 0.0000 -82.7485 2.0425
50.0000 3.1571 -77.2803 50.0000 0.0000 -82.7485 2.8615
50.0000 2.8361 -74.0200 50.0000 0.0000 -82.7485 3.4412
50.0000 -1.3802 -84.2814 50.0000 0.0000 -82.7485 1.0000
50.0000 -1.1848 -84.8006 50.0000 0.0000 -82.7485 1.0000
50.0000 -0.9009 -85.5211 50.0000 0.0000 -82.7485 1.0000
50.0000 0.0000 0.0000 50.0000 -1.0000 2.0000 2.3669
50.0000 -1.0000 2.0000 50.0000 0.0000 0.0000 2.3669
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0009 7.1792
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0010 7.1792
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0011 7.2195
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0012 7.2195
50.0000 -0.0010 2.4900 50.0000 0.0009 -2.4900 4.8045
50.0000 -0.0010 2.4900 50.0000 0.0010 -2.4900 4.8045
50.0000 -0.0010 2.4900 50.0000 0.0011 -2.4900 4.7461
50.0000 2.5000 0.0000 50.0000 0.0000 -2.5000 4.3065
50.0000 2.5000 0.0000 73.0000 25.0000 -18.0000 27.1492
50.0000 2.5000 0.0000 61.0000 -5.0000 29.0000 22.8977
50.0000 2.5000 0.0000 56.0000 -27.0000 -3.0000 31.9030
50.0000 2.5000 0.0000 58.0000 24.0000 15.0000 19.4535
50.0000 2.5000 0.0000 50.0000 3.1736 0.5854 1.0000
50.0000 2.5000 0.0000 50.0000 3.2972 0.0000 1.0000
50.0000 2.5000 0.0000 50.0000 1.8634 0.5757 1.0000
50.0000 2.5000 0.0000 50.0000 3.2592 0.3350 1.0000
60.2574 -34.0099 36.2677 60.4626 -34.1751 39.4387 1.2644
63.0109 -31.0961 -5.8663 62.8187 -29.7946 -4.0864 1.2630
61.2901 3.7196 -5.3901 61.4292 2.2480 -4.9620 1.8731
35.0831 -44.1164 3.7933 35.0232 -40.0716 1.5901 1.8645
22.7233 20.0904 -46.6940 23.0331 14.9730 -42.5619 2.0373
36.4612 47.8580 18.3852 36.2715 50.5065 21.2231 1.4146
90.8027 -2.0831 1.4410 91.1528 -1.6435 0.0447 1.4441
90.9257 -0.5406 -0.9208 88.6381 -0.8985 -0.7239 1.5381
6.7747 -0.2908 -2.4247 5.8714 -0.0985 -2.2286 0.6377
2.0776 0.0795 -1.1350 0.9033 -0.0636 -0.5514 0.9082
"""

lab = st.tuples(st.floats(0, 100), st.floats(-100, 100), st.floats(-100, 100))


@pytest.mark.parametrize("line", PUBLISHED.split("\n")[1:-1])
def test_every_published_pair_has_its_published_difference_both_ways(line):
    numbers = torch.tensor([float(word) for word in line.split()], dtype=torch.float64)
    one, other, wanted = numbers[:3], numbers[3:6], float(numbers[6])
    assert float(ciede2000(one, other)) == pytest.approx(wanted, abs=5e-5)
    assert float(ciede2000(other, one)) == pytest.approx(wanted, abs=5e-5)


@given(lab, st.lists(lab, min_size=1, max_size=4))
def test_one_colour_against_many_is_each_pair_alone_to_and_fro(one, others):
    first, rest = torch.tensor(one, dtype=torch.float64), torch.tensor(others, dtype=torch.float64)
    found = ciede2000(first, rest)
    assert found.dtype == torch.float64 and found.shape == (len(others),)
    for value, other in zip(found, rest, strict=True):
        assert float(value) == pytest.approx(float(ciede2000(other, first)), abs=1e-6)
        assert float(ciede2000(other, other)) == 0


def test_many_colours_at_once_in_srgb():
    chance = torch.Generator().manual_seed(0)
    one, other = torch.rand(2, 5, 7, 3, generator=chance)
    apart = difference(one, other)
    assert apart.shape == (5, 7)
    assert float(difference(one, one).max()) == 0
    assert float(apart[2, 3]) == pytest.approx(float(difference(one[2, 3], other[2, 3])), abs=1e-4)
    # White against black is 100.
    assert float(difference(torch.ones(3), torch.zeros(3))) == pytest.approx(100, abs=0.01)
