"""A picture that is to be painted in a style is wanted in the style's colours: otherwise the one undoes the other.

Its colours are moved by the straight map that carries their mean and covariance to the style's with the least
movement (Pitié and Kokaram 2007, "The linear Monge-Kantorovitch linear colour mapping for example-based colour
transfer"), in CIE L*a*b*.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from frida_painter.goal import Goal, Term
from frida_painter.images import sized
from frida_painter.palette import from_lab, to_lab

_SEEN = 40_000  # pixels of a picture from which its colours are told
_CHANGE = (0.5, 3.0)  # of differences between colours: what a picture shows stays seen, and an even ground even
_RARE = 0.02  # share of the pixels that may be darker, or lighter, than can be shown
_LEAST = 1.0  # variance of colours of Lab along any direction, below which nothing is told of it


def in_style_colors(goal: Goal) -> Goal:
    """The goal, whose pictures have the colours of its styles, as far as these matter against them.

    With the weight of a picture, or more, of a style, all of the way; with less, so much of it. A picture to begin
    with that is not painted afterwards stays as it is, and so does a goal without a style.
    """
    styles = [(term.colors, term.weight) for term in goal.terms if term.colors is not None]
    if not styles:
        return goal
    wanted = _moments([_lab(colors) for colors, _ in styles], [weight for _, weight in styles])
    moved: dict[int, Tensor] = {}

    def recolored(term: Term) -> Term:
        picture = term.picture
        if picture is None:
            return term
        if id(picture) not in moved:
            share = min(1.0, sum(weight for _, weight in styles) / term.weight)
            moved[id(picture)] = torch.lerp(picture, _carried(picture, wanted), share)
        return term.with_picture(moved[id(picture)])

    terms = tuple(recolored(term) for term in goal.terms)
    initial = tuple(recolored(term) if id(term.picture) in moved else term for term in goal.initial)
    return Goal(terms, initial)


def _moments(every: Sequence[Tensor], weights: Sequence[float]) -> tuple[Tensor, Tensor]:
    """Mean [3] and covariance [3, 3] of all colours in Lab, those of each picture [n, 3] mattering by its weight."""
    share = torch.tensor(weights, dtype=torch.float64) / sum(weights)
    mean = sum((part * lab.mean(0) for part, lab in zip(share, every, strict=True)), torch.zeros(3).double())
    spread = sum(
        (part * (lab - mean).T @ (lab - mean) / len(lab) for part, lab in zip(share, every, strict=True)),
        _LEAST * torch.eye(3).double(),
    )
    return mean, spread


def _carried(picture: Tensor, wanted: tuple[Tensor, Tensor]) -> Tensor:
    """The picture [3, H, W] with its mean and covariance of colours carried to those wanted."""
    seen = _lab(picture)
    mean, spread = _moments([seen], [1.0])
    root = _root(spread)
    back = torch.linalg.inv(root)
    stretch, directions = torch.linalg.eigh(back @ _root(root @ wanted[1] @ root) @ back)
    carry = directions @ torch.diag(stretch.clamp(*_CHANGE)) @ directions.T
    carried = (to_lab(picture.flatten(1).T).double() - mean) @ carry.T + wanted[0]
    # A style may be as good as black: then what the picture shows is only as dark as it can be told apart.
    lightness = ((seen - mean) @ carry.T + wanted[0])[:, 0]
    darkest, lightest = lightness.quantile(_RARE), lightness.quantile(1 - _RARE)
    carried[:, 0] += (-darkest).clamp(min=0) - (lightest - 100).clamp(min=0)
    return from_lab(carried.float()).T.reshape(picture.shape).to(picture)


def _lab(picture: Tensor) -> Tensor:
    """Colours of a picture [3, H, W] at some of its pixels, in Lab, [n, 3] float64."""
    return to_lab(sized(picture, _SEEN).clamp(0, 1).flatten(1).T).double()


def _root(matrix: Tensor) -> Tensor:
    """The symmetric square root of a symmetric matrix [3, 3] without negative eigenvalues."""
    values, directions = torch.linalg.eigh(matrix)
    return directions @ torch.diag(values.clamp(min=0).sqrt()) @ directions.T
