"""Recipes: small integer parts of a few paints whose mixture is nearest to a colour."""

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import torch
from torch import Tensor

from frida_painter import registry
from frida_painter.errors import ConfigError, PluginError
from frida_painter.mixing import Finish
from frida_painter.mixing.paint import Paint, color_of, mix_reflectance, read_paints, usual_paints
from frida_painter.strokes.palette import ciede2000, from_lab, to_lab
from frida_painter.system.images import to_linear

GOOD, NEAR, REACHED = 2.0, 3.0, 5.0
"""Limits of CIEDE2000.

GOOD: the difference is hardly visible
NEAR: an easy recipe is near enough; no other one is looked for
REACHED: the colour is out of reach above it
"""
EASY_PAINTS, EASY_PARTS, MAX_PARTS = 3, 40, 240
"""Largest recipe.

EASY_PAINTS, EASY_PARTS: paints, and parts of all together, if such a mixture is near: drops of half a teaspoon
MAX_PARTS: parts if only traces or a fourth paint bring the colour near, half as many at first: drops of a teaspoon or
two
"""
_LEVELS, _EVERY_LEVEL = (0, 1, 3, 9, 27), tuple(range(EASY_PARTS + 1))  # parts that are tested first, and then
_CHOSEN, _NEAREST = 12, 1600  # combinations of paints, and mixtures of them, that are tested further
_FEW, _KEPT = 6, 40  # paints in mixtures of four; combinations whose mixtures are kept
# Traces: added parts, factors of the other parts, and mixtures to which traces are added.
_ADDED, _FACTORS, _SEEDS = (1, 2, 3), (1, 2, 3, 6, 12, 40, 100), 16
# CIEDE2000 that a simpler recipe may cost: for each paint less, half as many parts, no traces, no black in lights.
_PER_PAINT, _PER_DOUBLING, _PER_TRACE = 0.6, 0.25, 1.5
_PER_BLACK, _DARK, _FAR = 4.0, 45.0, 100.0
_PER_OKLAB = 100.0  # CIEDE2000 of a difference of 1 in OKLab, about
_ALIKE, _CLIPPED = (1.0, 1.0, 1.0), (0.7, 1.0, 2.0)  # weights of lightness, chroma and hue within and out of reach
# Linear sRGB to the cones' answers, and their cube roots to OKLab.
_CONES = (
    (0.4122214708, 0.5363325363, 0.0514459929),
    (0.2119034982, 0.6806995451, 0.1073969566),
    (0.0883024619, 0.2817188376, 0.6299787005),
)
_OKLAB = (
    (0.2104542553, 0.7936177850, -0.0040720468),
    (1.9779984951, -2.4285922050, 0.4505937099),
    (0.0259040371, 0.7827717662, -0.8086757660),
)
_SAME_LIGHTNESS = 0.1  # L*, for colours that were rounded
_BLACK_PAINT, _WHITE_PAINT = 30.0, 85.0  # largest L* of a black, smallest of a white
_BLACK = (0.0, 0.0, 0.0)
_GREY = 5.0  # largest chroma of mixtures that count as black, grey or white
ACRYLICS, ANY_PAINTS = "acrylics", "any"
"""Names of paints: six common acrylics; any colour, for people who do not mix."""


@dataclass(frozen=True)
class Recipe:
    """Recipe for one colour.

    target [3]: sRGB
    parts: paints with their parts, largest first
    color [3]: predicted colour of the dry mixture, sRGB
    difference: CIEDE2000 between target and color, for the search
    missed: the same for the target with its lightness in the range of the paints (PaintSet.darkest)
    """

    target: Tensor
    parts: tuple[tuple[Paint, int], ...]
    color: Tensor
    difference: float
    missed: float

    @property
    def off(self) -> float:
        """`missed` in tenths: the one number that people read, and by which a recipe is judged."""
        return round(self.missed, 1)

    @property
    def within_reach(self) -> bool:
        """True if the mixture is near the target."""
        return self.off <= REACHED

    @property
    def verdict(self) -> str:
        """Word beside `off`; "" if the difference is hardly visible."""
        if not self.within_reach:
            return "out of reach"
        if round(self.difference, 1) > self.off:
            return "as dark as it gets" if float(to_lab(self.target)[0]) < 50 else "as light as it gets"
        return "near" if self.off > GOOD else ""

    @property
    def whole(self) -> int:
        """Sum of all parts."""
        return sum(count for _, count in self.parts)

    @property
    def words(self) -> str:
        """Recipe in words: "6 titanium white + 1 phthalo blue"."""
        return " + ".join(f"{count} {paint.name}" for paint, count in self.parts)

    def volumes(self, total: float) -> list[float]:
        """Returns the amount of each paint in `total` of the mixture, in the unit of `total`."""
        return [total * count / self.whole for _, count in self.parts]


@dataclass(frozen=True)
class MixerKind:
    """Theory of mixtures.

    name: as in a file of paints, `mixer = "NAME"`
    help: one sentence
    mix: returns the reflectance [m, b] in [0, 1] of mixtures in b bands of light, from their parts [m, n], the
    absorption and the scattering [n, b] of the n paints, and the finish
    """

    name: str
    help: str
    mix: Callable[[Tensor, Tensor, Tensor, Finish], Tensor]


KUBELKA_MUNK = MixerKind("kubelka-munk", "Absorption and scattering of the paints add up.", mix_reflectance)


@dataclass(frozen=True, eq=False)
class PaintSet:
    """Paints of a person, from which the colours of a plan are mixed.

    finish: surface of the dry paint. Artists' acrylics dry glossy.
    darkest: measured colour of the darkest paint, sRGB; black if unknown. A colour that is not darker counts as
    within reach if only its darkness is missed, because black and white are those of the easel's camera. None: the
    theory's black and white count.
    mixer: name of the theory of mixtures
    """

    paints: tuple[Paint, ...]
    finish: Finish = Finish.gloss
    darkest: tuple[float, float, float] | None = _BLACK
    mixer: str = "kubelka-munk"

    @classmethod
    def of(cls, name: str | Path, darkest: tuple[float, float, float] | None = None) -> Self | None:
        """Returns the paints of that name: "acrylics", or a file; None for "any". Raises ConfigError."""
        if str(name) == ANY_PAINTS:
            return None
        if str(name) == ACRYLICS:
            return cls(usual_paints(), darkest=darkest or _BLACK)
        paints, finish, mixer = read_paints(Path(name))
        return cls(paints, finish, darkest or _BLACK, mixer)

    def mix(self, colors: Tensor, most: int = 4) -> list[Recipe]:
        """Returns a recipe for each colour sRGB [k, 3], of at most `most` paints.

        The nearest of all mixtures of three paints in at most 40 parts is taken if it is within reach. If not, a
        fourth paint and traces are added. A colour that stays out of reach keeps its hue, and as much chroma as the
        paints have, rather than its lightness: weighted clipping (Katoh and Ito 1996) in OKLab (Ottosson 2020).
        Raises ConfigError if there are no paints, or `most` is not from 1 to 4.
        """
        if not self.paints or not 1 <= most <= 4:
            raise ConfigError(
                f"{len(self.paints)} paints and at most {most} of them were given; mixing takes 1 or more, and at most "
                "1 to 4."
            )
        if most not in self._mixers:
            mixer = _Mixer(self, min(most, len(self.paints)))
            self._mixers[most] = functools.cache(lambda *color: mixer.recipe(torch.tensor(color, dtype=torch.float64)))
        return [self._mixers[most](*color) for color in colors.double().tolist()]

    @functools.cached_property
    def _mixers(self) -> dict[int, Callable[..., Recipe]]:
        """Searches by the largest number of paints; a planner and its sheets ask for the same colours."""
        return {}


@dataclass(frozen=True, eq=False)
class _Mixtures:
    """Mixtures: parts [m, n], colours sRGB [m, 3], OKLab and chroma [m, 4], prices [m], black or not [m]."""

    parts: Tensor
    color: Tensor
    oklab: Tensor
    price: Tensor
    black: Tensor

    def __getitem__(self, order: Tensor) -> Self:
        return type(self)(*(part[order] for part in vars(self).values()))

    def __add__(self, other: Self) -> Self:
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return type(self)(*(torch.cat(pair) for pair in pairs))


def _cheapest(cost: Tensor, count: int) -> Tensor:
    """Returns the places of at most `count` least costs [m], the least first."""
    order = cost.topk(min(count, len(cost)), largest=False).indices.sort().values
    return order[cost[order].argsort(stable=True)]


class _Mixer:
    """Search for recipes of a set of paints.

    most: largest number of paints in a mixture
    """

    def __init__(self, owned: PaintSet, most: int) -> None:
        self._paints, self._most, self._finish = owned.paints, most, owned.finish
        self._kind = registry.load_part(registry.MIXERS, owned.mixer, MixerKind, "mixer")
        self._absorption = torch.stack([paint.absorption for paint in owned.paints])
        self._scattering = torch.stack([paint.scattering for paint in owned.paints])
        self._black = torch.zeros(len(owned.paints), dtype=torch.float64)
        alone = to_lab(self._mix(torch.eye(len(owned.paints), dtype=torch.float64)).color)
        self._black = ((alone[:, 0] <= _BLACK_PAINT) & (alone[:, 1:].norm(dim=1) <= _GREY)).double()
        together = min(most, EASY_PAINTS)
        self._combinations = list(itertools.combinations(range(len(owned.paints)), together))
        self._rough = self._mix(self._parts(_LEVELS, self._combinations))
        # All easy mixtures of a combination of paints.
        self._every = functools.lru_cache(_KEPT)(lambda paints: self._mix(self._parts(_EVERY_LEVEL, [paints])))
        lab = to_lab(self._rough.color)
        greyness = lab[:, 1:].norm(dim=1)
        lightness = lab[greyness <= max(_GREY, float(greyness.min())), 0]
        black, white = float(lightness.min()), float(lightness.max())
        self._ends = black if black <= _BLACK_PAINT else 0.0, white if white >= _WHITE_PAINT else 100.0
        darkest = None if owned.darkest is None else float(to_lab(torch.tensor([owned.darkest]))[0, 0])
        self._darkest = None if darkest is None else darkest - _SAME_LIGHTNESS

    def recipe(self, color: Tensor) -> Recipe:
        """Returns the recipe of a colour sRGB [3]."""
        aim = self._within_lightness(to_lab(color))
        nearest, combinations = self._near(aim, _ALIKE)
        found, near = self._cheapest(nearest, aim)
        easy = self._recipe(color, aim, found)
        if near:
            return easy
        found, _ = self._cheapest(found + self._hard(combinations), aim)
        for most in (MAX_PARTS // 2, MAX_PARTS):
            found, near = self._cheapest(self._mix(self._with_traces(found.parts, most)), aim)
            hard = self._recipe(color, aim, found)
            if near:
                return hard
        best = easy if easy.off <= NEAR else min(easy, hard, key=lambda recipe: recipe.off)
        return best if best.within_reach else self._recipe(color, aim, self._near(aim, _CLIPPED)[0])

    def _hard(self, combinations: list[tuple[int, ...]]) -> _Mixtures:
        """Returns rough mixtures of as many paints as a recipe may have, of the first few in these combinations."""
        paints = list(dict.fromkeys(itertools.chain(*combinations)))[:_FEW]
        return self._mix(self._parts(_LEVELS, list(itertools.combinations(paints, min(self._most, len(paints))))))

    def _cheapest(self, mixtures: _Mixtures, aim: Tensor) -> tuple[_Mixtures, bool]:
        """Returns the cheapest mixtures for the Lab colour `aim` [3], near ones first, and whether there are any."""
        off = ciede2000(to_lab(mixtures.color), aim)
        far = (off > NEAR) | (mixtures.black & _is_lively(aim))
        return mixtures[_cheapest(off + mixtures.price + _FAR * far, _SEEDS)], not bool(far.all())

    def _recipe(self, color: Tensor, aim: Tensor, found: _Mixtures) -> Recipe:
        """Returns the recipe of the first of the mixtures for a colour sRGB [3], and for `aim`, Lab [3]."""
        used = [(paint, int(parts)) for paint, parts in zip(self._paints, found.parts[0], strict=True) if parts]
        used.sort(key=lambda part: (-part[1], part[0].name))
        off, missed = (float(ciede2000(to_lab(found.color[0]), lab)) for lab in (to_lab(color), aim))
        return Recipe(color, tuple(used), found.color[0], off, missed)

    def _near(self, aim: Tensor, weights: tuple[float, float, float]) -> tuple[_Mixtures, list[tuple[int, ...]]]:
        """Returns the easy mixtures nearest to the Lab colour `aim` [3], and their combinations; the cheapest first.

        weights: of lightness, chroma and hue in OKLab
        """
        target, lively = _to_oklab(from_lab(aim)), _is_lively(aim)

        def cost(mixtures: _Mixtures) -> Tensor:
            apart = _PER_OKLAB * _apart(mixtures.oklab, target, weights)
            return apart + mixtures.price + (_PER_BLACK * mixtures.black if lively else 0)

        order = cost(self._rough).reshape(len(self._combinations), -1).amin(1).argsort(stable=True)
        best = [self._combinations[number] for number in order[:_CHOSEN].tolist()]
        every = [self._every(paints) for paints in best]
        chosen = _cheapest(torch.cat([cost(one) for one in every]), _NEAREST)
        size = len(every[0].price)
        near = functools.reduce(
            _Mixtures.__add__, [one[chosen[chosen // size == at] % size] for at, one in enumerate(every)]
        )
        return near[_cheapest(cost(near), _NEAREST)], best

    def _parts(self, levels: tuple[int, ...], combinations: list[tuple[int, ...]]) -> Tensor:
        """Returns all mixtures [m, n] of combinations of paints at these levels in lowest terms, of easy size."""
        parts = _easy_parts(levels, len(combinations[0]))
        found = parts.new_zeros(len(combinations), len(parts), len(self._paints))
        for at, paints in enumerate(combinations):
            found[at, :, list(paints)] = parts
        return found.flatten(0, 1)

    def _with_traces(self, parts: Tensor, most: int) -> Tensor:
        """Returns mixtures [m, n] and those with traces of one paint more, in lowest terms, of at most `most` parts."""
        added = torch.eye(len(self._paints), dtype=parts.dtype)[:, None] * torch.tensor(_ADDED)[:, None]  # [n, a, n]
        scaled = torch.tensor(_FACTORS)[:, None, None] * parts  # [f, m, n]
        more = (scaled[:, :, None, None] + added).reshape(-1, parts.shape[1])
        more = torch.cat((parts, more // _divisor(more.long())[:, None]))
        return more[(more.sum(1) <= most) & ((more > 0).sum(1) <= self._most)].unique(dim=0)  # type: ignore[no-untyped-call]

    def _price(self, parts: Tensor) -> Tensor:
        """Returns CIEDE2000 [m] that mixtures [m, n] must gain over simpler ones."""
        total = parts.sum(1)
        return _PER_PAINT * (parts > 0).sum(1) + _PER_DOUBLING * total.log2() + _PER_TRACE * (total > EASY_PARTS)

    def _within_lightness(self, lab: Tensor) -> Tensor:
        """Returns the Lab colour [3] with its lightness in the range of mixed greys.

        An end of the range counts only if the paints have a black or a white. The colour stays as it is if it is
        darker than the darkest paint, or if no darkest paint was given.
        """
        if self._darkest is None or not self._darkest <= float(lab[0]):
            return lab
        return torch.cat((lab[:1].clamp(*self._ends), lab[1:]))

    def _mix(self, parts: Tensor) -> _Mixtures:
        """Returns the mixtures [m, n] with their colours. Raises PluginError if the kind of mixer breaks its rules."""
        reflected = self._kind.mix(parts, self._absorption, self._scattering, self._finish)
        if tuple(reflected.shape) != (len(parts), self._absorption.shape[1]) or not bool(
            ((reflected >= 0) & (reflected <= 1)).all()
        ):
            raise PluginError(
                f"The mixer {self._kind.name!r} gave reflectances of shape {tuple(reflected.shape)} or outside [0, 1] "
                f"for {len(parts)} mixtures in {self._absorption.shape[1]} bands; mend it."
            )
        color = color_of(reflected)
        oklab = _to_oklab(color)
        oklab = torch.cat((oklab, oklab[:, 1:].norm(dim=1, keepdim=True)), 1)
        return _Mixtures(parts, color, oklab, self._price(parts), parts @ self._black > 0)


@functools.cache
def _easy_parts(levels: tuple[int, ...], paints: int) -> Tensor:
    """Returns all mixtures [m, paints] with these levels of parts, in lowest terms and of easy size."""
    parts = torch.cartesian_prod(*[torch.tensor(levels)] * paints).reshape(-1, paints)
    return parts[(parts.sum(1) <= EASY_PARTS) & (_divisor(parts) == 1)].double()


def _divisor(parts: Tensor) -> Tensor:
    """Returns the greatest common divisor [m] of parts [m, n], 0 for nothing."""
    return functools.reduce(torch.gcd, parts.long().unbind(1))


def _to_oklab(color: Tensor) -> Tensor:
    """Converts sRGB [..., 3] to OKLab [..., 3], L in [0, 1] (B. Ottosson, 2020)."""
    return (to_linear(color) @ color.new_tensor(_CONES).T).clamp(min=0) ** (1 / 3) @ color.new_tensor(_OKLAB).T


def _is_lively(aim: Tensor) -> bool:
    """Returns True if a Lab colour [3] is neither dark nor grey; black would dull it."""
    return bool(aim[0] > _DARK and aim[1:].norm() > _GREY)


def _apart(mixed: Tensor, target: Tensor, weights: tuple[float, float, float]) -> Tensor:
    """Returns distances [m] in OKLab from mixtures [m, 4] to a colour [3], weighted by lightness, chroma and hue."""
    (light, a, b, chroma), (its_light, its_a, its_b) = mixed.unbind(1), target
    more = chroma - torch.hypot(its_a, its_b)
    hue = ((a - its_a) ** 2 + (b - its_b) ** 2 - more**2).clamp(min=0)  # squared
    return ((weights[0] * (light - its_light)) ** 2 + (weights[1] * more) ** 2 + weights[2] ** 2 * hue).sqrt()
