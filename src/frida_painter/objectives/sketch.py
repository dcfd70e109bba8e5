"""The sketch objective: have edges where a drawing has lines, and show what it shows."""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.images import sized
from frida_painter.objectives.encoders.hed import Hed

_PIXELS = 16_000  # of the picture in which edges are compared, about 112 x 143
_BLURS = (0.008, 0.02, 0.05)  # of the shorter side: a line that is a little off is still nearly right
_MEANING = 0.1  # of the weight of edges: to a network a drawing is far from any painting in colours
_BALANCE = 0.05  # against the squared difference to a picture, when both have a weight of 1


class Sketch:
    """The difference between the edges of a picture and those of a drawing, as the edge detector HED sees them.

    drawing [3, H, W] in [0, 1]: lines on white. Both maps are blurred three ways and compared, each
    difference relative to the strength of the drawing's own edges: 0 is the drawing itself, and
    without any edge it is as far off as 1 before the balance. The drawing is looked at once.
    meaning: what else a picture is to have in common with the drawing.
    """

    def __init__(self, drawing: Tensor, hed: Hed, meaning: Callable[[Tensor], Tensor] | None = None) -> None:
        self._hed = hed
        self._meaning = meaning
        with torch.no_grad():
            self._wanted = self._see(drawing)

    def __call__(self, picture: Tensor) -> Tensor:
        """picture [3, H, W] in [0, 1] -> its distance to the drawing; differentiable."""
        total = picture.new_zeros(())
        for seen, wanted in zip(self._see(picture), self._wanted, strict=True):
            wanted = wanted.to(seen)
            total = total + (seen - wanted).square().mean() / wanted.square().mean().clamp(min=1e-6)
        distance = _BALANCE * total / len(_BLURS)
        return distance if self._meaning is None else distance + _MEANING * self._meaning(picture)

    def _see(self, picture: Tensor) -> list[Tensor]:
        """The edges [h, w] at each blur."""
        edges = self._hed.edges(sized(picture, _PIXELS))
        return [_blurred(edges, share * min(edges.shape)) for share in _BLURS]


def _blurred(edges: Tensor, spread: float) -> Tensor:
    """Edges [h, w] blurred by a Gaussian of `spread` pixels."""
    reach = max(1, round(2.5 * spread))
    along = torch.arange(-reach, reach + 1, dtype=edges.dtype, device=edges.device)
    kernel = torch.exp(-along.square() / (2 * spread**2))
    kernel = kernel / kernel.sum()
    rows = functional.conv2d(edges[None, None], kernel[None, None, :, None], padding=(reach, 0))
    return functional.conv2d(rows, kernel[None, None, None, :], padding=(0, reach))[0, 0]
