"""Canvas: a primed cloth with a tooth, dry paint, and one wet layer that exchanges paint with bristles.

Units are millimetres, microlitres and seconds. Row 0 is the canvas's lower edge, so that rows go up like y. The
volume of a film per area is its thickness in millimetres.
"""

import math

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from frida_painter.virtual.bristles import Tuft
from frida_painter.virtual.fine_canvas import Bristles, FineCanvas
from frida_painter.virtual.paint import BANDS, film_over

# Shares per cell that a bristle crosses: of the difference to its film that it evens out, and of the wet paint that
# it stirs.
_GIVING, _STIRRING = 0.45, 0.22
# Contrast of the tops of the weave when paint runs short.
_TOOTH = 4.0
# Least thickness of a film, mm; less paint covers a smaller part of the cell.
_THINNEST = 0.010
# Thickness in mm below which a wet film counts as set.
_NEGLIGIBLE = 2e-4
# Diffuse light from the upper left on the ridges: brightness per slope, and its bound.
_RELIEF, _RELIEF_BOUND = 0.16, 0.06


class Canvas:
    """Canvas of width x height mm in cells of `cell` mm; at first it has no paint.

    wet [r, c, 7]: thickness (mm) of the wet film, then its K and S times thickness.
    ground [r, c, 3]: linear reflectance under the wet film. The argument `ground` is one colour [3], or a picture
    [h, w, 3] of any size.
    dry [r, c]: thickness (mm) of set paint.
    settled [r, c]: time (s) of the last update of the wet film.
    tooth [r, c]: 0 for the tops of the weave, 1 for its valleys.

    drying_rate: mm of a wet film that set per second; a film sets from below.
    detail: least pixels of the longer side of a print, whose detail is drawn with the marks. 0: no print is made.
    """

    def __init__(
        self, width: float, height: float, *, cell: float, ground: NDArray[np.float64], drying_rate: float,
        random: np.random.Generator, detail: int = 0,
    ) -> None:  # fmt: skip
        self.width, self.height, self.cell = width, height, cell
        self._drying_rate, self._detail = drying_rate, detail
        rows, columns = math.ceil(height / cell), math.ceil(width / cell)
        self.wet = np.zeros((rows, columns, 1 + 2 * BANDS), np.float32)
        self.dry = np.zeros((rows, columns), np.float32)
        self.settled = np.zeros((rows, columns), np.float32)
        self.tooth = _cloth(rows, columns, cell, random)
        if ground.ndim == 3:
            ground = np.asarray(cv2.resize(ground, (columns, rows), interpolation=cv2.INTER_AREA), np.float64)
        self._changed = np.ones((rows, columns), np.bool_)
        self.tone(ground)
        self._looks = np.empty((rows, columns, BANDS), np.float32)

    @property
    def wet_volume(self) -> float:
        """Wet paint on the canvas, in microlitres."""
        return float(self.wet[..., 0].sum(dtype=np.float64)) * self.cell**2

    @property
    def dry_volume(self) -> float:
        """Set paint on the canvas, in microlitres."""
        return float(self.dry.sum(dtype=np.float64)) * self.cell**2

    def tone(self, ground: NDArray[np.float64]) -> None:
        """Sets the linear reflectance under the wet film, [3] or [rows, columns, 3]."""
        self.ground = (ground * (1 - 0.012 * (self.tooth[..., None] - 0.5))).astype(np.float32)
        self._changed[:] = True
        self._fine: FineCanvas | None = None

    def touch(self, tuft: Tuft, path: NDArray[np.float64], now: float) -> None:
        """Moves a tuft along a path (see Tuft.feet) at time `now` (s); both exchange paint."""
        feet, travelled = tuft.feet(path)
        reach = 2 * tuft.brush.hard_radius + tuft.brush.drag
        low = np.maximum(0, (path[:, :2].min(0) - reach) / self.cell).astype(int)
        high = np.maximum(0, (path[:, :2].max(0) + reach) / self.cell).astype(int)
        box = np.s_[low[1] : high[1], low[0] : high[0]]
        _settle(
            self.wet[box], self.ground[box], self.dry[box], self.settled[box], self._changed[box],
            now, self._drying_rate,
        )  # fmt: skip
        before = Bristles.of(tuft) if self._detail else None
        _exchange(
            feet, travelled / self.cell, tuft.load, tuft.pigment, tuft.capacity, tuft.bite,
            self.wet, self.tooth, self._changed, self.cell, tuft.brush.film,
        )  # fmt: skip
        if before is not None:
            self._finer.lay(feet, travelled, tuft, before)

    def print(self) -> NDArray[np.uint8] | None:
        """Returns the canvas with its hairs and weave, in even light: sRGB [rows, columns, 3], row 0 at the top.

        Its longer side has at least `detail` pixels. None if that is 0.
        """
        return self._finer.picture(self.reflectance(), self._detail) if self._detail else None

    @property
    def _finer(self) -> FineCanvas:
        """The detail of the marks, begun at the first mark on the ground."""
        if self._fine is None:
            self._fine = FineCanvas(self.ground, self.tooth, self.cell, self._detail)
        return self._fine

    def dry_until(self, now: float) -> None:
        """Dries the whole canvas until time `now` (s)."""
        _settle(self.wet, self.ground, self.dry, self.settled, self._changed, now, self._drying_rate)

    def reflectance(self) -> NDArray[np.float32]:
        """Returns the linear reflectance in diffuse light [r, c, 3], row 0 at the bottom.

        Valid until the next touch.
        """
        _look(self.wet, self.ground, self.dry, self._changed, self._looks, self.cell)
        self._changed[:] = False
        return self._looks


@numba.njit(cache=True, nogil=True)
def _settle(wet, ground, dry, settled, changed, now, rate):  # type: ignore[no-untyped-def]
    """Moves the paint that has set since the last update from the wet film to the ground."""
    for r in range(wet.shape[0]):
        for c in range(wet.shape[1]):
            thickness = wet[r, c, 0]
            if thickness > 0.0:
                setting = min(thickness, (now - settled[r, c]) * rate)
                if thickness - setting < _NEGLIGIBLE:
                    setting = thickness
                if setting > 0.0:
                    _film(wet[r, c], setting, ground[r, c], ground[r, c])
                    share = setting / thickness
                    for k in range(1, 7):
                        wet[r, c, k] -= share * wet[r, c, k]
                    wet[r, c, 0] = thickness - setting
                    dry[r, c] += setting
                    changed[r, c] = True
            settled[r, c] = now


@numba.njit(cache=True, nogil=True)
def _film(wet, thickness, ground, out):  # type: ignore[no-untyped-def]
    """Writes into out [3] the reflectance of `thickness` mm of a cell's wet paint over ground [3]."""
    covered = min(1.0, thickness / _THINNEST)
    laid = max(thickness, _THINNEST)
    for band in range(3):
        k, s = wet[1 + band] / wet[0], wet[4 + band] / wet[0]
        out[band] = (1.0 - covered) * ground[band] + covered * film_over(k, s, laid, ground[band])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _exchange(feet, travelled, load, pigment, capacity, bite, wet, tooth, changed, cell, film):  # type: ignore[no-untyped-def]
    """Exchanges paint between each bristle and the four cells around it, at every step; travelled [k] is in cells."""
    rows, columns = tooth.shape
    area = cell * cell
    for step in range(feet.shape[0]):
        moved = travelled[step]
        for i in range(feet.shape[1]):
            press = feet[step, i, 2]
            if press <= 0.0:
                continue
            full = load[i] / capacity[i]
            wanted = film * math.sqrt(full)
            # Little paint or little pressure reaches only the tops of the weave: dry brush.
            reaching = _TOOTH * (0.12 + (2.2 + bite[i]) * full + 0.5 * press + 0.6 * bite[i])
            x, y = feet[step, i, 0] / cell - 0.5, feet[step, i, 1] / cell - 0.5
            left, below = math.floor(x), math.floor(y)
            if left < 0 or below < 0 or left > columns - 2 or below > rows - 2:
                continue
            for corner in range(4):
                c, r = left + (corner & 1), below + (corner >> 1)
                reach = reaching - _TOOTH * tooth[r, c]
                if reach <= 0.0:
                    continue
                near = (1.0 - abs(x - c)) * (1.0 - abs(y - r))
                part = min(0.9, near * moved * min(1.0, reach))
                there, held = wet[r, c, 0] * area, load[i]
                # Towards the film that a bristle with this load leaves; a thicker film is taken up.
                given = _GIVING * part * (wanted * area - there)
                if given > 0.0:
                    given = min(given, 0.5 * held)
                else:
                    given = -min(-given, 0.5 * there, max(0.0, capacity[i] - held))
                stirred = min(_STIRRING * part * there, 0.3 * held)
                down = (stirred + max(given, 0.0)) / held if held > 0.0 else 0.0
                up = area * (stirred + max(-given, 0.0)) / there if there > 0.0 else 0.0
                for k in range(6):
                    lowered = down * pigment[i, k] - up * wet[r, c, 1 + k]
                    pigment[i, k] -= lowered
                    wet[r, c, 1 + k] += lowered / area
                load[i] = held - given
                wet[r, c, 0] = (there + given) / area
                changed[r, c] = True


@numba.njit(cache=True, nogil=True)
def _look(wet, ground, dry, changed, looks, cell):  # type: ignore[no-untyped-def]
    """Updates looks [r, c, 3] at each changed cell, and at cells whose upper or left neighbour has changed."""
    rows, columns = dry.shape
    for r in range(rows):
        above = min(r + 1, rows - 1)
        for c in range(columns):
            beside = max(c - 1, 0)
            if not (changed[r, c] or changed[above, c] or changed[r, beside]):
                continue
            height = wet[r, c, 0] + dry[r, c]
            slope = 2 * height - wet[above, c, 0] - dry[above, c] - wet[r, beside, 0] - dry[r, beside]
            light = 1.0 + max(-_RELIEF_BOUND, min(_RELIEF_BOUND, _RELIEF * slope / cell))
            if wet[r, c, 0] > 0.0:
                _film(wet[r, c], wet[r, c, 0], ground[r, c], looks[r, c])
            else:
                for band in range(3):  # a slice would take numba two seconds to compile
                    looks[r, c, band] = ground[r, c, band]
            for band in range(3):
                looks[r, c, band] *= light


def _cloth(rows: int, columns: int, cell: float, random: np.random.Generator) -> NDArray[np.float32]:
    """Returns the tooth [rows, columns] of a primed cloth, uniform in [0, 1].

    The tooth consists of threads in both directions and the primer's grain.
    """

    def noise(along: float, across: float) -> NDArray[np.float32]:
        rough = random.standard_normal((rows, columns), dtype=np.float32)
        smooth = cv2.GaussianBlur(rough, (0, 0), sigmaX=along / cell, sigmaY=across / cell)
        return np.asarray(smooth / smooth.std(), np.float32)

    height = noise(1.5, 0.3) + noise(0.3, 1.5) + np.float32(1.5) * noise(0.4, 0.4)
    sample = np.sort(height[::3, ::3], axis=None)
    return (np.searchsorted(sample, height, side="left") / len(sample)).astype(np.float32)
