"""Importance of places in a picture: with few strokes, faces and other subjects get more of them."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.faces import Face, faces
from frida_painter.objectives.image import ImageTerm, rise, spread
from frida_painter.objectives.objective import Goal, Term
from frida_painter.system import images

if TYPE_CHECKING:
    from frida_painter.objectives.encoders.convolutional import Hed


_BUDGET = 0.5  # additional importance of all faces of a photograph, relative to that of the whole picture
_MORE, _MAX_MORE = 6.0, 60.0  # additional importance inside a face: in goals with other terms, and most in a photograph
_AROUND, _SOFT = 1.25, 0.25  # times a face's box, with hair and chin; share of the radius over which it falls off
# Eyes, nose and corners of the mouth: times that, more, and radii as shares of the face's height and width.
_MARKS = (1.0, 0.12, 0.2), (1.0, 0.12, 0.2), (0.35, 0.096, 0.16), (0.6, 0.096, 0.16), (0.6, 0.096, 0.16)
_FOCUS_ROWS = 256  # rows of the map of faces: an eye has a few


def importance_of(found: Sequence[Face], rows: int, columns: int, *, by_size: bool = False) -> Tensor:
    """Returns the importance of each place of a picture with these faces: [rows, columns], mean 1.

    by_size: True if faces share a budget by the roots of their areas: small and single ones count more.
    A face without marks is a place that a person marked, and counts as far as its box reaches.
    """
    down = ((torch.arange(rows) + 0.5) / rows)[:, None]
    across = ((torch.arange(columns) + 0.5) / columns)[None]

    def place(row: float, column: float, height: float, width: float) -> Tensor:
        far = (((down - row) / height).square() + ((across - column) / width).square()).sqrt()
        return ((1 + _SOFT - far) / _SOFT).clamp(0, 1)

    around = [_AROUND if face.marks else 1.0 for face in found]
    sides = [times * (face.height * face.width) ** 0.5 for times, face in zip(around, found, strict=True)]
    added = torch.zeros(rows, columns)
    for face, times, side in zip(found, around, sides, strict=True):
        weight = min(_MAX_MORE, _BUDGET / (side * sum(sides))) if by_size else _MORE
        parts = [inside := place(face.row, face.column, times / 2 * face.height, times / 2 * face.width)]
        for (more, high, wide), (row, column) in zip(_MARKS, face.marks, strict=False):
            parts.append(inside + more * place(row, column, high * face.height, wide * face.width))
        added = torch.stack([added, *(weight * part for part in parts)]).amax(0)
    return (1 + added) / (1 + added).mean()


_ROWS, _FLAT_ROWS = 112, 256  # rows of the examined and of the simplified picture
_ATTENTION_AROUND = 9  # pixels: window over which an edge counts
_FLAT = 0.04, 24.0  # share of the shorter side, and 8-bit difference of colours, over which an area becomes even
_DETAILED = 3.0  # importance of a place, relative to the least, from which it keeps its details
_SIDE = 224  # pixels of a side of the network's input
_EDGES, _THINGS, _STRONGEST = 1.0, 0.7, 6.0  # relative to the base importance; the last is the largest, to the mean


def start_from_meaning(goal: Goal, encoders: EncoderRegistry) -> Goal:
    """Returns the goal with importance maps for the pictures that it begins with.

    This applies if the goal begins with a picture that is painted by its content (SemanticTerm). Other goals
    stay unchanged. Raises WeightsError if a network is missing.
    """
    begins = goal.initial_terms
    meant = [term.picture for term in goal.terms if term.picture is not None and not term.is_pixelwise]
    if goal.initial or not meant or not any(term.picture is meant[0] for term in begins):
        return goal
    seer, hed = encoders.meaning(), encoders.edges_if_any()

    def begin_with(term: Term) -> Term:
        if term.picture is None:
            return term
        matters = importance(term.picture, seer, hed)
        if term.importance is not None:
            matters = matters * spread(term.importance, *matters.shape)
        return ImageTerm(simplify(term.picture, matters), term.weight, matters / matters.mean())

    return replace(goal, initial=tuple(map(begin_with, begins)))


def simplify(picture: Tensor, importance: Tensor) -> Tensor:
    """Returns a picture [3, H, W] with even areas where it matters little (mean shift; Comaniciu and Meer 2002).

    importance [h, w]: importance of each place
    """
    import cv2

    _, rows, columns = picture.shape
    small = images.fit(picture, _FLAT_ROWS, max(16, round(_FLAT_ROWS * columns / rows)))
    pixels = images.to_uint8(small)
    even = cv2.pyrMeanShiftFiltering(pixels, _FLAT[0] * min(small.shape[1:]), _FLAT[1])
    flat = images.fit(images.from_uint8(even.astype(pixels.dtype)).to(picture), rows, columns)
    return torch.lerp(flat, picture, rise(spread(importance, rows, columns), _DETAILED).to(picture))


def weight_by_focus(
    goal: Goal, seek_faces: bool, places: Sequence[tuple[float, float, float]], encoders: EncoderRegistry
) -> Goal:
    """Returns the goal with more importance on the faces and the marked places of its photographs.

    places: column, row and radius of each marked place, as shares of the width, the height and the shorter side

    If it finds faces, it adds a remark to `encoders`.
    """

    def weigh(term: Term) -> Term:
        if term.picture is None or term.importance is not None or not term.can_be_weighed:
            return term
        found, (_, rows, columns) = faces(term.picture) if seek_faces else [], term.picture.shape
        if found:
            told = "A face was found in the picture and matters" if len(found) == 1 else f"{len(found)} faces matter"
            encoders.remark(f"{told} more than the rest; --focus none changes that.")
        side = 2 * min(rows, columns)
        found = [*found, *(Face(y, x, side * radius / rows, side * radius / columns) for x, y, radius in places)]
        size = _FOCUS_ROWS, max(16, round(_FOCUS_ROWS * columns / rows))
        by_size = all(each.is_pixelwise for each in goal.terms)
        return term.weigh(importance_of(found, *size, by_size=by_size)) if found else term

    terms = tuple(map(weigh, goal.terms))
    return goal if all(map(operator.is_, terms, goal.terms)) else replace(goal, terms=terms)


@torch.no_grad()
def importance(picture: Tensor, seer: Seer, hed: Hed | None) -> Tensor:
    """Returns the importance of each place for the content of a picture [3, H, W]: [h, w], mean 1.

    It is higher along edges, by HED, and at strong responses of the network's last layer.
    """
    _, rows, columns = picture.shape
    small = images.fit(picture, _ROWS, max(16, round(_ROWS * columns / rows)))
    shape = small.shape[1:]
    total = torch.ones(shape).to(picture)
    if hed is not None:
        edges = hed.edges(small)[None, None]
        edges = functional.avg_pool2d(edges, _ATTENTION_AROUND, 1, _ATTENTION_AROUND // 2, count_include_pad=False)
        total = total + _EDGES * edges[0, 0] / edges[0, 0].mean().clamp(min=1e-6)
    view = functional.interpolate(picture[None], (_SIDE, _SIDE), mode="bilinear", antialias=True)
    answer = seer.features(view)[-1].square().sum(1, keepdim=True).sqrt()
    answer = answer - answer.amin()
    things = functional.interpolate(answer, list(shape), mode="bilinear")[0, 0]
    total = total + _THINGS * things / things.mean().clamp(min=1e-6)
    total = (total / total.mean()).clamp(max=_STRONGEST)
    return total / total.mean()
