from dataclasses import replace

import pytest
import torch

from frida_painter.brush.dip import Dip
from frida_painter.brush.kinds import MEDIUM
from frida_painter.errors import ConfigError


def test_a_dip_is_used_up_by_area_or_by_strokes() -> None:
    areas = torch.tensor([1e-4, 3e-4])
    assert torch.equal(Dip(5e-4).used_by(areas), areas)
    assert torch.equal(Dip.of_strokes(4).used_by(areas), torch.ones(2))
    assert (str(Dip(5e-4)), str(Dip.of_strokes(4))) == ("5.0 cm²", "4 strokes")


def test_what_is_known_of_a_brush_goes_before_what_is_usual() -> None:
    assert replace(MEDIUM, known_dip=None).dip.holds == pytest.approx(0.6 * 0.060 * 0.017)
    assert MEDIUM.dip == Dip(13e-4)
    assert replace(MEDIUM, known_dip=Dip(1e-4)).dip == Dip(1e-4)


@pytest.mark.parametrize("holds", [0.0, -1e-4, 2.0, float("nan"), float("inf")])
def test_a_dip_that_cannot_be_is_refused(holds: float) -> None:
    with pytest.raises(ConfigError, match="from 0 to 1"):
        Dip(holds)
    with pytest.raises(ConfigError, match=r"strokes was given; it is from 1 to 1000\."):
        Dip(holds / 4, by_strokes=True)
