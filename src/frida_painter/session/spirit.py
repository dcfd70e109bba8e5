"""Spirit of a person's drawing: the properties of their strokes, and strokes of the robot that have the same.

These are colours, directions, lengths, bends, press, and the rhythm: the way from each stroke to the next one.
Strokes that are not known, as at a real easel, are traced in the paint that the person added.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import PersonStroke
from frida_painter.palette import to_lab
from frida_painter.plan import Plan
from frida_painter.stroke_family import Taught
from frida_painter.strokes import StrokeLimits, Strokes

_BESIDE = 0.006  # metres by which a stroke begins beside the place that the rhythm gives it
_TURNED = 0.15  # radians by which its direction differs from that of the person's stroke
_TRIES, _ANYWHERE = 24, 96  # places that are tried for a stroke, in the rhythm and anywhere else that is free
_CLEAR = 0.004  # metres that the middle of a stroke keeps from a protected part
_MOVED = 0.01  # metres by which a stroke may be moved onto the canvas
_SAMPLES = 9  # points of a stroke that are tested
_USUAL_PRESS = 0.5  # of traced strokes, whose press is unknown


@dataclass(frozen=True)
class StrokeSpirit:
    """Properties that a stroke of the robot takes from a stroke of a person.

    start [2]: in canvas metres.
    angle: direction in radians, counter-clockwise. length, bend: metres. press: in [0, 1].
    color: sRGB.
    """

    start: NDArray[np.float64]
    angle: float
    length: float
    bend: float
    press: float
    color: tuple[float, float, float]

    @classmethod
    def of(cls, stroke: PersonStroke, color: tuple[float, float, float]) -> "StrokeSpirit":
        """Returns the properties of a stroke whose way is known."""
        along = stroke.place[-1] - stroke.place[0]
        length = max(float(np.linalg.norm(along)), 1e-3)
        across = np.array([-along[1], along[0]]) / length
        bow = (stroke.place - stroke.place[0]) @ across
        bend = float(bow[np.abs(bow).argmax()]) / 0.75  # of a Bezier curve whose middle lies 3/4 of the way out
        angle = float(np.arctan2(along[1], along[0]))
        return cls(stroke.place[0], angle, length, bend, float(stroke.press.mean()), color)


def trace_strokes(painted: NDArray[np.bool_], seen: Tensor, size: CanvasSize) -> list[StrokeSpirit]:
    """Returns a stroke for each connected part of added paint, from left to right.

    painted [H, W]: True where the paint is. seen [3, H, W]: the canvas with it.
    A part is taken for one stroke along its longest direction; strokes that cross are one part.
    """
    count, labels = cv2.connectedComponents(painted.astype(np.uint8), connectivity=8)
    pitch = np.array([size.width / painted.shape[1], size.height / painted.shape[0]])
    picture = seen.permute(1, 2, 0).numpy()
    found = []
    for number in range(1, count):
        rows, columns = np.nonzero(labels == number)
        place = np.c_[columns + 0.5, painted.shape[0] - rows - 0.5] * pitch
        middle = place.mean(0)
        _, _, axes = np.linalg.svd(place - middle, full_matrices=False)
        along = axes[0] * (1 if tuple(axes[0]) > (0.0, 0.0) else -1)  # a right-handed hand goes to the right
        way, aside = (place - middle) @ along, (place - middle) @ np.array([-along[1], along[0]])
        first, last = np.percentile(way, [1, 99])
        inner = np.abs(way - (first + last) / 2) < 0.15 * max(last - first, 1e-6)
        ends = np.abs(way - (first + last) / 2) > 0.4 * (last - first)
        bow = float(np.median(aside[inner]) - np.median(aside[ends])) if inner.any() and ends.any() else 0.0
        red, green, blue = np.median(picture[rows, columns], axis=0).tolist()
        start = (
            middle
            + first * along
            + (float(np.median(aside[ends])) if ends.any() else 0.0) * np.array([-along[1], along[0]])
        )
        angle = math.atan2(along[1], along[0])
        found.append(
            StrokeSpirit(start, angle, max(float(last - first), 1e-3), bow / 0.75, _USUAL_PRESS, (red, green, blue))
        )
    return sorted(found, key=lambda each: float(each.start[0]))


def continue_drawing(
    spirit: Sequence[StrokeSpirit], rest: Plan, count: int, clear: NDArray[np.bool_] | None, seed: int
) -> Plan:
    """Returns strokes in the spirit of a person's, as many as `rest` has in each layer, or `count` if it has none.

    rest: strokes that they replace, for canvas, brushes and paints.
    clear [H, W]: True for a place without strokes. None: all places are free.

    Each stroke follows one of the person's, chosen by chance. It begins where the one before it began, after a way as
    between two strokes of the person, and the chain begins at their last stroke. If that leads over the edge, the
    chain begins anew at a place chosen by chance, and turns back.
    Raises ConfigError if there is no room for a stroke.
    """
    random = np.random.default_rng(seed)
    chain = _Chain(spirit, rest.canvas, clear, random)
    strokes, paints, layers = [Strokes.empty()], [torch.zeros(0, dtype=torch.long)], []
    for part, layer in zip(rest.by_layer(), rest.layers, strict=True):
        wanted = len(part) if len(rest) else count
        chosen = [spirit[int(random.integers(len(spirit)))] for _ in range(wanted)]
        taught = [part.strokes[[number]].taught if len(part) else None for number in range(wanted)]
        placed = [chain.place(one, layer.limits, code) for one, code in zip(chosen, taught, strict=True)]
        made = [(one, stroke) for one, stroke in zip(chosen, placed, strict=True) if stroke is not None]
        first, end = layer.paints
        wanted_colors = torch.tensor([one.color for one, _ in made]).reshape(-1, 3)
        paint = first + torch.cdist(to_lab(wanted_colors), to_lab(rest.palette.color[first:end])).argmin(1)
        if made:
            together = Strokes.join(*(stroke for _, stroke in made))
            strokes.append(together.with_groups(color=rest.palette.color[paint]))
        paints.append(paint)
        layers.append(replace(layer, strokes=len(made)))
    if not any(layer.strokes for layer in layers):
        raise ConfigError("There is no free place left for a stroke; remove the protection, or paint elsewhere.")
    return replace(rest, strokes=Strokes.join(*strokes), paint=torch.cat(paints), layers=tuple(layers))


def touches(strokes: Strokes, forbidden: NDArray[np.bool_], size: CanvasSize) -> NDArray[np.bool_]:
    """Returns True for each stroke [n] whose middle line comes within 4 mm of a forbidden place [H, W]."""
    rows, columns = forbidden.shape
    side = 2 * max(1, round(_CLEAR / size.height * rows)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    wide = cv2.dilate(forbidden.astype(np.uint8), disc) > 0
    path = strokes.path(torch.linspace(0, 1, _SAMPLES)).detach().numpy()
    column = np.clip((path[..., 0] / size.width * columns).astype(int), 0, columns - 1)
    row = np.clip(((1 - path[..., 1] / size.height) * rows).astype(int), 0, rows - 1)
    return np.asarray(wide[row, column].any(-1))


class _Chain:
    """Places strokes one after another, in the rhythm of a person's strokes."""

    def __init__(
        self,
        spirit: Sequence[StrokeSpirit],
        size: CanvasSize,
        clear: NDArray[np.bool_] | None,
        random: np.random.Generator,
    ) -> None:
        starts = np.array([each.start for each in spirit])
        self._ways = np.diff(starts, axis=0) if len(starts) > 1 else np.full((1, 2), 0.3 * spirit[0].length)
        self._here, self._size, self._clear, self._random = starts[-1], size, clear, random
        self._heading = np.ones(2)  # -1 along an axis where the chain has turned back

    def place(self, like: StrokeSpirit, limits: StrokeLimits, taught: Taught | None) -> Strokes | None:
        """Returns one stroke at the next place; None if no free place is found."""
        corner = np.array([self._size.width, self._size.height])
        ways = self._heading * self._ways[self._random.integers(len(self._ways), size=_TRIES)]
        chain = self._here + ways + self._random.normal(0, _BESIDE, (_TRIES, 2))
        tried = np.concatenate([chain, self._anywhere(corner)])
        angle = like.angle + self._random.normal(0, _TURNED, len(tried))
        every = torch.ones(len(tried))
        strokes = Strokes(
            torch.from_numpy(tried).float(), torch.from_numpy(angle).float(), like.length * every, like.bend * every,
            like.press * every, torch.zeros(len(tried), 3), None if taught is None else taught[[0] * len(tried)],
        ).project(limits, self._size)  # fmt: skip
        free = np.ones(len(tried), np.bool_)
        if self._clear is not None:
            free = ~touches(strokes, self._clear, self._size)
        if not free.any():
            return None
        moved = np.linalg.norm(strokes.position.numpy() - tried, axis=1)  # onto the canvas
        whole = free & (moved < _MOVED)
        at = int((whole if whole.any() else free).argmax())
        if at >= _TRIES:  # the rhythm led over the edge, or into what is to stay free
            over = (chain < 0).any(0) | (chain > corner).any(0)
            self._heading = np.where(over, -self._heading, self._heading)
        self._here = strokes.position[at].double().numpy()
        return strokes[[at]]

    def _anywhere(self, corner: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns places chosen by chance that are not protected, [k, 2] in canvas metres; all are on the canvas."""
        if self._clear is None or self._clear.all():
            return self._random.uniform(size=(_ANYWHERE, 2)) * corner
        free = np.argwhere(~self._clear)
        rows, columns = self._clear.shape
        row, column = (free[self._random.integers(len(free), size=_ANYWHERE)] + 0.5).T
        return np.c_[column / columns, 1 - row / rows] * corner
