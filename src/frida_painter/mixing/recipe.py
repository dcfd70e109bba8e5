"""Recipes: small whole parts of a few paints whose mixture comes nearest to a colour."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import torch
from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.errors import ConfigError
from frida_painter.mixing.finish import Finish
from frida_painter.mixing.kubelka_munk import mixed
from frida_painter.mixing.paint import Paint, color_of
from frida_painter.palette import ciede2000, to_lab
from frida_painter.plan import Plan

GOOD, REACHED = 2.0, 5.0
"""CIEDE2000 up to which a mixture is hardly told from its colour, and from which the colour is out of reach."""
EASY_PARTS, MOST_PARTS, PARTS_WITH_TRACES = 40, 120, 600
"""Of all paints together: drops of half a teaspoon; of a whole one where half a teaspoon will not do; and with
traces of strong paints, as whites have that are nearly white, where nothing else is within reach."""
_LEVELS = (1, 3, 9, 27, 81)  # parts that are tried first
# What a fourth paint is tried with: how many times the other three, and its parts.
_LITTLE, _MUCH = ((27, 1), (9, 1), (3, 1)), tuple((1, level) for level in _LEVELS)
_SEEDS = 16  # mixtures from which the nearest is sought
# What a simpler recipe may cost in CIEDE2000: for each paint less, and for half as many parts.
_PER_PAINT, _PER_DOUBLING = 0.6, 0.25
# CIEDE2000 that more than `EASY_PARTS` must bring, and below which nobody sees what they bring.
_WORTH_COUNTING, _UNSEEN = 0.5, 1.0


@dataclass(frozen=True)
class Recipe:
    """How to mix one colour.

    target [3] sRGB; parts: the paints and how many parts of each, most first; color [3] sRGB: what it
    is predicted to look like when it is dry; difference: CIEDE2000 between the two.
    """

    target: Tensor
    parts: tuple[tuple[Paint, int], ...]
    color: Tensor
    difference: float

    @property
    def within_reach(self) -> bool:
        """Whether these paints can give about that colour."""
        return self.difference <= REACHED

    @property
    def whole(self) -> int:
        """How many parts it has in all."""
        return sum(count for _, count in self.parts)

    @property
    def words(self) -> str:
        """ "6 titanium white + 1 phthalo blue"."""
        return " + ".join(f"{count} {paint.name}" for paint, count in self.parts)

    def volumes(self, total: float) -> list[float]:
        """How much of each paint makes `total` of the mixture, in its unit."""
        return [total * count / self.whole for _, count in self.parts]


def recipes(colors: Tensor, paints: Sequence[Paint], most: int = 4, finish: Finish = Finish.matte) -> list[Recipe]:
    """A recipe for each colour sRGB [k, 3] of at most `most` of the paints, dry in that finish. Raises ConfigError.

    All mixtures of three paints in rough parts are looked at, the best are extended by a fourth, and
    from the best of those whole parts are moved up and down as long as that brings the mixture nearer
    or makes it simpler by what it is worth. More than `EASY_PARTS` are counted only where that can be seen.
    """
    if not paints or not 1 <= most <= 4:
        raise ConfigError(
            f"{len(paints)} paints and at most {most} of them were given; mixing takes 1 or more, and at most 1 to 4."
        )
    mixer = _Mixer(paints, min(most, len(paints)), finish)
    return [_recipe(color.double(), mixer) for color in colors]


def _recipe(color: Tensor, mixer: "_Mixer") -> Recipe:
    """The best in many parts, or the best in few where hardly anybody would see the difference."""
    best = _Search(color, mixer, MOST_PARTS).best()
    if not best.within_reach:
        traces = _Search(color, mixer, PARTS_WITH_TRACES).best()
        return traces if traces.within_reach else best
    if best.whole <= EASY_PARTS:
        return best
    easy = _Search(color, mixer, EASY_PARTS).best()
    return easy if easy.difference <= max(best.difference + _WORTH_COUNTING, _UNSEEN) else best


class _Mixer:
    """Paints, of which at most `most` go into one mixture; rough: mixtures to begin with, and rough_lab their Lab."""

    def __init__(self, paints: Sequence[Paint], most: int, finish: Finish) -> None:
        self.paints, self.most, self._finish = paints, most, finish
        self._absorption = torch.stack([paint.absorption for paint in paints])
        self._scattering = torch.stack([paint.scattering for paint in paints])
        self.rough = _rough(len(paints), min(most, 3))
        self.rough_lab = to_lab(self.colors(self.rough))

    def colors(self, parts: Tensor) -> Tensor:
        """sRGB of mixtures [m, n], [m, 3]."""
        return color_of(mixed(parts, self._absorption, self._scattering, self._finish))


class _Search:
    """The search for one colour, in at most so many parts."""

    def __init__(self, target: Tensor, mixer: _Mixer, parts: int) -> None:
        self._target, self._mixer, self._parts = target, mixer, parts
        self._lab = to_lab(target)

    def best(self) -> Recipe:
        mixer = self._mixer
        seeds = self._nearest(mixer.rough, mixer.rough_lab)
        if mixer.most == 4:
            extended = torch.cat([seeds, *(self._with_another(seed) for seed in seeds)])
            seeds = torch.cat((seeds[: _SEEDS // 2], self._nearest(extended)[: _SEEDS // 2]))
        found = self._refined([tuple(map(int, seed)) for seed in seeds.tolist()])
        color = mixer.colors(torch.tensor([found], dtype=torch.float64))[0]
        used = sorted(
            ((paint, count) for paint, count in zip(mixer.paints, found, strict=True) if count), key=_most_first
        )
        return Recipe(self._target, tuple(used), color, float(ciede2000(to_lab(color), self._lab)))

    def _cost(self, parts: Tensor, lab: Tensor | None = None) -> Tensor:
        """The difference of mixtures, and what a recipe's length and size count against it, [m]; lab: theirs [m, 3]."""
        used, total = (parts > 0).sum(1), parts.sum(1)
        lab = to_lab(self._mixer.colors(parts)) if lab is None else lab
        cost = ciede2000(lab, self._lab) + _PER_PAINT * used + _PER_DOUBLING * total.log2()
        return torch.where((used <= self._mixer.most) & (total <= self._parts), cost, torch.inf)

    def _nearest(self, parts: Tensor, lab: Tensor | None = None) -> Tensor:
        return parts[self._cost(parts, lab).argsort()[:_SEEDS]]

    def _with_another(self, seed: Tensor) -> Tensor:
        """The mixture with very little to much of each paint that it has none of."""
        unused = (seed == 0).nonzero()[:, 0].tolist()
        added = [scale * seed + _only(index, level, seed) for index in unused for scale, level in (*_LITTLE, *_MUCH)]
        return torch.stack(added or [seed])

    def _refined(self, starts: list[tuple[int, ...]]) -> tuple[int, ...]:
        """Whole parts near one of `starts` that cost least.

        From each of them, the cheapest neighbour is gone to as long as that costs less: step by step for all of
        them together. A way that comes to where another has been would go on as that one did, and ends there.
        """
        costs = self._cost(torch.tensor(starts, dtype=torch.float64)).tolist()
        ways = dict(zip(starts, costs, strict=True))
        been, ends = set(ways), dict[tuple[int, ...], float]()
        while ways:
            around = [_neighbours(here) for here in ways]
            every = self._cost(torch.tensor(list(itertools.chain(*around)), dtype=torch.float64))
            onwards = {}
            for (here, cost), there, theirs in zip(
                ways.items(), around, torch.split(every, [len(some) for some in around]), strict=True
            ):
                best = int(theirs.argmin())
                if not float(theirs[best]) < cost - 1e-9:
                    ends[here] = cost
                elif there[best] not in been:
                    onwards[there[best]] = float(theirs[best])
                    been.add(there[best])
            ways = onwards
        return min(ends, key=ends.__getitem__)


def _rough(count: int, most: int) -> Tensor:
    """Mixtures of up to `most` of `count` paints in rough parts, [m, count]."""
    found = []
    for used in range(1, most + 1):
        levels = torch.tensor(list(itertools.product(_LEVELS, repeat=used)), dtype=torch.float64)
        levels = levels[(levels.amin(1) == 1)]  # the others are these in larger amounts
        for chosen in itertools.combinations(range(count), used):
            parts = torch.zeros(len(levels), count, dtype=torch.float64)
            parts[:, list(chosen)] = levels
            found.append(parts)
    return torch.cat(found)


def _neighbours(parts: tuple[int, ...]) -> list[tuple[int, ...]]:
    """The same mixture with one or two of its parts changed, in lowest terms."""
    used = [index for index, count in enumerate(parts) if count]
    changes: list[dict[int, int]] = [{index: count} for index in used for count in _near(parts[index])]
    changes += [
        {one: first, other: second}
        for one, other in itertools.combinations(used, 2)
        for first, second in itertools.product(_near(parts[one])[:2], _near(parts[other])[:2])
    ]
    scaled = [tuple(factor * count for count in parts) for factor in (2, 3)]
    changed = [tuple(change.get(index, count) for index, count in enumerate(parts)) for change in changes]
    return [_lowest(one) for one in changed if sum(one)] + [
        tuple(count + (index == more) * sign for index, count in enumerate(one))
        for one in scaled
        for more in used
        for sign in (-1, 1)
    ]


def _near(count: int) -> list[int]:
    """Parts that may take the place of `count`, the nearest first."""
    return [count + 1, count - 1, *(other for other in (2 * count, count // 2, count + 3, count - 3) if other >= 0)]


def _lowest(parts: tuple[int, ...]) -> tuple[int, ...]:
    divisor = reduce(math.gcd, parts) or 1
    return tuple(count // divisor for count in parts)


def _only(index: int, parts: int, like: Tensor) -> Tensor:
    only = torch.zeros_like(like)
    only[index] = parts
    return only


def _most_first(used: tuple[Paint, int]) -> tuple[int, str]:
    return -used[1], used[0].name


# How much of each paint a plan takes, so that nobody runs out half-way.

_FILM = 0.15e-3  # metres of wet paint under a brush
_KEPT_BACK = 2.0  # as much again stays in the brush, the water and the wells
_LEAST = 3.0  # millilitres in which a brush can be dipped at all
_ML = 1e6  # in a cubic metre


def volumes(plan: Plan) -> Tensor:
    """Millilitres to mix of each paint of the plan's palette, [k], by the area that its strokes paint.

    Raises ConfigError where a brush of the plan is not known.
    """
    areas = [brush_kind(part.layers[0].brush).area(part.strokes).double() for part in plan.filled_layers()]
    area = torch.cat(areas) if areas else torch.zeros(0).double()  # [n] m2
    painted = plan.paint.bincount(area, minlength=len(plan.palette))  # [k] m2
    return (painted * _FILM * _KEPT_BACK * _ML).clamp(min=_LEAST)
