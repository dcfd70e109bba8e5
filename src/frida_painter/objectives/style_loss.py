"""The style objective: have the colours, textures and marks of another picture, wherever they lie."""

from collections.abc import Sequence

import torch
from torch import Tensor

from frida_painter.devices import Constant, sent
from frida_painter.images import sized
from frida_painter.objectives.encoders.vgg import Vgg16
from frida_painter.objectives.objective import Goal, Term
from frida_painter.palette import from_lab, to_lab

# How far one cloud of features lies from another: the Earth Mover's Distance, relaxed so that it can be descended.
#
# Kolkin, Salavon and Shakhnarovich 2019 (STROTSS); Kusner et al. 2015 (the relaxation).

_SMALL = 1e-8


def cosine_cost(a: Tensor, b: Tensor) -> Tensor:
    """Cosine distances [n, m] in [0, 2] between rows of a [n, c] and b [m, c]; 1 from or to a row of zeros."""
    return 1 - _unit(a) @ _unit(b).T


def euclidean_cost(a: Tensor, b: Tensor) -> Tensor:
    """Distances [n, m] between rows of a [n, c] and b [m, c]; its slope is finite where rows are equal."""
    squared = a.square().sum(1)[:, None] + b.square().sum(1)[None] - 2 * a @ b.T
    return (squared.clamp(min=0) + _SMALL).sqrt()


def relaxed_emd(cost: Tensor) -> Tensor:
    """A lower bound of the Earth Mover's Distance for cost [n, m] between two clouds of equal weights.

    Each point goes where it is cheapest, in one direction or the other, whichever costs more.
    """
    return torch.maximum(cost.amin(1).mean(), cost.amin(0).mean())


def moment_distance(a: Tensor, b: Tensor) -> Tensor:
    """Mean absolute difference of the means, plus that of the covariances, of rows a [n, c] and b [m, c]."""
    mean_a, mean_b = a.mean(0), b.mean(0)
    covariance_a = (a - mean_a).T @ (a - mean_a) / len(a)
    covariance_b = (b - mean_b).T @ (b - mean_b) / len(b)
    return (mean_a - mean_b).abs().mean() + (covariance_a - covariance_b).abs().mean()


def _unit(rows: Tensor) -> Tensor:
    return rows / (rows.square().sum(1, keepdim=True) + _SMALL).sqrt()


# A picture that is to be painted in a style is wanted in the style's colours: otherwise the one undoes the other.
#
# Its colours are moved by the straight map that carries their mean and covariance to the style's with the least
# movement (Pitié and Kokaram 2007, "The linear Monge-Kantorovitch linear colour mapping for example-based colour
# transfer"), in CIE L*a*b*.

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


LAYERS = ("conv1_2", "conv2_2", "conv3_1", "conv3_3", "conv4_3")
_PIXELS = 16_000  # of the picture in which styles are compared, about 112 x 143
_BALANCE = 0.04  # against the squared difference to a picture, when both have a weight of 1
_SAMPLES = 1024  # places at which features are compared
# Rows of the matrix that turns sRGB into lightness and two colour differences, which vary independently.
_DECORRELATE = ((0.577, 0.577, 0.577), (-0.577, 0.789, -0.211), (0.577, 0.211, -0.789))


class Style:
    """l_style of the paper (Eq. "style"), as in STROTSS: relaxed Earth Mover's Distances, and moments.

    style [3, H, W] in [0, 1]: whose style is wanted; vgg: sees it. Places are sampled once, from
    `seed`, so that the same picture always has the same distance.
    """

    def __init__(self, style: Tensor, vgg: Vgg16, seed: int) -> None:
        self._vgg = vgg
        self._seed = seed
        self._decorrelate = Constant(torch.tensor(_DECORRELATE))
        with torch.no_grad():
            self._clouds = self._see(style)

    def __call__(self, picture: Tensor) -> Tensor:
        """picture [3, H, W] in [0, 1] -> its distance in style, 0 for the style picture itself; differentiable."""
        (colors, *seen), (wanted, *layers) = self._see(picture), self._clouds
        total = relaxed_emd(euclidean_cost(colors, wanted.to(colors))) + moment_distance(colors, wanted.to(colors))
        for cloud, aim in zip(seen, layers, strict=True):
            aim = aim.to(cloud)
            total = total + (relaxed_emd(cosine_cost(cloud, aim)) + moment_distance(cloud, aim)) / len(LAYERS)
        return _BALANCE * total

    def _see(self, picture: Tensor) -> list[Tensor]:
        """Colours, then the features of each layer, at sampled places: [n, c] each."""
        small = sized(picture, _PIXELS)
        maps = [small, *self._vgg.features(small, LAYERS)]
        clouds = [_sampled(one, self._seed) for one in maps]
        clouds[0] = clouds[0] @ self._decorrelate.like(clouds[0]).T
        # Features of one layer are brought to one size: their own units mean nothing.
        return [clouds[0], *(cloud / (cloud.detach().square().mean().sqrt() + 1e-6) for cloud in clouds[1:])]


def _sampled(features: Tensor, seed: int) -> Tensor:
    """Features [c, h, w] at no more than so many places, [n, c]: the same places for every map of that shape."""
    rows = features.flatten(1).T
    if len(rows) <= _SAMPLES:
        return rows
    places = torch.randperm(len(rows), generator=torch.Generator().manual_seed(seed))[:_SAMPLES]
    return rows[sent(places, rows.device)]
