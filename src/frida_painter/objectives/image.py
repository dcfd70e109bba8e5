"""Goal "image": a picture to reproduce pixel by pixel, sharpened before planning."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Self

import torch
from torch import Tensor
from torch.nn.functional import mse_loss

from frida_painter.frames import PixelGrid, Rows
from frida_painter.objectives.objective import Goal, ObjectiveContext, ObjectiveTerm, Term, require_weight
from frida_painter.system import images


@dataclass(frozen=True)
class PictureTerm(Term):
    """Base class of terms with a picture.

    image [3, H, W]: sRGB in [0, 1]
    called: name in messages
    longest: longer side in pixels to which a file is shrunk; None to keep its size
    Raises ConfigError if the weight is invalid.
    """

    image: Tensor
    weight: float = 1.0
    called: ClassVar[str] = "a picture"
    longest: ClassVar[int | None] = None

    def __post_init__(self) -> None:
        require_weight(self.weight, self.called)

    def as_start(self, goal: Goal) -> ImageTerm:
        """Returns an ImageTerm with the same picture, weight and importance."""
        return ImageTerm(self.image, self.weight, self.importance)

    def fit_to(self, rows: int, columns: int, *, pad: bool = False) -> Self:
        """Returns the term with its picture fitted to `rows` x `columns`."""
        return replace(self, image=(images.pad if pad else images.fit)(self.image, rows, columns))

    def crop(self, box: tuple[float, float, float, float]) -> Self:
        """Returns the term with a part of its picture. Raises ConfigError if that part is no goal of this kind."""
        return replace(self, image=images.crop(self.image, box))

    @classmethod
    def open(cls, path: Path, weight: float = 1.0) -> Self:
        """Returns the term of a picture file. Raises ConfigError and ImageError."""
        return cls(images.load(path) if cls.longest is None else images.load(path, longest=cls.longest), weight)


@dataclass(frozen=True)
class PaintedTerm(PictureTerm):
    """Base class of terms whose picture is painted: it sets composition and colours.

    importance [h, w]: importance of each place, with mean 1; None if uniform
    """

    importance: Tensor | None = None
    is_tried = False
    can_be_weighed = True

    @property
    def picture(self) -> Tensor:
        """Picture to paint."""
        return self.image

    def with_picture(self, picture: Tensor) -> Self:
        """Returns the term with another picture and the same importance."""
        return replace(self, image=picture)

    def weigh(self, importance: Tensor) -> Self:
        """Returns the term with this importance of each place."""
        return replace(self, importance=importance)


@dataclass(frozen=True)
class ImageTerm(PaintedTerm):
    """Term of a goal: reproduce a picture pixel by pixel.

    wanted [3, h, w]: picture that the planner compares with, so that the painting looks like `image`; None for
    `image`, which is sharpened if the goal has no other terms
    """

    wanted: Tensor | None = None
    initial_order = 0
    interpretation_order = 5
    is_pixelwise = True

    def as_start(self, goal: Goal) -> ImageTerm:
        """Returns the term itself, with its importance."""
        return self

    @property
    def guide(self) -> Tensor:
        """Picture that the planner compares with."""
        return self.image if self.wanted is None else self.wanted

    def fit_to(self, rows: int, columns: int, *, pad: bool = False) -> Self:
        """Returns the term with its picture fitted to `rows` x `columns`; a smaller picture keeps its pixels.

        It is shrunk again later to the planning image, so it is not softened here.
        """
        if pad:
            return super().fit_to(rows, columns, pad=True)
        scale = min(1.0, self.image.shape[1] / rows, self.image.shape[2] / columns)
        fewer = max(1, round(scale * rows)), max(1, round(scale * columns))
        return replace(self, image=images.resize_by_area(self.image, *fewer))

    def with_picture(self, picture: Tensor) -> Self:
        """Returns the term with another picture and the same importance."""
        return replace(self, image=picture, wanted=None)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the mean squared difference to `guide`."""
        return _term_of(Replication.of(self.guide, context.grid, self.importance))

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Sharpens photographs to compensate for the blur of painting, if the goal has no other terms.

        Beside other terms, photographs stay unchanged, because the other terms set the edges.
        """
        photographs = [term for term in goal.terms if isinstance(term, cls)]
        if len(photographs) < len(goal.terms):
            return goal
        sharp = (fit_and_sharpen(one.image, context.grid) if one.wanted is None else one.wanted for one in photographs)
        return replace(goal, terms=tuple(map(lambda one, wanted: replace(one, wanted=wanted), photographs, sharp)))


@dataclass(frozen=True)
class Replication:
    """Mean squared difference to `target` [3, H, W]: l_print of the paper (Eq. "l2").

    matters [H, W]: weight of each pixel, mean 1; None if uniform
    """

    target: Tensor
    matters: Tensor | None = None

    @classmethod
    def of(cls, image: Tensor, grid: PixelGrid, importance: Tensor | None = None) -> Self:
        """Returns the objective for a picture [3, h, w] with this importance [h, w], fitted to the grid."""
        matters = None if importance is None else spread(importance, grid.rows, grid.columns)
        return cls(images.fit(image, grid.rows, grid.columns), matters)

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns the distance of a picture [3, H, W] to the target."""
        if self.matters is None:
            return mse_loss(picture, self.target.to(picture))
        root, rooted = self._rooted
        return mse_loss(root.to(picture) * picture, rooted.to(picture))

    @cached_property
    def _rooted(self) -> tuple[Tensor, Tensor]:
        assert self.matters is not None
        root = self.matters.sqrt()
        return root, root * self.target

    def of_variance(self, variance: Tensor) -> Tensor:
        """Returns the mean increase by pixel variance [H, W]: E[(C - T)^2] = (M - T)^2 + Var C."""
        return variance.mean() if self.matters is None else (self.matters.to(variance) * variance).mean()

    def on_rows(self, rows: Rows) -> Self:
        """Returns the objective for pictures with these rows only."""
        return type(self)(rows.of(self.target), None if self.matters is None else rows.of(self.matters))


def _term_of(judge: Replication) -> ObjectiveTerm:
    return ObjectiveTerm(judge, of_variance=judge.of_variance, on_rows=lambda rows: _term_of(judge.on_rows(rows)))


def spread(importance: Tensor, rows: int, columns: int) -> Tensor:
    """Returns importance [h, w] fitted to `rows` x `columns`, mean 1."""
    most = importance.amax()
    fitted = images.fit((importance / most)[None], rows, columns)[0] * most
    return fitted / fitted.mean()


def rise(importance: Tensor, times: float) -> Tensor:
    """Returns by how much places [h, w] matter more than the least: 0 for the least, 1 from `times` the least on."""
    return ((importance / importance.amin() - 1) / (times - 1)).clamp(0, 1)


# Painting softens a picture: marks have soft edges and land beside their intended place, and the planner averages
# colours if it is uncertain. So photographs are sharpened first by unsharp masking, as printers do.
#
# In a picture that is dark as a whole, eyes see small differences from dark surroundings. There the contrast that is
# planned rises as that of Weber does, difference over surroundings, so that strokes go there and are not averaged away.
_SPREAD = 0.0037  # standard deviation of the blur, in metres on the canvas
_SHARPNESS = 0.3  # increase of each pixel's difference from its surroundings
_NIGHT, _DAY = 0.22, 0.35  # median sRGB of a picture that is wholly dark, and from which it is not dark
_IN_THE_DARK = 0.9  # further increase in black surroundings of the night
_DARK = 0.35  # sRGB of surroundings from which there is none
_SURROUNDINGS = 0.006  # standard deviation of the blur that finds surroundings, in metres


def fit_and_sharpen(picture: Tensor, grid: PixelGrid) -> Tensor:
    """Returns a picture [3, h, w], fitted to the grid [3, H, W] and sharpened for planning, more in the dark of night.

    Pictures whose median is 0.35 or more in sRGB are sharpened everywhere alike.
    """
    fitted, sharpness = images.fit(picture, grid.rows, grid.columns), torch.tensor(_SHARPNESS)
    light = fitted.mean(0, keepdim=True)
    if (night := ((_DAY - light.median()) / (_DAY - _NIGHT)).clamp(max=1)) > 0:
        around = images.gaussian_blur(light, _SURROUNDINGS / grid.pitch[1])
        sharpness = _SHARPNESS + _IN_THE_DARK * night * (1 - around / _DARK).clamp(min=0)
    return (fitted + sharpness * (fitted - images.gaussian_blur(fitted, _SPREAD / grid.pitch[1]))).clamp(0, 1)
