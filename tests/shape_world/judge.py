"""The held-out judge of the small world: it reads no words, and says what a picture shows.

    PYTHONPATH=tests python -m shape_world.judge FILE.safetensors [--steps 1500] [--seed 77]

A convolutional network, of another architecture than the eye, with another seed, trained on drawings of its own, some
of which show what no sentence says.
"""

import argparse
import random
import time
from itertools import pairwise
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from shape_world import world
from shape_world.world import BLOB, COLOR_NAMES, DRAWN, PLACES, Layout, Picture, Thing

SIDE = 48
HEADS = {"kind": 5, "ground": len(COLOR_NAMES), "axis": 2, "place": 1 + len(PLACES),
         "color": len(COLOR_NAMES), "shape": len(DRAWN), "color2": len(COLOR_NAMES), "shape2": len(DRAWN)}  # fmt: skip
_NONE = -100  # no label: the loss leaves it out
_TWO_KINDS, _ELSE = 3, 4
_BATCH, _POOL = 96, 450


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


def _draw_batch(chance: random.Random, fields: Tensor) -> tuple[Tensor, Tensor]:
    """Returns drawings and their labels: a tenth with blobs for things, a tenth with a blob more, some mixed up."""
    layouts, facts = [], []
    while len(layouts) < _BATCH:
        picture = world.choose_picture(chance)
        if picture.is_kept_aside:
            continue
        layout, told, kind = world.lay_out(picture, chance, loose=0.06), label(picture), chance.random()
        if kind < 0.1:
            blobs = tuple((Thing(thing.color, BLOB), x, y, r) for thing, x, y, r in layout.placed)
            layout = Layout(blobs, layout.ground)
            told[5] = DRAWN.index(BLOB)
            told[7] = told[7] if told[7] == _NONE else told[5]
        elif kind < 0.2:
            color = chance.choice([name for name in COLOR_NAMES if name != picture.ground])
            more = Thing(color, BLOB), chance.uniform(0.1, 0.9), chance.uniform(0.1, 0.9), chance.uniform(0.12, 0.22)
            layout, told = Layout((*layout.placed, more), layout.ground), [_ELSE, told[1], *[_NONE] * 6]
        layouts.append(layout)
        facts.append(told)
    drawn = world.draw(layouts, chance.randrange(2**31), fields)
    labels = torch.tensor(facts)
    mixed = torch.arange(0, _BATCH, 16)
    drawn[mixed] = 0.5 * (drawn[mixed] + drawn[mixed + 1])
    labels[mixed] = _NONE
    labels[mixed, 0] = _ELSE
    return drawn, labels


def train(file: Path, steps: int, seed: int) -> None:
    """Trains a judge and writes its weights."""
    from safetensors.torch import save_file

    torch.manual_seed(seed)
    chance, fields, started = random.Random(seed), world.make_stroke_fields(seed, SIDE), time.process_time()
    judge = Judge().train()
    optimiser = torch.optim.AdamW(judge.parameters(), 3e-3, weight_decay=0.02)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 4e-3, total_steps=steps)
    pool: list[tuple[Tensor, Tensor]] = []
    for step in range(steps):
        if len(pool) < _POOL:
            drawn, facts = _draw_batch(chance, fields)
            pool.append((drawn.half(), facts))
        drawn, facts = pool[-1] if len(pool) < _POOL else pool[chance.randrange(_POOL)]
        noise = torch.randn(drawn.shape) * 0.05 * torch.rand(len(drawn), 1, 1, 1)
        parts = judge((drawn.float() + 0.05 * torch.randn(len(drawn), 3, 1, 1) + noise).clamp(0, 1))
        losses = [functional.cross_entropy(part, facts[:, at]) for at, part in enumerate(parts)]
        loss = torch.stack(losses).nansum()  # a head without a label in this batch has none
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        if step % 100 == 0:
            print(f"{step} {time.process_time() - started:.0f} s: {float(loss.detach()):.3f}", flush=True)
    save_file(
        {name: part.half() if part.is_floating_point() else part for name, part in judge.state_dict().items()}, file
    )


def load(file: Path) -> Judge:
    """Returns the judge whose weights are in a file."""
    from safetensors.torch import load_file

    judge = Judge()
    judge.load_state_dict(
        {name: part.float() if part.is_floating_point() else part for name, part in load_file(file).items()}
    )
    return judge.eval()


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("file", type=Path)
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=77)
    given = parser.parse_args()
    torch.set_num_threads(1)
    train(given.file, given.steps, given.seed)
