"""The frozen suite of the benchmark: pictures, combined goals, budgets and seeds of the studio.

Nothing here changes within a version: a figure of `v1` means the same in ten years. The pictures are the public half,
for tuning. The held-out half is made by a rule from a seed (`held_out_picture`), so that everybody can make an own one
that no system was tuned on: "cat~7" is a part of `cat`, mirrored or not, in other colours, as seed 7 decides.
"""

import hashlib
import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
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


_FIXED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
BUDGETS: Mapping[int, Budget] = {one["strokes"]: Budget(**one) for one in _FIXED["budgets"]}
"""Budgets by their number of strokes."""
_PICTURES: Mapping[str, tuple[str, str]] = _FIXED["pictures"]
PICTURES = tuple(_PICTURES)
GOALS: Mapping[str, Sequence[Mapping[str, Any]]] = _FIXED["goals"]
"""Combined goals, which name their pictures."""


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
