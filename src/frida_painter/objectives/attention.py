"""Importance of places in a picture: with few strokes, faces and other subjects get more of them."""

from __future__ import annotations

import operator
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm, rise, spread
from frida_painter.objectives.objective import Goal, Term
from frida_painter.system import images

if TYPE_CHECKING:
    from frida_painter.objectives.encoders.convolutional import Hed


# Faces, found by a cascade of local binary patterns; viewers look at faces first
#
# P. Viola, M. Jones, "Rapid object detection using a boosted cascade of simple features", 2001; S. Liao et al.,
# "Learning multi-scale block local binary patterns for face recognition", 2007. It finds faces that look at the
# camera, in photographs.

_LONGEST = 320  # longer side in pixels of the searched picture
_SMALLEST = 24  # pixels of a face, and of the cascade's window: about a broad stroke on a canvas of 14 inches
_LARGER = np.float32(1.1)  # factor between two sizes of the window
_LIKE_SIZED = 0.6  # smallest size relative to the largest face; much smaller finds are mostly wrong
_VOTES = 12  # windows about a face that must agree; tissue and cells had up to 7
_SAME = 0.5  # shared part of the smaller of two windows, above which they show the same face
_GREY = (0.2125, 0.7154, 0.0721)
_NEIGHBOURS = ((0, 0), (0, 1), (0, 2), (1, 2), (2, 2), (2, 1), (2, 0), (1, 0))  # row and column of a block's neighbours
_ROUNDING = 1e-5  # of scores

Box = tuple[int, int, int]
"""Row, column and size in pixels of a window."""


class Face(NamedTuple):
    """Place of a face: its centre, height and width, as shares of the picture's height and width."""

    row: float
    column: float
    height: float
    width: float


class _Test(NamedTuple):
    """Test of a window: column, row, width and height of a block, and the score for each pattern [256] about it."""

    block: tuple[int, ...]
    scores: NDArray[np.float32]


def faces(picture: Tensor) -> list[Face]:
    """Returns the faces in a picture, sRGB [3, H, W], largest first."""
    rows, columns = (max(1, round(side * _LONGEST / max(picture.shape[1:]))) for side in picture.shape[1:])
    if min(rows, columns) < _SMALLEST:
        return []
    seen = (images.fit(picture, rows, columns).permute(1, 2, 0) * 255).round().byte().cpu().numpy()
    sums = np.pad((seen / 255 @ _GREY).cumsum(0).cumsum(1), ((1, 0), (1, 0))).astype(np.float32)
    powers = np.arange(0, np.log(min(rows, columns) / _SMALLEST) / np.log(_LARGER))
    found = [box for scale in np.power(_LARGER, powers, dtype=np.float32) for box in _find_boxes(sums, scale)]
    boxes = sorted(_group(found), key=lambda box: -box[2])
    return [
        Face((row + size / 2) / rows, (column + size / 2) / columns, size / rows, size / columns)
        for row, column, size in boxes
        if size >= _LIKE_SIZED * boxes[0][2]
    ]


def _find_boxes(sums: NDArray[np.float32], scale: np.float32) -> list[Box]:
    """Returns the windows of one size that pass all stages; sums [H + 1, W + 1]: of the pixels above and left."""
    size, step, wide = int(_SMALLEST * scale), int(scale + np.float32(0.5)), sums.shape[1]
    rows, columns = (np.arange(0, side - 1 - size, step) for side in sums.shape)
    at = (rows[:, None] * wide + columns).ravel()  # numbers of the windows' first pixels
    for least, tests in _load_stages():
        score = np.zeros(len(at), np.float32)
        for test in tests:
            score += test.scores[_patterns(sums, at, [int(side * scale) for side in test.block])]
        at = at[score >= least]
    return [(*divmod(place, wide), size) for place in at.tolist()]


def _patterns(sums: NDArray[np.float32], at: NDArray[np.int64], block: list[int]) -> NDArray[np.uint8]:
    """Returns a bit for each neighbour of a block that is not darker than the block, in windows that begin at [n]."""
    (column, row, width, height), flat, wide = block, sums.ravel(), sums.shape[1]
    corners = [
        [flat.take(at + ((row + down * height) * wide + column + across * width)) for across in range(4)]
        for down in range(4)
    ]
    blocks = [
        [lower[k + 1] + upper[k] - upper[k + 1] - lower[k] for k in range(3)] for upper, lower in pairwise(corners)
    ]
    pattern = np.zeros(len(at), np.uint8)
    for down, across in _NEIGHBOURS:
        pattern = pattern << 1 | (blocks[down][across] >= blocks[1][1])
    return pattern


def _group(boxes: list[Box]) -> list[Box]:
    """Returns the mean of each group of windows that show the same face, if enough of them do."""
    groups: list[list[int]] = []  # sums of rows, columns and sizes, and the number of windows
    for box in boxes:
        shared = [_shared_part(box, _mean_box(group)) for group in groups]
        if max(shared, default=0.0) > _SAME:
            best = shared.index(max(shared))
            groups[best] = [total + more for total, more in zip(groups[best], (*box, 1), strict=True)]
        else:
            groups.append([*box, 1])
    return [_mean_box(group) for group in groups if group[3] >= _VOTES]


def _mean_box(group: list[int]) -> Box:
    row, column, size, count = group
    return row // count, column // count, size // count


def _shared_part(one: Box, other: Box) -> float:
    """Returns the shared area of two windows, as a share of the smaller one."""
    (row, column, size), (other_row, other_column, other_size) = one, other
    down = min(row + size, other_row + other_size) - max(row, other_row)
    across = min(column + size, other_column + other_size) - max(column, other_column)
    return max(0, down) * max(0, across) / min(size, other_size) ** 2


@cache
def _load_stages() -> list[tuple[float, list[_Test]]]:
    """Returns the least score of each stage of the cascade, and its tests."""
    stages: list[tuple[float, list[_Test]]] = []
    for line in Path(__file__).with_name("faces.txt").read_text("ascii").splitlines():
        words = line.split()
        if words[0] == "stage":
            stages.append((float(words[1]) - _ROUNDING, []))
        elif words[0] != "#":
            bits = np.unpackbits(np.frombuffer(bytes.fromhex(words[4]), np.uint8), bitorder="little")
            scores = np.where(bits, *map(np.float32, words[5:]))
            stages[-1][1].append(_Test((*map(int, words[:4]),), scores))
    return stages


# Importance

_MORE = 6.0  # additional importance inside a face
_AROUND = 1.25  # times its box: includes hair and chin
_SOFT = 0.25  # share of the radius over which the importance falls off


def importance_of(found: list[Face], rows: int, columns: int) -> Tensor:
    """Returns the importance of each place of a picture with these faces: [rows, columns], mean 1."""
    down = ((torch.arange(rows) + 0.5) / rows)[:, None]
    across = ((torch.arange(columns) + 0.5) / columns)[None]
    inside = torch.zeros(rows, columns)
    for face in found:
        radii = _AROUND * face.height / 2, _AROUND * face.width / 2
        far = (((down - face.row) / radii[0]).square() + ((across - face.column) / radii[1]).square()).sqrt()
        inside = torch.maximum(inside, ((1 + _SOFT - far) / _SOFT).clamp(0, 1))
    matters = 1 + _MORE * inside
    return matters / matters.mean()


FACES, EVERYWHERE = "faces", "none"
"""Possible focus of a painting of a photograph."""
_ROWS = 112  # rows of the examined picture
_FLAT_ROWS = 256  # rows of the simplified picture
_ATTENTION_AROUND = 9  # pixels: window over which an edge counts
_FLAT = 0.04, 24.0  # share of the shorter side, and 8-bit difference of colours, over which an area becomes even
_DETAILED = 3.0  # importance of a place, relative to the least, from which it keeps its details
_SIDE = 224  # pixels of a side of the network's input
_EDGES, _THINGS = 1.0, 0.7  # relative to the base importance of each place
_STRONGEST = 6.0  # largest importance, relative to the mean


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
            matters = matters * term.importance
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


def weight_by_focus(goal: Goal, focus: str, encoders: EncoderRegistry) -> Goal:
    """Returns the goal with more importance on the faces of its photographs if the focus is FACES.

    If it finds faces, it adds a remark to `encoders`.
    """
    if focus == EVERYWHERE:
        return goal

    def weigh(term: Term) -> Term:
        if term.picture is None or term.importance is not None or not term.can_be_weighed:
            return term
        found = faces(term.picture)
        if not found:
            return term
        told = "A face was found in the picture and matters" if len(found) == 1 else f"{len(found)} faces matter"
        encoders.remark(f"{told} more than the rest; --focus {EVERYWHERE} changes that.")
        return term.weigh(importance_of(found, *_choose_size(term.picture)))

    terms = tuple(map(weigh, goal.terms))
    return goal if all(map(operator.is_, terms, goal.terms)) else replace(goal, terms=terms)


def _choose_size(picture: Tensor) -> tuple[int, int]:
    _, rows, columns = picture.shape
    return _ROWS, max(16, round(_ROWS * columns / rows))


@torch.no_grad()
def importance(picture: Tensor, seer: Seer, hed: Hed | None) -> Tensor:
    """Returns the importance of each place for the content of a picture [3, H, W]: [h, w], mean 1.

    It is higher along edges, by HED, and at strong responses of the network's last layer.
    """
    small = images.fit(picture, *_choose_size(picture))
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
