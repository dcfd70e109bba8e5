"""Figures of people who do something: a drawn body in the pose of a verb, with its tool, dressed as those called so."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from frida_painter.drawing.compositing import resize
from frida_painter.drawing.lights import Color, color_of
from frida_painter.drawing.tables import read_lines
from frida_painter.objectives.encoders.sentence import SentenceEncoder

_Point = npt.NDArray[np.float64]

# Poses, clothes and tools, from tables.

_Shapes = tuple[tuple[str, ...], ...]


class Pose(NamedTuple):
    """Pose: its words, angles of the body's parts in degrees, and what carries it, as `poses.txt` explains."""

    words: tuple[str, ...]
    angles: tuple[float, ...]
    carried: str


class Tool(NamedTuple):
    """Tool of an action: words of the action, names of the things it shows, a pose and shapes, as `tools.txt` explains.

    color: of its main part, if the prompt does not give another
    """

    words: tuple[str, ...]
    things: tuple[str, ...]
    pose: Pose
    color: Color
    shapes: _Shapes

    @property
    def meets(self) -> bool:
        """True if two who do it together touch, or share the tool."""
        return any(shape[0] == "meet" for shape in self.shapes)


class Clothes(NamedTuple):
    """Clothes of people: names of those who wear them, colours, cut, and shapes, as `clothes.txt` explains.

    A garment has its own names and colour, what it dyes, and a cut or "-", as `garments.txt` explains.
    kinds: first words of the clothes that several people have in turn: boys' and girls' of children
    """

    words: tuple[str, ...]
    top: Color
    bottom: Color
    cut: str
    shapes: _Shapes = ()
    kinds: tuple[str, ...] = ()

    def put_on(self, garment: Clothes, color: str) -> Clothes:
        """Returns the clothes with a garment of that colour over them or instead of them."""
        is_top, is_bottom = (garment.bottom in (part, "all") for part in ("top", "bottom"))
        top, bottom = color if is_top else self.top, color if is_bottom else self.bottom
        over = tuple(tuple(color if word == "@" else word for word in shape) for shape in garment.shapes)
        cut = self.cut if garment.cut == "-" else garment.cut
        return Clothes(self.words, top, bottom, cut, over if is_top else (*self.shapes, *over))


def _rows(name: str) -> list[tuple[list[tuple[str, ...]], list[str], _Shapes]]:
    """Returns the rows of a table: lists of words, what is after their colon, and shapes."""
    split = [re.split(r": |; ", line) for line in read_lines(f"drawing/{name}")]
    return [
        (
            [tuple(words.split(", ")) for words in head.split(" = ")],
            rest.split(),
            tuple(tuple(one.split()) for one in some),
        )
        for head, rest, *some in split
    ]


@cache
def poses() -> tuple[Pose, ...]:
    """Returns the table of `poses.txt`."""
    return tuple(Pose(words, tuple(map(float, angles)), held) for (words,), (*angles, held), _ in _rows("poses.txt"))


@cache
def tools() -> tuple[Tool, ...]:
    """Returns the table of `tools.txt`."""
    found, rows = {word: pose for pose in poses() for word in pose.words}, _rows("tools.txt")
    return tuple(
        Tool(acts, things, found[" ".join(pose)], color, some) for (acts, things), (*pose, color), some in rows
    )


@cache
def wardrobe(file: str = "clothes.txt") -> tuple[Clothes, ...]:
    """Returns a table of clothes: of people, or "garments.txt"."""
    return tuple(
        Clothes(words, top, bottom, cut, some, *kinds) for (words, *kinds), (top, bottom, cut), some in _rows(file)
    )


_Row = TypeVar("_Row", bound=Pose | Clothes | Tool)


def nearest(said: Sequence[str], rows: Sequence[_Row], sentences: SentenceEncoder) -> tuple[_Row, str, float]:
    """Returns the row of a table with the word of most similar meaning to any of some words, that word, and its
    similarity."""
    owners: list[tuple[_Row, str]] = [(row, word) for row in rows for word in row.words]
    meanings = sentences.embed([*said, *(word for _, word in owners)])
    similarity, best = (meanings[len(said) :] @ meanings[: len(said)].T).amax(1).max(0)
    row, word = owners[int(best)]
    return row, word, float(similarity)


# Drawing. Lengths are in heights of the head; x points right, and y down.

_SIDE, _UNIT = 1024, 48  # pixels of the sheet, and of a head
_NECK, _TORSO, _UPPER_ARM, _FOREARM, _THIGH, _SHIN = 1.05, 2.1, 1.25, 1.15, 1.7, 1.7  # lengths
_FOOT, _HAND = 0.5, 0.2  # length of a foot, and radius of a hand
_ADULT = 6.0  # height of an adult's body below the head, to which the lengths apply
_SHADED = 0.72  # brightness of the far limbs
_LIFTED = 0.16  # space below somebody in the air, as a share of the height
_SKINS = ("burlywood", "peru", "tan", "sienna", "sandybrown")
_HAIRS, _WHITE = ("saddlebrown", "black", "darkgoldenrod", "black", "sienna"), "silver"
_DARK = 0.3  # brightness of shoes
_SOLE, _EDGE = 0.12, 0.03  # depth of the floor below an ankle; half the width of the edge of an area
_HOLDS = {"hips": "k0,0", "lap": "k.7,.3", "shoulder": "c-.4,.3", "back": "c-.75,-1.2"}  # places of who sits there
_TONES = {"@": 1.0, "-": 0.75, "+": 1.25}
_STOOL = tuple(
    tuple(f"line saddlebrown {line}".split())
    for line in (".28 k-.35,-.5 k.55,-.5", ".2 k-.35,-.5 g-.35,.1", ".2 k.55,-.5 g.55,.1")
)


@dataclass(frozen=True)
class Figure:
    """Drawn figure.

    picture: colour and opacity [4, h, w]
    hand: place of the hand, or of the end of its tool, from the middle of the lower edge, in widths and heights
    holds: places of the hips, the lap, the shoulder and the back, likewise
    seat: height of the hips of somebody who sits, as a share of the picture's height; 0 for others
    tall: height of the picture, by the height of the same figure upright
    does: words of the tables that mean what it does, or ""
    meets: place across at which it touches who does the same, in widths from the middle; None if it touches nobody
    afloat: True for a swimmer, whose lower half the water hides
    """

    picture: Tensor
    hand: tuple[float, float]
    seat: float
    tall: float
    does: str = ""
    meets: float | None = None
    afloat: bool = False
    holds: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def mirror(self) -> Figure:
        """Returns the figure that looks to the left."""
        meets = None if self.meets is None else -self.meets
        holds = {name: (-across, up) for name, (across, up) in self.holds.items()}
        return replace(self, picture=self.picture.flip(2), hand=(-self.hand[0], self.hand[1]), meets=meets, holds=holds)


def draw_figure(
    pose: Pose, worn: Clothes, *, heads: float, is_old: bool, kind: int, has_seat: bool, tool: Tool | None = None
) -> Figure:
    """Returns a figure that looks to the right.

    heads: height of the body upright, in heads: about 7, and 4 to 5 for a child
    is_old: True for white hair
    kind: number that chooses the colours of skin and hair
    has_seat: True if something in the scene carries somebody who sits; otherwise there is a stool
    """
    body, sheet = _Body(pose, (heads - 1) / _ADULT), _Sheet()
    skin, hair = _SKINS[kind % len(_SKINS)], _WHITE if is_old else _HAIRS[kind % len(_HAIRS)]
    _draw_shapes(sheet, body, _STOOL if pose.carried == "seat" and not has_seat else (), "", 1.0)
    shapes, main, size = (tool.shapes, tool.color, (1 + body.grown) / 2) if tool else ((), "", 1.0)
    kinds = [shape[0] for shape in shapes]
    first, last = (kinds.index(part) if part in kinds else end for part, end in (("body", 0), ("arm", len(kinds))))
    _draw_shapes(sheet, body, shapes[:first], main, size)
    _draw_arm(sheet, body, 1, worn, skin)
    for number in (1, 0):
        _draw_leg(sheet, body, number, worn, skin)
    if worn.cut in ("skirt", "robe", "coat"):
        hem, wide = (body.ankles, 0.4) if worn.cut == "robe" else (body.knees, 0.36)
        color = worn.top if worn.cut == "coat" else worn.bottom
        sheet.fill(color, [(body.hips, 0.4), *((end, wide) for end in hem)])
    sheet.draw(worn.top, [(body.hips, 0.44), (body.chest, 0.52)])
    _draw_head(sheet, body, worn, skin, hair)
    _draw_shapes(sheet, body, shapes[first:last], main, size)
    _draw_arm(sheet, body, 0, worn, skin)
    _draw_shapes(sheet, body, shapes[last:], main, size)
    ends = {shape[0]: body.find(shape[1], size)[0] for shape in shapes if shape[0] in ("end", "meet")}
    return _cut_out(sheet, body, pose, heads, ends.get("end", body.hands[0]), ends.get("meet"))


def _beyond(start: _Point, angle: float, length: float) -> _Point:
    """Returns the point at a distance in a direction, in degrees from straight down to the right."""
    turned = math.radians(angle)
    return start + length * np.array([math.sin(turned), math.cos(turned)])


class _Body:
    """Joints of a body in a pose, the near ones of a pair first.

    grown: height of the body by that of an adult's
    """

    def __init__(self, pose: Pose, grown: float) -> None:
        lean, nod, near_arm, near_fore, far_arm, far_fore, *legs = pose.angles
        self.hips, self._upward, self._spine, self.grown = np.zeros(2), 180 - lean - nod, 180 - lean, grown
        self.chest = _beyond(self.hips, 180 - lean, _TORSO * grown)
        self.skull = _beyond(self.chest, self._upward, _NECK)
        self.forearms, self.shins = (near_fore, far_fore), (legs[1], legs[3])
        self.elbows = [_beyond(self.chest, angle, _UPPER_ARM * grown) for angle in (near_arm, far_arm)]
        self.wrists = [
            _beyond(elbow, angle, _FOREARM * grown) for elbow, angle in zip(self.elbows, self.forearms, strict=True)
        ]
        self.hands = [_beyond(wrist, angle, _HAND) for wrist, angle in zip(self.wrists, self.forearms, strict=True)]
        self.knees = [_beyond(self.hips, angle, _THIGH * grown) for angle in legs[::2]]
        self.ankles = [_beyond(knee, angle, _SHIN * grown) for knee, angle in zip(self.knees, self.shins, strict=True)]

    @property
    def floor(self) -> float:
        """Height of the lower foot."""
        return float(max(ankle[1] for ankle in self.ankles))

    def find(self, said: str, size: float) -> tuple[_Point, float]:
        """Returns the place of a point of a shape, as `tools.txt` explains, and half a width, of that size."""
        across, up, wide = (size * float(length) for length in f"{said[1:]},0".split(",")[:3])
        hand = self.hands[said[0] == "o"]
        x, y = {"f": (hand[0], self.floor + _SOLE), "g": (self.hips[0], self.floor + _SOLE)}.get(said[0], hand)
        turned = {"a": (self.skull, self._upward), "c": (self.chest, self._spine), "k": (self.hips, self._spine)}
        turned |= {name: (self.ankles[at], self.shins[at] + 180) for at, name in enumerate("lm")}
        start, upward = turned.get(said[0], (np.array([x, y]), 180.0))
        return _beyond(_beyond(start, upward, up), upward - 90, across), wide


class _Sheet:
    """Sheet on which limbs are drawn: colour and opacity. Each joint of a limb has half a width."""

    def __init__(self) -> None:
        self.drawn = np.zeros((_SIDE, _SIDE, 4), np.float32)

    def draw(self, color: Color, joints: Sequence[tuple[_Point, float]], shade: float = 1.0) -> None:
        """Draws a limb through joints."""
        for pair in pairwise(joints):
            self.fill(color, pair, shade)

    def fill(self, color: Color, joints: Sequence[tuple[_Point, float]], shade: float = 1.0) -> None:
        """Fills the hull of joints."""
        around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        circle = np.stack((np.cos(around), np.sin(around)), 1)
        edge = np.concatenate([middle + wide * circle for middle, wide in joints])
        pixels = np.round(16 * (edge * _UNIT + _SIDE / 2)).astype(np.int32)  # in sixteenths of a pixel
        paint = (*(shade * color_of(color)).clamp(max=1.0).tolist(), 1.0)
        cv2.fillConvexPoly(self.drawn, cv2.convexHull(pixels), paint, shift=4)


def _draw_arm(sheet: _Sheet, body: _Body, number: int, worn: Clothes, skin: str) -> None:
    shade = _SHADED if number else 1.0
    sheet.draw(worn.top, [(body.chest, 0.24), (body.elbows[number], 0.22), (body.wrists[number], 0.16)], shade)
    sheet.fill(skin, [(body.hands[number], _HAND)], shade)


def _draw_leg(sheet: _Sheet, body: _Body, number: int, worn: Clothes, skin: str) -> None:
    shade, knee, ankle = _SHADED if number else 1.0, body.knees[number], body.ankles[number]
    toe = _beyond(ankle, body.shins[number] + 75, _FOOT)
    sheet.fill(worn.bottom, [(ankle, 0.18), (toe, 0.12)], _DARK)
    sheet.fill(skin if worn.cut == "skirt" else worn.bottom, [(body.hips, 0.32), (knee, 0.26)], shade)
    sheet.fill(skin if worn.cut in ("skirt", "shorts") else worn.bottom, [(knee, 0.24), (ankle, 0.18)], shade)
    if worn.cut == "robe":
        sheet.fill(worn.bottom, [(body.hips, 0.44), (knee, 0.42), (ankle, 0.44)], shade)


def _draw_head(sheet: _Sheet, body: _Body, worn: Clothes, skin: str, hair: str) -> None:
    sheet.draw(skin, [(body.chest, 0.2), (body.skull, 0.2)], 0.85)
    if any(one.cut in ("skirt", "robe") for one in (worn, *wardrobe()) if one.words == worn.words):  # long hair
        sheet.fill(hair, [body.find("a-0.2,0.0,0.42", 1.0), body.find("a-0.3,-0.75,0.26", 1.0)])
    sheet.fill(hair, [body.find("a-0.08,0.06,0.52", 1.0)])
    hood = tuple(("area", *rest) for name, *rest in worn.shapes if name == "hood")
    _draw_shapes(sheet, body, hood, worn.top, 1.0)  # it covers the hair, and not the face
    sheet.fill(skin, [body.find("a0.1,-0.06,0.43", 1.0)])
    sheet.fill("black", [body.find("a0.32,0.0,0.055", 1.0)])  # an eye
    _draw_shapes(sheet, body, worn.shapes, worn.top, 1.0)


def _draw_shapes(sheet: _Sheet, body: _Body, shapes: _Shapes, main: Color, size: float) -> None:
    """Draws shapes from back to front, as `tools.txt` explains."""
    chance = np.random.default_rng(0)
    for kind, *rest in shapes:
        if kind not in ("area", "line", "ring", "dabs"):
            continue
        joints = [body.find(one, size) for one in rest[1:] if one[0].isalpha()]
        numbers = [size * float(one) for word in rest[1:] if not word[0].isalpha() for one in word.split(",")]
        color, shade = (main, _TONES[rest[0]]) if rest[0] in _TONES else (rest[0], 1.0)
        if kind == "ring":
            joints = [(_beyond(joints[0][0], turn, numbers[1]), 0.0) for turn in range(0, 375, 15)]
        if kind == "area":
            sheet.fill(color, [(point, wide or _EDGE) for point, wide in joints], shade)
        elif kind == "dabs":
            for _ in range(round(numbers[0] / size)):
                away = chance.uniform(-1, 1, 2) * numbers[2:]
                sheet.fill(color, [(joints[0][0] + away, numbers[1])], shade * chance.uniform(0.9, 1.1))
        else:
            sheet.draw(color, [(point, numbers[0] / 2) for point, _ in joints], shade)


def _cut_out(sheet: _Sheet, body: _Body, pose: Pose, heads: float, reached: _Point, meeting: _Point | None) -> Figure:
    """Returns the drawn figure without its empty margin."""
    drawn = torch.from_numpy(sheet.drawn).permute(2, 0, 1)
    afloat = pose.carried == "water"
    if afloat:
        drawn[3, round(body.hips[1] * _UNIT + _SIDE / 2) :] = 0
    left, top, width, height = cv2.boundingRect((drawn[3] > 0).byte().numpy())
    high = round(height + (pose.carried == "air") * _LIFTED * heads * _UNIT)

    def place(point: _Point) -> tuple[float, float]:
        x, y = point * _UNIT + _SIDE / 2
        return float((x - left) / width - 0.5), float(1 - (y - top) / high)

    seat = place(body.hips)[1] if pose.carried == "seat" else 0.0
    picture = resize(drawn[:, top : top + high, left : left + width], 0.5)
    meets = None if meeting is None else place(meeting)[0]
    holds = {name: place(body.find(point, 1.0)[0]) for name, point in _HOLDS.items()}
    return Figure(picture, place(reached), seat, high / (heads * _UNIT), meets=meets, afloat=afloat, holds=holds)
