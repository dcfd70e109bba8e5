"""Faces in a picture, found by a cascade of local binary patterns; viewers look at faces first.

P. Viola, M. Jones, "Rapid object detection using a boosted cascade of simple features", 2001; S. Liao et al.,
"Learning multi-scale block local binary patterns for face recognition", 2007. It finds faces that look at the camera,
in photographs.
"""

from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import images

_LONGEST = 320  # longer side in pixels of the searched picture
_SMALLEST = 24  # pixels of a face, and of the cascade's window: about a broad stroke on a canvas of 14 inches
_LARGER = np.float32(1.1)  # factor between two sizes of the window
_LIKE_SIZED = 0.6  # smallest size relative to the largest face; much smaller finds are mostly wrong
_VOTES = 12  # windows about a face that must agree; tissue and cells had up to 7
_SAME = 0.5  # shared part of the smaller of two windows, above which they show the same face
_GREY = (0.2125, 0.7154, 0.0721)
_AROUND = ((0, 0), (0, 1), (0, 2), (1, 2), (2, 2), (2, 1), (2, 0), (1, 0))  # row and column of a block's neighbours
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
    for down, across in _AROUND:
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
    for line in Path(__file__).with_suffix(".txt").read_text("ascii").splitlines():
        words = line.split()
        if words[0] == "stage":
            stages.append((float(words[1]) - _ROUNDING, []))
        elif words[0] != "#":
            bits = np.unpackbits(np.frombuffer(bytes.fromhex(words[4]), np.uint8), bitorder="little")
            scores = np.where(bits, *map(np.float32, words[5:]))
            stages[-1][1].append(_Test((*map(int, words[:4]),), scores))
    return stages
