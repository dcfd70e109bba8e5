"""A small world of balls, posts and bars: what a picture shows, its sentence, and its drawing.

Things are large enough for a broad brush. Drawings look like paintings and not like vector graphics: edges waver,
colours vary, grounds have gradients, blotches and marks, and half of the drawings consist of strokes.
"""

import math
import random
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

COLORS = {
    "red": (0.82, 0.12, 0.10), "yellow": (0.95, 0.82, 0.12), "green": (0.12, 0.58, 0.22),
    "blue": (0.12, 0.25, 0.75), "black": (0.07, 0.07, 0.08), "white": (0.95, 0.95, 0.93),
}  # fmt: skip
COLOR_NAMES = tuple(COLORS)
PAPER = "white"  # ground of a picture whose sentence names none
SHAPES = ("ball", "post", "bar")
BLOB = "blob"  # no sentence names it: what an optimiser paints to please an eye that looks at colours alone
DRAWN = (*SHAPES, BLOB)
PLACES = ("left", "right", "top", "bottom")
RELATIONS = {"left of": "right of", "right of": "left of", "above": "below", "below": "above"}
COUNTS = ("a", "two", "three")
PLURALS = {"ball": "balls", "post": "posts", "bar": "bars"}
_MAX_THINGS = 4  # in a picture: three and a blob
_NARROW, _LONG = 0.42, 1.25  # half sides of a post or bar, relative to the radius of a ball
_MARKS = 320  # strokes of a field


@dataclass(frozen=True)
class Thing:
    """A shape of a colour."""

    color: str
    shape: str


@dataclass(frozen=True)
class Picture:
    """Content of a picture: one to three equal things, or two different ones in a relation.

    place: of a single thing; "" for the middle
    relation: of the first thing to the second; "" if there is one kind of thing
    """

    thing: Thing
    count: int = 1
    place: str = ""
    relation: str = ""
    other: Thing | None = None
    ground: str = PAPER

    def say(self) -> str:
        """Returns the sentence of the picture."""
        noun = self.thing.shape if self.count == 1 else PLURALS[self.thing.shape]
        said = f"{COUNTS[self.count - 1]} {self.thing.color} {noun}"
        if self.other is not None:
            said = f"{said} {self.relation} a {self.other.color} {self.other.shape}"
        if self.place:
            said = f"{said} on the {self.place}"
        return said if self.ground == PAPER else f"{said} on {self.ground} ground"

    def turn(self) -> "Picture":
        """Returns the picture whose sentence names the second thing first."""
        if self.other is None:
            return self
        return replace(self, thing=self.other, other=self.thing, relation=RELATIONS[self.relation])

    def set_upright(self) -> "Picture":
        """Returns the picture whose sentence names the left or upper thing first: one for each meaning."""
        return self.turn() if self.relation in ("right of", "below") else self

    @property
    def is_kept_aside(self) -> bool:
        """True for about one meaning of five: no training sees its pictures or sentences."""
        return sum(ord(letter) * (7 + at % 5) for at, letter in enumerate(self.set_upright().say())) % 5 == 0

    @property
    def colors(self) -> set[str]:
        """Colours of the things."""
        return {self.thing.color, (self.other or self.thing).color}


def read(sentence: str) -> Picture:
    """Returns the picture of a sentence of the world. Raises ValueError if it is none."""
    words = sentence.split()
    ground = PAPER
    if words[-1:] == ["ground"]:
        ground, words = words[-2], words[:-3]
    place = words[-1] if words[-1] in PLACES and words[-3:-1] == ["on", "the"] else ""
    said = words[: -3 if place else None]
    shapes = {**{shape: shape for shape in SHAPES}, **{many: one for one, many in PLURALS.items()}}
    thing, count = Thing(said[1], shapes[said[2]]), 1 + COUNTS.index(said[0])
    relation, other = "", None
    if len(said) > 3:
        relation, other = " ".join(said[3:-3]), Thing(said[-2], shapes[said[-1]])
    picture = Picture(thing, count, place, relation, other, ground)
    if picture.say() != sentence:
        raise ValueError(f"{sentence!r} is no sentence of the world")
    return picture


def choose_picture(chance: random.Random) -> Picture:
    """Returns a picture of the world: about a third each of single things, counts and relations."""
    ground = chance.choice(COLOR_NAMES) if chance.random() < 0.7 else PAPER
    colors = [color for color in COLORS if color != ground]
    thing, kind = Thing(chance.choice(colors), chance.choice(SHAPES)), chance.random()
    if kind < 0.35:
        return Picture(thing, place=chance.choice(("", *PLACES)), ground=ground)
    if kind < 0.6:
        return Picture(thing, count=chance.choice((2, 3)), ground=ground)
    other = thing
    while other == thing:
        other = Thing(chance.choice(colors), chance.choice(SHAPES))
    return Picture(thing, relation=chance.choice(tuple(RELATIONS)), other=other, ground=ground)


@dataclass(frozen=True)
class Layout:
    """Places of things: (thing, x, y, radius) in shares of the side, y down; and the colour of the ground."""

    placed: tuple[tuple[Thing, float, float, float], ...]
    ground: str


_MIDDLE, _SIDE = 0.5, 0.26
_AT = {"": (_MIDDLE, _MIDDLE), "left": (_SIDE, _MIDDLE), "right": (1 - _SIDE, _MIDDLE),
       "top": (_MIDDLE, _SIDE), "bottom": (_MIDDLE, 1 - _SIDE)}  # fmt: skip
_ROWS = {
    ("ball", 2): ((0.26, 0.5), (0.74, 0.5)), ("ball", 3): ((0.5, 0.27), (0.25, 0.72), (0.75, 0.72)),
    ("post", 2): ((0.29, 0.5), (0.71, 0.5)), ("post", 3): ((0.19, 0.5), (0.5, 0.5), (0.81, 0.5)),
    ("bar", 2): ((0.5, 0.29), (0.5, 0.71)), ("bar", 3): ((0.5, 0.19), (0.5, 0.5), (0.5, 0.81)),
}  # fmt: skip


def lay_out(picture: Picture, chance: random.Random, spoiled: float = 0.0, loose: float = 0.04) -> Layout:
    """Returns a layout of the picture.

    spoiled: probability that a thing is replaced by a blob, or that a blob is added
    loose: largest shift of each thing, as a share of the side
    """
    if picture.other is not None:
        first, second = ("left", "right") if picture.relation in ("left of", "right of") else ("top", "bottom")
        if picture.relation in ("right of", "below"):
            first, second = second, first
        places, size = (_AT[first], _AT[second]), 0.18
        things = [picture.thing, picture.other]
    else:
        places = (_AT[picture.place],) if picture.count == 1 else _ROWS[picture.thing.shape, picture.count]
        size = (0.2 if picture.place else 0.27) if picture.count == 1 else 0.2 if picture.count == 2 else 0.17
        if picture.count > 1 and picture.thing.shape != "ball":
            size = 0.24 if picture.count == 2 else 0.22
        things = [picture.thing] * picture.count
    size *= chance.uniform(0.9, 1.1)
    placed = [
        (thing, x + chance.uniform(-loose, loose), y + chance.uniform(-loose, loose), size * chance.uniform(0.93, 1.07))
        for thing, (x, y) in zip(things, places, strict=True)
    ]
    if chance.random() < spoiled:
        if chance.random() < 0.6:
            at = chance.randrange(len(placed))
            thing, x, y, size = placed[at]
            placed[at] = (replace(thing, shape=BLOB), x, y, size * chance.uniform(0.7, 1.2))
        else:
            color = chance.choice([color for color in COLORS if color != picture.ground])
            x, y, size = chance.uniform(0.1, 0.9), chance.uniform(0.1, 0.9), chance.uniform(0.1, 0.2)
            placed.append((Thing(color, BLOB), x, y, size))
    return Layout(tuple(placed), picture.ground)


def make_stroke_fields(seed: int, side: int, count: int = 48) -> Tensor:
    """Returns for each pixel the point whose colour a stroke brings there: [count, side, side, 2] in -1..1.

    A field is a painting of many strokes in random directions, each in the colour of the picture at its middle.
    """
    generator = torch.Generator().manual_seed(seed)
    along = (torch.arange(side) + 0.5) / side
    y, x = torch.meshgrid(along, along, indexing="ij")
    field = torch.stack((x, y), -1).expand(count, -1, -1, -1).clone()
    for number in range(_MARKS):
        fine = 1 - number / _MARKS  # large strokes first
        middle = torch.rand(count, 2, 1, 1, generator=generator)
        angle = math.pi * torch.rand(count, 1, 1, generator=generator)
        length = 0.01 + (0.02 + 0.07 * fine) * torch.rand(count, 1, 1, generator=generator)
        width = 0.014 + (0.008 + 0.03 * fine) * torch.rand(count, 1, 1, generator=generator)
        dx, dy = x - middle[:, 0], y - middle[:, 1]
        far = (dx * angle.cos() + dy * angle.sin()).abs() - length
        aside = dy * angle.cos() - dx * angle.sin()
        over = (far.clamp(min=0).square() + aside.square()) < width.square()
        field = torch.where(over[..., None], middle.permute(0, 2, 3, 1), field)
    return 2 * field - 1


def draw(layouts: list[Layout], seed: int, fields: Tensor) -> Tensor:
    """Returns drawings [n, 3, side, side] in [0, 1].

    fields: strokes of half of the drawings, from `make_stroke_fields`; they set the side
    """
    chance = torch.Generator().manual_seed(seed)
    n, side = len(layouts), fields.shape[1]
    placed = [[*one.placed, *[None] * (_MAX_THINGS - len(one.placed))] for one in layouts]
    places = torch.tensor([[(0.5, 0.5, -1.0) if one is None else one[1:] for one in row] for row in placed])
    colors = torch.tensor([[0 if one is None else COLOR_NAMES.index(one[0].color) for one in row] for row in placed])
    shapes = torch.tensor([[0 if one is None else DRAWN.index(one[0].shape) for one in row] for row in placed])
    grounds = torch.tensor([COLOR_NAMES.index(layout.ground) for layout in layouts])
    table = torch.tensor(list(COLORS.values()))
    along = (torch.arange(side) + 0.5) / side
    y, x = torch.meshgrid(along, along, indexing="ij")

    def rand(*shape: int) -> Tensor:
        return torch.rand(n, *shape, generator=chance)

    def randn(*shape: int) -> Tensor:
        return torch.randn(n, *shape, generator=chance)

    def smooth(channels: int, cells: int) -> Tensor:
        return functional.interpolate(randn(channels, cells, cells), [side, side], mode="bilinear", align_corners=False)

    wave = rand(1, 1, 1) * (0.02 * smooth(2, 6) + 0.012 * smooth(2, 12))
    xs, ys = x + wave[:, 0], y + wave[:, 1]
    strength = rand(1, 1, 1)
    picture = (table[grounds] + 0.05 * randn(3))[:, :, None, None]
    picture = picture + strength * (0.07 * smooth(3, 2) + 0.05 * smooth(1, 8))
    for _ in range(3):  # marks on the ground, of nearly its colour
        angle, cx, cy = math.pi * rand(1, 1), rand(1, 1), rand(1, 1)
        u, v = (xs - cx) * angle.cos() + (ys - cy) * angle.sin(), (ys - cy) * angle.cos() - (xs - cx) * angle.sin()
        over = (v.abs() < 0.03) & (u.abs() < 0.2)
        picture = picture + over[:, None] * (0.12 * randn(3, 1, 1) * rand(1, 1, 1))
    edge = 25 + 60 * rand(1, 1)
    turn = 0.08 * randn(_MAX_THINGS)
    stretch = torch.where(rand(_MAX_THINGS) < 0.5, 1.4 + 0.3 * rand(_MAX_THINGS), 0.6 + 0.1 * rand(_MAX_THINGS))
    bumps = 0.6 * smooth(1, 5)[:, 0]
    for j in range(_MAX_THINGS):
        cx, cy, r = (places[:, j, k, None, None] for k in range(3))
        t = torch.where(shapes[:, j] == DRAWN.index(BLOB), 20 * turn[:, j], turn[:, j])[:, None, None]
        u, v = (xs - cx) * t.cos() + (ys - cy) * t.sin(), (ys - cy) * t.cos() - (xs - cx) * t.sin()
        ball = (u * u + v * v + 1e-8).sqrt()
        post = torch.maximum(u.abs() / _NARROW, v.abs() / _LONG)
        bar = torch.maximum(u.abs() / _LONG, v.abs() / _NARROW)
        s = stretch[:, j, None, None].sqrt()
        blob = (u * u * s * s + v * v / (s * s) + 1e-8).sqrt() * (1 + bumps) * 1.1
        distance = torch.stack((ball, post, bar, blob), 1)[torch.arange(n), shapes[:, j]]
        over = ((r - distance) * edge).sigmoid() * (r > 0)
        tone = (table[colors[:, j]] + 0.05 * randn(3))[:, :, None, None] + 0.05 * strength * smooth(1, 8)
        picture = picture + over[:, None] * (tone - picture)
    some = torch.randperm(n, generator=chance)[: n // 2]
    which = torch.randint(len(fields), (len(some),), generator=chance)
    painted = functional.grid_sample(picture[some], fields[which], mode="bilinear", align_corners=False)
    picture = picture.index_copy(0, some, painted + 0.03 * torch.randn(painted.shape, generator=chance))
    soft = functional.avg_pool2d(functional.pad(picture, (1, 1, 1, 1), mode="replicate"), 3, 1)
    picture = picture + rand(1, 1, 1) * (soft - picture)
    haze = 0.2 * rand(1, 1, 1) * rand(1, 1, 1)  # paints are paler or darker than they should be
    picture = picture + haze * (rand(1, 1, 1) - picture)
    return (picture + 0.03 * strength * randn(3, side, side)).clamp(0, 1)
