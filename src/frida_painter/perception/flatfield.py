"""Uneven light and a colour cast, learned from the bare canvas and taken out of every photograph."""

from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from frida_painter.calibration import BareCanvas, Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError, FrameRejected
from frida_painter.frames import PixelGrid
from frida_painter.palette import to_lab
from frida_painter.perception.rectify import photographed_pixels, rectify, require_photograph
from frida_painter.perception.srgb import light_of_bytes, to_linear, to_srgb
from frida_painter.plan import WHITE

_DEGREE = 4
_ROUNDS = 4
_DIMMEST = 0.05
_MOST_CLIPPED = 0.2
_MOST_RESIDUAL = 0.06
_SAMPLES = 128
_RENEWING_SAMPLES = 40
_RENEWING_DEGREE = 3
_LEAST_BARE = 0.05


@dataclass(frozen=True)
class FlatField:
    """How bright the light on the canvas is, for each band, as a smooth surface over the canvas.

    logarithm [3, terms]: coefficients of a polynomial in the canvas's (across, down), each in
    [-1, 1], whose value is the logarithm of what the camera sees of a perfectly white canvas,
    in linear light: there light and canvas multiply, and the two can be told apart.
    """

    logarithm: Tensor

    @classmethod
    def learn(cls, bare: Tensor, ground: tuple[float, float, float]) -> Self:
        """From the rectified photograph [3, H, W] of the bare canvas, whose true colour is `ground` (sRGB).

        Specks and pencil lines do not count. Raises FrameRejected where the photograph is too dark,
        overexposed, or the canvas is not bare.
        """
        step = [max(1, side // _SAMPLES) for side in bare.shape[1:]]
        pooled = torch.nn.functional.avg_pool2d(to_linear(bare)[None], step)[0].double()  # [3, h, w]
        if not float(pooled.median()) >= _DIMMEST:
            raise FrameRejected("The photograph of the bare canvas is too dark; bring more light.")
        if not float((bare >= 1).double().mean()) <= _MOST_CLIPPED:
            raise FrameRejected("The photograph of the bare canvas is overexposed; bring less light or expose shorter.")
        seen = pooled.flatten(1).clamp(min=1e-4).log()  # [3, samples]
        terms = _terms(*pooled.shape[1:]).to(seen)  # [samples, terms]
        logarithm, residual = _fitted(terms, seen)
        if not residual <= _MOST_RESIDUAL:
            raise FrameRejected(
                f"The canvas does not look bare: {100 * residual:.0f} % of its light does not fit a smooth surface, "
                f"and {100 * _MOST_RESIDUAL:.0f} % is allowed; put up a bare canvas, or say --on-canvas to "
                "paint on what is there."
            )
        logarithm[:, 0] -= to_linear(torch.tensor(ground, dtype=seen.dtype)).clamp(min=1e-3).log()
        return cls(logarithm.float())

    def renewed(self, light: Tensor, bare: Tensor, ground: tuple[float, float, float]) -> Self:
        """The field as it is in a later photograph of the same canvas, of which only parts are still bare.

        light [3, H, W]: the later photograph, rectified, linear; bare [H, W]: where it shows the
        ground, of colour `ground` (sRGB). Only broad changes are followed: another brightness, another
        colour, light from another side. Where less than a twentieth is bare, all stays as it was.
        """
        step = [max(1, side // _RENEWING_SAMPLES) for side in bare.shape]
        share = torch.nn.functional.avg_pool2d(bare[None].to(light), step)[0]  # [h, w]
        known = (share > 0.5).flatten()
        if not float(known.double().mean()) >= _LEAST_BARE:
            return self
        white = self.light(*share.shape).to(light) * to_linear(torch.tensor(ground).to(light))[:, None, None]
        mean = torch.nn.functional.avg_pool2d(light * bare, step) / share.clamp(min=1e-3)
        seen = (mean / white).flatten(1)[:, known].double().clamp(min=1e-4).log()  # [3, samples]
        broad = torch.tensor([i + j <= _RENEWING_DEGREE for i, j in _pairs()])
        terms = _terms(*share.shape).to(seen)[known][:, broad]  # [samples, terms]
        logarithm = self.logarithm.clone()
        logarithm[:, broad] += _fitted(terms, seen)[0].to(logarithm)
        return type(self)(logarithm)

    def tilted(self, change: Tensor, down: Tensor, across: Tensor) -> tuple[Self, float]:
        """The field after a change of the light, and how far places are from it in the mean.

        change [3, places]: the logarithm of how much brighter each band is at places (down, across) [places], -1
        to 1 over the canvas and a little beyond. Brightness, colour and a lean to one side are followed.
        """
        tilt = [_pairs().index(pair) for pair in ((0, 0), (1, 0), (0, 1))]
        terms = torch.stack((torch.ones_like(down), down, across), 1).to(change)
        logarithm = self.logarithm.clone()
        coefficients, residual = _fitted(terms, change)
        logarithm[:, tilt] += coefficients.to(logarithm)
        return type(self)(logarithm), residual

    def light(self, rows: int, columns: int) -> Tensor:
        """What the camera sees of a white canvas, linear light, [3, rows, columns]."""
        down, across = _chebyshev(_places(rows)).float(), _chebyshev(_places(columns)).float()  # [degree + 1, side]
        grid = self.logarithm.new_zeros(3, _DEGREE + 1, _DEGREE + 1)
        for term, (i, j) in enumerate(_pairs()):
            grid[:, i, j] = self.logarithm[:, term]
        return (down.T @ grid @ across).exp()

    def correct(self, picture: Tensor) -> Tensor:
        """The rectified photograph [3, H, W] as it would look in even, white light, sRGB in [0, 1]."""
        return to_srgb(to_linear(picture) / self.light(*picture.shape[1:]).to(picture))


def _fitted(terms: Tensor, seen: Tensor) -> tuple[Tensor, float]:
    """Coefficients [3, terms] of what is seen [3, samples], and the mean residual.

    Least squares, in which what does not fit counts less and less.
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
    """Products of Chebyshev polynomials up to the degree at every pixel centre, [rows x columns, terms]."""
    down, across = _chebyshev(_places(rows)), _chebyshev(_places(columns))  # [degree + 1, side]
    return torch.stack([(down[i][:, None] * across[j]).flatten() for i, j in _pairs()], 1)


def _pairs() -> list[tuple[int, int]]:
    """Degrees (down, across) of the terms."""
    return [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]


def _places(count: int) -> Tensor:
    """Where pixel centres lie in [-1, 1]."""
    return (torch.arange(count, dtype=torch.float64) * 2 + 1) / count - 1


def _chebyshev(place: Tensor) -> Tensor:
    return torch.cos(torch.arange(_DEGREE + 1, dtype=place.dtype)[:, None] * torch.acos(place))


# The margin around the canvas: by it the light is known on a canvas that is not bare.
#
# A bare white canvas shows the light itself. Where something is on the canvas, the light is as it was when the canvas
# was bare, changed as the margin has changed since: another brightness, another colour, light from another side.

Color = tuple[float, float, float]
_ROWS = 256
_PLACES = 12  # on each side of the canvas
_BAND = (0.004, 0.012)  # metres beyond the edge
_ACROSS, _ALONG = 8, 9  # samples of a place
_MARGIN_DIMMEST = 0.003  # linear light, below which a place shows the camera's noise
_FEWEST = 16  # places
_MARGIN_MOST_RESIDUAL = 0.1
_CELLS = 24  # rows and columns of squares by which a canvas is called bare
_UNLIKE, _MOST_TOUCHED = 9.0, 0.02  # CIELAB of a square that has another colour, and the share of them in specks


def bare_canvas(photograph: NDArray[np.uint8], calibration: Calibration, size: CanvasSize) -> BareCanvas:
    """What a photograph [H, W, 3] of a bare white canvas tells of the light. Raises FrameRejected where it is none."""
    light = FlatField.learn(rectify(photograph, calibration, PixelGrid.of_height(size, _ROWS)), WHITE)
    seen = _margin(photograph, calibration, size)
    margin = tuple(None if np.isnan(place).any() else tuple(place.tolist()) for place in seen)
    return BareCanvas(tuple(map(tuple, light.logarithm.tolist())), margin)


def light_by_margin(photograph: NDArray[np.uint8], calibration: Calibration, size: CanvasSize) -> FlatField:
    """The light on a canvas with anything on it, by the margin now and when the canvas was bare.

    Raises CalibrationError where the record knows nothing of a bare canvas, and FrameRejected where the margin is
    not what it was, or too dark.
    """
    known = calibration.bare
    if known is None:
        raise CalibrationError(
            "What the light does is learned from a bare canvas, and the calibration record knows none; put up a bare "
            "white canvas once, and repeat the canvas calibration: frida-painter calibrate canvas"
        )
    before = np.array([(np.nan,) * 3 if place is None else place for place in known.margin])
    change = np.log(_margin(photograph, calibration, size) / before)
    usable = np.isfinite(change).all(1)
    if not usable.sum() >= _FEWEST:
        raise FrameRejected(
            f"Only {usable.sum()} of {len(usable)} places around the canvas can be seen in the photograph, and at "
            f"least {_FEWEST} tell what the light does; lay something brighter around the canvas, and leave room there."
        )
    row, column = _margin_places(size).mean(1).T
    field = FlatField(torch.tensor(known.light))
    changed, residual = field.tilted(
        torch.from_numpy(change[usable]).T, torch.from_numpy(row[usable]), torch.from_numpy(column[usable])
    )
    if not residual <= _MARGIN_MOST_RESIDUAL:
        raise FrameRejected(
            f"The surroundings of the canvas differ by {100 * residual:.0f} % from what they were when the canvas was "
            f"bare, and {100 * _MARGIN_MOST_RESIDUAL:.0f} % is allowed; put them back, or repeat the canvas "
            "calibration with a bare canvas."
        )
    return changed


def share_unlike(canvas: Tensor, color: Color, tolerance: float = _UNLIKE) -> float:
    """The share of the canvas [3, H, W], in true colours, that is not of that colour (sRGB), within so much CIELAB."""
    squares = functional.adaptive_avg_pool2d(to_linear(canvas)[None], (_CELLS, _CELLS))[0]
    seen = to_lab(to_srgb(squares).permute(1, 2, 0))
    return float(((seen - to_lab(torch.tensor(color))).norm(dim=-1) > tolerance).double().mean())


def is_evenly(canvas: Tensor, color: Color, tolerance: float = _UNLIKE) -> bool:
    """Whether the canvas [3, H, W], in true colours, has that colour (sRGB) all over but for specks."""
    return share_unlike(canvas, color, tolerance) <= _MOST_TOUCHED


def _margin(photograph: NDArray[np.uint8], calibration: Calibration, size: CanvasSize) -> NDArray[np.float64]:
    """Linear light [places, 3] around the canvas; not a number where it is not seen, or dark."""
    require_photograph(photograph, calibration)
    place = _margin_places(size)  # [places, samples, 2], (row, column) in [-1, 1] over the canvas
    grid = PixelGrid.of_height(size, _ROWS)
    side = np.array([grid.columns, grid.rows])
    pixel = (place[..., ::-1].reshape(-1, 2) + 1) / 2 * side - 0.5
    seen = photographed_pixels(pixel, calibration, grid)
    rows, columns = photograph.shape[:2]
    inside = np.all((seen >= 0) & (seen <= np.array([columns, rows]) - 1), axis=1)
    column, row = np.where(inside[:, None], seen, 0).round().astype(int).T
    light = light_of_bytes(photograph[row, column]).astype(np.float64)
    light[~inside] = np.nan
    mean = light.reshape(*place.shape[:2], 3).mean(1)
    mean[(mean < _MARGIN_DIMMEST).any(1)] = np.nan
    return mean


def _margin_places(size: CanvasSize) -> NDArray[np.float64]:
    """Samples [places, samples, 2] around the canvas, clockwise from its top left: (row, column) in its halves."""
    along = (np.arange(_PLACES) + 0.5) / _PLACES * 2 - 1
    step = (np.arange(_ALONG) + 0.5) / _ALONG * 2 - 1
    half = np.array([size.height, size.width]) / 2
    sides = []
    for down, out in ((False, -1), (True, 1), (False, 1), (True, -1)):
        beyond = out * (1 + np.linspace(*_BAND, _ACROSS) / half[1 if down else 0])
        at = along[:, None, None] + step[None, :, None] / _PLACES
        away = np.broadcast_to(beyond[None, None], (_PLACES, _ALONG, _ACROSS))
        at = np.broadcast_to(at, away.shape)
        pair = (at, away) if down else (away, at)
        sides.append(np.stack(pair, -1).reshape(_PLACES, -1, 2))
    return np.concatenate(sides)
