"""Recipes: small integer parts of a few paints whose mixture is nearest to a colour."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import torch
from torch import Tensor

from frida_painter import registry
from frida_painter.brush.kinds import brush_kind
from frida_painter.errors import ConfigError, PluginError
from frida_painter.mixing import Finish
from frida_painter.mixing.paint import Paint, color_of, mix_reflectance, read_paints, usual_paints
from frida_painter.strokes.palette import ciede2000, to_lab
from frida_painter.strokes.plan import Plan

GOOD, REACHED = 2.0, 5.0
"""Limits of CIEDE2000: the difference is hardly visible up to GOOD; the colour is out of reach above REACHED."""
EASY_PARTS, MAX_PARTS, PARTS_WITH_TRACES = 40, 120, 600
"""Largest number of parts of all paints together.

EASY_PARTS: drops of half a teaspoon
MAX_PARTS: drops of a teaspoon, if half a teaspoon is not enough
PARTS_WITH_TRACES: with traces of strong paints, if nothing else is within reach, as in whites that are nearly white
"""
_LEVELS = (1, 3, 9, 27, 81)  # parts that are tested first
# Tests of a fourth paint: factor of the other three, and its parts.
_LITTLE, _MUCH = ((27, 1), (9, 1), (3, 1)), tuple((1, level) for level in _LEVELS)
_SEEDS = 16  # number of mixtures at which the search starts
# CIEDE2000 that a simpler recipe may cost: for each paint less, and for half as many parts.
_PER_PAINT, _PER_DOUBLING = 0.6, 0.25
# CIEDE2000 that more than `EASY_PARTS` must gain, and below which the gain is invisible.
_WORTH_COUNTING, _UNSEEN = 0.5, 1.0
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

        All mixtures of three paints in rough parts are tested. The best ones are extended by a fourth paint. From
        the best results, integer parts are changed step by step while this reduces difference plus complexity. More
        than `EASY_PARTS` are used only if the gain is visible.
        Raises ConfigError if there are no paints, or `most` is not from 1 to 4.
        """
        if not self.paints or not 1 <= most <= 4:
            raise ConfigError(
                f"{len(self.paints)} paints and at most {most} of them were given; mixing takes 1 or more, and at most "
                "1 to 4."
            )
        mixer, found = _Mixer(self, min(most, len(self.paints))), []
        for color in colors.double():
            best = _Search(color, mixer, MAX_PARTS).best()
            if not best.within_reach:
                traces = _Search(color, mixer, PARTS_WITH_TRACES).best()
                best = traces if traces.within_reach else best
            elif best.whole > EASY_PARTS:
                easy = _Search(color, mixer, EASY_PARTS).best()
                best = easy if easy.difference <= max(best.difference + _WORTH_COUNTING, _UNSEEN) else best
            found.append(best)
        return found


class _Mixer:
    """Paints with precomputed mixtures.

    most: largest number of paints in a mixture
    rough: start mixtures; rough_lab: their Lab colours
    """

    def __init__(self, owned: PaintSet, most: int) -> None:
        self.paints, self.most, self._finish = owned.paints, most, owned.finish
        self._kind = registry.load_part(registry.MIXERS, owned.mixer, MixerKind, "mixer")
        self._absorption = torch.stack([paint.absorption for paint in owned.paints])
        self._scattering = torch.stack([paint.scattering for paint in owned.paints])
        self.rough = _rough(len(owned.paints), min(most, 3))
        self.rough_lab = to_lab(self.colors(self.rough))
        greyness = self.rough_lab[:, 1:].norm(dim=1)
        lightness = self.rough_lab[greyness <= max(_GREY, float(greyness.min())), 0]
        black, white = float(lightness.min()), float(lightness.max())
        self._ends = black if black <= _BLACK_PAINT else 0.0, white if white >= _WHITE_PAINT else 100.0
        darkest = None if owned.darkest is None else float(to_lab(torch.tensor([owned.darkest]))[0, 0])
        self._darkest = None if darkest is None else darkest - _SAME_LIGHTNESS

    def within_lightness(self, lab: Tensor) -> Tensor:
        """Returns the Lab colour [3] with its lightness in the range of mixed greys.

        An end of the range counts only if the paints have a black or a white. The colour stays as it is if it is
        darker than the darkest paint, or if no darkest paint was given.
        """
        if self._darkest is None or not self._darkest <= float(lab[0]):
            return lab
        return torch.cat((lab[:1].clamp(*self._ends), lab[1:]))

    def colors(self, parts: Tensor) -> Tensor:
        """Returns sRGB [m, 3] of mixtures [m, n]."""
        reflected = self._kind.mix(parts, self._absorption, self._scattering, self._finish)
        if tuple(reflected.shape) != (len(parts), self._absorption.shape[1]) or not bool(
            ((reflected >= 0) & (reflected <= 1)).all()
        ):
            raise PluginError(
                f"The mixer {self._kind.name!r} gave reflectances of shape {tuple(reflected.shape)} or outside [0, 1] "
                f"for {len(parts)} mixtures in {self._absorption.shape[1]} bands; mend it."
            )
        return color_of(reflected)


class _Search:
    """Search for one colour with a limit of parts."""

    def __init__(self, target: Tensor, mixer: _Mixer, parts: int) -> None:
        self._target, self._mixer, self._parts = target, mixer, parts
        self._lab = mixer.within_lightness(to_lab(target))

    def best(self) -> Recipe:
        mixer = self._mixer
        seeds = self._nearest(mixer.rough, mixer.rough_lab)
        if mixer.most == 4:
            extended = torch.cat([seeds, *(self._with_another(seed) for seed in seeds)])
            seeds = torch.cat((seeds[: _SEEDS // 2], self._nearest(extended)[: _SEEDS // 2]))
        found = self._refine([tuple(map(int, seed)) for seed in seeds.tolist()])
        color = mixer.colors(torch.tensor([found], dtype=torch.float64))[0]
        used = [(paint, count) for paint, count in zip(mixer.paints, found, strict=True) if count]
        used.sort(key=lambda part: (-part[1], part[0].name))
        lab = to_lab(color)
        off, missed = (float(ciede2000(lab, wanted)) for wanted in (to_lab(self._target), self._lab))
        return Recipe(self._target, tuple(used), color, off, missed)

    def _cost(self, parts: Tensor, lab: Tensor | None = None) -> Tensor:
        """Returns the cost of mixtures, [m]: difference plus penalties for the numbers of paints and parts.

        lab [m, 3]: their Lab colours, if known
        """
        used, total = (parts > 0).sum(1), parts.sum(1)
        lab = to_lab(self._mixer.colors(parts)) if lab is None else lab
        cost = ciede2000(lab, self._lab) + _PER_PAINT * used + _PER_DOUBLING * total.log2()
        return torch.where((used <= self._mixer.most) & (total <= self._parts), cost, torch.inf)

    def _nearest(self, parts: Tensor, lab: Tensor | None = None) -> Tensor:
        return parts[self._cost(parts, lab).argsort()[:_SEEDS]]

    def _with_another(self, seed: Tensor) -> Tensor:
        """Returns the mixture with very little to much of each unused paint."""
        unused = (seed == 0).nonzero()  # [u, 1]
        if not len(unused):
            return seed[None]
        scales, levels = torch.tensor((*_LITTLE, *_MUCH), dtype=seed.dtype).unbind(1)
        added = (scales[:, None] * seed).repeat(len(unused), 1, 1)  # [u, s, n]
        added[torch.arange(len(unused))[:, None], torch.arange(len(scales)), unused] = levels
        return added.flatten(0, 1)

    def _refine(self, starts: list[tuple[int, ...]]) -> tuple[int, ...]:
        """Returns integer parts near one of `starts` with the lowest cost.

        Each start moves to its cheapest neighbour while that lowers the cost; all starts move together. A path
        that reaches a visited mixture ends, because it would repeat the other path.
        """
        costs = self._cost(torch.tensor(starts, dtype=torch.float64)).tolist()
        ways = dict(zip(starts, costs, strict=True))
        been, ends = set(ways), dict[tuple[int, ...], float]()
        while ways:
            around = [_neighbours(here) for here in ways]
            every = self._cost(torch.tensor(list(itertools.chain(*around)), dtype=torch.float64))
            onwards = {}
            shares = torch.split(every, list(map(len, around)))
            for (here, cost), there, theirs in zip(ways.items(), around, shares, strict=True):
                best = int(theirs.argmin())
                if not float(theirs[best]) < cost - 1e-9:
                    ends[here] = cost
                elif there[best] not in been:
                    onwards[there[best]] = float(theirs[best])
                    been.add(there[best])
            ways = onwards
        return min(ends, key=ends.__getitem__)


def _rough(count: int, most: int) -> Tensor:
    """Returns mixtures of up to `most` of `count` paints in rough parts: [m, count]."""
    found = []
    for used in range(1, most + 1):
        levels = torch.tensor(list(itertools.product(_LEVELS, repeat=used)), dtype=torch.float64)
        levels = levels[(levels.amin(1) == 1)]  # the others are multiples
        for chosen in itertools.combinations(range(count), used):
            parts = torch.zeros(len(levels), count, dtype=torch.float64)
            parts[:, list(chosen)] = levels
            found.append(parts)
    return torch.cat(found)


def _neighbours(parts: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Returns mixtures with one or two parts changed, in lowest terms, and mixtures in finer parts."""
    used = [index for index, count in enumerate(parts) if count]
    changes: list[dict[int, int]] = [{index: count} for index in used for count in _near(parts[index])]
    changes += [
        {one: first, other: second}
        for one, other in itertools.combinations(used, 2)
        for first, second in itertools.product(_near(parts[one])[:2], _near(parts[other])[:2])
    ]
    changed = [tuple(change.get(index, count) for index, count in enumerate(parts)) for change in changes]
    lowest = [tuple(count // math.gcd(*one) for count in one) for one in changed if sum(one)]
    return lowest + [
        tuple(factor * count + (index == more) * sign for index, count in enumerate(parts))
        for factor in (2, 3)
        for more in used
        for sign in (-1, 1)
    ]


def _near(count: int) -> list[int]:
    """Returns parts that may replace `count`, nearest first."""
    return [count + 1, count - 1, *(other for other in (2 * count, count // 2, count + 3, count - 3) if other >= 0)]


# Amount of each paint in a plan, so that paint does not run out

_FILM = 0.15e-3  # thickness of wet paint under a brush in metres
_KEPT_BACK = 2.0  # factor: as much paint again stays in the brush, the water and the wells
_MIN = 3.0  # millilitres, the least in which a brush can be dipped
_ML = 1e6  # millilitres in a cubic metre


def volumes(plan: Plan) -> Tensor:
    """Returns the millilitres to mix of each paint of the plan's palette, [k], from the painted areas.

    Raises ConfigError if a brush of the plan is unknown.
    """
    areas = [brush_kind(part.layers[0].brush).area(part.strokes).double() for part in plan.filled_layers()]
    area = torch.cat(areas) if areas else torch.zeros(0).double()  # [n] m2
    painted = plan.paint.bincount(area, minlength=len(plan.palette))  # [k] m2
    return (painted * _FILM * _KEPT_BACK * _ML).clamp(min=_MIN)
