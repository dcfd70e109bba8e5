"""Goal "style": colours, textures and marks of another picture, independent of their places."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.errors import ConfigError
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.convolutional import Vgg16
from frida_painter.objectives.image import PictureTerm, rise
from frida_painter.objectives.objective import GRADIENT_LASTS, Goal, ObjectiveContext, ObjectiveTerm, Term
from frida_painter.objectives.style_flow import FACE, change_by_place, magnification, styles_of
from frida_painter.objectives.style_marks import fill_drawing_in_style, in_style_marks
from frida_painter.strokes.palette import from_lab, to_lab
from frida_painter.system import images
from frida_painter.system.devices import Constant, send_to_device

_FLAT = 0.01  # standard deviation below which a picture has a single colour


@dataclass(frozen=True)
class StyleTerm(PictureTerm):
    """Term of a goal: paint in the style of a picture. Raises ConfigError if the picture has a single colour.

    free [h, w]: places of the painting that are free of the style, such as faces, 1, and others, 0; None if none is
    """

    free: Tensor | None = None
    called = "a style"
    is_tried = False
    longest = 1024  # pixels; styles are compared in small pictures
    initial_order = 3
    interpretation_order = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        if not float(self.image.flatten(1).std(1).max()) >= _FLAT:
            raise ConfigError("A style picture of a single colour was given, which has no style; give another picture.")

    @property
    def colors(self) -> Tensor:
        """Style picture."""
        return self.image

    def fit_to(self, rows: int, columns: int, *, pad: bool = False) -> Self:
        """Returns the term unchanged: a style does not fill the canvas."""
        return self

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the distance in style by VGG16, and by a CLIP's layers too if there is one."""
        encoders, grid = context.encoders, context.grid
        pixels = max(_FEWEST_PIXELS, min(_PIXELS, round(_OF_GRID * grid.rows * grid.columns)))
        judge = Style(self.image, encoders.style(), context.seed, pixels, self.free, encoders.clip_of_style())
        return ObjectiveTerm(judge, lasts=GRADIENT_LASTS, smooth=True)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Moves the colours of the pictures to paint to those of the styles, and puts photographs into their marks.

        A drawing without a photograph gets a picture in the style. Faces are free of all styles.
        """
        made = fill_drawing_in_style(in_style_marks(in_style_colors(goal)), context.grid.rows, context.grid.columns)
        matters = next((term.importance for term in made.terms if term.importance is not None), None)
        if matters is None or any(term.words is not None for term in made.terms):
            return made
        free = rise(matters, FACE)
        terms = (replace(one, free=free) if isinstance(one, cls) else one for one in made.terms)
        return replace(made, terms=tuple(terms))


# Distance of two clouds of features: a differentiable relaxation of the Earth Mover's Distance
#
# Kolkin, Salavon and Shakhnarovich 2019 (STROTSS); Kusner et al. 2015 (the relaxation).

_SMALL = 1e-8


def euclidean_cost(a: Tensor, b: Tensor) -> Tensor:
    """Returns distances [n, m] between rows of a [n, c] and b [m, c]. The gradient is finite for equal rows."""
    squared = a.square().sum(1)[:, None] + b.square().sum(1)[None] - 2 * a @ b.T
    return (squared.clamp(min=0) + _SMALL).sqrt()


def _moments(rows: Tensor) -> tuple[Tensor, Tensor]:
    """Returns mean [c] and covariance [c, c] of rows [n, c]."""
    mean = rows.mean(0)
    return mean, (rows - mean).T @ (rows - mean) / len(rows)


def _unit(rows: Tensor) -> Tensor:
    return rows / (rows.square().sum(1, keepdim=True) + _SMALL).sqrt()


class Cloud:
    """Cloud of features to be matched, [n, c], with all that does not change kept.

    cosine: True for one less the cosine, False for the distance of `euclidean_cost`
    """

    def __init__(self, rows: Tensor, *, cosine: bool) -> None:
        self._cosine = cosine
        self._rows = Constant(_unit(rows) if cosine else rows)
        self._kept = [*map(Constant, _moments(rows))]

    def distance(self, rows: Tensor) -> Tensor:
        """Returns the distance of rows [m, c] and the difference of the moments; differentiable by the rows.

        It is a lower bound of the Earth Mover's Distance: each point moves to its cheapest partner, in both directions,
        and the larger mean cost counts. The gradient needs only the pairs of partners, which halves the time.
        """
        wanted = self._rows.like(rows)
        seen = _unit(rows) if self._cosine else rows
        with torch.no_grad():
            cost = 1 - seen @ wanted.T if self._cosine else euclidean_cost(seen, wanted)
            partner, source = cost.argmin(1), cost.argmin(0)
        there = self._cost_of_pairs(seen, wanted.index_select(0, partner)).mean()
        back = self._cost_of_pairs(seen.index_select(0, source), wanted).mean()
        apart = ((a - b.like(rows)).abs().mean() for a, b in zip(_moments(rows), self._kept, strict=True))
        return torch.maximum(there, back) + sum(apart, rows.new_zeros(()))

    def _cost_of_pairs(self, a: Tensor, b: Tensor) -> Tensor:
        return 1 - (a * b).sum(1) if self._cosine else ((a - b).square().sum(1) + _SMALL).sqrt()


# Colours of a picture to be painted in a style: they are moved to the style's colours first, because picture and
# style would otherwise work against each other.
#
# The linear map carries mean and covariance to those of the style with the least movement, in CIE L*a*b* (Pitié and
# Kokaram 2007, "The linear Monge-Kantorovitch linear colour mapping for example-based colour transfer").

_SEEN = 40_000  # pixels of a picture that are used for its colours
_CHANGE = (0.5, 3.0)  # limits for the scaling of colour differences: content stays visible, an even ground stays even
_RARE = 0.02  # share of pixels that may be too dark or too light
_MIN = 1.0  # variance in Lab that is added along each direction, so that the covariance can be inverted


def in_style_colors(goal: Goal) -> Goal:
    """Returns the goal with the colours of its pictures moved to those of its styles, each at its places.

    Styles with at least the weight of a picture move the colours completely, lighter ones in proportion. A first
    picture that is not painted later stays unchanged. So does a goal without a style.
    """
    styles = styles_of(goal)
    if not styles:
        return goal
    moved: dict[int, Tensor] = {}

    def recolored(term: Term) -> Term:
        picture = term.picture
        if picture is None:
            return term
        if id(picture) not in moved:
            share = min(1.0, sum(style.weight for style in styles) / term.weight)
            carried = change_by_place(picture, styles, lambda style: _transfer_colors(picture, _lab(style)))
            moved[id(picture)] = torch.lerp(picture, carried, share)
        return term.with_picture(moved[id(picture)])

    terms = tuple(recolored(term) for term in goal.terms)
    initial = tuple(recolored(term) if id(term.picture) in moved else term for term in goal.initial)
    return Goal(terms, initial)


def _transfer_colors(picture: Tensor, wanted: Tensor) -> Tensor:
    """Returns the picture [3, H, W] with mean and covariance of its colours moved to those of `wanted`, Lab [n, 3]."""
    seen = _lab(picture)
    (mean, spread), (aim, aimed) = _moments(seen), _moments(wanted)
    least = _MIN * torch.eye(3).double()
    root = _root(spread + least)
    back = torch.linalg.inv(root)
    stretch, directions = torch.linalg.eigh(back @ _root(root @ (aimed + least) @ root) @ back)
    carry = directions @ torch.diag(stretch.clamp(*_CHANGE)) @ directions.T
    carried = (to_lab(picture.flatten(1).T).double() - mean) @ carry.T + aim
    # A style may be nearly black: the lightness is then raised so that the content stays visible.
    lightness = ((seen - mean) @ carry.T + aim)[:, 0]
    darkest, lightest = lightness.quantile(_RARE), lightness.quantile(1 - _RARE)
    carried[:, 0] += (-darkest).clamp(min=0) - (lightest - 100).clamp(min=0)
    return from_lab(carried.float()).T.reshape(picture.shape).to(picture)


def _lab(picture: Tensor) -> Tensor:
    """Returns colours at some pixels of a picture [3, H, W] in Lab: [n, 3] float64."""
    return to_lab(images.resize_to_pixels(picture, _SEEN).clamp(0, 1).flatten(1).T).double()


def _root(matrix: Tensor) -> Tensor:
    """Returns the symmetric square root of a positive semidefinite matrix [3, 3]."""
    values, directions = torch.linalg.eigh(matrix)
    return directions @ torch.diag(values.clamp(min=0).sqrt()) @ directions.T


LAYERS = ("conv1_2", "conv2_2", "conv3_1", "conv3_3", "conv4_3")
_PIXELS = 16_000  # pixels of the compared picture, about 112 x 143
_FEWEST_PIXELS, _OF_GRID = 6_000, 0.4  # least number of them, for coarse plans; share of the grid's pixels
_BALANCE = 0.04  # relative to the squared difference to a picture, if both weights are 1
_SAMPLES = 1024  # places at which features are compared
_FEWEST_COUNT = 0.05  # share of places that count
_SIDE = 224  # pixels of a side of a CLIP's input
# Rows of the matrix from sRGB to lightness and two colour differences, which vary independently.
_DECORRELATE = ((0.577, 0.577, 0.577), (-0.577, 0.789, -0.211), (0.577, 0.211, -0.789))


class Style:
    """Distance in style, l_style of the paper (Eq. "style"), as in STROTSS.

    style [3, H, W]: style picture in [0, 1]
    vgg: network whose features are compared
    seed: places are sampled once from it, so the distance is deterministic
    free [h, w]: places of the painting that do not count, such as faces: 1 for those, 0 for the others. None: all count
    seer: network whose layers are compared too, such as a CLIP
    pixels: number of pixels of the compared pictures

    The distance is a sum of relaxed Earth Mover's Distances and differences of moments.
    """

    def __init__(
        self,
        style: Tensor,
        vgg: Vgg16,
        seed: int,
        pixels: int = _PIXELS,
        free: Tensor | None = None,
        seer: Seer | None = None,
    ) -> None:
        self._vgg, self._seer = vgg, seer
        self._seed, self._pixels, self._free = seed, pixels, free
        self._decorrelate = Constant(torch.tensor(_DECORRELATE))
        with torch.no_grad():
            seen = self._see(style, round(pixels * magnification(style) ** 2), None)
            self._clouds = [Cloud(rows, cosine=number > 0) for number, rows in enumerate(seen)]

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns the distance in style of a picture [3, H, W] in [0, 1]; differentiable."""
        seen = self._see(picture, self._pixels, self._free)
        colors, *layers = (cloud.distance(rows) for cloud, rows in zip(self._clouds, seen, strict=True))
        return _BALANCE * (colors + torch.stack(layers).mean())

    def _see(self, picture: Tensor, pixels: int, free: Tensor | None) -> list[Tensor]:
        """Returns colours, then the features of each layer, at sampled places: [n, c] each."""
        small = images.resize_to_pixels(picture, pixels)
        maps = [small, *self._vgg.features(small, LAYERS)]
        if self._seer is not None:
            view = functional.interpolate(picture[None], (_SIDE, _SIDE), mode="bilinear", antialias=True)
            maps += [layer[0] for layer in self._seer.features(view)]
        clouds = [_sample(one, self._seed, free) for one in maps]
        clouds[0] = clouds[0] @ self._decorrelate.like(clouds[0]).T
        # Features of each layer are scaled to one size, because their units have no meaning.
        return [clouds[0], *(cloud / (cloud.detach().square().mean().sqrt() + 1e-6) for cloud in clouds[1:])]


def _sample(features: Tensor, seed: int, free: Tensor | None) -> Tensor:
    """Returns features [c, h, w] at up to 1024 places, [n, c], the same in each map; if hardly one is not free, all."""
    rows = features.flatten(1).T
    places = torch.randperm(len(rows), generator=torch.Generator().manual_seed(seed))
    if free is not None:
        counts = images.fit(free[None].cpu(), *features.shape[1:]).flatten()[places] < 0.5
        places = places[counts] if float(counts.float().mean()) > _FEWEST_COUNT else places
    return rows[send_to_device(places[:_SAMPLES], rows.device)]
