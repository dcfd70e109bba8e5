"""Composition of a scene: its things on a ground with depth, or a mood, with rain, snow or stars over them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.drawing.arrangement import Placed
from frida_painter.drawing.brushwork import paint_mood
from frida_painter.drawing.compositing import paste, resize, soften, stack
from frida_painter.drawing.lights import Light, Weather, color_of
from frida_painter.drawing.places import SUMMIT, TOLD_APART, Setting, with_contrast
from frida_painter.drawing.scenery import draw_scenery
from frida_painter.frames import PixelGrid

# Simplification for few strokes: areas of one colour, without texture.

_NEAR = 0.027  # share of the height: about the width of a fine brush's mark
_ALIKE = 28.0  # of 256 steps of sRGB; neighbouring colours within it become one


def simplify(picture: Tensor) -> Tensor:
    """Returns the picture [3, H, W] with flat areas and sharp edges.

    Mean shift in position and colour (Comaniciu and Meer 2002). Flat areas keep their colour within 1/256.
    """
    near = _NEAR * picture.shape[1]
    flat = cv2.pyrMeanShiftFiltering(images.to_uint8(picture), near, _ALIKE, maxLevel=0)
    return images.from_uint8(np.asarray(flat, np.uint8))


# Stars, rain and flakes: separate marks of the fine brush that cover no thing.

_DAB = 0.031  # diameter of a star or a flake, as a share of the height: a dab of the fine brush
_RAIN_LENGTH, _RAIN_WIDTH = 0.15, 0.018  # of the height: about a stroke of the fine brush
_SLOPE = 0.28  # of rain: columns per row
_GUSTS, _GUST_LENGTH, _GUST_WIDTH, _WAVE = 7, 0.34, 0.012, 0.016  # number of a wind's marks, and their size
_STARLIGHT = (1.0, 0.96, 0.78)
_TRIES = 30  # random places that are tried for each mark
_APART = 16  # a height divided by this is the distance of marks


def _mark_of(weather: Weather) -> tuple[npt.NDArray[np.float64], float]:
    """Returns the line of one mark of a weather, [n, 2] x and y, and its width, in heights of the canvas."""
    if weather.rain:
        return _RAIN_LENGTH * np.array([(0.0, 0.0), (-_SLOPE * (1 + 2 * weather.wind), 1.0)]), _RAIN_WIDTH
    if weather.flakes or not weather.wind:
        return np.zeros((2, 2)), _DAB
    along = np.linspace(0, 1, 12)[:, None]
    return np.hstack((_GUST_LENGTH * along, _WAVE * np.sin(2 * np.pi * along))), _GUST_WIDTH


def falling(setting: Setting, where: Tensor, seed: int) -> tuple[Tensor, Tensor]:
    """Returns the rain, flakes, gusts or stars of a setting: opacity [H, W] in [0, 1], and sRGB [3]. Their sizes vary.

    where: [H, W] opacity of the scene's things
    """
    weather, (rows, columns), (line, width) = setting.weather, where.shape, _mark_of(setting.weather)
    falls = weather.rain or weather.flakes
    blows = falls or (_GUSTS if weather.wind else 0)
    count = (blows or setting.light.stars) if setting.place.is_open else 0
    space = (1.0 if falls else SUMMIT if setting.on_hill else setting.place.horizon) * rows, columns
    chance, around = np.random.default_rng(seed), np.ones((2 * (rows // _APART) + 1,) * 2, np.uint8)
    over, taken = np.zeros((rows, columns), np.uint8), np.asarray(where > 0.3, np.uint8)
    for _ in range(_TRIES * count):
        (y, x), size, mark = chance.random(2) * space, 0.75 + 0.5 * chance.random(), np.zeros_like(over)
        points = np.round((x, y) + size * rows * line).astype(np.int32)
        cv2.polylines(mark, [points], False, 255, max(1, round(size * width * rows)), cv2.LINE_AA)
        if count and not (mark[taken > 0] > 0).any():
            over, count = np.maximum(over, mark), count - 1
            taken = np.maximum(taken, np.asarray(cv2.dilate(mark, around), np.uint8))
    return torch.from_numpy(over).float() / 255, color_of(weather.color if blows else _STARLIGHT)


_WIDE, _HIGH = 0.86, 0.80  # of the canvas: greatest extent of the things
_STANDS = 0.55  # of the land below the horizon: position of the things' feet
_LONG, _CUT = 1.25, 0.6  # width of the things by the canvas's above which a long one is cut, and its share at most
_ALOFT = 0.40  # of the height: position of the middle of things in the air
_ATOP, _BEFORE = 0.58, 0.3  # the same on a hill, and before what is far away
_AMID = 0.62  # of the height that a single thing fills in a visible place
_THIRD, _ASHORE = 0.07, 0.24  # of the width: distance from the middle of a thing that leaves room, and beside a river

_DARKEST = 0.7  # share of a picture's brightness that is left in the darkest light
_AT_NIGHT = 0.5  # factor of the contrast between things and a night, which stays dark
_LIT = 0.55  # share of the light's colour that things take on
_ROUND, _MODELLED, _BOUNCED = 0.05, 0.3, 0.12  # of the height: reach of the shade; its depth; share of the ground
_STANDING = 0.05  # of its height, by which a thing on the floor may be above it
_SHADOW, _LEAN, _DARK = 0.28, 1.1, 0.42  # length by the thing's height, columns per row to the right, and opacity
_TOUCH = 0.75  # opacity of the shadow right below a thing

_HAZE, _ROOTED = 0.35, 0.01  # share of the light in far things; depth of their feet

_DIPS = 0.07  # of its height: the part of a thing that water hides


@dataclass(frozen=True)
class ComposedScene:
    """Composed scene: its picture [3, H, W], and the opacity of its things and marks, [H, W] in [0, 1].

    is_alone: True if it has things of one kind only, in no place that the words name
    """

    picture: Tensor
    where: Tensor
    is_alone: bool


def compose_scene(
    things: Sequence[Placed],
    setting: Setting,
    grid: PixelGrid,
    seed: int,
    *,
    in_the_air: bool,
    absent: Sequence[str] = (),
    far: Sequence[Placed] = (),
) -> ComposedScene:
    """Composes the things in their setting.

    in_the_air: True if none of them stands on anything
    absent: nouns of things that must not be seen
    far: things behind that
    """
    drawn = _fit(things, setting, grid, seed, in_the_air=in_the_air, most=_BEFORE if far else 1.0)
    drawing = stack(drawn, grid.rows, grid.columns)
    where = drawing[3]
    ground, behind = setting.ground(grid, seed), torch.zeros_like(where)
    for picture, top, left in _fit(far, setting, grid, seed, in_the_air=False, is_far=True):
        ground, over = paste(_in_haze(picture, setting, 0.5 * _HAZE), ground, top, left)
        behind = torch.maximum(behind, over)
    ground = draw_scenery(ground, setting, seed, absent)
    ground = setting.raise_land(ground, grid, seed)
    colors = _in_light(simplify(drawing[:3]), ground, where, setting)
    ground = with_contrast(ground, where, colors, TOLD_APART * (_AT_NIGHT if setting.light.stars else 1))
    if not in_the_air and setting.place.kind != "paper":
        low = min(one.y for one in things) if things else 0.0
        for one, (picture, top, left) in zip(things, drawn, strict=True):
            if one.y - low < _STANDING * one.height:
                ground = _cast(picture, ground, top + picture.shape[1], left, is_water=setting.on_water)
    is_alone = len(things) == 1 and not setting.is_named
    picture = torch.lerp(ground, colors, where)
    return _under(setting, picture, torch.maximum(where, behind), seed, is_alone=is_alone)


def _in_haze(picture: Tensor, setting: Setting, haze: float = _HAZE) -> Tensor:
    """Returns a picture [4, h, w] in the light of its setting, and far away."""
    far = color_of(setting.light.low)[:, None, None].expand_as(picture[:3])
    lit = picture[:3] * setting.light.shade[:, None, None].clamp(max=1.0)
    return torch.cat((torch.lerp(lit, far, haze), picture[3:]))


def compose_mood(first: Light, second: Light, setting: Setting, grid: PixelGrid, seed: int) -> ComposedScene:
    """Composes a mood without things, in the form of the first light and with strokes of the second."""
    picture = paint_mood(first.form, first.colors, second.colors, first.energy, grid, seed)
    scene = _under(setting, picture, torch.zeros(grid.rows, grid.columns), seed, is_alone=False)
    return replace(scene, where=torch.ones(grid.rows, grid.columns))


def _in_light(colors: Tensor, ground: Tensor, where: Tensor, setting: Setting) -> Tensor:
    """Returns the colours of things [3, H, W] in the light of their place: brighter on the left, and with some of the
    ground's own colour in their shade."""
    shade = setting.light.shade[:, None, None].clamp(max=1.0)
    colors = colors * torch.lerp(torch.ones_like(shade), shade, _LIT)
    if setting.place.kind == "paper" or not bool((where > 0.5).any()):
        return colors
    near = max(1, round(_ROUND * where.shape[0]))
    left, right = (functional.pad(where, (near, 0))[:, :-near], functional.pad(where, (0, near))[:, near:])
    side = soften((right - left)[None], near // 2 + 1)[0]  # 1 at the left edge of a thing, -1 at its right edge
    shaded = (0.5 - 0.5 * side)[None] * where
    around = ground.mean((1, 2), keepdim=True).expand_as(colors)
    return (torch.lerp(colors, around, _BOUNCED) * (1 + _MODELLED * (0.5 - shaded))).clamp(0, 1)


def _cast(picture: Tensor, ground: Tensor, foot: int, left: int, *, is_water: bool) -> Tensor:
    """Returns the ground [3, H, W] with the shadow of a thing [4, h, w] on it, or its reflection in water.

    foot, left: row below the thing, and its first column
    """
    share, lean = (0.7, 0.0) if is_water else (_SHADOW, _LEAN)  # the light comes from the left
    rows = max(2, round(share * picture.shape[1]))
    first = max(0, foot - round(0.5 * rows * _SHADOW))
    color = picture[:3] if is_water else torch.zeros_like(picture[:3])
    flat = functional.interpolate(torch.cat((color, picture[3:])).flip(1)[None], (rows, picture.shape[2]), mode="area")
    wide = functional.pad(flat[0], (0, round(lean * rows)))
    cast = torch.stack([wide[:, row].roll(round(lean * row), -1) for row in range(rows)], 1)
    cast[3] *= _DARK * torch.linspace(1, 0.2, rows)[:, None]
    laid, _ = paste(cast[:, : ground.shape[1] - first, : ground.shape[2] - left], ground, first, left)
    near = max(1, round(0.008 * ground.shape[1]))
    feet, (_, height, width) = picture[3:, -near:], ground.shape
    sides = (left, width - left - feet.shape[2], foot - feet.shape[1], height - foot)
    soft = soften(laid - ground, near)
    return ground + soft if is_water else (ground + soft) * (1 - _TOUCH * soften(functional.pad(feet, sides), 2 * near))


def compose_photograph(picture: Tensor, setting: Setting, grid: PixelGrid, seed: int) -> ComposedScene:
    """Composes a picture [3, h, w] with its own ground, which fills the canvas in the setting's light and weather."""
    colors = simplify(images.fit(picture, grid.rows, grid.columns))
    return lay_setting(colors, setting, torch.ones_like(colors[0]), seed)


def lay_setting(picture: Tensor, setting: Setting, where: Tensor, seed: int) -> ComposedScene:
    """Lays the light and the weather of a setting over a picture [3, H, W]; marks keep clear of `where` [H, W]."""
    shade = setting.light.shade[:, None, None].clamp(max=1.0)
    shade = shade * (_DARKEST / shade.max()).clamp(min=1.0)  # what is there can still be told at night
    return _under(setting, picture * shade, where, seed, is_alone=False)


def _under(setting: Setting, picture: Tensor, where: Tensor, seed: int, *, is_alone: bool) -> ComposedScene:
    """Returns the scene of a picture [3, H, W] with things at `where` [H, W], with fog, rain, flakes or stars added."""
    picture = setting.in_fog(picture)
    marks, color = falling(setting, where, seed)
    picture = torch.lerp(picture, color[:, None, None].expand_as(picture), marks.expand_as(picture))
    return ComposedScene(picture.clamp(0, 1), torch.maximum(where, marks), is_alone)


def _fit(
    things: Sequence[Placed],
    setting: Setting,
    grid: PixelGrid,
    seed: int,
    *,
    in_the_air: bool,
    is_far: bool = False,
    most: float = 1.0,
) -> list[tuple[Tensor, int, int]]:
    """Returns the pictures scaled to pixels, each with its first row and column.

    Nothing touches the edge, but a thing that is much longer than the others leaves the canvas on the right.

    most: greatest share of the canvas's height
    """
    if not things:
        return []
    rows, columns = grid.rows, grid.columns
    left = min(one.x - one.width / 2 for one in things)
    right = max(one.x + one.width / 2 for one in things)
    low, high = min(one.y for one in things), max(one.y + one.height for one in things)
    tall = _AMID if setting.is_named and (in_the_air or len(things) == 1) else _HIGH
    wide, tall = (_AMID, _AMID) if is_far else (_ATOP, _ATOP) if setting.on_hill else (_WIDE, min(tall, most))
    longest = max(things, key=lambda one: one.width)
    if not is_far and longest.x + longest.width / 2 == right > longest.x - longest.width / 2 > left:
        least = _LONG * (high - low) * wide * columns / (tall * rows)  # a train beside somebody leaves the picture
        right -= min(_CUT * longest.width, max(0.0, right - left - least)) if longest.figure is None else 0.0
    is_cut = right < longest.x + longest.width / 2
    scale = min(wide * columns / (right - left), tall * rows / (high - low)) * min(1, max(one.size for one in things))
    width, height = scale * (right - left), scale * (high - low)
    horizon = setting.place.horizon
    floor = horizon if is_far else SUMMIT if setting.on_hill else horizon + _STANDS * (1 - horizon) - _ROOTED
    floor += _ROOTED
    bottom = _ALOFT * rows + height / 2 if in_the_air else floor * rows
    bottom = min(max(bottom, height + 0.04 * rows), 0.96 * rows)
    free = columns - width
    aside = _ASHORE if setting.place.has("stream") and setting.is_raised else _THIRD
    shift = min(aside * columns, 0.5 * free - 0.04 * columns) if setting.is_named and not setting.on_hill else 0.0
    start = free if is_cut else free / 2 + (1 if seed % 2 else -1) * max(0.0, shift)
    found = []
    for one in things:
        picture = resize(one.picture, max(1e-3, scale * one.height / one.picture.shape[1]))
        if setting.on_water and setting.is_named and not (in_the_air or is_far) and one.y == low:
            dips = max(1, round(_DIPS * picture.shape[1]))
            picture[3, -dips:] *= torch.linspace(1, 0, dips)[:, None]
        down, across = (torch.linspace(0, 1, picture.shape[1])[:, None], torch.linspace(-1, 1, picture.shape[2]))
        rim = 1 - one.hidden + one.dip * (1 - across**2).sqrt()  # the front of a round rim, seen from above
        picture[3] *= (down <= rim) | (one.hidden == 0)
        top = round(bottom - scale * (one.y - low) - picture.shape[1])
        at = round(start + scale * (one.x - one.width / 2 - left))
        top = max(0, min(top, rows - picture.shape[1]))
        at = max(0, min(at, columns - (1 if is_cut else picture.shape[2])))
        found.append((picture[:, :rows, : columns - at], top, at))
    return found
