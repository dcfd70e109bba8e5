"""Style objective: colours, textures and marks of another picture, independent of their places."""

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.devices import Constant, send_to_device
from frida_painter.frames import PixelGrid
from frida_painter.images import resize_to_pixels
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.vgg import Vgg16
from frida_painter.objectives.objective import Goal, Term
from frida_painter.objectives.style_flow import change_by_place, magnification, styles_of
from frida_painter.palette import from_lab, to_lab

# Distance of two clouds of features: a differentiable relaxation of the Earth Mover's Distance
#
# Kolkin, Salavon and Shakhnarovich 2019 (STROTSS); Kusner et al. 2015 (the relaxation).

_SMALL = 1e-8


def cosine_cost(a: Tensor, b: Tensor) -> Tensor:
    """Returns cosine distances [n, m] in [0, 2] between rows of a [n, c] and b [m, c]; 1 for a row of zeros."""
    return 1 - _unit(a) @ _unit(b).T


def euclidean_cost(a: Tensor, b: Tensor) -> Tensor:
    """Returns distances [n, m] between rows of a [n, c] and b [m, c]. The gradient is finite for equal rows."""
    squared = a.square().sum(1)[:, None] + b.square().sum(1)[None] - 2 * a @ b.T
    return (squared.clamp(min=0) + _SMALL).sqrt()


def relaxed_emd(cost: Tensor) -> Tensor:
    """Returns a lower bound of the Earth Mover's Distance for cost [n, m] between two clouds of equal weights.

    Each point moves to its cheapest partner. This is done in both directions; the larger mean cost counts.
    """
    return torch.maximum(cost.amin(1).mean(), cost.amin(0).mean())


def _cloud_moments(rows: Tensor) -> tuple[Tensor, Tensor]:
    """Returns mean [c] and covariance [c, c] of rows [n, c]."""
    mean = rows.mean(0)
    return mean, (rows - mean).T @ (rows - mean) / len(rows)


def _apart(one: tuple[Tensor, Tensor], other: tuple[Tensor, Tensor]) -> Tensor:
    return sum(((a - b).abs().mean() for a, b in zip(one, other, strict=True)), one[0].new_zeros(()))


def _unit(rows: Tensor) -> Tensor:
    return rows / (rows.square().sum(1, keepdim=True) + _SMALL).sqrt()


class Cloud:
    """Cloud of features to be matched, [n, c], with all that does not change kept.

    cosine: True for the cosine cost of `cosine_cost`, False for the distance of `euclidean_cost`
    """

    def __init__(self, rows: Tensor, *, cosine: bool) -> None:
        self._cosine = cosine
        self._rows = Constant(_unit(rows) if cosine else rows)
        self._mean, self._covariance = map(Constant, _cloud_moments(rows))

    def distance(self, rows: Tensor) -> Tensor:
        """Returns `relaxed_emd` of the cost plus the difference of the moments for rows [m, c]; differentiable by them.

        The gradient needs only the pairs of partners, and not the whole matrix of costs: half the time.
        """
        wanted = self._rows.like(rows)
        seen = _unit(rows) if self._cosine else rows
        with torch.no_grad():
            cost = 1 - seen @ wanted.T if self._cosine else euclidean_cost(seen, wanted)
            partner, source = cost.argmin(1), cost.argmin(0)
        there = self._cost_of_pairs(seen, wanted.index_select(0, partner)).mean()
        back = self._cost_of_pairs(seen.index_select(0, source), wanted).mean()
        moments = self._mean.like(rows), self._covariance.like(rows)
        return torch.maximum(there, back) + _apart(_cloud_moments(rows), moments)

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
            carried = change_by_place(picture, styles, lambda style: _transfer_colors(picture, _moments(_lab(style))))
            moved[id(picture)] = torch.lerp(picture, carried, share)
        return term.with_picture(moved[id(picture)])

    terms = tuple(recolored(term) for term in goal.terms)
    initial = tuple(recolored(term) if id(term.picture) in moved else term for term in goal.initial)
    return Goal(terms, initial)


def _moments(lab: Tensor) -> tuple[Tensor, Tensor]:
    """Returns mean [3] and covariance [3, 3] of colours [n, 3] in Lab."""
    mean = lab.mean(0)
    return mean, (lab - mean).T @ (lab - mean) / len(lab) + _MIN * torch.eye(3).double()


def _transfer_colors(picture: Tensor, wanted: tuple[Tensor, Tensor]) -> Tensor:
    """Returns the picture [3, H, W] with mean and covariance of its colours moved to `wanted`."""
    seen = _lab(picture)
    mean, spread = _moments(seen)
    root = _root(spread)
    back = torch.linalg.inv(root)
    stretch, directions = torch.linalg.eigh(back @ _root(root @ wanted[1] @ root) @ back)
    carry = directions @ torch.diag(stretch.clamp(*_CHANGE)) @ directions.T
    carried = (to_lab(picture.flatten(1).T).double() - mean) @ carry.T + wanted[0]
    # A style may be nearly black: the lightness is then raised so that the content stays visible.
    lightness = ((seen - mean) @ carry.T + wanted[0])[:, 0]
    darkest, lightest = lightness.quantile(_RARE), lightness.quantile(1 - _RARE)
    carried[:, 0] += (-darkest).clamp(min=0) - (lightest - 100).clamp(min=0)
    return from_lab(carried.float()).T.reshape(picture.shape).to(picture)


def _lab(picture: Tensor) -> Tensor:
    """Returns colours at some pixels of a picture [3, H, W] in Lab: [n, 3] float64."""
    return to_lab(resize_to_pixels(picture, _SEEN).clamp(0, 1).flatten(1).T).double()


def _root(matrix: Tensor) -> Tensor:
    """Returns the symmetric square root of a positive semidefinite matrix [3, 3]."""
    values, directions = torch.linalg.eigh(matrix)
    return directions @ torch.diag(values.clamp(min=0).sqrt()) @ directions.T


LAYERS = ("conv1_2", "conv2_2", "conv3_1", "conv3_3", "conv4_3")
_PIXELS = 16_000  # pixels of the compared picture, about 112 x 143
_FEWEST_PIXELS, _OF_GRID = 6_000, 0.4  # least number of them; share of the grid's pixels
_BALANCE = 0.04  # relative to the squared difference to a picture, if both weights are 1
_SAMPLES = 1024  # places at which features are compared
_FEWEST_COUNT = 0.05  # share of places that count
_SIDE = 224  # pixels of a side of a CLIP's input
# Rows of the matrix from sRGB to lightness and two colour differences, which vary independently.
_DECORRELATE = ((0.577, 0.577, 0.577), (-0.577, 0.789, -0.211), (0.577, 0.211, -0.789))


def pixels_of(grid: PixelGrid) -> int:
    """Number of pixels of the pictures compared for a painting on a grid: plans that are coarse need fewer."""
    return max(_FEWEST_PIXELS, min(_PIXELS, round(_OF_GRID * grid.rows * grid.columns)))


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
        larger = round(pixels * magnification(style) ** 2)
        self._decorrelate = Constant(torch.tensor(_DECORRELATE))
        with torch.no_grad():
            self._clouds = [
                Cloud(rows, cosine=number > 0) for number, rows in enumerate(self._see(style, larger, None))
            ]

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns the distance in style of a picture [3, H, W] in [0, 1]; near 0 for the style picture itself.

        Differentiable.
        """
        colors, *layers = (
            cloud.distance(rows)
            for cloud, rows in zip(self._clouds, self._see(picture, self._pixels, self._free), strict=True)
        )
        return _BALANCE * (colors + torch.stack(layers).mean())

    def _see(self, picture: Tensor, pixels: int, free: Tensor | None) -> list[Tensor]:
        """Returns colours, then the features of each layer, at sampled places: [n, c] each."""
        small = resize_to_pixels(picture, pixels)
        maps = [small, *self._vgg.features(small, LAYERS)]
        if self._seer is not None:
            view = functional.interpolate(picture[None], (_SIDE, _SIDE), mode="bilinear", antialias=True)
            maps += [layer[0] for layer in self._seer.features(view)]
        clouds = [_sample(one, self._seed, free) for one in maps]
        clouds[0] = clouds[0] @ self._decorrelate.like(clouds[0]).T
        # Features of each layer are scaled to one size, because their units have no meaning.
        return [clouds[0], *(cloud / (cloud.detach().square().mean().sqrt() + 1e-6) for cloud in clouds[1:])]


def _sample(features: Tensor, seed: int, free: Tensor | None) -> Tensor:
    """Returns features [c, h, w] at up to 1024 places, [n, c]; the same places for each map of that shape.

    free [h, w]: as for `Style`; if hardly a place counts, all do
    """
    rows = features.flatten(1).T
    places = torch.randperm(len(rows), generator=torch.Generator().manual_seed(seed))
    if free is not None:
        counts = images.fit(free[None].cpu(), *features.shape[1:]).flatten()[places] < 0.5
        places = places[counts] if float(counts.float().mean()) > _FEWEST_COUNT else places
    return rows[send_to_device(places[:_SAMPLES], rows.device)]
