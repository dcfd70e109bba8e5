"""Check that a photograph shows the canvas properly before it is used for decisions, with a reason if not.

The sharpness of the canvas edges comes from a first good photograph. The position comes from the last good one:
each photograph is registered with it. The content is compared with the expectation. At a place without new
strokes nothing may have changed. At a place with new strokes it may look as before, as planned, or in between.
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import FrameDoubtful, FrameRejected
from frida_painter.perception.flatfield import read_margin
from frida_painter.perception.rectify import pixels_per_metre
from frida_painter.perception.registration import (
    COARSEST,
    TELLS,
    CanvasShift,
    CanvasView,
    Pixels,
    Registration,
    Verdict,
    find_widening,
    register,
    trace_sides,
)
from frida_painter.strokes.palette import to_lab
from frida_painter.system import images
from frida_painter.system.images import to_linear

_TELLABLE = 0.5  # share of a large pixel
_REACH = 0.012  # metres around the canvas edge that are searched
_MAX_BLUR = 0.75  # largest widening of the edge, in pixels
_BLURRED = 0.0008  # and in metres; the larger one counts
_LIGHT = (0.7, 1.4)  # allowed light relative to the expectation, median over all places
_CLIPPED = 253  # bytes
_MAX_CLIPPED = 0.02  # more of the canvas than in the good photograph
_PLACES = 48  # along each side, at which the light beside the canvas is compared
_BESIDE_EDGE = (0.006, 0.012)  # metres from the edge; a canvas that was bumped lies nearer
_DIMMEST = 0.01  # linear light: the camera's noise
_OTHER_LIGHT = 0.3  # natural logarithm of the light beside the edge, relative to that of all places
_MAX_COVERED = 0.015  # metres along the edge

_CELL = 0.006  # metres; side of the squares in which the canvas is compared
_BESIDE = 2  # squares
_A_CHANGE = 6.0  # CIELAB; larger planned differences count as a change
_LIKE_BEFORE, _LIKE_PLANNED = 8.0, 30.0  # CIELAB; larger differences are unexplained
_MAX_UNEXPLAINED = 0.0009  # m2 in one piece: a square of 3 cm


class Motions(NamedTuple):
    """Motions of the canvas from the first photograph to the last one.

    drift: as registered
    slid: by what no stroke can have changed, with printed markers
    told: what was last told to people
    """

    drift: CanvasShift = CanvasShift()
    slid: CanvasShift = CanvasShift()
    told: CanvasShift = CanvasShift()


@dataclass(frozen=True)
class Expected:
    """Expected pictures of the canvas, [3, H, W] each.

    before: the canvas as last seen
    after: the same with the strokes painted since then
    """

    before: Tensor
    after: Tensor

    def changes(self, size: CanvasSize) -> bool:
        """Returns True if the strokes should change something."""
        return bool(((_cells(self.after, size) - _cells(self.before, size)).norm(dim=0) > _A_CHANGE).any())

    def strange(self, seen: Tensor, size: CanvasSize) -> Tensor:
        """Returns the mask [rows, columns] of squares that look unlike both pictures and unlike any mixture of them.

        seen [3, H, W]: the canvas now
        Strokes may lie up to two squares from their intended place.
        """
        before, after, now = (_cells(picture, size) for picture in (self.before, self.after, seen))
        changed = ((after - before).norm(dim=0) > _A_CHANGE).float()
        changed = functional.max_pool2d(changed[None], 2 * _BESIDE + 1, 1, _BESIDE)[0] > 0
        rows, columns = changed.shape
        around = functional.unfold(
            functional.pad(after[None], (_BESIDE,) * 4, mode="replicate"), 2 * _BESIDE + 1
        )  # [1, 3 k, rows x columns]
        way = around.reshape(3, -1, rows, columns) - before[:, None]  # [3, k, rows, columns]
        gone = now - before
        share = (gone[:, None] * way).sum(0) / (way.square().sum(0) + 1e-6)
        off = (gone[:, None] - share.clamp(0, 1) * way).norm(dim=0).amin(0)
        return torch.where(changed, off > _LIKE_PLANNED, gone.norm(dim=0) > _LIKE_BEFORE)


@dataclass(frozen=True)
class FrameCheck:
    """Reference for the photographs of one camera and one canvas.

    widths [4, places]: pixels of the step at the canvas's edges; NaN if it is not visible
    margin [places, 3]: linear light around the canvas
    clipped: share of the canvas that is overexposed
    view: plane of the canvas as the camera sees it
    last: last good photograph in that view, from CanvasView.light
    motions: of the canvas since the first photograph
    """

    calibration: Calibration
    size: CanvasSize
    widths: NDArray[np.float64] = field(repr=False)
    margin: NDArray[np.float64] = field(repr=False)
    clipped: float
    view: CanvasView = field(repr=False)
    last: Pixels = field(repr=False)
    motions: Motions = field(default_factory=Motions)

    @classmethod
    def learn(
        cls,
        photograph: NDArray[np.uint8],
        calibration: Calibration,
        size: CanvasSize,
        last: NDArray[np.uint8] | None = None,
    ) -> Self:
        """Returns the reference from a photograph [rows, columns, 3] with the canvas at its calibrated place.

        last: a later photograph of the same canvas; None if there is none
        """
        view, clipped = CanvasView.of(calibration, size), _clipped_share(photograph, calibration)
        widths, margin = _widths(photograph, calibration, size), _margin(photograph, calibration, size)
        last_light = view.light(photograph if last is None else last)
        return cls(calibration, size, widths, margin, clipped, view, last_light)

    def require(
        self, photograph: NDArray[np.uint8], seen: Tensor, expected: Expected | None, *, doubtful: bool = False
    ) -> Self:
        """Checks a photograph and returns the new reference. Raises FrameRejected with the reason if it is not usable.

        seen [3, H, W]: rectified canvas of the photograph in true colours
        expected: None if a person may have painted too, so that any content is allowed
        doubtful: True to count the canvas as unmoved if the motion is uncertain; False to raise FrameDoubtful
        """
        if expected is not None:
            self._require_light(seen, expected)
        if not _clipped_share(photograph, self.calibration) <= self.clipped + _MAX_CLIPPED:
            raise FrameRejected(
                "The photograph is blown out: parts of the canvas are as bright as the camera can tell. Take glare off "
                "the canvas, bring less light, or expose shorter."
            )
        pixels = pixels_per_metre(self.calibration, self.size)
        blur = find_widening(_widths(photograph, self.calibration, self.size), self.widths)
        if blur > max(_MAX_BLUR, _BLURRED * pixels):
            raise FrameRejected(
                f"The photograph is blurred: the edge of the canvas is {blur:.1f} pixels wider than it was. Focus the "
                "camera, and see that nothing shakes it."
            )
        found = self.register(photograph, expected)
        covered = self._measure_covered(_margin(photograph, self.calibration, self.size))
        if covered > _MAX_COVERED:
            raise FrameRejected(
                f"Something reaches over the edge of the canvas, {covered * 100:.0f} cm wide, or the canvas was moved "
                "far. Take arms, hands and things out of the camera's sight, and put the canvas back."
            )
        whole = self.motions.drift.followed_by(found.motion)
        away = f"{whole.corner_shift(self.size) * 1000:.1f}"
        if found.verdict is Verdict.MOVED:
            raise FrameRejected(
                f"The canvas is no longer where it was: its edge is {away} mm away in the photograph "
                f"({whole.describe()}). Put {'it' if self.calibration.markers else 'canvas and camera'} back, or "
                "repeat the canvas and robot calibrations."
            )
        if expected is not None:
            self.require_explained(seen, expected)
        if not doubtful and found.verdict is Verdict.UNSURE:
            raise FrameDoubtful(
                "The photograph does not tell whether the canvas is still where it was: what can be seen of it fits a "
                f"place {away} mm away, and others. Look whether canvas or camera was moved; if neither was, go on."
            )
        # If the result is unsure, a person has confirmed the position. A camera with large pixels cannot measure
        # slow drift: paint looks like a motion of part of a pixel, and these errors would add up.
        large = self.view.pitch if self.view.pitch > COARSEST else 0.0
        tells = found.motion.corner_shift(self.size) > _TELLABLE * large
        is_drift = tells and found.verdict is not Verdict.UNSURE
        drift = self.motions.drift.followed_by(found.motion) if is_drift else self.motions.drift
        _, slid, told = self.motions
        if self.calibration.markers:  # strokes beside their places look like motions of up to 0.3 mm
            slid = slid.followed_by((found if expected is None else self.register(photograph, None)).motion)
            since = CanvasShift.of(slid.values - told.values).corner_shift(self.size)
            told = slid if since > TELLS else told
        return replace(self, last=self.view.light(photograph), motions=Motions(drift, slid, told))

    @property
    def moved(self) -> str:
        """Sentence about a small motion of the canvas; "" without one, or without printed markers.

        Only those tell it from a motion of the camera.
        """
        told = self.motions.told
        far = told.corner_shift(self.size)
        if not self.calibration.markers or not far > TELLS:
            return ""
        return (
            f"The canvas was moved under the camera by {1000 * far:.1f} mm ({told.describe()}): strokes land as "
            "far beside. Push it back, or leave it."
        )

    def register(self, photograph: NDArray[np.uint8], expected: Expected | None) -> Registration:
        """Registers a photograph [rows, columns, 3] with the last good one."""
        grid, strokes = self.view.grid, None
        if expected is not None:
            fitted = (images.fit(picture, grid.rows, grid.columns) for picture in (expected.before, expected.after))
            light = (to_linear(picture).permute(1, 2, 0).numpy() for picture in fitted)
            before, after = (np.ascontiguousarray(each, np.float32) for each in light)
            strokes = before, after
        return register(self.view, self.view.light(photograph), self.last, strokes, self.motions.drift)

    def _measure_covered(self, margin: NDArray[np.float64]) -> float:
        """Returns the greatest length in metres along the edge over which something new reaches; lamps do not count."""
        share = (margin.mean(1) + _DIMMEST) / (self.margin.mean(1) + _DIMMEST)
        strange = np.abs(np.log(share / float(np.median(share)))) > _OTHER_LIGHT
        longest = run = 0
        for place in np.concatenate((strange, strange)):  # goes on past the first corner
            run = run + 1 if place else 0
            longest = max(longest, run)
        return min(longest, len(strange)) * 2 * (self.size.width + self.size.height) / len(strange)

    def _require_light(self, seen: Tensor, expected: Expected) -> None:
        light = to_linear(images.fit(seen, *_shape(self.size))) + 0.02
        wanted = to_linear(images.fit(expected.after, *_shape(self.size))) + 0.02
        share = float((light / wanted).median())
        if not _LIGHT[0] <= share <= _LIGHT[1]:
            word = "dark" if share < 1 else "too bright"
            raise FrameRejected(
                f"The photograph is {word}: the canvas shows {100 * share:.0f} % of the light that it should. Bring "
                "back the light that was there when the painting was begun."
            )

    def require_explained(self, seen: Tensor, expected: Expected) -> None:
        """Raises FrameRejected if the canvas in the photograph shows something that was not painted."""
        strange = expected.strange(seen, self.size).numpy().astype(np.uint8)
        count, _, pieces, _ = cv2.connectedComponentsWithStats(strange, connectivity=4)
        cell = self.size.width * self.size.height / strange.size
        area = max((int(piece[cv2.CC_STAT_AREA]) for piece in pieces[1:count]), default=0) * cell
        if area > _MAX_UNEXPLAINED:
            raise FrameRejected(
                f"Something is in the way, or this is not the canvas as it was: {area * 1e4:.0f} cm2 of it show what "
                "nobody has painted. Take arms, hands and shadows out of the camera's sight."
            )


def _shape(size: CanvasSize) -> tuple[int, int]:
    return max(2, round(size.height / _CELL)), max(2, round(size.width / _CELL))


def _cells(picture: Tensor, size: CanvasSize) -> Tensor:
    """Returns the picture [3, H, W] in coarse squares, CIELAB [3, rows, columns]."""
    coarse = functional.adaptive_avg_pool2d(picture[None], _shape(size))[0]
    return to_lab(coarse.permute(1, 2, 0)).permute(2, 0, 1)


def _widths(photograph: NDArray[np.uint8], calibration: Calibration, size: CanvasSize) -> NDArray[np.float64]:
    sides = trace_sides(photograph, calibration.corners, _REACH * pixels_per_metre(calibration, size))
    return np.full((4, 1), math.nan) if sides is None else sides.widths


def _margin(photograph: NDArray[np.uint8], calibration: Calibration, size: CanvasSize) -> NDArray[np.float64]:
    return np.nan_to_num(read_margin(photograph, calibration, size, _PLACES, _BESIDE_EDGE))


def _clipped_share(photograph: NDArray[np.uint8], calibration: Calibration) -> float:
    """Returns the share of the canvas that is overexposed in all bands."""
    canvas = np.zeros(photograph.shape[:2], np.uint8)
    cv2.fillConvexPoly(canvas, np.array(calibration.corners).round().astype(np.int32), 1)
    return float((photograph.min(2)[canvas > 0] >= _CLIPPED).mean())


# Paint that was added between two looks at a canvas

_MIN_CHANGE = 7.0  # difference in CIELAB that paint makes between two looks; the camera's noise makes less
_SPECK = 2e-5  # share of the picture; a smaller change is noise


MARK = 1e-4
"""Share of the picture; smaller changes may be the rims of older marks, which no two photographs show the same."""


def find_painted(before: Tensor, after: Tensor, least: float = _SPECK) -> NDArray[np.bool_]:
    """Returns a mask [H, W]: True for a pixel with added paint.

    before, after: pictures of a canvas, [3, H, W].
    least: share of the picture; a smaller connected change is left out. If nothing else is known of the paint: MARK.
    """
    lab = [to_lab(picture.permute(1, 2, 0)).numpy() for picture in (before, after)]
    smooth = [cv2.GaussianBlur(each, (0, 0), max(0.8, each.shape[0] / 540)) for each in lab]
    mask = (np.linalg.norm(smooth[1] - smooth[0], axis=-1) > _MIN_CHANGE).astype(np.uint8)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    large = [number for number in range(1, count) if facts[number, cv2.CC_STAT_AREA] >= max(4, least * mask.size)]
    return np.isin(labels, large)
