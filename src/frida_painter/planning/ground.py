"""Choice of the ground: the colour in which a canvas is toned before it is painted."""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.planning.fields import EVERYWHERE
from frida_painter.planning.mixable import make_mixable
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Planner
from frida_painter.strokes.palette import to_lab
from frida_painter.strokes.plan import WHITE
from frida_painter.system import images

_ROWS = 64
# Quick plans, measured on nine pictures with two seeds: they chose the same ground as whole plans, or one at most
# 0.05 dB worse. The one exception was a logo on white (0.26 dB worse).
_TRYING, _TRIAL_ROWS = 0.1, 96  # share of the planner's effort; rows of the picture
_FEWEST = 8  # strokes of a quick plan
_CLEARLY = 0.944  # share of the loss: 0.25 dB, by which quick plans on the same ground differ by chance
_OTHER = 25.0  # CIELAB distance above which two colours count as equally different


def proposed_ground(
    planner: Planner, strokes: int, colors: int, notify: Callable[[Step], None] = lambda step: None
) -> tuple[float, float, float]:
    """Returns the best ground for a plan with these numbers of strokes and paints, in sRGB.

    A quick plan is made on each of a few colours, with the first two brushes, in a seventh of the time. The colour
    with the least expected loss is taken, or white if none is clearly better.
    notify: called after every step.
    Raises ConfigError if the goal has no picture to take colours from, or if the strokes are too few for the
    layers.
    """
    term = next((term for term in planner.goal.initial_terms if term.guide is not None), None)
    if term is None or term.guide is None:
        raise ConfigError(
            "--ground auto takes its colour from the picture to paint, and this goal has none; give a colour, such as "
            "#c8a878."
        )
    planner.layer_sizes(strokes)  # raises before the trials start
    rows = min(_TRIAL_ROWS, planner.settings.render_height)
    settings = planner.settings.model_copy(update={"render_height": rows, "focus": EVERYWHERE})
    few_models = planner.materials.models[:2]
    materials = replace(planner.materials, models=few_models, layers=None, shares=None, ground=WHITE, paints=None)
    # the term already has its importance map, and is already sharpened
    goal = Goal((ImageTerm(term.guide, importance=term.importance, wanted=term.guide),))
    effort = planner.effort.scale(_TRYING)
    trial = Planner(goal, settings, materials, effort, encoders=planner.encoders, device=planner.device)
    few = max(strokes // 2, min(strokes, _FEWEST))

    def expected_loss(ground: tuple[float, float, float]) -> float:
        on_it = trial.on_ground(ground)
        return on_it.expected_loss(on_it.plan(None, few, min(colors, few), notify), on_it.bare)

    grounds = [_within_reach(ground, planner) for ground in possible_grounds(_in_paint(term.guide, planner))]
    losses = {ground: expected_loss(ground) for ground in grounds}
    best = min(losses, key=lambda ground: losses[ground])
    return best if losses[best] < _CLEARLY * losses[WHITE] else WHITE


def possible_grounds(picture: Tensor) -> list[tuple[float, float, float]]:
    """Returns candidate grounds for a painting of this picture, in sRGB rounded to 8 bits.

    The candidates are white, the mean of the picture and the mean of its darker half. The mean leaves the least
    squared error between strokes. The darker mean suits because strokes are painted from light to dark, and dark
    strokes leave gaps.
    picture [3, H, W]: sRGB in [0, 1].
    """
    color = images.fit(picture, _ROWS, _ROWS).flatten(1)  # [3, pixels]
    lightness = color.mean(0)
    found = [WHITE]
    for share in (1.0, 0.5):
        dark = color[:, lightness <= torch.quantile(lightness, share)]
        red, green, blue = (dark.mean(1) * 255).round().div(255).tolist()
        found.append((red, green, blue))
    return found


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
    red, green, blue = (around[apart.argmin()] * 255).round().div(255).tolist()
    return _within_reach((red, green, blue), planner)


def _within_reach(ground: tuple[float, float, float], planner: Planner) -> tuple[float, float, float]:
    """Returns the ground, or the colour that its recipe gives if the planner's paints cannot mix it."""
    paints = planner.materials.paints
    if paints is None or ground == WHITE:
        return ground
    mixed = make_mixable(torch.tensor([ground]), torch.ones(1), paints, apart=0.0)
    if not mixed.changes:
        return ground
    red, green, blue = (mixed.color[0] * 255).round().div(255).tolist()
    return red, green, blue
