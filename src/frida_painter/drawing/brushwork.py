"""Pictures of loose brush strokes: grounds with depth, and moods as colour, light, rhythm and direction of strokes."""

import math

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.frames import PixelGrid
from frida_painter.palette import from_lab, to_lab

_FINE = 2  # the strokes are drawn that much larger, for smooth edges
_COVERS = 3.0  # layers of strokes over every place
_WIDTH, _LENGTH = 0.055, 0.22  # of a stroke, as shares of the height: marks of the broad brush
_STEPS = 8  # straight parts of a stroke
_LIVELY = 4.0  # Lab distance by which the colours of neighbouring strokes differ
_SECOND = 0.22  # share of the strokes in the colours of the second mood

FORMS = ("horizon", "field", "vortex", "fall", "burst", "waves")
"""Compositions of a mood."""


def paint_loosely(
    picture: Tensor, angle: Tensor, seed: int, *, size: float = 1.0, lively: float = 1.0, second: Tensor | None = None
) -> Tensor:
    """Returns a picture [3, H, W] in loose strokes, whose directions follow `angle` [H, W] in radians, y up.

    size: factor of the strokes' width and length
    lively: factor of the differences between the colours of neighbouring strokes
    second: [3, H, W] picture from which a fifth of the strokes take their colours
    """
    _, rows, columns = picture.shape
    chance = np.random.default_rng(seed)
    width, length = size * _WIDTH * rows, size * _LENGTH * rows
    count = math.ceil(_COVERS * rows * columns / (width * length))
    canvas = images.to_uint8(images.fit(picture, rows * _FINE, columns * _FINE)).copy()
    wet = [to_lab(one.permute(1, 2, 0)).numpy() for one in (picture, picture if second is None else second)]
    turn = angle.numpy()
    spots = chance.random((count, 2)) * (rows, columns)
    shades = chance.normal(0, lively * _LIVELY * np.array([1.0, 0.6, 0.6]), (count, 3))
    others = chance.random(count) < _SECOND
    colors = np.stack([wet[int(other)][int(y), int(x)] for other, (y, x) in zip(others, spots, strict=True)]) + shades
    paints = images.to_uint8(from_lab(torch.from_numpy(colors).float()).T[:, None]).reshape(-1, 3)
    for (y, x), paint in zip(spots, paints, strict=True):
        path = [(x, y)]
        for _ in range(_STEPS):
            inside = min(max(int(y), 0), rows - 1), min(max(int(x), 0), columns - 1)
            x, y = x + length / _STEPS * math.cos(turn[inside]), y - length / _STEPS * math.sin(turn[inside])
            path.append((x, y))
        points = np.round(_FINE * np.array(path)).astype(np.int32)[:, None]
        thick = max(1, round(_FINE * width * (0.7 + 0.6 * chance.random())))
        cv2.polylines(canvas, [points], isClosed=False, color=paint.tolist(), thickness=thick, lineType=cv2.LINE_AA)
    return images.fit(images.from_uint8(canvas), rows, columns)


def paint_mood(form: str, colors: Tensor, second: Tensor, energy: float, grid: PixelGrid, seed: int) -> Tensor:
    """Returns a mood as a picture [3, H, W] without things, from the form, colours [4, 3] and energy of its light.

    second: colours of another mood that is felt in it
    """
    share, angle = _lay_out(form, grid, seed)
    ramps = [_color_along(share, palette) for palette in (colors, second)]
    wobble = energy * 1.2 * (clouds(grid, seed + 1, 0.12) - 0.5)
    size = 1.45 - 0.75 * energy
    return paint_loosely(ramps[0], angle + wobble, seed, size=size, lively=0.8 + 1.6 * energy, second=ramps[1])


def _lay_out(form: str, grid: PixelGrid, seed: int) -> tuple[Tensor, Tensor]:
    """Returns the lightness [H, W], 0 for depth to 1 for the accent, and the directions of strokes [H, W] of a form."""
    chance = torch.Generator().manual_seed(seed)
    shift = (torch.rand(2, generator=chance) - 0.5).tolist()
    wide = grid.columns / grid.rows
    y, x = torch.meshgrid(
        (torch.arange(grid.rows) + 0.5) / grid.rows, (torch.arange(grid.columns) + 0.5) / grid.rows, indexing="ij"
    )
    mist = clouds(grid, seed, 0.25)
    middle = wide * (0.38 if seed % 2 else 0.62) + 0.1 * shift[0], 0.42 + 0.1 * shift[1]
    far = ((x - middle[0]) ** 2 + (y - middle[1]) ** 2).sqrt()
    around = torch.atan2(middle[1] - y, x - middle[0])
    flat = torch.zeros_like(x)
    if form == "horizon":
        horizon = 0.66 + 0.05 * shift[0]
        sky = 0.3 + 0.5 * (y / horizon).clamp(max=1) ** 2 + 0.3 * (1 - far / 0.35).clamp(0, 1)
        land = 0.22 - 0.3 * (y - horizon) + 0.25 * (1 - (x - middle[0]).abs() / 0.14).clamp(0, 1)
        return torch.where(y < horizon, sky, land) + 0.12 * (mist - 0.5), flat + 0.15 * (mist - 0.5)
    if form == "field":
        rise = 0.25 + 0.5 * mist + 0.35 * (1 - far / 0.5).clamp(0, 1) ** 2
        return rise, 1.0 + 1.0 * (mist - 0.5) + flat
    if form == "vortex":
        spiral = 0.5 + 0.5 * torch.cos(2 * around + 9 * far.clamp(min=0.02).log())
        return 0.12 + 0.45 * spiral * (1 - 0.4 * far) + 0.5 * (1 - far / 0.2).clamp(0, 1), around + math.pi / 2 + 0.3
    if form == "fall":
        columns = clouds(grid, seed, 0.1)[grid.rows // 2].expand_as(x)
        glow = 0.35 * (1 - far / 0.6).clamp(0, 1)
        return 0.12 + 0.45 * columns * (1 - 0.5 * y) + glow, flat - math.pi / 2 + 0.25 * (mist - 0.5)
    if form == "burst":
        rays = 0.5 + 0.5 * torch.cos(9 * around + 5 * mist)
        return (1.05 - 1.1 * far + 0.22 * (rays - 0.5)).clamp(0.05, 1), around
    waves = 2 * math.pi * (2.2 * y + 0.45 * torch.sin(2 * math.pi * x / wide + 3 * shift[0]))
    slope = -0.45 * 2 * math.pi / wide * torch.cos(2 * math.pi * x / wide + 3 * shift[0]) / 2.2
    return 0.42 + 0.3 * torch.sin(waves) + 0.3 * (mist - 0.5), torch.atan(-slope)


def clouds(grid: PixelGrid, seed: int, size: float) -> Tensor:
    """Returns smooth noise [H, W] in [0, 1], with patches of that size as a share of the height."""
    cells = max(2, round(1 / size)) + 1, max(2, round(grid.columns / grid.rows / size)) + 1
    noise = torch.rand(1, 1, *cells, generator=torch.Generator().manual_seed(seed))
    return functional.interpolate(noise, (grid.rows, grid.columns), mode="bicubic", align_corners=True)[0, 0].clamp(
        0, 1
    )


def _color_along(share: Tensor, colors: Tensor) -> Tensor:
    """Returns the colours [3, H, W] at shares [H, W] of the way from the first of `colors` [4, 3] to the last."""
    lab = to_lab(colors)
    along = share.clamp(0, 1) * (len(lab) - 1)
    first = along.floor().long().clamp(max=len(lab) - 2)
    between = torch.lerp(lab[first], lab[first + 1], (along - first)[..., None])
    return from_lab(between).permute(2, 0, 1).clamp(0, 1)
