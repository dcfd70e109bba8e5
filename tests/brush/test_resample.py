import pytest
import torch

from frida_painter.brush.library import resample
from frida_painter.frames import MapFrame

GIVEN = MapFrame(-0.01, 0.05, -0.02, 0.02, 40, 60)


def mark() -> torch.Tensor:
    maps = torch.zeros(1, 40, 60, dtype=torch.float64)
    maps[0, 10:20, 15:40] = 0.8
    return maps


def area(maps: torch.Tensor, frame: MapFrame) -> float:
    return float(maps.sum()) * frame.pitch[0] * frame.pitch[1]


@pytest.mark.parametrize("wanted", [MapFrame(-0.013, 0.056, -0.025, 0.021, 17, 23), GIVEN.resize(7, 11)])
def test_larger_cells_hold_the_same_paint(wanted):
    assert area(resample(mark(), GIVEN, wanted), wanted) == pytest.approx(area(mark(), GIVEN))


def test_the_same_cells_give_the_same_map():
    torch.testing.assert_close(resample(mark(), GIVEN, GIVEN), mark())


def test_smaller_cells_are_interpolated():
    finer = resample(mark(), GIVEN, GIVEN.resize(80, 120))
    assert area(finer, GIVEN.resize(80, 120)) == pytest.approx(area(mark(), GIVEN))
    assert finer.max() == pytest.approx(0.8)


def test_beyond_the_given_frame_there_is_nothing():
    elsewhere = MapFrame(0.06, 0.08, -0.01, 0.01, 4, 4)
    assert not resample(torch.ones(1, 40, 60), GIVEN, elsewhere).any()


def test_rows_go_down_from_the_top():
    upper = MapFrame(-0.01, 0.05, 0.0, 0.02, 10, 60)
    assert area(resample(mark(), GIVEN, upper), upper) == pytest.approx(area(mark(), GIVEN))
