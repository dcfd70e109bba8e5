"""Words in a style or in a photograph: a thing is laid into it."""

from collections.abc import Sequence
from itertools import product

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.objectives.style_marks import style_colors, to_lab_picture, tone
from frida_painter.words.compositing import paste, resize

_ROWS = 96  # of the small picture on which places for the thing are tried
_AREA = 4  # its pixels, half the width over which an edge is measured
_STYLE_SCENE_AROUND = 6  # its pixels around a thing, which are its background
_SIZES = (0.85, 0.75, 0.65)  # of the shorter side
_PLACES = (0.06, 0.21, 0.35, 0.5, 0.65, 0.79, 0.94)  # positions in the free space, down and across
_TONES = ((0.0, 1.0), (0.0, 0.6), (0.4, 1.0))  # tones for a thing, 0 for the picture's darkest
_CLEAR = 40.0  # difference of L* that counts as full visibility
_KEEPING, _LARGE = 0.7, 0.55  # weights of unchanged edges and of size, against visibility


def composite_into_style(
    drawing: Tensor,
    picture: Tensor,
    *,
    own: float = 0.0,
    sizes: Sequence[float] = _SIZES,
    rows: tuple[float, float] = (0.0, 1.0),
) -> tuple[Tensor, Tensor]:
    """Returns a picture [3, H, W] with a drawing, colour and opacity [4, h, w], in it, and the thing's opacity [H, W].

    own: share of its own colours that the drawing keeps; the rest are the picture's colours, from dark to light
    sizes: possible lengths of its longer side, relative to the picture's shorter one
    rows: least and greatest position in the free space, from the picture's upper edge, 0, to its lower one

    The place is a compromise: the picture's coarse edges should change little, by their correlation, and the thing
    should be large and stand out clearly.
    """
    small = images.fit(picture, _ROWS, round(_ROWS * picture.shape[2] / picture.shape[1]))
    edges, light = _edges(small), to_lab_picture(small)[0]
    colors = style_colors(picture)
    painted = [drawing] if own == 1 else [torch.lerp(tone(drawing, colors, *tones), drawing, own) for tones in _TONES]

    def worth(choice: tuple[Tensor, float, float, float]) -> float:
        shown, where = _lay(small, *choice)
        wider = functional.max_pool2d(where[None, None], 2 * _STYLE_SCENE_AROUND + 1, 1, _STYLE_SCENE_AROUND)[0, 0]
        around = float((light * (wider - where)).sum() / (wider - where).sum())
        clear = min(1.0, abs(float(to_lab_picture(shown)[0][where > 0.5].median()) - around) / _CLEAR)
        kept = float(torch.corrcoef(torch.stack((_edges(shown).flatten(), edges.flatten())))[0, 1])
        return _KEEPING * kept + clear + _LARGE * choice[1]

    heights = [down for down in _PLACES if rows[0] <= down <= rows[1]]
    return _lay(picture, *max(product(painted, sizes, heights, _PLACES), key=worth))


def _lay(picture: Tensor, thing: Tensor, size: float, down: float, across: float) -> tuple[Tensor, Tensor]:
    """Returns a picture [3, H, W] with a thing in it, and the thing's opacity [H, W].

    size: of its longer side, relative to the picture's shorter one
    down, across: position in the free space, from 0 to 1
    """
    one = resize(thing, size * min(picture.shape[1:]) / max(thing.shape[1:]))
    return paste(
        one, picture,
        round(down * (picture.shape[1] - one.shape[1])), round(across * (picture.shape[2] - one.shape[2])),
    )  # fmt: skip


def _edges(picture: Tensor) -> Tensor:
    """Returns the gradient of lightness at the scale of areas, not of marks."""
    smooth = functional.avg_pool2d(picture.mean(0)[None], 2 * _AREA + 1, 1)[0]
    across = smooth[:, 2 * _AREA :] - smooth[:, : -2 * _AREA]
    down = smooth[2 * _AREA :] - smooth[: -2 * _AREA]
    return (across[_AREA:-_AREA].square() + down[:, _AREA:-_AREA].square()).sqrt()
