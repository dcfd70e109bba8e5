"""Fine picture of the studio's canvas, to print: hairs, ridges of paint and weave, finer than the simulated cells.

The simulation stays the truth about the colour of each cell. This module lays the same bristles again on a finer
grid, each as a lock of hairs, and only takes the detail within the cells from there.
"""

import math
from typing import NamedTuple

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from frida_painter.virtual.bristles import Tuft
from frida_painter.virtual.paint import BANDS, to_srgb

_MAX_FINER, _MAX_PIXELS = 10, 26_000_000  # of the fine grid: pixels along a cell, and in all
_TRACK = 0.35  # mm: width of a track; in one track, a bristle covers the marks of those before it
_HAIRS = 7  # in a lock
# Half of the width (mm) of a lock at the lightest touch and at the hardest press.
_LIGHT_LOCK, _HARD_LOCK = np.float32(0.36), np.float32(0.60)
_STEP = np.float32(1)  # along a hair, pixels
_TOOTH = np.float32(4)
_CLOTH = np.float32(0.8)  # share of the simulated cloth in the tooth; the rest are the threads
_THREAD = 0.55  # pitch of the weave, mm
_WEAVE, _FILM = np.float32(0.022), np.float32(0.11)  # height of the threads and of paint, mm
_LIGHT, _LIGHT_BOUND = np.float32(1.3), np.float32(0.3)  # brightness per slope, and its bound
_BLEND = 0.5  # cells over which colour is brought to that of the simulation
_EMPTY = 1e-9
_MIN_PAINT = 1e-3  # share of paint below which a bristle has no colour of its own


class Bristles(NamedTuple):
    """Paint in the bristles of a tuft: its share of a full tuft's [n], and its linear reflectance [n, 3]."""

    full: NDArray[np.float32]
    color: NDArray[np.float32]

    @classmethod
    def of(cls, tuft: Tuft) -> "Bristles":
        """Returns the present paint; an empty bristle is as white as nothing."""
        ratio = tuft.pigment[:, :BANDS] / np.maximum(tuft.pigment[:, BANDS:], _EMPTY)
        thick = 1 + ratio - np.sqrt(ratio * (ratio + 2))
        return cls((tuft.load / tuft.capacity).astype(np.float32), thick.astype(np.float32))


class FineCanvas:
    """Detail of a canvas.

    ground [r, c, 3], tooth [r, c], cell: of the canvas.
    longest: wanted pixels of its longer side. A small canvas has fewer, for hairs have a size.
    """

    def __init__(self, ground: NDArray[np.float32], tooth: NDArray[np.float32], cell: float, longest: int) -> None:
        rows, columns = tooth.shape
        finer = self._finer = min(
            -(-longest // max(rows, columns)), _MAX_FINER, math.isqrt(_MAX_PIXELS // (rows * columns))
        )
        self._pixel = cell / finer
        size = columns * finer, rows * finer
        random = np.random.default_rng(0)  # of its own: the studio's marks do not depend on a print
        weave = _weave(size[1], size[0], _THREAD / self._pixel, random)
        tooth = np.asarray(cv2.resize(tooth, size, interpolation=cv2.INTER_CUBIC), np.float32)
        self._tooth = _CLOTH * tooth + (1 - _CLOTH) * (1 - weave)
        self._paint = np.empty((size[1], size[0], BANDS + 1), np.float32)
        self._paint[..., :BANDS] = cv2.resize(ground, size, interpolation=cv2.INTER_LINEAR)
        self._paint[..., BANDS] = _WEAVE * weave
        hairs = random.random((512, _HAIRS), dtype=np.float32)
        self._hairs = np.float32(0.3) + np.float32(0.7) * hairs

    def lay(self, feet: NDArray[np.float32], travelled: NDArray[np.float64], tuft: Tuft, before: Bristles) -> None:
        """Draws the contacts of a tuft (see Tuft.feet), which had the paint `before` before them."""
        after = Bristles.of(tuft)
        color = np.where(after.full[:, None] > _MIN_PAINT, after.color, before.color)
        since = _last_visible(feet, travelled, _TRACK)
        _lay(
            feet, since, np.stack((before.full, after.full)), np.stack((before.color, color)),
            tuft.bite.astype(np.float32), self._hairs, self._tooth, self._paint, np.float32(self._pixel),
        )  # fmt: skip

    def picture(self, truth: NDArray[np.float32], longest: int) -> NDArray[np.uint8]:
        """Returns the picture [rows, columns, 3] in sRGB, row 0 at the top.

        truth: linear reflectance of the cells [r, c, 3], row 0 at the bottom; the picture agrees with it.
        longest: least pixels of the longer side; what the grid lacks is interpolated.
        """
        color = np.ascontiguousarray(self._paint[..., :BANDS])
        around = np.ones((3, 3), np.uint8)
        least, most = cv2.erode(truth, around), cv2.dilate(truth, around)
        _bound(color, least, most, self._finer)
        for _ in range(3):
            seen = cv2.resize(color, truth.shape[1::-1], interpolation=cv2.INTER_AREA)
            missing = cv2.GaussianBlur(truth - seen, (0, 0), _BLEND)  # else cells would show at the edges of paint
            color += cv2.resize(missing, color.shape[1::-1], interpolation=cv2.INTER_LINEAR)
            _bound(color, least, most, self._finer)
        _light_up(color, self._paint, np.float32(1 / self._pixel))
        if (larger := longest / max(color.shape)) > 1:
            color = cv2.resize(color, None, fx=larger, fy=larger, interpolation=cv2.INTER_CUBIC)
        picture: NDArray[np.uint8] = _encode(color, _srgb_table())
        return picture


def _weave(rows: int, columns: int, pitch: float, random: np.random.Generator) -> NDArray[np.float32]:
    """Returns the heights of the threads of a plain weave [rows, columns], in [0, 1].

    pitch: mean distance of threads, pixels
    """

    def threads(count: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns the roundness of a thread at each pixel across it, and 1 or -1 by turns with smooth changes."""
        ends = np.cumsum(random.normal(pitch, 0.12 * pitch, int(count / pitch * 1.5) + 9).clip(0.5 * pitch))
        place = np.interp(np.arange(count) + 0.5, ends, np.arange(len(ends))) + 1
        return np.sin(np.pi * (place % 1)).astype(np.float32), np.sin(np.pi * place).astype(np.float32)

    (weft, above), (warp, beside) = threads(rows), threads(columns)
    over = above[:, None] * np.sign(beside)
    under = np.sign(above)[:, None] * beside
    return np.maximum(warp * (1 + over), weft[:, None] * (1 - under)) / 2


def _srgb_table() -> NDArray[np.uint8]:
    """Returns sRGB bytes for the square roots of linear light, in 4096 steps."""
    return np.round(255 * to_srgb((np.arange(4096) / 4095) ** 2)).astype(np.uint8)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _last_visible(feet, travelled, width):  # type: ignore[no-untyped-def]
    """Returns the first step [n] from which the mark of each bristle stays visible.

    Bristles that follow in its track cover what a bristle marks before. Tracks are `width` wide.
    """
    steps, n = feet.shape[:2]
    gone = np.cumsum(travelled)
    last = np.zeros(n, np.int64)
    middle = 0
    most = 0
    for step in range(steps):
        there = 0
        for i in range(n):
            if feet[step, i, 2] > 0.0:
                last[i] = step
                there += 1
        if there > most or (there == most and 2 * step <= steps):
            most, middle = there, step
    back, on = max(0, middle - 3), min(steps - 1, middle + 3)
    ahead_x, ahead_y = 0.0, 0.0
    for i in range(n):
        ahead_x += feet[on, i, 0] - feet[back, i, 0]
        ahead_y += feet[on, i, 1] - feet[back, i, 1]
    norm = max(1e-9, math.hypot(ahead_x, ahead_y))
    ahead_x, ahead_y = ahead_x / norm, ahead_y / norm
    along = ahead_x * feet[middle, :, 0] + ahead_y * feet[middle, :, 1]
    across = ahead_x * feet[middle, :, 1] - ahead_y * feet[middle, :, 0]
    track = ((across - across.min()) / width).astype(np.int64)
    rear = np.full(track.max() + 1, np.inf)  # place of the last bristle of each track
    for i in range(n):
        if feet[middle, i, 2] > 0.0:
            rear[track[i]] = min(rear[track[i]], along[i])
    since = np.zeros(n, np.int64)
    for i in range(n):
        ahead = along[i] - rear[track[i]]
        if ahead > 0.0:
            since[i] = np.searchsorted(gone, gone[last[i]] - ahead)
    return since


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _lay(feet, since, full, color, bite, hairs, tooth, paint, pixel):  # type: ignore[no-untyped-def]
    """Draws the visible part of each bristle's track, as a lock of hairs, in steps of about a pixel.

    full [2, n], color [2, n, 3]: at the first and at the last step.
    """
    rows, columns = tooth.shape
    steps = feet.shape[0]
    one, half_step = np.float32(1), np.float32(0.5)
    for step in range(1, steps):
        late = np.float32(step) / np.float32(steps)
        for i in range(feet.shape[1]):
            press = feet[step, i, 2]
            if step < since[i] or press <= 0 or feet[step - 1, i, 2] <= 0:
                continue
            held = full[0, i] + late * (full[1, i] - full[0, i])
            x, y = feet[step - 1, i, 0] / pixel, feet[step - 1, i, 1] / pixel
            dx, dy = feet[step, i, 0] / pixel - x, feet[step, i, 1] / pixel - y
            way = math.sqrt(dx * dx + dy * dy)
            if way < np.float32(1e-3):
                continue
            # As the bristles of the simulation: little paint or little pressure reaches only the tops of the weave.
            reaching = np.float32(0.12) + (np.float32(2.2) + bite[i]) * held + half_step * press
            reaching += np.float32(0.6) * bite[i]
            red = color[0, i, 0] + late * (color[1, i, 0] - color[0, i, 0])
            green = color[0, i, 1] + late * (color[1, i, 1] - color[0, i, 1])
            blue = color[0, i, 2] + late * (color[1, i, 2] - color[0, i, 2])
            half = (_LIGHT_LOCK + (_HARD_LOCK - _LIGHT_LOCK) * min(press, one)) / pixel
            along, across = int(way / _STEP) + 1, int(2 * half / _STEP) + 1
            thick = _FILM * math.sqrt(held)
            for b in range(across):
                u = (b + half_step) / across
                hair = hairs[i, int(u * hairs.shape[1])]
                off = (2 * u - one) * half / way
                hx, hy = x - dy * off, y + dx * off
                for a in range(along):
                    t = (a + half_step) / along
                    c, r = int(hx + t * dx), int(hy + t * dy)
                    if c < 0 or r < 0 or c >= columns or r >= rows:
                        continue
                    reach = _TOOTH * (reaching - tooth[r, c])
                    if reach <= 0:
                        continue
                    part = np.float32(0.8) * min(one, hair * reach)
                    paint[r, c, 0] += part * (red - paint[r, c, 0])
                    paint[r, c, 1] += part * (green - paint[r, c, 1])
                    paint[r, c, 2] += part * (blue - paint[r, c, 2])
                    paint[r, c, 3] += part * (thick * hair - paint[r, c, 3])


@numba.njit(cache=True, nogil=True)
def _bound(color, least, most, finer):  # type: ignore[no-untyped-def]
    """Brings each pixel between the least and the most of the cells around it: no colour that is not there."""
    for r in range(color.shape[0]):
        for c in range(color.shape[1]):
            for band in range(3):
                low, high = least[r // finer, c // finer, band], most[r // finer, c // finer, band]
                color[r, c, band] = max(low, min(high, color[r, c, band]))


@numba.njit(cache=True, nogil=True)
def _light_up(color, paint, scale):  # type: ignore[no-untyped-def]
    """Multiplies the colour by light from the upper left on the heights of paint."""
    rows, columns = paint.shape[:2]
    one = np.float32(1)
    for r in range(rows):
        above = min(r + 1, rows - 1)
        for c in range(columns):
            slope = 2 * paint[r, c, 3] - paint[above, c, 3] - paint[r, max(c - 1, 0), 3]
            light = one + max(-_LIGHT_BOUND, min(_LIGHT_BOUND, _LIGHT * slope * scale))
            for band in range(3):
                color[r, c, band] *= light


@numba.njit(cache=True, nogil=True, fastmath=True)
def _encode(linear, table):  # type: ignore[no-untyped-def]
    rows, columns = linear.shape[:2]
    picture = np.empty(linear.shape, np.uint8)
    for r in range(rows):
        for c in range(columns):
            for band in range(3):
                value = max(np.float32(0), min(np.float32(1), linear[r, c, band]))
                picture[rows - 1 - r, c, band] = table[int(np.float32(4095) * math.sqrt(value) + np.float32(0.5))]
    return picture
