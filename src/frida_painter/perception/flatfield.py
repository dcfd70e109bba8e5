"""Flat field: uneven light and colour cast, learned from the bare canvas and removed from photographs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from frida_painter.calibration import BareCanvas, Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError, FrameRejected
from frida_painter.frames import PixelGrid
from frida_painter.perception.rectify import photographed_pixels, rectified_pixels, rectify, require_photograph
from frida_painter.strokes.palette import to_lab
from frida_painter.strokes.plan import WHITE
from frida_painter.system.images import light_of_bytes, to_linear, to_srgb

_DEGREE = 4
_PAIRS = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]  # degrees (down, across) of the terms
_ROUNDS = 4
_DIMMEST = 0.05
_MAX_CLIPPED = 0.2
_MAX_RESIDUAL = 0.06
_SAMPLES = 128
_RENEWING_SAMPLES = 40
_RENEWING_DEGREE = 3
_MIN_BARE = 0.05
_MIN_FREE = 0.1


@dataclass(frozen=True)
class FlatField:
    """Brightness of the light on the canvas for each band, as a smooth surface.

    logarithm [3, terms]: coefficients of a polynomial in the canvas coordinates (across, down), each in [-1,
    1]. Its value is the logarithm of linear light that the camera sees from a white canvas. Linear light is the
    product of light and canvas, so the two can be separated.
    """

    logarithm: Tensor

    @classmethod
    def of(cls, coefficients: Sequence[Sequence[float]]) -> Self:
        """Returns the field with these coefficients [3, terms]. Raises ValueError if they have another shape."""
        logarithm = torch.tensor(coefficients)
        if logarithm.shape != (3, len(_PAIRS)):
            raise ValueError(f"the light is of shape {tuple(logarithm.shape)}")
        return cls(logarithm)

    @classmethod
    def even(cls) -> Self:
        """Returns even white light."""
        return cls(torch.zeros(3, len(_PAIRS)))

    @classmethod
    def learn(cls, bare: Tensor, ground: tuple[float, float, float], free: Tensor | None = None) -> Self:
        """Learns the field from a rectified photograph of the bare canvas.

        bare [3, H, W]: the photograph, sRGB
        ground: true colour of the canvas, sRGB
        free [H, W]: 1 for a pixel on which nothing lies, else 0; None if nothing lies on the canvas
        Specks and pencil lines do not matter. Raises FrameRejected if the photograph is too dark or
        overexposed, or the canvas is not bare.
        """
        step = [max(1, side // _SAMPLES) for side in bare.shape[1:]]
        pooled = functional.avg_pool2d(to_linear(bare)[None], step)[0].double()  # [3, h, w]
        if not float(pooled.median()) >= _DIMMEST:
            raise FrameRejected("The photograph of the bare canvas is too dark; bring more light.")
        if not float((bare >= 1).double().mean()) <= _MAX_CLIPPED:
            raise FrameRejected("The photograph of the bare canvas is overexposed; bring less light or expose shorter.")
        seen = pooled.flatten(1).clamp(min=1e-4).log()  # [3, samples]
        terms = _terms(*pooled.shape[1:]).to(seen)  # [samples, terms]
        if free is not None:
            known = (functional.avg_pool2d(free[None].float(), step)[0] == 1).flatten()
            shows = float(known.double().mean())
            if not shows >= _MIN_FREE:
                raise FrameRejected(
                    f"What lies on the canvas covers all but {shows:.0%} of it, and {_MIN_FREE:.0%} must show, for the "
                    "light is judged by it; lay it further aside, or take a smaller one."
                )
            seen, terms = seen[:, known], terms[known]
        logarithm, residual = fit_robustly(terms, seen)
        if not residual <= _MAX_RESIDUAL:
            raise FrameRejected(
                f"The canvas does not look bare: {100 * residual:.0f} % of its light does not fit a smooth surface, "
                f"and {100 * _MAX_RESIDUAL:.0f} % is allowed; put up a bare canvas, or say --on-canvas to "
                "paint on what is there."
            )
        logarithm[:, 0] -= to_linear(torch.tensor(ground, dtype=seen.dtype)).clamp(min=1e-3).log()
        return cls(logarithm.float())

    def refit(self, light: Tensor, bare: Tensor, ground: tuple[float, float, float]) -> Self:
        """Returns the field of a later photograph of the same canvas, of which only parts are still bare.

        light [3, H, W]: the later photograph, rectified, linear light
        bare [H, W]: mask of the bare ground
        ground: true colour of the ground, sRGB
        Only broad changes are followed: brightness, colour, direction of the light. If less than a twentieth is
        bare, the field stays as it is.
        """
        step = [max(1, side // _RENEWING_SAMPLES) for side in bare.shape]
        share = functional.avg_pool2d(bare[None].to(light), step)[0]  # [h, w]
        known = (share > 0.5).flatten()
        if not float(known.double().mean()) >= _MIN_BARE:
            return self
        white = self.light(*share.shape).to(light) * to_linear(torch.tensor(ground).to(light))[:, None, None]
        mean = functional.avg_pool2d(light * bare, step) / share.clamp(min=1e-3)
        seen = (mean / white).flatten(1)[:, known].double().clamp(min=1e-4).log()  # [3, samples]
        broad = torch.tensor([i + j <= _RENEWING_DEGREE for i, j in _PAIRS])
        terms = _terms(*share.shape).to(seen)[known][:, broad]  # [samples, terms]
        logarithm = self.logarithm.clone()
        logarithm[:, broad] += fit_robustly(terms, seen)[0].to(logarithm)
        return type(self)(logarithm)

    def fit_tilt(self, change: Tensor, down: Tensor, across: Tensor) -> tuple[Self, float]:
        """Returns the field after a change of the light, and the mean deviation of the places from it.

        change [3, places]: logarithm of the change of brightness for each band
        down, across [places]: coordinates of the places, -1 to 1 over the canvas and a little outside
        Changes of brightness, colour and a tilt to one side are followed.
        """
        tilt = [_PAIRS.index(pair) for pair in ((0, 0), (1, 0), (0, 1))]
        coefficients, residual = fit_robustly(torch.stack((torch.ones_like(down), down, across), 1).to(change), change)
        logarithm = self.logarithm.clone()
        logarithm[:, tilt] += coefficients.to(logarithm)
        return type(self)(logarithm), residual

    def light(self, rows: int, columns: int) -> Tensor:
        """Returns the linear light that the camera sees from a white canvas: [3, rows, columns]."""
        down, across = _chebyshev(rows).float(), _chebyshev(columns).float()
        grid = self.logarithm.new_zeros(3, _DEGREE + 1, _DEGREE + 1)
        for term, (i, j) in enumerate(_PAIRS):
            grid[:, i, j] = self.logarithm[:, term]
        return (down.T @ grid @ across).exp()

    def correct(self, picture: Tensor) -> Tensor:
        """Returns the rectified photograph [3, H, W] as in even white light, sRGB in [0, 1]."""
        return to_srgb(to_linear(picture) / self.light(*picture.shape[1:]).to(picture))


def fit_robustly(terms: Tensor, seen: Tensor) -> tuple[Tensor, float]:
    """Returns coefficients [3, terms] of values [3, samples], and the mean residual.

    The fit is by least squares with falling weights of outliers.
    """
    weight = torch.ones_like(seen)
    for _ in range(_ROUNDS):
        root = weight.sqrt()[..., None]
        coefficients = torch.linalg.lstsq(root * terms, root * seen[..., None]).solution[..., 0]
        off = (coefficients @ terms.T - seen).abs()
        usual = off.median(1, keepdim=True).values + 1e-3
        weight = 1 / (1 + (off / (3 * usual)) ** 2) ** 2
    return coefficients, float(off.mean())


def _terms(rows: int, columns: int) -> Tensor:
    """Returns products of Chebyshev polynomials up to the degree at each pixel centre: [rows x columns, terms]."""
    down, across = _chebyshev(rows), _chebyshev(columns)
    return torch.stack([(down[i][:, None] * across[j]).flatten() for i, j in _PAIRS], 1)


def _chebyshev(count: int) -> Tensor:
    """Returns the Chebyshev polynomials at `count` pixel centres in [-1, 1]: [degree + 1, count]."""
    place = (torch.arange(count, dtype=torch.float64) * 2 + 1) / count - 1
    return torch.cos(torch.arange(_DEGREE + 1, dtype=place.dtype)[:, None] * torch.acos(place))


# Margin around the canvas: it shows the light if the canvas is not bare
#
# A bare white canvas shows the light directly. On a painted canvas the light is that of the bare canvas, changed
# like the margin: another brightness, another colour, or another direction.

Color = tuple[float, float, float]
_ROWS = 256
_PLACES = 12  # on each side of the canvas, for the light
_BAND = (0.004, 0.012)  # distance from the edge in metres
_ACROSS, _ALONG = 8, 9  # samples of a place
_SHOWN = 0.25  # share of a place inside the photograph
_MARGIN_DIMMEST = 0.003  # linear light; darker places show only noise
_FEWEST = 16  # places
_MARGIN_MAX_RESIDUAL = 0.1
_CELLS = 24  # rows and columns of squares in the test of a bare canvas
_UNLIKE, _MAX_TOUCHED = 9.0, 0.02  # CIELAB difference of another colour, and the largest share of specks


def bare_canvas(
    photograph: NDArray[np.uint8], calibration: Calibration, size: CanvasSize, card: NDArray[np.float64] | None = None
) -> BareCanvas:
    """Returns the light measurements of a photograph [H, W, 3] of a bare white canvas.

    card [k, 2]: outline of a card on the canvas, (column, row) in the photograph; None if there is none
    Raises FrameRejected if the photograph is unusable.
    """
    grid = PixelGrid.of_height(size, _ROWS)
    free = None
    if card is not None:
        covered = np.zeros((grid.rows, grid.columns), np.uint8)
        outline = rectified_pixels(card, calibration, grid).round().astype(np.int32)
        free = torch.from_numpy(cv2.fillPoly(covered, [outline], 1) == 0)
    light = FlatField.learn(rectify(photograph, calibration, grid), WHITE, free)
    seen = read_margin(photograph, calibration, size)
    margin = tuple(None if np.isnan(place).any() else tuple(place.tolist()) for place in seen)
    return BareCanvas(tuple(map(tuple, light.logarithm.tolist())), margin)


def light_by_margin(photograph: NDArray[np.uint8], calibration: Calibration, size: CanvasSize) -> FlatField:
    """Returns the light on a canvas with any content, from the margin now and at the time of the bare canvas.

    Raises CalibrationError if the record has no bare canvas, and FrameRejected if the margin has changed or is
    too dark.
    """
    known = calibration.bare
    if known is None:
        raise CalibrationError(
            "What the light does is learned from a bare canvas, and the calibration record knows none; put up a bare "
            "white canvas once, and repeat the canvas calibration: frida-painter calibrate canvas"
        )
    before = np.array([(np.nan,) * 3 if place is None else place for place in known.margin])
    change = np.log(read_margin(photograph, calibration, size) / before)
    usable = np.isfinite(change).all(1)
    if not usable.sum() >= _FEWEST:
        raise FrameRejected(
            f"Only {usable.sum()} of {len(usable)} places around the canvas can be seen in the photograph, and at "
            f"least {_FEWEST} tell what the light does; lay something brighter around the canvas, and leave room there."
        )
    row, column = _margin_places(size, _PLACES, _BAND).mean(1).T
    field = FlatField(torch.tensor(known.light))
    changed, residual = field.fit_tilt(
        torch.from_numpy(change[usable]).T, torch.from_numpy(row[usable]), torch.from_numpy(column[usable])
    )
    if not residual <= _MARGIN_MAX_RESIDUAL:
        raise FrameRejected(
            f"The surroundings of the canvas differ by {100 * residual:.0f} % from what they were when the canvas was "
            f"bare, and {100 * _MARGIN_MAX_RESIDUAL:.0f} % is allowed; put them back, or repeat the canvas "
            "calibration with a bare canvas."
        )
    return changed


def share_unlike(canvas: Tensor, color: Color, tolerance: float = _UNLIKE) -> float:
    """Returns the share of a canvas that does not have a given colour.

    canvas [3, H, W]: true colours
    color: sRGB
    tolerance: largest distance in CIELAB
    """
    squares = functional.adaptive_avg_pool2d(to_linear(canvas)[None], (_CELLS, _CELLS))[0]
    seen = to_lab(to_srgb(squares).permute(1, 2, 0))
    return float(((seen - to_lab(torch.tensor(color))).norm(dim=-1) > tolerance).double().mean())


def is_evenly(canvas: Tensor, color: Color, tolerance: float = _UNLIKE) -> bool:
    """Returns True if the canvas [3, H, W], in true colours, has that colour (sRGB) everywhere except for specks."""
    return share_unlike(canvas, color, tolerance) <= _MAX_TOUCHED


def read_margin(
    photograph: NDArray[np.uint8],
    calibration: Calibration,
    size: CanvasSize,
    places: int = _PLACES,
    band: tuple[float, float] = _BAND,
) -> NDArray[np.float64]:
    """Returns linear light [4 places, 3] around the canvas, clockwise from its top left.

    places: on each side
    band: distances from the edge in metres
    NaN if a place is not visible or too dark. Raises FrameRejected like `require_photograph`.
    """
    require_photograph(photograph, calibration)
    place = _margin_places(size, places, band)  # [places, samples, 2], (row, column) in [-1, 1] over the canvas
    grid = PixelGrid.of_height(size, _ROWS)
    side = np.array([grid.columns, grid.rows])
    pixel = (place[..., ::-1].reshape(-1, 2) + 1) / 2 * side - 0.5
    seen = photographed_pixels(pixel, calibration, grid)
    inside = np.all((seen >= 0) & (seen <= np.array(photograph.shape[1::-1]) - 1), axis=1)
    column, row = np.where(inside[:, None], seen, 0).round().astype(int).T
    light = light_of_bytes(photograph[row, column]).astype(np.float64)
    shown = inside.reshape(place.shape[:2])
    light = (light * inside[:, None]).reshape(*shown.shape, 3)
    mean = np.asarray(light.sum(1) / np.maximum(shown.sum(1), 1)[:, None], np.float64)
    mean[(mean < _MARGIN_DIMMEST).any(1) | (shown.mean(1) < _SHOWN)] = np.nan
    return mean


def _margin_places(size: CanvasSize, places: int, band: tuple[float, float]) -> NDArray[np.float64]:
    """Returns samples [places, samples, 2] around the canvas, clockwise from its top left.

    Coordinates are (row, column), -1 to 1 over the canvas.
    """
    along = (np.arange(places) + 0.5) / places * 2 - 1
    step = (np.arange(_ALONG) + 0.5) / _ALONG * 2 - 1
    at = along[:, None, None] + step[:, None] / places + np.zeros(_ACROSS)  # [places of a side, along, across]
    sides = []
    for down, out, half in ((0, -1, size.height), (1, 1, size.width), (0, 1, size.height), (1, -1, size.width)):
        away = np.broadcast_to(out * (1 + np.linspace(*band, _ACROSS) / (half / 2)), at.shape)
        sides.append(np.stack((at, away) if down else (away, at), -1).reshape(places, -1, 2))
    return np.concatenate(sides)
