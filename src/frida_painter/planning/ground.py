"""Choice of the ground: the colour in which a canvas is toned before it is painted."""

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.errors import ConfigError
from frida_painter.planning.mixable import make_mixable
from frida_painter.planning.planner import Planner
from frida_painter.strokes.palette import to_lab
from frida_painter.strokes.plan import WHITE
from frida_painter.system import images

_ROWS, _MARK = 64, 4  # rows and columns of the picture, and of a place that a stroke paints in one colour
# Chosen on plans of 300 strokes for ten pictures (docs/lab/grounds.md): the share of the canvas that strokes leave
# bare; the squared error that they leave on even areas; the squared error above which a bare place needs a stroke.
_BARE, _LEFT, _NEAR = 0.02, 0.001, 0.01
_CLEARLY = 0.944  # share of the error: 0.25 dB
_OTHER = 25.0  # CIELAB distance above which two colours count as equally different


def proposed_ground(planner: Planner) -> tuple[float, float, float]:
    """Returns the mean colour of the picture to paint, in sRGB, or white if the mean is not clearly better.

    The estimated error of a painting is what strokes leave of the picture's detail, and the ground in gaps between
    them. Places in the colour of the ground need no strokes, which then leave fewer gaps elsewhere.
    Raises ConfigError if the goal has no picture to take colours from.
    """
    term = next((term for term in planner.goal.initial_terms if term.guide is not None), None)
    if term is None or term.guide is None:
        raise ConfigError(
            "--ground auto takes its colour from the picture to paint, and this goal has none; give a colour, such as "
            "#c8a878."
        )
    wanted = _in_paint(term.guide, planner)
    picture = functional.adaptive_avg_pool2d(wanted, _ROWS)
    matters = torch.ones(_ROWS, _ROWS)
    if term.importance is not None:
        matters = functional.adaptive_avg_pool2d(term.importance[None], _ROWS)[0]
    marks = functional.interpolate(functional.avg_pool2d(picture, _MARK)[None], scale_factor=_MARK)[0]

    def error(painted: Tensor) -> Tensor:  # [_ROWS, _ROWS]
        return (picture - painted).square().mean(0)

    def expected_error(ground: tuple[float, float, float]) -> float:
        bare = error(torch.tensor(ground)[:, None, None])
        gaps = _BARE * (bare / _NEAR).clamp(max=1).mean() * bare
        return float((matters * (error(marks) + gaps)).sum() / matters.sum()) + _LEFT

    mean = _within_reach(mean_color(wanted), planner)
    return mean if expected_error(mean) < _CLEARLY * expected_error(WHITE) else WHITE


def mean_color(picture: Tensor) -> tuple[float, float, float]:
    """Returns the mean of a picture [3, H, W], in sRGB rounded to 8 bits."""
    red, green, blue = (picture.mean((1, 2)) * 255).round().div(255).tolist()
    return red, green, blue


def _in_paint(picture: Tensor, planner: Planner) -> Tensor:
    """Returns the picture, sRGB [3, H, W], with no colour darker than the darkest paint."""
    darkest = planner.materials.darkest
    return picture if darkest is None else torch.maximum(picture, torch.tensor(darkest)[:, None, None])


def ground_around_things(planner: Planner) -> tuple[float, float, float]:
    """Returns the commonest colour around the things of the goal's start picture, in sRGB rounded to 8 bits.

    Areas of this colour need no strokes, so that more strokes remain for the things. A hundred strokes do not cover
    a canvas. A start picture without an importance map, such as patches arranged for a CLIP, counts as a whole; without
    a start picture the ground is white.
    """
    term = next((term for term in planner.goal.initial_terms if term.guide is not None), None)
    if term is None or term.guide is None:
        return WHITE
    around = images.fit(_in_paint(term.guide, planner), _ROWS, _ROWS).flatten(1).T  # [pixels, 3]
    if term.importance is not None:
        matters = images.fit(term.importance[None], _ROWS, _ROWS).flatten()
        around = around[matters <= matters.median().clamp(max=1)]
    lab = to_lab(around)
    apart = torch.cdist(lab, lab).clamp(max=_OTHER).mean(1)
    return _within_reach(mean_color(around[apart.argmin()][:, None, None]), planner)


def _within_reach(ground: tuple[float, float, float], planner: Planner) -> tuple[float, float, float]:
    """Returns the ground, or the colour that its recipe gives if the planner's paints cannot mix it."""
    paints = planner.materials.paints
    if paints is None or ground == WHITE:
        return ground
    mixed = make_mixable(torch.tensor([ground]), torch.ones(1), paints, apart=0.0)
    return mean_color(mixed.color[0][:, None, None]) if mixed.changes else ground
