"""Whether a canvas lies where it lay: the photograph that is expected, registered with the one that is seen.

The painter knows what it painted, and where. So what is compared is whole: the canvas as it was last photographed, the
strokes since then, which may lie a little beside where they were sent, its edges, and the table around it. A motion
moves all of that at once; paint along an edge changes some colours, and moves nothing. Small squares of canvas and
table are witnesses, and each tells how much worse the photograph is explained by one motion than by another. The
verdict is by how far they agree.
"""

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import Calibration, Corners
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.perception.rectify import photographed_pixels
from frida_painter.perception.srgb import light_of_bytes

# The edge of a sheet of paper in a photograph: whether the paper moved since, and whether the picture is sharp.
#
# Every photograph has it, also the first one of a bare sheet, and nobody paints on it.

_PLACES = 48  # looked at along each side
_MARGIN = 0.06  # of a side, left out at its ends
_FINE = 2  # samples a pixel across the edge
_LEAST_STEP = 0.06  # of linear light, between table and paper
_LEAST_SEEN = 0.5  # of the places of a side
_LEAST_LEFT = 0.2
_DIMMEST = 0.01  # linear light: the camera's noise
_OTHER_LIGHT = 0.3  # natural logarithm of the light beside the edge, against that of all places
_ROUNDS = 6


@dataclass(frozen=True)
class PaperEdge:
    """Where the edge of the paper is seen.

    place, outward [4 x 48, 2]: points (column, row) around the paper and the way out of it; offset
    [4 x 48]: how many pixels outwards of its point the edge lies, NaN where it is not seen; width
    [4 x 48]: pixels within which it passes from a fifth to four fifths of its step, NaN likewise; table
    [4 x 48]: linear light just beyond it; inside [4 x 48]: the same just within it; softness: the median width, NaN
    where it is not visible; visible: whether the edge is seen at most places of every side.
    """

    place: NDArray[np.float64]
    outward: NDArray[np.float64]
    offset: NDArray[np.float64]
    softness: float
    visible: bool
    width: NDArray[np.float64]
    table: NDArray[np.float64]
    inside: NDArray[np.float64]

    @classmethod
    def read(cls, photograph: NDArray[np.uint8], corners: Corners, reach: float) -> Self:
        """Looks within `reach` pixels of the four sides between the corners, which go round clockwise.

        photograph [rows, columns, 3] uint8 sRGB.
        """
        start = np.array(corners, np.float64)
        way = np.roll(start, -1, 0) - start
        outward = np.stack((way[:, 1], -way[:, 0]), 1) / np.linalg.norm(way, axis=1, keepdims=True)
        along = np.linspace(_MARGIN, 1 - _MARGIN, _PLACES)
        place = (start[:, None] + along[:, None] * way[:, None]).reshape(-1, 2)
        outward = np.repeat(outward, _PLACES, 0)
        step = np.arange(-reach, reach + 0.5 / _FINE, 1 / _FINE)
        samples = (place[:, None] + step[:, None] * outward[:, None]).astype(np.float32)
        seen = cv2.remap(
            photograph, samples[..., 0], samples[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        light = light_of_bytes(np.asarray(seen, np.uint8)).mean(2)  # [places, steps]
        light = cv2.blur(light, (_FINE + 1, 1))
        outside = np.median(light[:, -len(step) // 5 :], 1)
        inside = np.median(light[:, : len(step) // 3], 1)
        rise = np.where(np.abs(inside - outside) >= _LEAST_STEP, inside - outside, np.nan)
        height = (light - outside[:, None]) / rise[:, None]  # 0 the table, 1 the paper
        offset, near, far = (_first_above(height, level, step) for level in (0.5, 0.8, 0.2))
        soft = far - near
        visible = bool((np.isfinite(offset).reshape(4, _PLACES).mean(1) >= _LEAST_SEEN).all())
        return cls(
            place, outward, offset, float(np.nanmedian(soft)) if visible else math.nan, visible, soft, outside, inside
        )

    @property
    def beside(self) -> float:
        """How many pixels the farthest corner lies beside where it was looked for; NaN where that cannot be told."""
        return self._motion(self.offset) if self.visible else math.nan

    def moved_since(self, earlier: Self) -> float:
        """By how many pixels the farthest corner moved, of a paper that was seen `earlier` with the same corners.

        Infinite where it is not seen any more, NaN where it was not seen before either.
        """
        if not earlier.visible:
            return math.nan
        if not self.visible:
            return math.inf
        return self._motion(self.offset - earlier.offset)

    def blurring_since(self, earlier: Self) -> float:
        """How many pixels wider the edge is, in the middle of all places; NaN where too little of it is left."""
        wider = self.width - earlier.width
        return float(np.nanmedian(wider)) if _enough(wider) else math.nan

    def covered_since(self, earlier: Self) -> int:
        """At how many places in a row something reaches over the edge that was not there, whatever the light is now."""
        strange = _is_other(self.table, earlier.table, self._brighter_than(earlier))
        longest = run = 0
        for place in np.concatenate((strange, strange)):  # round the paper, over its first corner
            run = run + 1 if place else 0
            longest = max(longest, run)
        return min(longest, len(strange))

    def _brighter_than(self, earlier: Self) -> float:
        """How many times as bright the lamps are as they were, by the table in the middle of all places."""
        return float(np.median((self.table + _DIMMEST) / (earlier.table + _DIMMEST)))

    def _motion(self, outwards: NDArray[np.float64]) -> float:
        """The largest way of a corner under the shift and turn that move the places outwards [n] so."""
        known = np.isfinite(outwards)
        place, outward, outwards = self.place[known], self.outward[known], outwards[known]
        middle = self.place.mean(0)
        scale = float(np.abs(self.place - middle).max())
        arm = (place - middle) / scale
        turning = outward[:, 1] * arm[:, 0] - outward[:, 0] * arm[:, 1]
        terms = np.c_[outward, turning]
        weight = np.ones(len(outwards))
        motion = np.zeros(3)
        for _ in range(_ROUNDS):  # least squares, in which what does not fit counts less and less
            root = np.sqrt(weight)
            motion = np.linalg.lstsq(root[:, None] * terms, root * outwards, rcond=None)[0]
            off = np.abs(terms @ motion - outwards)
            weight = 1 / (1 + (off / (3 * np.median(off) + 0.05)) ** 2) ** 2
        corner = (self.place[:: _PLACES - 1] - middle) / scale
        ways = motion[:2] + motion[2] * np.stack((-corner[:, 1], corner[:, 0]), 1)
        return float(np.linalg.norm(ways, axis=1).max())


def _is_other(light: NDArray[np.float64], earlier: NDArray[np.float64], brighter: float) -> NDArray[np.bool_]:
    """At which places the light is another than it was, the lamps being so many times as bright."""
    share = (light + _DIMMEST) / (earlier + _DIMMEST) / brighter
    return np.asarray(np.abs(np.log(share)) > _OTHER_LIGHT)


def _enough(values: NDArray[np.float64]) -> bool:
    """Whether values [4 x 48] are known at a fifth of the places of three sides, or more."""
    return bool((np.isfinite(values).reshape(4, _PLACES).mean(1) >= _LEAST_LEFT).sum() >= 3)


def _first_above(height: NDArray[np.float64], level: float, step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where each row of heights, seen from its end, first passes the level, between its samples; NaN for never."""
    backwards = height[:, ::-1]
    above = backwards >= level
    index = above.argmax(1)
    row = np.arange(len(height))
    crossed = above[row, index] & (index > 0)
    before = np.maximum(index - 1, 0)
    low, high = backwards[row, before], backwards[row, index]
    share = (level - low) / np.where(high > low, high - low, 1)
    place = step[::-1][before] + share * (step[::-1][index] - step[::-1][before])
    return np.where(crossed, place, np.nan)


COARSEST, _ROWS = 0.001, 250  # metres of the canvas per pixel of what is registered, and pixels along its shorter side
_AROUND = 0.015  # metres of the table that are looked at around the canvas
_REACH = 0.012  # metres that a motion is searched for
_DIM = 0.02  # linear light that is added before logarithms are taken: the camera's noise
_NOISE = 0.1  # logarithm of light within which a pixel looks as it should
_GRAINY = 4.0  # times the usual square of a difference is still noise
_SOFTEST = 0.8  # the same, where a search begins
_BESIDE = 0.006  # metres that strokes may lie beside where they were sent, at most
_CHANGED = 0.04  # logarithm of light from which strokes are said to have changed a pixel
_SPREAD = 0.15  # logarithm of light by which paint looks lighter or darker than it was rendered
_SMOOTHNESS = 0.7  # pixels, standard deviation, so that between pixels a picture is as smooth as on them
_RIM = 4  # pixels on either side of the edge of the canvas, in which its blur shows
_BLUR = 0.8  # pixels, standard deviation of that
_WITNESSES, _WIDEST = 20, 12  # along the shorter side of a view, squares that have one voice each; pixels of one
_FAINT, _LOUD = (
    1 / 15,
    4 / 15,
)  # of the side of a witness, in pixels that it finds explained worse: hardly counts; fully
_MURMUR = 0.02  # of the pixels of a witness: no voice
_STRANGE = 0.5  # how badly a canvas is explained on which a person may have painted anything
_PATCH = 13  # pixels of a square that looks otherwise all over, as no motion makes it
_LIGHT_CELL = 10  # pixels along the side of a square by which light is compared

MAX_SHIFT = 0.00125
"""Metres that a corner of the canvas may have moved."""
MAX_TURN = math.radians(0.4)
"""Radians that the canvas may have turned."""
_SURE = 3.0  # standard deviations by which witnesses agree
_SURE_STILL = 2.0
_WELL_WITHIN = 0.5  # of what is allowed: a canvas was moved if no such motion explains a photograph as well

Pixels = NDArray[np.float32]


class Verdict(Enum):
    """What a registration says of the canvas."""

    STILL = "it lies where it lay"
    MOVED = "it was moved"
    UNSURE = "it cannot be told"


@dataclass(frozen=True)
class Motion:
    """A motion in the plane of the canvas.

    right, down: metres; turn: radians, clockwise as seen; growth: natural logarithm of how much larger all became.
    """

    right: float = 0.0
    down: float = 0.0
    turn: float = 0.0
    growth: float = 0.0

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> Self:
        """From its four numbers, [4]."""
        return cls(*(float(value) for value in values))

    @property
    def values(self) -> NDArray[np.float64]:
        """Its four numbers [4]."""
        return np.array([self.right, self.down, self.turn, self.growth])

    def corner_shift(self, size: CanvasSize) -> float:
        """Metres that the corner moves that moves farthest."""
        x, y = size.width / 2, size.height / 2
        return max(math.hypot(*self._move(right, down)) for right in (-x, x) for down in (-y, y))

    def size(self, size: CanvasSize) -> float:
        """How large it is: 1 where a corner moves, or all turns, by as much as is allowed."""
        return max(self.corner_shift(size) / MAX_SHIFT, abs(self.turn) / MAX_TURN)

    def followed_by(self, later: "Motion") -> Self:
        """Both, one after the other; they are small, and so their order does not matter."""
        return self.of(self.values + later.values)

    def to_source(self, center: tuple[float, float], pitch: float) -> NDArray[np.float64]:
        """Where what is at a pixel (column, row) afterwards was before: a matrix [2, 3]."""
        scale = math.exp(-self.growth)
        cos, sin = scale * math.cos(self.turn), scale * math.sin(self.turn)
        back = np.array([[cos, sin], [-sin, cos]])
        middle = np.array(center)
        shift = np.array([self.right, self.down]) / pitch
        return np.c_[back, middle - back @ (middle + shift)]

    def _move(self, right: float, down: float) -> tuple[float, float]:
        scale = math.exp(self.growth)
        cos, sin = scale * math.cos(self.turn), scale * math.sin(self.turn)
        return cos * right - sin * down + self.right - right, sin * right + cos * down + self.down - down


@dataclass(frozen=True)
class Registration:
    """What became of a canvas since it was photographed before, by which it is judged with what it had moved then.

    motion: the likeliest; deviation: standard deviations of its four numbers; evidence: by how many standard
    deviations witnesses agree that it moved (above 0) or lies still (below 0).
    """

    verdict: Verdict
    motion: Motion
    deviation: Motion
    evidence: float


@dataclass(frozen=True)
class CanvasView:
    """The plane of the canvas, a little of the table around it included, as a camera sees it.

    grid: of the canvas alone; column, row [rows, columns] float32: where each of its pixels lies in a photograph;
    canvas, seen [rows, columns] bool: which are on the canvas, and in the photograph; smoothing: pixels of the
    photograph that make one of these; pitch: metres of one.
    """

    grid: PixelGrid
    column: Pixels
    row: Pixels
    canvas: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    smoothing: int
    pitch: float

    @classmethod
    def of(cls, calibration: Calibration, size: CanvasSize) -> Self:
        """By a calibration record."""
        sides = np.linalg.norm(np.roll(calibration.corners, -1, 0) - np.array(calibration.corners), axis=1)
        finest = 2 * (size.width + size.height) / float(sides.sum())  # a pixel of the photograph
        pitch = max(finest, min(COARSEST, size.width / _ROWS, size.height / _ROWS))
        around = round(_AROUND / pitch)
        grid = PixelGrid(size, round(size.height / pitch), round(size.width / pitch))
        down, across = np.arange(-around, grid.rows + around), np.arange(-around, grid.columns + around)
        place = np.stack(np.meshgrid(across, down), -1).astype(np.float64)
        seen = photographed_pixels(place.reshape(-1, 2), calibration, grid).reshape(place.shape)
        rows, columns = calibration.photograph
        in_sight = np.asarray(((seen >= 0) & (seen <= (columns - 1, rows - 1))).all(2), np.bool_)  # NaN: not
        canvas = np.asarray(((place >= 0) & (place < (grid.columns, grid.rows))).all(2), np.bool_)
        column, row = np.nan_to_num(seen, nan=-1.0).astype(np.float32).transpose(2, 0, 1)
        return cls(
            grid,
            np.ascontiguousarray(column),
            np.ascontiguousarray(row),
            canvas,
            in_sight,
            2 * int(pitch / finest / 2) + 1,
            pitch,
        )

    def light(self, photograph: NDArray[np.uint8]) -> Pixels:
        """The logarithm of light [rows, columns, 3] in a photograph [H, W, 3] uint8 sRGB."""
        smooth = cv2.blur(light_of_bytes(photograph), (self.smoothing, self.smoothing))
        seen = cv2.remap(smooth, self.column, self.row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(np.log(cv2.GaussianBlur(seen, (0, 0), _SMOOTHNESS) + _DIM), np.float32)

    def around(self, picture: Pixels) -> Pixels:
        """A picture of the canvas [rows, columns, ...] of the grid in this view, its margin repeated around it."""
        beyond = (self.canvas.shape[0] - self.grid.rows) // 2
        return np.asarray(cv2.copyMakeBorder(picture, *(beyond,) * 4, cv2.BORDER_REPLICATE), np.float32)


@dataclass(frozen=True)
class _Scene:
    """One photograph, and what is expected in it, at one fineness.

    seen, expected: logarithm of light [rows, columns, 3]; known: where both can be compared; canvas: where the canvas
    is expected; touched: where strokes came since; as_paint: how badly a pixel is explained by these strokes, [0, 1];
    rim: where the edge of the canvas is blurred into them; grain: square of the camera's noise, to which a picture
    that is moved by parts of a pixel, and so smoothed, must owe nothing.
    """

    seen: Pixels
    expected: Pixels
    known: Pixels
    canvas: Pixels
    touched: Pixels
    as_paint: Pixels
    rim: Pixels
    grain: Pixels
    pitch: float

    def coarser(self) -> "_Scene":
        """The same with half as many rows and columns."""
        rows, columns = self.canvas.shape
        arrays = {
            name: np.asarray(cv2.resize(each, (columns // 2, rows // 2), interpolation=cv2.INTER_AREA), np.float32)
            for name in ("seen", "expected", "known", "canvas", "touched", "as_paint", "rim", "grain")
            for each in (getattr(self, name),)
        }
        return replace(self, **arrays, pitch=self.pitch * 2)

    def misfit(self, motion: Motion, noise: float = _NOISE) -> Pixels:
        """How badly each pixel is explained by a motion, [rows, columns], from 0 to 1."""
        expected, canvas, known, touched = self._moved(motion)
        misfit = _misfit(self.seen - expected, noise, self.grain)
        on_table = canvas <= 0.5
        lies_still = on_table & (self.canvas <= 0.5)  # the table need not have gone with the canvas
        misfit = np.where(lies_still, np.minimum(misfit, _misfit(self.seen - self.expected, noise, self.grain)), misfit)
        misfit = np.where(~on_table & (touched > 0), np.minimum(misfit, self.as_paint), misfit)
        return np.asarray(misfit * (known > 0.99), np.float32)

    def refine(
        self, motion: Motion, noises: tuple[float, ...], *, grows: bool = True
    ) -> tuple[Motion, NDArray[np.float64]]:
        """The motion near that one by which most is explained, and the covariance of its four numbers [4, 4].

        grows: whether another growth than that of `motion` is looked for.
        Robust least squares, in which what does not fit counts less and less (Geman and McClure).
        """
        step = np.array([0.3 * self.pitch, 0.3 * self.pitch, 0.5 * self.pitch / 0.2, 0.5 * self.pitch / 0.2])
        loose = np.diag(step**-2) * 1e-3
        covariance = np.linalg.inv(loose)
        for noise in noises:
            expected, _, known, touched = self._moved(motion)
            off = self.seen - expected
            weight = (noise**2 / ((off**2).mean(2) + noise**2)) ** 2 * (known > 0.99)
            weight[(touched > 0) & (self._warped(self.rim, motion) < 0.5)] = 0
            slope = np.zeros((*off.shape, 4), np.float32)
            for number in range(4 if grows else 3):
                change = np.zeros(4)
                change[number] = step[number]
                slope[..., number] = self._warped(self.expected, Motion.of(motion.values + change)) - expected
            slope[weight <= 0] = 0
            chosen = weight > 1e-4
            j, r, w = slope[chosen], off[chosen], weight[chosen]
            weighted = j * w[:, None, None]
            normal = np.einsum("pci,pcj->ij", weighted, j).astype(np.float64) + loose * step[:, None] * step
            pull = np.einsum("pci,pc->i", weighted, r).astype(np.float64)
            way = np.linalg.solve(normal, pull) * step
            motion = Motion.of(motion.values + way)
            voices = self._voices(np.einsum("rcki,rck->rci", slope, off) * weight[..., None])
            spread = np.linalg.inv(normal)
            covariance = step[:, None] * (spread @ (voices.T @ voices) @ spread) * step
        return motion, np.asarray(covariance, np.float64)

    def votes(self, better: Motion, worse: Motion) -> float:
        """By how many standard deviations witnesses agree that one motion explains the photograph better."""
        voices = self._voices((self.misfit(worse) - self.misfit(better))[..., None])[:, 0]
        murmur = _MURMUR * self._witness**2
        voices = np.sign(voices) * np.maximum(np.abs(voices) - murmur, 0)
        loud = np.tanh(voices / (_LOUD * self._witness))
        return float(loud.sum() / math.sqrt((loud**2).sum() + (_FAINT / _LOUD) ** 2))

    @property
    def _witness(self) -> int:
        """Pixels along the side of a witness."""
        return min(_WIDEST, max(2, min(self.canvas.shape) // _WITNESSES))

    def _voices(self, each: NDArray[np.float32]) -> NDArray[np.float64]:
        """Sums over squares of pixels [rows, columns, k]: [squares, k]."""
        rows, columns, k = each.shape
        side = self._witness
        high, wide = -(-rows // side), -(-columns // side)
        padded = np.zeros((high * side, wide * side, k), np.float64)
        padded[:rows, :columns] = each
        return padded.reshape(high, side, wide, side, k).sum((1, 3)).reshape(-1, k)

    def _moved(self, motion: Motion) -> tuple[Pixels, Pixels, Pixels, Pixels]:
        expected = self._warped(self.expected, motion)
        canvas = self._warped(self.canvas, motion)
        known = self._warped(self.known, motion) * (self.known > 0.99)
        touched = self._warped(self.touched, motion)
        return expected, canvas, known, touched

    def _warped(self, picture: Pixels, motion: Motion) -> Pixels:
        rows, columns = self.canvas.shape
        matrix = motion.to_source(((columns - 1) / 2, (rows - 1) / 2), self.pitch)
        return np.asarray(
            cv2.warpAffine(
                picture,
                matrix,
                (columns, rows),
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_REPLICATE,
            ),
            np.float32,
        )


def register(
    view: CanvasView,
    seen: Pixels,
    before: Pixels,
    strokes: tuple[Pixels, Pixels] | None = None,
    drift: Motion = Motion(),
) -> Registration:
    """How the canvas lies in a photograph, against one before, both as CanvasView.light has them.

    Where not even the photograph before would tell a motion, a canvas that shows none lies still: nobody is asked again
    and again. strokes: the canvas before, and as the strokes since then make it, linear light [rows, columns, 3] of the
    view's grid; None where a person may have painted anything; drift: by how much it had moved before.
    """
    scene = _scene(view, seen, before, strokes)
    size = view.grid.size
    best, covariance = _best(scene, size)
    deviation = Motion.of(np.sqrt(np.maximum(np.diag(covariance), 0)))
    whole = drift.followed_by(best)
    how_large = whole.size(size) / max(1.0, view.pitch / MAX_SHIFT)  # large pixels tell of no smaller motion
    if how_large > 1:
        back = Motion.of(best.values - (1 - _WELL_WITHIN / how_large) * whole.values)
        still = min((back, Motion()), key=lambda each: float(scene.misfit(each).sum()))
        evidence = scene.votes(best, still)
        verdict = Verdict.MOVED if evidence >= _SURE else Verdict.UNSURE
        return Registration(verdict, best, deviation, evidence)
    evidence = _stillness(scene, best, size)
    sure = evidence >= _SURE_STILL or _stillness(_scene(view, before, before, None), Motion(), size) < _SURE_STILL
    return Registration(Verdict.STILL if sure else Verdict.UNSURE, best, deviation, -evidence)


def _stillness(scene: _Scene, best: Motion, size: CanvasSize) -> float:
    """By how many standard deviations witnesses agree, at least, that the best motion is better than larger ones."""
    return min(scene.votes(best, best.followed_by(rival)) for rival in _rivals(size))


def _rivals(size: CanvasSize) -> list[Motion]:
    """Motions a little larger than is allowed: a canvas lies still where none of them explains a photograph as well."""
    far = 1.2 * MAX_SHIFT
    shifts = [Motion(far * math.cos(angle), far * math.sin(angle)) for angle in np.arange(8) * math.pi / 4]
    turn = far / math.hypot(size.width / 2, size.height / 2)
    return [*shifts, Motion(turn=turn), Motion(turn=-turn)]


def _best(fine: _Scene, size: CanvasSize) -> tuple[Motion, NDArray[np.float64]]:
    """The motion by which most of the photograph is explained, found from coarse to fine, and its covariance."""
    coarse = fine.coarser()
    step = 2 * max(coarse.pitch, _REACH / 6)
    count = int(_REACH / step)
    grid = [Motion(step * x, step * y) for x in range(-count, count + 1) for y in range(-count, count + 1)]
    reach = math.hypot(size.width, size.height) / 2
    grid += [Motion(turn=way * 2 * step / reach) for way in (-3, -2, -1, 1, 2, 3)]
    grid += [Motion(growth=way * 2 * step / reach) for way in (-3, -2, -1, 1, 2, 3)]
    ranking = np.argsort([float(coarse.misfit(motion, _SOFTEST / 3).sum()) for motion in grid])
    starts = [Motion()] if grid[ranking[0]] == Motion() else [Motion(), *(grid[at] for at in ranking[:3])]
    found = []
    for start in starts:
        noises: tuple[float, ...] = (_SOFTEST, _SOFTEST, _SOFTEST / 2, _SOFTEST / 2, _SOFTEST / 4, _NOISE)
        motion, _ = coarse.refine(start, noises, grows=start.growth != 0)
        found.append(motion if motion.corner_shift(size) < 2 * _REACH else start)
    coarsely = min(found, key=lambda motion: float(fine.misfit(motion).sum()))
    closer = (_SOFTEST / 4, _NOISE, _NOISE, _NOISE)
    known = [fine.refine(start, closer, grows=start.growth != 0) for start in dict.fromkeys((coarsely, Motion()))]
    known.append(fine.refine(min(known, key=lambda each: float(fine.misfit(each[0]).sum()))[0], closer[1:]))
    loss = {Motion(): (float(fine.misfit(Motion()).sum()), known[-1][1])}
    loss |= {motion: (float(fine.misfit(motion).sum()), covariance) for motion, covariance in known}
    best = min(loss, key=lambda motion: loss[motion][0])
    rival = min((best.followed_by(each) for each in _rivals(size)), key=lambda motion: float(fine.misfit(motion).sum()))
    if float(fine.misfit(rival).sum()) < loss[best][0]:
        motion, covariance = fine.refine(rival, (_SOFTEST / 4, _NOISE, _NOISE, _NOISE))
        loss |= {each: (float(fine.misfit(each).sum()), covariance) for each in (rival, motion)}
        best = min(loss, key=lambda motion: loss[motion][0])
    return best, loss[best][1]


def _scene(view: CanvasView, seen: Pixels, expected: Pixels, strokes: tuple[Pixels, Pixels] | None) -> _Scene:
    known = view.seen.astype(np.float32)
    canvas = view.canvas.astype(np.float32)
    touched = np.zeros_like(canvas)
    as_paint = np.ones_like(canvas)
    if strokes is not None:
        change = view.around(np.asarray(np.log(strokes[1] + _DIM) - np.log(strokes[0] + _DIM), np.float32))
        is_changed = ((np.abs(change) > _CHANGED).any(2) & view.canvas).astype(np.uint8)
        around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * round(_BESIDE / view.pitch) + 1,) * 2)
        touched = cv2.dilate(is_changed, around).astype(np.float32) * canvas
    else:
        even = seen - _lamps(seen - expected, known * (1 - canvas))
        is_other = (np.abs(even - expected).max(2) > 2 * _NOISE).astype(np.uint8)
        patch = cv2.morphologyEx(is_other * view.canvas, cv2.MORPH_OPEN, np.ones((_PATCH, _PATCH), np.uint8))
        touched = cv2.dilate(patch, np.ones((_PATCH, _PATCH), np.uint8)).astype(np.float32) * canvas
    seen = seen - _lamps(seen - expected, known * (touched <= 0))
    if strokes is None:
        as_paint = np.where(touched > 0, _STRANGE, 1).astype(np.float32)
    else:
        ring = cv2.dilate((1 - canvas).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        low, high = expected.copy(), expected.copy()
        for colors in (expected, expected + change):
            inside = np.where(view.canvas[..., None], colors, np.inf)
            low = np.minimum(low, cv2.erode(inside.astype(np.float32), around))
            outside = np.where(view.canvas[..., None], colors, -np.inf)
            high = np.maximum(high, cv2.dilate(outside.astype(np.float32), around))
        beyond = np.maximum(np.maximum(low - _SPREAD - seen, seen - high - _SPREAD), 0)
        as_paint = np.where(touched > 0, _misfit(beyond, _NOISE), 1).astype(np.float32)
        as_paint[ring & (touched > 0)] = 0
    grain = np.zeros_like(canvas)
    for where in (view.canvas, ~view.canvas):
        as_before = where & (known > 0) & (touched <= 0)
        if as_before.any():  # faint light on a bright canvas is another share of it than on a dark table
            seen[where] -= np.median((seen - expected)[as_before], axis=0)
            alike = ((seen - expected) ** 2).mean(2)[as_before]
            grain[where] = min(_GRAINY * float(np.median(alike)), (_NOISE / 2) ** 2)
    expected, is_rim = _with_rim(view, seen, expected, touched)
    return _Scene(seen.astype(np.float32), expected, known, canvas, touched, as_paint, is_rim, grain, view.pitch)


def _with_rim(view: CanvasView, seen: Pixels, expected: Pixels, touched: Pixels) -> tuple[Pixels, Pixels]:
    """What is expected, with the new colour of the canvas in the blur of its edge where that was painted, and where.

    The colour is that which is seen a little farther in: there alone a stroke that lies beside its place changes it.
    """
    composed, is_rim = expected.copy(), np.zeros_like(touched)
    share = cv2.GaussianBlur(view.canvas.astype(np.float32), (0, 0), _BLUR)[..., None]
    down, across = np.flatnonzero(view.canvas.any(1)), np.flatnonzero(view.canvas.any(0))
    for axis, inside in ((0, down), (1, across)):
        for edge, inwards in ((inside[0], 1), (inside[-1], -1)):
            at = edge + inwards * np.arange(-_RIM, _RIM)
            within, beyond = edge + inwards * (_RIM + 1), edge - inwards * (_RIM + 2)
            strip, paint, table = ((slice(None),) * axis + (which,) for which in (at, [within], [beyond]))
            light = share[strip] * np.exp(seen[paint]) + (1 - share[strip]) * np.exp(expected[table])
            is_new = np.broadcast_to(touched[paint] > 0, is_rim[strip].shape)
            composed[strip] = np.where(is_new[..., None], np.log(light), composed[strip])
            is_rim[strip] = np.where(is_new, 1, is_rim[strip])
    return composed, is_rim


def _lamps(change: Pixels, weight: Pixels) -> Pixels:
    """How much brighter the lamps became, as a plane over the view, logarithm of light [rows, columns, 3]."""
    rows, columns = weight.shape
    small = (max(2, columns // _LIGHT_CELL), max(2, rows // _LIGHT_CELL))
    share = cv2.resize(weight, small, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(change * weight[..., None], small, interpolation=cv2.INTER_AREA) / (share[..., None] + 1e-6)
    usable = share > 0.5
    if usable.sum() < 8:
        return np.zeros_like(change)
    down, across = np.meshgrid(np.linspace(-1, 1, small[1]), np.linspace(-1, 1, small[0]), indexing="ij")
    terms = np.stack((np.ones(usable.sum()), down[usable], across[usable]), 1)
    plane = np.empty_like(change)
    rows_at, columns_at = np.linspace(-1, 1, rows)[:, None], np.linspace(-1, 1, columns)
    for band in range(3):
        values = mean[usable][:, band].astype(np.float64)
        trust = np.ones(len(values))
        start = np.array([np.median(values), 0.0, 0.0])
        for _ in range(6):
            off = np.abs(terms @ start - values)
            trust = 1 / (1 + (off / (3 * np.median(off) + 0.01)) ** 2) ** 2
            root = np.sqrt(trust)
            start = np.linalg.lstsq(root[:, None] * terms, root * values, rcond=None)[0]
        plane[..., band] = start[0] + start[1] * rows_at + start[2] * columns_at
    return plane


def _misfit(off: Pixels, noise: float, grain: Pixels | float = 0.0) -> Pixels:
    """How little a difference of light [..., 3] looks like noise, [...], from 0 to 1; none up to `grain`, a square."""
    square = np.maximum((off**2).mean(-1) - grain, 0)
    return np.asarray(square / (square + noise**2), np.float32)
