from dataclasses import replace

import pytest
import torch

from frida_painter.brush.kinds import BROAD, MEDIUM, Dip
from frida_painter.errors import ConfigError


def test_a_dip_is_used_up_by_area_or_by_strokes() -> None:
    areas = torch.tensor([1e-4, 3e-4])
    assert torch.equal(Dip(5e-4).used_by(areas), areas)
    assert torch.equal(Dip.of_strokes(4).used_by(areas), torch.ones(2))
    assert (str(Dip(5e-4)), str(Dip.of_strokes(4))) == ("5.0 cm²", "4 strokes")


def test_marks_lack_paint_towards_the_end_of_a_dip() -> None:
    """Full at first, they fade evenly from three tenths of it on; as by the middle of each mark."""
    dip = Dip(10e-4, fades=0.7)
    assert [dip.lacking(left, 0.0) for left in (10e-4, 8e-4, 7e-4)] == pytest.approx([0, 0, 0], abs=1e-9)
    assert dip.lacking(3.5e-4, 0.0) == pytest.approx(0.35)
    assert dip.lacking(4.5e-4, 2e-4) == pytest.approx(0.35)
    assert dip.lacking(0.0, 0.0) == pytest.approx(0.7)
    assert Dip(1e-4, fades=1.0).lacking(-1e-4, 0.0) == 1.0
    assert Dip(10e-4).lacking(0.0, 0.0) == 0.0


def test_a_dip_may_end_before_marks_are_faint() -> None:
    dip = Dip(10e-4, fades=0.6)
    short = dip.until(0.3)
    assert short.fades == 0.3 and short.holds == pytest.approx(6.5e-4)
    assert short.lacking(0.0, 0.0) == pytest.approx(0.3) == dip.lacking(3.5e-4, 0.0)
    assert dip.until(0.7) is dip
    assert replace(Dip.of_strokes(2), fades=0.5).until(0.1).holds == 1.0
    assert BROAD.for_any_order.dip.holds < BROAD.dip.holds


def test_what_is_known_of_a_brush_goes_before_what_is_usual() -> None:
    assert replace(MEDIUM, known_dip=None).dip.holds == pytest.approx(0.6 * 0.060 * 0.017)
    assert MEDIUM.dip == Dip(17e-4, fades=0.5)
    assert replace(MEDIUM, known_dip=Dip(1e-4)).dip == Dip(1e-4)


@pytest.mark.parametrize("holds", [0.0, -1e-4, 2.0, float("nan"), float("inf")])
def test_a_dip_that_cannot_be_is_refused(holds: float) -> None:
    with pytest.raises(ConfigError, match="from 0 to 1"):
        Dip(holds)
    with pytest.raises(ConfigError, match=r"strokes was given; it is from 1 to 1000\."):
        Dip(holds / 4, by_strokes=True)


@pytest.mark.parametrize("fades", [-0.1, 1.1, float("nan")])
def test_fading_that_cannot_be_is_refused(fades: float) -> None:
    with pytest.raises(ConfigError, match="from 0 to 1"):
        Dip(1e-4, fades=fades)
