"""A goal in one line, for notebooks and scripts: pictures by their files or as tensors, and words."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

from torch import Tensor

from frida_painter import images
from frida_painter.errors import ConfigError
from frida_painter.goal import Goal, ImageTerm, SemanticTerm, SketchTerm, StyleTerm, Term, TextTerm

Picture = str | Path | Tensor
"""A picture file, or sRGB [3, H, W] in [0, 1]."""
_KINDS = ("image", "semantic", "sketch", "text", "style")


def make_goal(
    image: Picture | Sequence[Picture] = (),
    *,
    semantic: Picture | Sequence[Picture] = (),
    sketch: Picture | Sequence[Picture] = (),
    text: str | Sequence[str] = (),
    style: Picture | Sequence[Picture] = (),
    weights: Mapping[str, float] | None = None,
) -> Goal:
    """What shall be painted: one or more of these, each a single one or a sequence; `make_goal("photo.jpg")`.

    image: to come near to, pixel by pixel; semantic: to paint by what it shows; sketch: a drawing to follow;
    text: words; style: a picture whose colours and marks the painting shall have. weights: how much a kind
    matters, by its name, above 0; 1 where it is not named. Everything but images is seen through networks that
    `frida-painter models fetch` gets. Raises ConfigError where there is nothing to paint or a kind is not
    known, and ImageError where a picture cannot be read.
    """
    given = dict(zip(_KINDS, (image, semantic, sketch, text, style), strict=True))
    weights = weights or {}
    if unknown := sorted(set(weights) - set(_KINDS)):
        raise ConfigError(f"A weight was given to {unknown[0][:40]!r}; weights are given to {', '.join(_KINDS)}.")
    return Goal(
        tuple(_term(kind, one, float(weights.get(kind, 1.0))) for kind, some in given.items() for one in _each(some))
    )


def _each(some: Picture | Sequence[Picture]) -> Sequence[Picture]:
    return [some] if isinstance(some, str | Path | Tensor) else some


def _term(kind: str, one: Picture, weight: float) -> Term:
    if kind == "text":
        return TextTerm(cast(str, one), weight)
    kinds = {"image": ImageTerm, "semantic": SemanticTerm, "sketch": SketchTerm, "style": StyleTerm}
    picture = one if isinstance(one, Tensor) else images.load(one)
    if picture.dim() != 3 or picture.shape[0] != 3:
        raise ConfigError(f"A picture of shape {tuple(picture.shape)} was given to {kind}; it is [3, height, width].")
    return cast(Term, kinds[kind](picture, weight))
