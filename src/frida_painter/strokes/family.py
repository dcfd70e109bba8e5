"""Stroke families: trajectories that a person taught, and the few parameters by which a planner may change them.

A family is a mean trajectory and a few modes of its shape. A trajectory is a uniform cubic B-spline of (x, y,
pressure): x and y in units of the stroke's size, from its start; the pressure as a share of the stroke's thickness.
A stroke of a family has a place, an angle, a size (its `length`), a thickness and a code. The code tells how far
its shape is from the mean along each mode, in standard deviations of the taught marks.
"""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import torch
from torch import Tensor

from frida_painter.errors import FamilyError

MAX_CODES = 2
"""Largest number of modes of a family."""
CODE_REACH = 2.0
"""Largest code, in standard deviations."""
MIN_CONTROLS, MAX_CONTROLS = 4, 128
MIN_SIZE, MAX_SIZE = 0.003, 0.5
"""Smallest and largest size of a family's strokes in metres."""
_SAMPLES = 97


def spline_matrix(fraction: Tensor, controls: int) -> Tensor:
    """Returns the weights of a uniform cubic B-spline's control points at curve parameters in [0, 1].

    fraction [..., t]: parameters
    Returns [..., t, controls].
    """
    at = fraction.detach() * (controls - 3)
    first = at.floor().clamp(0, controls - 4)
    t = at - first
    s = 1 - t
    weight = torch.stack((s**3, 4 - 6 * t**2 + 3 * t**3, 4 - 6 * s**2 + 3 * s**3, t**3), -1) / 6
    index = first.long()[..., None] + torch.arange(4, device=at.device)
    return at.new_zeros(*at.shape, controls).scatter(-1, index, weight)


@dataclass(frozen=True, eq=False)
class StrokeFamily:
    """Strokes that a person taught.

    name: a word of letters, digits, "-" and "_"
    mean [controls, 3]: control points of the mean trajectory
    modes [codes, controls, 3]: change of the control points for a code of 1
    size: least and greatest size of a stroke in metres, from its one end to the farthest place

    Raises FamilyError if a part is invalid.
    """

    name: str
    mean: Tensor
    modes: Tensor
    size: tuple[float, float]

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z][\w-]{0,31}", self.name):
            raise FamilyError(
                f"A stroke family was named {self.name[:40]!r}; it is a letter and up to 31 letters, digits, - or _."
            )
        controls = self.mean.shape[0] if self.mean.dim() == 2 else 0
        codes = self.modes.shape[0] if self.modes.dim() == 3 else 0
        if not (
            MIN_CONTROLS <= controls <= MAX_CONTROLS
            and 1 <= codes <= MAX_CODES
            and tuple(self.mean.shape) == (controls, 3)
            and tuple(self.modes.shape) == (codes, controls, 3)
            and bool(torch.cat([self.mean[None], self.modes]).abs().amax() <= 10)  # also False for NaN
        ):
            raise FamilyError(
                f"The stroke family {self.name!r} has a trajectory of shape {tuple(self.mean.shape)} and modes of "
                f"shape {tuple(self.modes.shape)}; give a file that `frida-painter teach` wrote."
            )
        if not MIN_SIZE <= self.size[0] < self.size[1] <= MAX_SIZE:
            raise FamilyError(
                f"The strokes of family {self.name!r} are {1000 * self.size[0]:g} to {1000 * self.size[1]:g} mm large; "
                f"give a range within {1000 * MIN_SIZE:g} to {1000 * MAX_SIZE:g} mm."
            )

    @property
    def codes(self) -> int:
        """Number of modes."""
        return len(self.modes)

    @cached_property
    def digest(self) -> str:
        """sha256 of all parts."""
        content = hashlib.sha256(repr((self.name, self.size)).encode())
        for tensor in (self.mean, self.modes):
            content.update(tensor.detach().float().cpu().contiguous().numpy().tobytes())
        return content.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, StrokeFamily) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __deepcopy__(self, memo: object) -> Self:
        return self

    def trace(self, fraction: Tensor, length: Tensor, code: Tensor) -> tuple[Tensor, Tensor]:
        """Returns points of strokes in their own frames, and the share of the thickness there.

        fraction [n, t] or [t]: curve parameters in [0, 1]
        length [n]: sizes in metres
        code [n, codes or more]: further columns do not count
        Returns places [n, t, 2] in metres from the start, and pressures [n, t] in [0, 1]. Differentiable in length
        and code.
        """
        mean, modes = self.mean.to(length), self.modes.to(length)
        controls = mean + torch.einsum("nk,kcd->ncd", code[:, : self.codes].to(length), modes)  # [n, c, 3]
        points = spline_matrix(fraction.to(length), len(mean)) @ controls  # [n, t, 3]
        return points[..., :2] * length[:, None, None], points[..., 2].clamp(0, 1)

    def beziers(self, length: Tensor, code: Tensor) -> Tensor:
        """Returns the paths of `trace` as cubic Bezier curves, [n, curves, 4, 2] in metres from the start.

        length [n]: sizes in metres
        code [n, codes or more]: further columns do not count
        """
        mean, modes = self.mean.to(length), self.modes.to(length)
        controls = mean + torch.einsum("nk,kcd->ncd", code[:, : self.codes].to(length), modes)
        before, start, end, after = (controls[:, k : len(mean) - 3 + k, :2] for k in range(4))
        corners = (
            (before + 4 * start + end) / 6,
            (2 * start + end) / 3,
            (start + 2 * end) / 3,
            (start + 4 * end + after) / 6,
        )
        return torch.stack(corners, 2) * length[:, None, None, None]

    @cached_property
    def middle(self) -> tuple[float, float]:
        """Centre of the mean trajectory, in units of the size."""
        points = self._mean_points.mean(0)
        return float(points[0]), float(points[1])

    @cached_property
    def way(self) -> float:
        """Length of the mean trajectory, in units of the size."""
        return float(self._mean_points.diff(dim=0).norm(dim=1).sum())

    @cached_property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of all shapes of the family, in units of the size, from the start."""
        steps = torch.linspace(-CODE_REACH, CODE_REACH, 9)
        code = torch.cartesian_prod(*[steps] * self.codes).view(-1, self.codes)
        points = self.trace(torch.linspace(0, 1, _SAMPLES), torch.ones(len(code)), code)[0].flatten(0, 1)
        least, most = points.amin(0).tolist(), points.amax(0).tolist()
        return least[0], most[0], least[1], most[1]

    @property
    def _mean_points(self) -> Tensor:
        fraction = torch.linspace(0, 1, 4 * _SAMPLES)
        return self.trace(fraction, torch.ones(1), torch.zeros(1, self.codes))[0][0]


@dataclass(frozen=True)
class Taught:
    """The part of n strokes that tells which of them belong to families.

    families: families of the strokes, each once, in the order of their first strokes
    number [n]: number of each stroke's family, -1 for a brush's own stroke
    code [n, k]: shape codes; k is the most of any family, and other strokes have zeros
    Raises FamilyError if the parts do not fit together.
    """

    families: tuple[StrokeFamily, ...]
    number: Tensor
    code: Tensor

    def __post_init__(self) -> None:
        k = max((family.codes for family in self.families), default=0)
        if self.number.dtype != torch.int64 or tuple(self.code.shape) != (len(self.number), k):
            raise FamilyError(
                f"Strokes of {len(self.families)} families have codes of shape {tuple(self.code.shape)} for "
                f"{len(self.number)} strokes; each has {k} numbers."
            )

    @classmethod
    def of(cls, family: StrokeFamily, code: Tensor) -> Self:
        """Returns the part for strokes of one family with these codes [n, codes]."""
        return cls((family,), torch.zeros(len(code), dtype=torch.int64, device=code.device), code)

    def __getitem__(self, index: Tensor | slice | list[int]) -> "Taught | None":
        """Returns the part of some strokes; None if none of them belongs to a family."""
        number, code = self.number[index], self.code[index]
        if len(self.families) == 1:
            return Taught(self.families, number, code) if bool((number >= 0).any()) else None
        used = list(dict.fromkeys(one for one in number.tolist() if one >= 0))
        if not used:
            return None
        rename = torch.full((len(self.families) + 1,), -1, dtype=torch.int64, device=number.device)
        rename[used] = torch.arange(len(used), device=number.device)  # the last entry stays -1, also for number -1
        families = tuple(self.families[one] for one in used)
        return Taught(families, rename[number], code[:, : max(family.codes for family in families)])

    @classmethod
    def join(cls, parts: "list[tuple[int, Taught | None]]", like: Tensor) -> "Taught | None":
        """Returns the part of joined strokes; None if none of them belongs to a family.

        parts: number of strokes and the part of each
        like: a tensor with precision and device of the strokes
        """
        families = list(dict.fromkeys(family for _, part in parts if part is not None for family in part.families))
        if not families:
            return None
        k = max(family.codes for family in families)
        numbers, codes = [], []
        for count, part in parts:
            if part is None:
                numbers.append(torch.full((count,), -1, dtype=torch.int64, device=like.device))
                codes.append(like.new_zeros(count, k))
                continue
            rename = [families.index(family) for family in part.families]
            names = torch.tensor([*rename, -1], dtype=torch.int64, device=part.number.device)
            numbers.append(names[part.number])
            codes.append(torch.nn.functional.pad(part.code, (0, k - part.code.shape[1])))
        return cls(tuple(families), torch.cat(numbers), torch.cat(codes))

    def to(self, target: torch.dtype | torch.device | str) -> "Taught":
        """Returns the part in another precision or on another device."""
        number = self.number if isinstance(target, torch.dtype) else self.number.to(target)
        return Taught(self.families, number, self.code.to(target))

    def detach(self) -> "Taught":
        """Returns the part without its autograd graph."""
        return Taught(self.families, self.number, self.code.detach())

    def groups(self) -> list[tuple[StrokeFamily, Tensor]]:
        """Returns each family with the indices of its strokes."""
        return [(family, (self.number == one).nonzero()[:, 0]) for one, family in enumerate(self.families)]


def describe_families(families: Sequence[StrokeFamily] | None) -> str:
    """Returns the families in words."""
    if not families:
        return "no family"
    names = ", ".join(f"{family.name} ({family.digest[:6]})" for family in families)
    return f"the {'family' if len(families) == 1 else 'families'} {names}"


def describe_kind(brush: str, family: StrokeFamily | None) -> str:
    """Returns the name of a kind of stroke: a brush, or a brush with a family, as in "fine+comma"."""
    return brush if family is None else f"{brush}+{family.name}"
