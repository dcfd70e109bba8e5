"""How a picture of a library looks, whatever it shows: whether a painting had better begin with it."""

from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.compositing import resized
from frida_painter.palette import to_lab

_REALISM = 0.6  # of a photograph before a sign
_OWN = 0.3  # of a person's own picture
_FLAT = 0.4  # of its realism, against a picture of flat areas alone: a drawing, whatever its file says
_PLAIN = 0.25  # against drawings without colour, and pictures that are no cut-outs
_COLORFUL = 8.0  # chroma
_BLACK, _SILHOUETTE = 12.0, 0.4  # L*, and share of a picture, from which it is a silhouette
_SKETCHY = 0.25  # share of its box that a thing fills, below which there are only lines
_MOSTLY = 0.5  # of neighbouring pixels that are the same, from which a picture is drawn
_LACY, _SOME_LACE = 0.6, 0.15  # against lines that are narrower than a brush, beyond that share of a thing
_LACE_SIDE, _BRUSH = 64, 5  # of a picture, and of a brush, in pixels
_FILLED = 0.95  # share of its box, from which a picture is a rectangle


def is_colorless(picture: Tensor) -> bool:
    """Whether a picture [4, h, w] is a drawing without colour: an outline, or a silhouette."""
    lab = to_lab(picture[:3, picture[3] > 0.5].T)
    return len(lab) == 0 or (_flatness(picture) > _MOSTLY and (_chroma(lab) < _COLORFUL or _black(lab) > _SILHOUETTE))


def appearance(picture: Tensor, realism: float, *, is_own: bool) -> float:
    """What a picture is worth before it is compared: cut-outs before rectangles, colours before outlines."""
    seen = picture[:3, picture[3] > 0.5].T
    if len(seen) == 0:
        return -1.0
    flat = _flatness(picture)
    worth = _REALISM * realism * (1 - _FLAT * flat) + _OWN * is_own
    lab = to_lab(seen[:: max(1, len(seen) // 2000)])
    worth -= _PLAIN * flat * (_black(lab) > _SILHOUETTE and not is_own)
    worth -= _PLAIN * flat * (_chroma(lab) < _COLORFUL and not is_own)
    if float(picture[3].mean()) < _SKETCHY:
        worth -= _PLAIN
    elif not is_own:
        worth -= min(_PLAIN, _LACY * max(0.0, _lace(picture) - _SOME_LACE))
    return worth - _PLAIN * (has_ground(picture) and not is_own)


def has_ground(picture: Tensor) -> bool:
    """Whether a picture [4, h, w] is no cut-out, but a rectangle with a ground of its own."""
    return float(picture[3].mean()) > _FILLED


def _lace(picture: Tensor) -> float:
    """Share of a thing [4, h, w] that is narrower than a brush is wide, as the bars of an iron fence are."""
    small = resized(picture, _LACE_SIDE / max(picture.shape[1:]))[3]
    seen = functional.pad((small > 0.5).float()[None, None], (_BRUSH,) * 4)
    inner = -functional.max_pool2d(-seen, _BRUSH, 1, _BRUSH // 2)
    wide = functional.max_pool2d(inner, _BRUSH, 1, _BRUSH // 2)
    return 1 - float(wide.sum() / seen.sum().clamp(min=1))


def _chroma(lab: Tensor) -> float:
    """The mean chroma of colours [n, 3] in CIELAB."""
    return float(lab[:, 1:].norm(dim=1).mean())


def _black(lab: Tensor) -> float:
    """The share of colours [n, 3] in CIELAB that are black."""
    return float((lab[:, 0] < _BLACK).float().mean())


def _flatness(picture: Tensor) -> float:
    """Share of neighbours in a thing [4, h, w] of the very same colour: near 0 in photographs, near 1 in signs."""
    opaque = picture[3] > 0.98
    pairs = opaque[:, 1:] & opaque[:, :-1]
    same = (picture[:3, :, 1:] == picture[:3, :, :-1]).all(0)
    return float((same & pairs).sum()) / max(1, int(pairs.sum()))
