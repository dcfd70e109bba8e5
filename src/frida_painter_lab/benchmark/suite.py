"""The frozen suite of the benchmark: pictures, combined goals, budgets and seeds of the studio.

Nothing here changes within a version: a figure of `v1` means the same in ten years. The pictures are the public half,
for tuning. The held-out half is made by a rule from a seed (`held_out_picture`), so that everybody can make an own one
that no system was tuned on: "cat~7" is a part of `cat`, mirrored or not, in other colours, as seed 7 decides.
"""

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.strokes.palette import from_lab, to_lab
from frida_painter.system import images, storage

VERSION = "v1"
SEEDS = (11, 12, 13, 14, 15)
"""Seeds of the virtual studio: its placement error, its hand, its paint and its camera."""
_LONG, _SHORT = 0.280, 0.210  # metres
MAX_HELD_OUT_SEED = 2**31 - 1


@dataclass(frozen=True)
class Budget:
    """Budget of a painting; the painting ends when a part of it is used up.

    strokes: brush strokes on the canvas
    paints: paints that are mixed, in all layers together
    minutes: of the robot's clock, with dips, washing, looks and drying
    dips: of the brush into a paint
    """

    strokes: int
    paints: int
    minutes: float
    dips: int


BUDGETS: Mapping[int, Budget] = {
    100: Budget(100, 12, 60.0, 100),
    300: Budget(300, 12, 150.0, 250),
    1000: Budget(1000, 24, 420.0, 700),
}
"""Budgets by their number of strokes."""

_PICTURES: Mapping[str, tuple[str, str]] = {
    "astronaut": ("portrait", "a4e9f56d3660e878e07bd4e21248a6be0e8b655dde4c314878f07e2651a77b7d"),
    "smile": ("portrait", "549d666e2122b36d8418c325af0fcab95c4f9d222c0cd5a36866208e80cbf6a3"),
    "cameraman": ("portrait", "e073ad8bbc03bfaf1e41a35c24d7a4afacaeb86832a850fac15adcd3db4dfcac"),
    "cat": ("animal", "fb9f769d2c57a9bcbb8950aa05233d0f769a9b621c4d573a05923aef0e460f31"),
    "raccoon": ("animal", "648c15d3f52852f6c3606bab2c210a9f60aac647e3f7ee6ae5e38700fdba29ab"),
    "dogs": ("animal", "605940d1baefa81363811e1efc150184c0187a61bf62dd93b2b0b46407cf4d05"),
    "mountain": ("place", "d6738033d4c03fc1a6d2c839c98fcf863af4b6f12c48a5dca85e19225a2296f9"),
    "temple": ("place", "13050d8ea82ead1c4c4af4c4b305333c25932d16638eb95f8bc564cbe1e1d6c7"),
    "stream": ("place", "acf8ff06ed8c5daeb7e0058df3515797910320a27c4ca33d85c8ef8077231dc2"),
    "coffee": ("still life", "f2a6c3a51070b8141e593135ed1a6baa31ac132e620b2e3422b503918bc881b4"),
    "fig": ("still life", "d6bd5ea6e1a91eff888ff67fb88b048af48ed70186a23374360656f30cee30fd"),
    "brushes": ("still life", "1b3bc95cb502f26f57f4df75539e88c89d8bd4bab3b4f959ea80002ac18944af"),
    "bottle": ("still life", "0568cbdf3a6ddaac0b07a770ce199ab1e92618fc8bf774bdb4f12f69e024b3f3"),
    "coins": ("still life", "603d505722c1bda2fce4a836d80cb889b2266ca44308b8cad3ba4c1530ae938d"),
    "flower": ("still life", "8cc2b537f298fc732b9ae5f3a7f66338fec58c52b1b5c882406eb4c763ca482a"),
    "dandelions": ("still life", "a3b9a4670549cdcf70721f199c4a98042fc089bdacaf5258480b3d5e043f4c84"),
    "rocket": ("night", "279d89e6d143958974ed8c900732b822e67f817cc9167f82bc43a1a06e786c59"),
    "galaxies": ("night", "32d941c9c37a3c9f0d5d97eb318de6ab12c92ba4d3fdd45f193fda4d1ef8ade9"),
    "moon": ("night", "44dac451670a9d1741c6042bd2b27764e8a635269e4ef410b617791d67f6e832"),
    "dusk": ("night", "f1ea7f5effbfca735d42be6ea2c17555e763727beee500929b79c073bbf6a653"),
    "peaks": ("snow", "0e19ef15bec5aa5691372164950fed7fdf541a2ac49f447c417b20b07a97b1cd"),
    "glacier": ("snow", "d60f0b79b0a7f2b6beabf3926e046cac16002a1b0cf6c9a8da697eb5799c0289"),
    "sailing-boat": ("drawing", "acc06446512965f62d07c2b938d7dadf59fe22c3ece2459ed07e50d2c35373a1"),
    "house": ("drawing", "5d25ad1d7158e171e41c15be35e0a7ac4475ae495e036d30fdbeaa8cd9f78b9c"),
}
"""Category and sha256 of each picture; pictures/README.md has the authors and licences."""
PICTURES = tuple(_PICTURES)

GOALS: Mapping[str, tuple[Mapping[str, Any], ...]] = {
    "rocket-and-dusk": ({"image": "rocket"}, {"image": "dusk", "weight": 0.5}),
    "coffee-and-coins": ({"image": "coffee"}, {"image": "coins", "weight": 0.3}),
    "flower-in-brushes": ({"image": "flower"}, {"style": "brushes", "weight": 2.0}),
    "temple-in-dusk": ({"image": "temple"}, {"style": "dusk", "weight": 2.0}),
    "cat-by-content": ({"semantic": "cat"}, {"image": "cat", "weight": 0.3}),
    "peaks-in-stream": ({"semantic": "peaks"}, {"style": "stream"}),
    "boat-in-dusk": ({"sketch": "sailing-boat"}, {"style": "dusk"}),
    "house-in-flower": ({"sketch": "house"}, {"style": "flower"}),
    "boat-on-the-sea": ({"sketch": "sailing-boat"}, {"text": "a sailing boat on the sea"}),
    "house-in-snow": ({"sketch": "house"}, {"text": "a house in the snow"}),
    "lemon-like-fig": ({"text": "a lemon"}, {"style": "fig"}),
    "moon-like-galaxies": ({"text": "the moon"}, {"style": "galaxies"}),
}
"""Combined goals; pictures are named. The first two need no network, the others those of `models fetch`."""


@dataclass(frozen=True)
class BenchmarkGoal:
    """Goal of a cell of the table.

    name: of a picture of the suite, of a held-out picture ("cat~7"), of a combined goal, or of a file
    items: goal in the form of a goal file, with paths
    canvas: size of the canvas, fixed by the suite
    picture: sRGB [3, H, W] that the painting is compared with; None for a combined goal
    """

    name: str
    items: tuple[Mapping[str, Any], ...]
    canvas: CanvasSize
    picture: Tensor | None = None


def suite_digest() -> str:
    """Returns the sha256 of everything that the version of the suite fixes."""
    goals = {name: [dict(item) for item in items] for name, items in GOALS.items()}
    budgets = {str(name): asdict(budget) for name, budget in BUDGETS.items()}
    fixed = [VERSION, {name: list(value) for name, value in _PICTURES.items()}, goals, budgets, SEEDS, [_LONG, _SHORT]]
    return hashlib.sha256(json.dumps(fixed, sort_keys=True).encode()).hexdigest()


def find_budget(strokes: int) -> Budget:
    """Returns the budget with that number of strokes. Raises ConfigError."""
    if strokes not in BUDGETS:
        known = ", ".join(map(str, BUDGETS))
        raise ConfigError(f"The suite {VERSION} has no budget of {strokes} strokes; budgets are {known}.")
    return BUDGETS[strokes]


def find_goal(name: str, folder: Path) -> BenchmarkGoal:
    """Returns the goal of a cell by its name.

    name: a picture, a held-out picture such as "cat~7", a combined goal, or the path of a picture file
    folder: takes the file of a held-out picture

    Raises ConfigError for an unknown name and for a picture of the suite that was edited; ImageError.
    """
    source, tilde, seed = name.partition("~")
    if name in GOALS:
        items = tuple(
            {kind: str(_file_of(value)) if value in _PICTURES else value for kind, value in item.items()}
            for item in GOALS[name]
        )
        return BenchmarkGoal(name, items, CanvasSize(_LONG, _SHORT))
    if name in _PICTURES:
        path = _file_of(name)
    elif tilde and source in _PICTURES:
        if re.fullmatch(r"[0-9]{1,10}", seed) is None or not 0 <= int(seed) <= MAX_HELD_OUT_SEED:
            raise ConfigError(
                f"The held-out picture {name[:60]!r} has no seed; write {source}~ and a whole number from 0 to "
                f"{MAX_HELD_OUT_SEED}, such as {source}~7."
            )
        name, path = f"{source}~{int(seed)}", folder / f"{source}-{int(seed)}.png"
        if not path.exists():
            images.save(held_out_picture(source, int(seed)), path)
    elif Path(name).suffix and Path(name).is_file():
        name, path = Path(name).stem, Path(name)
    else:
        raise ConfigError(
            f"{name[:60]!r} is neither a picture nor a goal of the suite {VERSION}; there are {', '.join(PICTURES)}, "
            f"{', '.join(GOALS)}, held-out pictures such as cat~7, and picture files."
        )
    picture = images.load(path, longest=1024)
    rows, columns = picture.shape[1:]
    ratio = min(rows, columns) / max(rows, columns)
    if not ratio >= 0.25:
        raise ConfigError(
            f"The picture has {columns} x {rows} pixels; its longer side is at most four times the shorter one."
        )
    short = round(_LONG * ratio, 3)  # in its own proportions
    canvas = CanvasSize(_LONG, short) if columns >= rows else CanvasSize(short, _LONG)
    return BenchmarkGoal(name, ({"image": str(path)},), canvas, picture)


def held_out_picture(name: str, seed: int) -> Tensor:
    """Returns a picture of the held-out half, sRGB [3, H, W].

    The rule: a part of 55 to 85 % of each side, at any place; mirrored in half of the cases; its colours turned about
    the axis of greys of CIE L*a*b* by 60 to 300 degrees; its lightness bent by an exponent from 0.75 to 1.35.
    """
    random = np.random.default_rng([seed, PICTURES.index(name)])
    picture = images.load(_file_of(name))
    _, rows, columns = picture.shape
    share, left, top = random.uniform(0.55, 0.85), random.uniform(), random.uniform()
    box = (left * (1 - share), top * (1 - share), share, share)
    part = images.crop(picture, box)
    if random.uniform() < 0.5:
        part = part.flip(2)
    pixels: NDArray[np.float32] = part.permute(1, 2, 0).contiguous().numpy()
    larger = cv2.resize(pixels, (columns, rows), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    lightness, a, b = to_lab(torch.from_numpy(larger)).unbind(-1)
    turn = math.radians(random.uniform(60, 300))
    cos, sin = math.cos(turn), math.sin(turn)
    bent = 100 * (lightness / 100).clamp(0, 1) ** random.uniform(0.75, 1.35)
    turned = torch.stack((bent, cos * a - sin * b, sin * a + cos * b), -1)
    return from_lab(turned).permute(2, 0, 1).contiguous().clamp(0, 1)


def _file_of(name: str) -> Path:
    """Returns the file of a picture after a check of its hash. Raises ConfigError if it was edited."""
    path = Path(__file__).parent / "pictures" / f"{name}.jpg"
    if storage.sha256(path, "a picture of the benchmark") != _PICTURES[name][1]:
        raise ConfigError(
            f"The picture {name} of the suite {VERSION} was edited, so no figure would be comparable; install "
            "frida-painter anew."
        )
    return path
