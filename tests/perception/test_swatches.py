import pytest
import torch

from frida_painter.errors import FrameRejected
from frida_painter.perception.color import read_swatches
from frida_painter.system.images import to_linear, to_srgb

COLORS = torch.tensor([[0.9, 0.86, 0.8], [0.75, 0.3, 0.2], [0.2, 0.35, 0.6], [0.12, 0.1, 0.09]])


def strip(colors: torch.Tensor = COLORS, light: tuple[float, float, float] = (0.8, 0.7, 0.55), side: int = 40):
    """A photograph [3, side, side * (n + 1)] of paper and swatches in coloured light."""
    paper = to_srgb(torch.full((1, 3), 0.9))
    fields = to_srgb(to_linear(torch.cat((paper, colors))) * torch.tensor(light))
    picture = fields.T[:, None, :].expand(3, side, -1).repeat_interleave(side, 2)
    return (picture + 0.01 * torch.randn(picture.shape, generator=torch.Generator().manual_seed(1))).clamp(0, 1)


def test_the_colours_come_back_whatever_the_light_is() -> None:
    for light in ((1.0, 1.0, 1.0), (0.8, 0.7, 0.55), (0.3, 0.35, 0.45)):
        assert torch.allclose(read_swatches(strip(light=light), 4).color, COLORS, atol=0.025)


def test_an_upright_strip_is_read_from_the_top() -> None:
    assert torch.allclose(read_swatches(strip().transpose(1, 2), 4).color, COLORS, atol=0.025)


def test_a_strip_that_is_cut_a_little_wrongly_is_read_all_the_same() -> None:
    cut = strip()[:, 3:, 7:-4]
    assert torch.allclose(read_swatches(cut, 4).color, COLORS, atol=0.03)


@pytest.mark.parametrize(
    ("picture", "count", "says"),
    [
        (strip(), 3, "is not one even colour"),
        (strip(torch.flip(COLORS, (0,)))[:, :, 40:], 3, "not bare white paper"),
        (strip(light=(0.05, 0.05, 0.05)), 4, "not bare white paper in enough light"),
        (strip(side=8), 4, "too small for bare paper and 4 swatches"),
        (strip(), 0, "0 swatches"),
    ],
)
def test_what_is_no_strip_is_refused_with_what_is_wrong(picture: torch.Tensor, count: int, says: str) -> None:
    with pytest.raises(FrameRejected, match=says):
        read_swatches(picture, count)
