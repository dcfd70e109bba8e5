"""Stars, rain and flakes: marks of the fine brush, each in a place of its own, where they hide no thing."""

import math

import torch
from torch import Tensor

from frida_painter.objectives.scenes.settings import Setting

_STAR, _FLAKE = 0.015, 0.016  # radius, as a share of the height: a dab of the fine brush
_RAIN_LENGTH, _RAIN_WIDTH = 0.15, 0.018  # of the height: about a stroke of the fine brush
_SLOPE = 0.28  # of rain: columns for each row
_STARLIGHT = (1.0, 0.96, 0.78)
_TRIES = 12  # places that are drawn for each mark


def falling(setting: Setting, where: Tensor, seed: int) -> tuple[Tensor, Tensor]:
    """What falls or shines in a setting: its opacity [H, W] in [0, 1], and its sRGB [3].

    where [H, W]: how much of the scene's things is there.
    """
    generator = torch.Generator().manual_seed(seed)
    weather, light = setting.weather, setting.light
    rows = where.shape[0]
    if weather.rain:
        length = _RAIN_LENGTH * rows
        return _marks(where, weather.rain, 1.0, (length, _RAIN_WIDTH * rows), generator), torch.tensor(weather.color)
    if weather.flakes:
        dab = 2 * _FLAKE * rows
        return _marks(where, weather.flakes, 1.0, (dab, dab), generator), torch.tensor(weather.color)
    if light.stars and setting.place.is_open:
        dab = 2 * _STAR * rows
        return _marks(where, light.stars, setting.place.horizon, (dab, dab), generator), torch.tensor(_STARLIGHT)
    return torch.zeros_like(where), torch.ones(3)


def _marks(where: Tensor, count: int, down: float, size: tuple[float, float], generator: torch.Generator) -> Tensor:
    """So many marks in the upper part `down` of a picture, of a length and width in pixels, apart from each other."""
    rows, columns = where.shape
    length, width = size
    taken, over = where.clone(), torch.zeros_like(where)
    for _ in range(count):
        places = torch.rand(_TRIES, 2, generator=generator) * torch.tensor([down * rows, float(columns)])
        tries = [_mark(where.shape, row, column, length, width) for row, column in places.tolist()]
        best = min(tries, key=lambda mark: float((mark * taken).sum()))
        if float((best * where).sum()) > 0.5 * float(best.sum()):
            continue  # there is no room beside the things
        over = torch.maximum(over, best)
        around = torch.nn.functional.max_pool2d(best[None, None], 2 * (rows // 16) + 1, 1, rows // 16)[0, 0]
        taken = torch.maximum(taken, around)
    return over


def _mark(shape: torch.Size, row: float, column: float, length: float, width: float) -> Tensor:
    """A slanting mark with round ends about a place, [H, W]; as long as wide, it is a dot."""
    down, across = torch.meshgrid(torch.arange(shape[0]) + 0.5, torch.arange(shape[1]) + 0.5, indexing="ij")
    norm = math.hypot(1, _SLOPE)
    along = ((down - row) - _SLOPE * (across - column)) / norm
    aside = ((across - column) + _SLOPE * (down - row)) / norm
    beyond = (along.abs() - (length - width) / 2).clamp(min=0)
    return (width / 2 - (beyond.square() + aside.square()).sqrt() + 0.5).clamp(0, 1)
