"""The held-out judge of the small world: it reads no words, and says what a picture shows.

A convolutional network, of another architecture than the eye, with another seed, trained on drawings of its own, some
of which show what no sentence says. The programs that trained both stand in this repository's history
(tests/shape_world/train.py and judge.py, 30 November 2026).
"""

from itertools import pairwise
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from shape_world.world import COLOR_NAMES, DRAWN, PLACES, Picture

SIDE = 48
HEADS = {"kind": 5, "ground": len(COLOR_NAMES), "axis": 2, "place": 1 + len(PLACES),
         "color": len(COLOR_NAMES), "shape": len(DRAWN), "color2": len(COLOR_NAMES), "shape2": len(DRAWN)}  # fmt: skip
_NONE = -100  # no label: the loss leaves it out
_TWO_KINDS, _ELSE = 3, 4


def label(picture: Picture) -> list[int]:
    """Returns what a judge should say of a picture, head by head; _NONE if it does not matter.

    The first thing is the left or the upper one.
    """
    upright = picture.set_upright()
    first, second = upright.thing, upright.other
    return [
        picture.count - 1 if second is None else _TWO_KINDS,
        COLOR_NAMES.index(picture.ground),
        _NONE if second is None else ("left of", "above").index(upright.relation),
        ("", *PLACES).index(picture.place) if picture.count == 1 and second is None else _NONE,
        COLOR_NAMES.index(first.color), DRAWN.index(first.shape),
        _NONE if second is None else COLOR_NAMES.index(second.color),
        _NONE if second is None else DRAWN.index(second.shape),
    ]  # fmt: skip


class Judge(nn.Module):
    """Network from pictures [n, 3, SIDE, SIDE] in [0, 1] to labels of their content, head by head."""

    def __init__(self) -> None:
        super().__init__()
        widths = (3, 16, 24, 32, 48)
        layers: list[nn.Module] = []
        for before, after in pairwise(widths):
            layers += [nn.Conv2d(before, after, 3, 2, 1, bias=False), nn.BatchNorm2d(after), nn.ReLU(),
                       nn.Conv2d(after, after, 3, 1, 1, bias=False), nn.BatchNorm2d(after), nn.ReLU()]  # fmt: skip
        self.trunk = nn.Sequential(*layers)
        self.told = nn.Sequential(
            nn.Flatten(), nn.Dropout(0.1), nn.Linear(48 * 9, 128), nn.ReLU(), nn.Linear(128, sum(HEADS.values()))
        )

    def forward(self, pictures: Tensor) -> list[Tensor]:
        return list(self.told(self.trunk(2 * pictures - 1)).split(list(HEADS.values()), 1))

    @torch.no_grad()
    def see(self, pictures: Tensor) -> Tensor:
        """Returns what pictures [n, 3, h, w] show: [n, heads]."""
        small = functional.interpolate(pictures, [SIDE, SIDE], mode="bilinear", antialias=True)
        return torch.stack([part.argmax(1) for part in self(small)], 1)

    def approves(self, picture: Tensor, asked: Picture) -> bool:
        """Returns True if a picture [3, H, W] shows all that its sentence says."""
        seen = self.see(picture[None])[0].tolist()
        return all(want in (_NONE, found) for want, found in zip(label(asked), seen, strict=True))

    def tell(self, picture: Tensor) -> str:
        """Returns what it sees in a picture, in words."""
        kind, ground, axis, place, color, shape, color2, shape2 = self.see(picture[None])[0].tolist()
        if kind == _ELSE:
            return f"something else on {COLOR_NAMES[ground]} ground"
        first, on = f"{COLOR_NAMES[color]} {DRAWN[shape]}", f"on {COLOR_NAMES[ground]} ground"
        if kind == _TWO_KINDS:
            return f"{first} {('left of', 'above')[axis]} {COLOR_NAMES[color2]} {DRAWN[shape2]} {on}"
        where = f" on the {PLACES[place - 1]}" if place and not kind else ""
        return f"{kind + 1} {first}{where} {on}"


def load(file: Path) -> Judge:
    """Returns the judge whose weights are in a file."""
    from safetensors.torch import load_file

    judge = Judge()
    judge.load_state_dict(
        {name: part.float() if part.is_floating_point() else part for name, part in load_file(file).items()}
    )
    return judge.eval()
