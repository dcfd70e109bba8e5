"""Uneven light and a colour cast, learned from the bare canvas and taken out of every photograph."""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from frida_painter.errors import FrameRejected
from frida_painter.perception.light import to_linear, to_srgb

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
