"""Where a picture says what it shows: with few strokes, those places are worth more of them than others."""

from __future__ import annotations

import operator
from dataclasses import replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.goal import Goal, Term
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.faces import faces, importance_of
from frida_painter.objectives.kinds.image import ImageTerm

if TYPE_CHECKING:
    from frida_painter.objectives.encoders.hed import Hed

FACES, SUBJECT, EVERYWHERE = "faces", "subject", "none"
"""Where a painting of a photograph is most careful."""
_ROWS = 112  # of the picture that is looked at
_AROUND = 9  # pixels of it over which an edge matters
_SIDE = 224  # of the view in which things are seen
_EDGES, _THINGS = 1.0, 0.7  # against what every place matters by itself
_STRONGEST = 6.0  # times the mean that a place may matter


def attended(goal: Goal, encoders: EncoderRegistry) -> Goal:
    """The goal, which begins with a picture that is to be painted by its meaning there where its meaning is.

    A goal that begins with anything else stays as it is. Raises WeightsError where a network is missing.
    """
    begins = goal.initial_terms
    meant = [term.picture for term in goal.terms if term.picture is not None and not term.is_pixelwise]
    if goal.initial or not meant or not any(term.picture is meant[0] for term in begins):
        return goal
    seer, hed = encoders.meaning(), encoders.edges_if_any()
    initial = tuple(
        term if term.picture is None else ImageTerm(term.picture, term.weight, importance(term.picture, seer, hed))
        for term in begins
    )
    return replace(goal, initial=initial)


def focused(goal: Goal, focus: str, encoders: EncoderRegistry) -> Goal:
    """The goal, in whose photographs faces matter more than the rest (FACES), or all that they show (SUBJECT).

    What was found is a remark of the encoders. Raises WeightsError where SUBJECT needs a network that is missing.
    """
    if focus == EVERYWHERE:
        return goal
    terms = [_focused(term, focus, encoders) for term in goal.terms]
    return goal if all(map(operator.is_, terms, goal.terms)) else replace(goal, terms=tuple(terms))


def _focused(term: Term, focus: str, encoders: EncoderRegistry) -> Term:
    if not isinstance(term, ImageTerm) or term.importance is not None:
        return term
    if focus == SUBJECT:
        return replace(term, importance=importance(term.image, encoders.meaning(), encoders.edges_if_any()))
    found = faces(term.image)
    if not found:
        return term
    told = "A face was found in the picture and matters" if len(found) == 1 else f"{len(found)} faces matter"
    encoders.remark(f"{told} more than the rest; --focus {EVERYWHERE} changes that.")
    return replace(term, importance=importance_of(found, *_looked_at(term.image)))


def _looked_at(picture: Tensor) -> tuple[int, int]:
    """Rows and columns of a picture [3, H, W] as it is looked at."""
    _, rows, columns = picture.shape
    return _ROWS, max(16, round(_ROWS * columns / rows))


@torch.no_grad()
def importance(picture: Tensor, seer: Seer, hed: Hed | None) -> Tensor:
    """How much each place of a picture [3, H, W] matters for what it shows, [h, w], 1 in the mean.

    More along edges, as HED sees them, and where a network's last layer answers most strongly.
    """
    small = images.fit(picture, *_looked_at(picture))
    shape = small.shape[1:]
    total = torch.ones(shape).to(picture)
    if hed is not None:
        edges = hed.edges(small)[None, None]
        edges = functional.avg_pool2d(edges, _AROUND, 1, _AROUND // 2, count_include_pad=False)[0, 0]
        total = total + _EDGES * edges / edges.mean().clamp(min=1e-6)
    view = functional.interpolate(picture[None], (_SIDE, _SIDE), mode="bilinear", antialias=True)
    answer = seer.features(view)[-1].square().sum(1, keepdim=True).sqrt()
    answer = answer - answer.amin()
    things = functional.interpolate(answer, list(shape), mode="bilinear")[0, 0]
    total = total + _THINGS * things / things.mean().clamp(min=1e-6)
    total = (total / total.mean()).clamp(max=_STRONGEST)
    return total / total.mean()
