"""Palette: the few paints that a person mixes, ordered from light to dark."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.strokes.palette_file import read_colors
from frida_painter.system import storage

MAX_COLORS = 64
_TRIES, _MAX_ITERATIONS = 4, 300  # of k-means


def to_lab(color: Tensor) -> Tensor:
    """Converts sRGB [..., 3] in [0, 1] to CIE L*a*b* (D65) with L in [0, 100], on the same device.

    Not differentiable.
    """
    if color.device.type != "cpu":
        return _to_lab_there(color.detach())
    import cv2  # loaded here because few callers need it

    flat = np.ascontiguousarray(color.detach().cpu().numpy().reshape(1, -1, 3), dtype=np.float32)
    if flat.size == 0:
        return color.detach().clone()
    return torch.from_numpy(cv2.cvtColor(flat, cv2.COLOR_RGB2Lab)).reshape(color.shape).to(color)


def _to_lab_there(color: Tensor) -> Tensor:
    """Computes `to_lab` with PyTorch on any device, without a wait for the device."""
    red, green, blue = torch.where(color > 0.04045, ((color + 0.055) / 1.055) ** 2.4, color / 12.92).unbind(-1)
    x = (0.412453 * red + 0.357580 * green + 0.180423 * blue) / 0.950456
    y = 0.212671 * red + 0.715160 * green + 0.072169 * blue
    z = (0.019334 * red + 0.119193 * green + 0.950227 * blue) / 1.088754
    at = torch.stack((x, y, z), -1)
    x, y, z = torch.where(at > 0.008856, at.clamp(min=1e-9) ** (1 / 3), 7.787 * at + 16 / 116).unbind(-1)
    return torch.stack((116 * y - 16, 500 * (x - y), 200 * (y - z)), -1)


def from_lab(lab: Tensor) -> Tensor:
    """Converts CIE L*a*b* [..., 3] to sRGB; values outside sRGB are clipped to [0, 1]."""
    import cv2

    flat = np.ascontiguousarray(lab.detach().cpu().numpy().reshape(1, -1, 3), dtype=np.float32)
    rgb = np.clip(cv2.cvtColor(flat, cv2.COLOR_Lab2RGB), 0, 1)
    return torch.from_numpy(rgb).reshape(lab.shape).to(lab)


def to_hex(color: Tensor) -> str:
    """Returns sRGB [3] in [0, 1] as "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*(color * 255).round().int().tolist())


def from_hex(text: str) -> Tensor:
    """Converts "#rrggbb" to sRGB [3] in [0, 1]. Raises ConfigError."""
    if not isinstance(text, str) or re.fullmatch(r"#[0-9a-fA-F]{6}", text) is None:
        raise ConfigError(f"{str(text)[:20]!r} is not a colour; write it like #b97f2c.")
    return torch.tensor([int(text[at : at + 2], 16) / 255 for at in (1, 3, 5)])


AnyColor = str | Sequence[float] | Tensor
"""Colour as public functions take it: "#c8a878", "white", or sRGB [3] in [0, 1]."""


def as_color(given: AnyColor) -> tuple[float, float, float]:
    """Returns a colour in any of its forms as sRGB in [0, 1]. Raises ConfigError."""
    if isinstance(given, str):
        given = (1.0, 1.0, 1.0) if given.strip().lower() == "white" else from_hex(given.strip())
    try:
        parts = torch.as_tensor(given, dtype=torch.float64).detach().flatten().tolist()
    except (TypeError, ValueError, RuntimeError):
        parts = []
    if len(parts) != 3 or not all(0 <= part <= 1 for part in parts):
        raise ConfigError(f"A colour {str(given)[:40]} was given; write it like #b97f2c, or as 3 numbers in [0, 1].")
    red, green, blue = parts
    return red, green, blue


def as_colors(given: Sequence[AnyColor] | Tensor) -> Tensor:
    """Returns colours in any of their forms as sRGB [k, 3]; a tensor stays as it is. Raises ConfigError."""
    if isinstance(given, Tensor):
        return given
    if isinstance(given, str):
        raise ConfigError(f"Colours were given as the text {given[:40]!r}; give a list of them.")
    return torch.tensor([as_color(one) for one in given]).reshape(-1, 3)


@dataclass(frozen=True)
class Palette:
    """Palette of k paints. Paint i belongs in well i.

    color [k, 3]: sRGB in [0, 1], or a list of colours such as "#f2e9dc". A planner orders it from light to dark; a
    measured palette keeps the order of its wells.
    Raises ConfigError if the shape or a value is out of range.

        >>> import frida_painter as fp, torch
        >>> palette = fp.Palette(torch.tensor([[1.0, 0.9, 0.6], [0.1, 0.2, 0.4]]))
        >>> palette.save("palette.json")
        >>> len(fp.Palette.load("palette.json"))
        2
    """

    color: Tensor

    def __init__(self, color: Sequence[AnyColor] | Tensor) -> None:
        object.__setattr__(self, "color", as_colors(color))
        if self.color.dim() != 2 or self.color.shape[1] != 3 or not 1 <= len(self.color) <= MAX_COLORS:
            raise ConfigError(
                f"A palette of shape {tuple(self.color.shape)} was given; it has 1 to {MAX_COLORS} colours of 3 parts."
            )
        if not bool(((self.color >= 0) & (self.color <= 1)).all()):
            raise ConfigError("A palette has a colour outside [0, 1]; give sRGB values between 0 and 1.")

    def __len__(self) -> int:
        return len(self.color)

    def __repr__(self) -> str:
        return f"Palette({', '.join(map(to_hex, self.color))})"

    @classmethod
    def sort_light_to_dark(cls, color: Tensor) -> "Palette":
        """Returns the palette of these colours, ordered from light to dark."""
        return cls(color[torch.argsort(to_lab(color)[:, 0], descending=True, stable=True)])

    @classmethod
    def cluster(cls, color: Tensor, weight: Tensor, count: int, seed: int) -> "Palette":
        """Returns `count` paints that represent many colours (paper, "Paint Colors and Mixing": k-means, here in Lab).

        color [n, 3]: sRGB
        weight [n]: importance of each colour, for example its painted area

        The clusters are found in Lab, then refined in sRGB, because pictures are compared in sRGB. If there are
        fewer than `count` different colours, the lightest is repeated.
        """
        points, lab = (tensor.detach().cpu().double().numpy() for tensor in (color, to_lab(color)))
        weights = weight.detach().cpu().double().numpy() + 1e-9
        clusters = min(count, len(np.unique(lab, axis=0)))
        chance = np.random.default_rng(seed)
        tried = [_settle(lab, weights, _spread(lab, weights, clusters, chance)) for _ in range(_TRIES)]
        start = from_lab(torch.from_numpy(min(tried, key=lambda one: one[1])[0])).double().numpy()
        settled, _ = _settle(points, weights, start)
        found = cls.sort_light_to_dark(torch.from_numpy(settled).to(color).clamp(0, 1))
        missing = count - len(found)
        return cls(torch.cat([found.color[:1].expand(missing, 3), found.color])) if missing else found

    @classmethod
    def load(cls, path: str | Path) -> "Palette":
        """Reads a palette of any format that palette_file.py reads, in its order. Raises ConfigError."""
        colors = read_colors(Path(path))
        if not 1 <= len(colors) <= MAX_COLORS:
            raise ConfigError(f"{path} has {len(colors)} paints; a palette has 1 to {MAX_COLORS}.")
        return cls(torch.tensor(colors))

    def save(self, path: str | Path) -> None:
        """Writes a JSON file: {"paints": ["#f2e9dc", ...]}. Raises StorageError."""
        storage.write_text(Path(path), json.dumps({"paints": [to_hex(color) for color in self.color]}, indent=2) + "\n")

    def lab(self) -> Tensor:
        """Returns the palette in CIE L*a*b*, [k, 3]."""
        return to_lab(self.color)

    def nearest(self, color: Tensor) -> Tensor:
        """Returns the index [n] of the paint nearest to each sRGB colour [n, 3], by distance in Lab."""
        return torch.cdist(to_lab(color), self.lab()).argmin(1)


# Weighted k-means, of points [n, d] with weights [n]


def _spread(points: NDArray[Any], weights: NDArray[Any], count: int, chance: np.random.Generator) -> NDArray[Any]:
    """Returns `count` of the points, far from each other (k-means++: Arthur and Vassilvitskii 2007).

    Each is the best of some points that are drawn by weight and squared distance from those that are chosen.
    """
    chosen = [int(chance.choice(len(points), p=weights / weights.sum()))]
    away = _square_distances(points, points[chosen])[:, 0]
    while len(chosen) < count:
        share = away * weights
        drawn = chance.choice(len(points), size=2 + int(np.log(count)), p=share / share.sum())
        left = np.minimum(_square_distances(points, points[drawn]), away[:, None])
        best = int((left * weights[:, None]).sum(0).argmin())
        chosen.append(int(drawn[best]))
        away = left[:, best]
    return points[chosen]


def _settle(points: NDArray[Any], weights: NDArray[Any], centers: NDArray[Any]) -> tuple[NDArray[Any], float]:
    """Returns the centers [k, d] after Lloyd's iterations, and the weighted sum of squared distances from them."""
    before = np.empty(0)
    for _ in range(_MAX_ITERATIONS):
        distances = _square_distances(points, centers)
        nearest = distances.argmin(1)
        if np.array_equal(nearest, before):
            break
        before = nearest
        mass = np.bincount(nearest, weights, len(centers))
        sums = np.stack([np.bincount(nearest, weights * part, len(centers)) for part in points.T], 1)
        centers = np.where(mass[:, None] > 0, sums / np.maximum(mass, 1e-300)[:, None], centers)
    return centers, float((distances.min(1) * weights).sum())


def _square_distances(points: NDArray[Any], others: NDArray[Any]) -> NDArray[Any]:
    squares = [np.subtract.outer(here, there) ** 2 for here, there in zip(points.T, others.T, strict=True)]
    return np.sum(squares, axis=0)


# Visible difference of two colours: CIEDE2000. A person sees differences of about 1 and more.


def difference(one: Tensor, other: Tensor) -> Tensor:
    """Returns CIEDE2000 between sRGB colours in [0, 1]: [..., 3] and [..., 3] -> [...]. Not differentiable."""
    return ciede2000(to_lab(one.clamp(0, 1)), to_lab(other.clamp(0, 1)))


def ciede2000(one: Tensor, other: Tensor) -> Tensor:
    """Returns CIEDE2000 with all weights 1 between CIE L*a*b* colours: [..., 3] and [..., 3] -> [...].

    G. Sharma, W. Wu, E. Dalal, "The CIEDE2000 color-difference formula", 2005. Not differentiable.
    """
    pair = (lab.detach().cpu().numpy() for lab in torch.broadcast_tensors(one, other))  # type: ignore[no-untyped-call]
    (light, red, yellow), (light_2, red_2, yellow_2) = (np.moveaxis(lab, -1, 0) for lab in pair)
    wide = 1 + 0.5 * (1 - _share_of_chroma(0.5 * (np.hypot(red, yellow) + np.hypot(red_2, yellow_2))))
    chroma, hue = np.hypot(red * wide, yellow), _turn(np.arctan2(yellow, red * wide))
    chroma_2, hue_2 = np.hypot(red_2 * wide, yellow_2), _turn(np.arctan2(yellow_2, red_2 * wide))
    is_grey, middle = chroma * chroma_2 == 0, 0.5 * (chroma + chroma_2)

    apart, total = hue_2 - hue, hue + hue_2
    shorter = np.where(apart > np.pi, apart - 2 * np.pi, np.where(apart < -np.pi, apart + 2 * np.pi, apart))
    across = np.where(total < 2 * np.pi, total + 2 * np.pi, total - 2 * np.pi)
    mean = np.where(is_grey, total, 0.5 * np.where(np.abs(apart) > np.pi, across, total))

    lift = (0.5 * (light + light_2) - 50) ** 2
    by_light = (light_2 - light) / (1 + 0.015 * lift / np.sqrt(20 + lift))
    by_chroma = (chroma_2 - chroma) / (1 + 0.045 * middle)
    weight = 1 - 0.17 * np.cos(mean - np.deg2rad(30)) + 0.24 * np.cos(2 * mean)
    weight = weight + 0.32 * np.cos(3 * mean + np.deg2rad(6)) - 0.20 * np.cos(4 * mean - np.deg2rad(63))
    by_hue = 2 * np.sqrt(chroma * chroma_2) * np.sin(shorter / 2) / (1 + 0.015 * middle * weight)  # 0 for grey
    blue = np.deg2rad(30) * np.exp(-(((np.rad2deg(mean) - 275) / 25) ** 2))
    squared = by_light**2
    for part in (by_chroma**2, by_hue**2, -np.sin(2 * blue) * 2 * _share_of_chroma(middle) * by_chroma * by_hue):
        squared += part  # in the precision of the colours
    return torch.from_numpy(np.asarray(np.sqrt(np.maximum(squared, 0)))).to(one)


def _share_of_chroma(chroma: NDArray[Any]) -> NDArray[Any]:
    """Returns the saturation of the formula: 0 for grey, near 1 for vivid colours."""
    seventh = chroma**7
    return np.asarray(np.sqrt(seventh / (seventh + 25**7)))


def _turn(angle: NDArray[Any]) -> NDArray[Any]:
    return (angle + np.where(angle < 0, 2 * np.pi, 0)).astype(angle.dtype)
