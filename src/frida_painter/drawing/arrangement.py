"""Arrangement of a scene: positions and sizes of its things, from the prompt's prepositions and their real sizes.

Lengths are relative: x points right, y up from the floor. The composition scales the scene to the canvas.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import torch
from torch import Tensor

from frida_painter.drawing.appearance import turn
from frida_painter.drawing.compositing import crop, resize, stack
from frida_painter.drawing.figures import Figure
from frida_painter.drawing.tables import read_rows, split_words

_GROWTH = 0.6  # exponent from the height in the world to the height in a picture
_SAID = 4  # exponent from a said size, such as tiny, to the height in the world
_MIN = 0.3  # least height of a thing, relative to the tallest
_SUBJECT = 0.5  # least height of the first thing of a prompt, relative to the tallest
_TOWERS = 1.7  # height in the world, by that of the tallest person, above which things are equally tall
_IN_THE_AIR = 0.38  # height of a thing in the sky, beside a thing of height 1
_SINKS = 0.1  # share of its height by which a thing overlaps the thing below it

_HIDDEN, _TO_THE_HIPS = 0.4, 0.52  # hidden share of the height of a thing inside another, and of a person
_BRIMS, _HOLDS = 0.8, 0.6  # shares of a picture's fullest row: of a row above the rim, and of one that is no foot
# Of an opening: place of the row called its rim, its narrowest row, and its greatest half height by the rim's.
_ABOVE, _ARC, _DEEPEST = 0.6, 0.35, 0.15
_BULGE = 0.12  # share of the height that shows in the middle of a rim, at least
_MOUTH = 0.5  # the same share of the uppermost rows of a vase, or another container that is open on top
_FITS = 0.85  # greatest width of a thing inside another, relative to that
_CROWDED = 0.6  # least share of its size that a thing keeps among others on the same thing
_TALLER = 1.45  # least height of a tree, relative to those under it
_DISH, _FLAT = 0.12, 1.4  # greatest height in the world and least width by height of a plate
_AMID, _WITHIN = 0.4, 0.75  # place in its height, and greatest width by its own, of the things on it
_SEAT = 0.5  # share of the height of a seat's picture at which somebody sits

_HAND, _LAP = (0.12, 0.45), (0.1, 0.5)  # of a person's picture: places of the hand and the lap
_CARRIED, _HANDLED = 0.62, 0.3  # height in the world, by a person's, of a thing in the hands, and of one under work
_INTO, _INSIDE, _SILL = 0.4, 0.75, 0.42  # the same for things to be in, and for cars; height of a car's window
_LENGTHY = 1.5  # height by width of a broom, which may reach the floor
_LIGHT = 0.8  # share of its size that a thing keeps in the hands

_CROWN, _HEAD = 0.1, 0.45  # shares of a picture's height at its top: the crown, and an animal's head
_EARS = 0.2  # of a picture's width, within which two ears belong to one head
_HAT, _LARGEST_HAT, _PULLED_DOWN = 1.25, 0.35, 0.3  # of the head's width, of the wearer's height, of its own height
_WORN = {"head": 0.0, "face": 0.55, "neck": 1.2}  # of the head's width: depth of things that are worn there
_BOUQUET, _FAN = 1.3, 60  # greatest height and width of flowers, by those of their vase, and the angle of a bunch
_BOTTOM, _CLEAR, _BITE = 0.15, 0.65, 0.4  # bottom of clear things; sizes of things in them, and in a mouth
_SIDE = 256  # pixels of one of several copies
_MEANT = {("water", "on"): "in", ("seat", "in"): "on"}  # where people are who are on a boat, or in a chair
_OPPOSITE = {"on": "beneath", "in": "around", "under": "shelter", "behind": "front", "taller": "shorter"}
_OPPOSITE |= {other: kind for kind, other in _OPPOSITE.items()} | {"over": "under"}
RIDES = {"lap": (0.45, 0.35), "shoulder": (0.6, 0.22), "back": (0.45, 0.22)}
"""Greatest heights of people and of animals on somebody, by whose body they are on."""
_STOOD_BY = ("on", "in", "under", "over", "behind", "hang", "atop", "mouth", *RIDES)  # their objects are placed first


@cache
def _kinds() -> dict[str, str]:
    return {one: kind for kind, words in read_rows("drawing/relations.txt") for one in split_words(words)}


def kind_of(word: str) -> str:
    """Returns the kind of arrangement of a preposition or a verb in `relations.txt`; "" puts things side by side."""
    kinds = _kinds()
    said = next((one for one in (word, word.rpartition(" ")[0]) if one in kinds), "")  # asleep on a chest
    return kinds.get(said, "doing" if word.endswith("ing") else "")


class Known(NamedTuple):
    """Known thing: its name, its height in metres in the real world, and its usual place, as `world.txt` explains."""

    name: str
    height: float
    where: str


@dataclass(frozen=True)
class Relation:
    """Relation of two things: their positions among the things, and a preposition or verb between them.

    at: positions of its words in the prompt
    """

    subject: int
    word: str
    object: int
    at: tuple[int, ...] = field(default=(), compare=False)


@dataclass(frozen=True)
class ScenePart:
    """Thing to be placed: all its copies as one picture, colour and opacity [4, h, w], and its height and place.

    figure: that is drawn in the picture
    size: factor of its height that the prompt asks for: a tiny mouse
    """

    picture: Tensor
    known: Known
    figure: Figure | None = None
    size: float = 1.0


@dataclass(frozen=True)
class Placed(ScenePart):
    """Thing at its place in a scene.

    x, y: middle of its lower edge
    height: of the picture
    depth: order of drawing; a greater depth is in front
    hidden: share of the height, from below, that the thing around it hides
    dip: share of the height by which less is hidden in the middle of a round rim
    """

    x: float = 0.0
    y: float = 0.0
    height: float = 1.0
    depth: float = 0
    hidden: float = 0.0
    dip: float = 0.0

    @property
    def width(self) -> float:
        """Width, from the picture's proportions."""
        return self.height * self.picture.shape[2] / self.picture.shape[1]


def arrange_parts(parts: Sequence[ScenePart | None], relations: Sequence[Relation]) -> list[Placed]:
    """Returns the parts at their places, from rear to front.

    parts: None for a part without a picture
    relations: their numbers are indices of `parts`
    """
    shown = {number: part for number, part in enumerate(parts) if part is not None}
    if not shown:
        return []
    alone = _scale(shown)
    known = {number: part.known.where for number, part in shown.items()}
    usable = [
        _turn(one, shown) for one in relations if one.subject != one.object and {one.subject, one.object} <= {*shown}
    ]
    inside = {one.subject: one.object for one in usable if kind_of(one.word) == "in"}
    for number, one in enumerate(usable):  # what is in a pot on a table is in the pot, which is on the table
        if kind_of(one.word) == "on" and inside.get(one.subject, one.object) != one.object:
            usable[number] = replace(one, subject=inside[one.subject])
    floor = [number for number in shown if known[number] != "air"] or list(shown)
    standing = [one for one in usable if kind_of(one.word) in _STOOD_BY]
    first = next((one.object for one in standing if one.object not in {one.subject for one in standing}), floor[0])
    top = next((number for number in shown if known[number] == "top"), None)
    related = {first, *(number for one in usable for number in (one.subject, one.object))}
    for number in sorted({*shown} - related):  # a lamp beside a table is on it, a clock on the wall, and a bird above
        is_small = top is not None and shown[number].known.height < shown[top].known.height
        if top is not None and is_small and known[number] == "ground":
            usable.append(Relation(number, "on", top))
        else:
            above = "above" if known[number] == "air" != known[first] else ""
            usable.append(Relation(number, "near" if known[number] == "wall" else above, first))
    placed = {first: alone[first]}
    together: dict[tuple[int, str], list[int]] = {}  # things on or in the same thing
    while usable:
        one = next((one for one in usable if {one.subject, one.object} & set(placed)), usable[0])
        usable.remove(one)
        mine, other, kind = one.subject, one.object, kind_of(one.word)
        if not {mine, other} & set(placed):
            placed[other] = _beside(list(placed.values()), alone[other])
        if mine in placed:
            mine, other, kind = other, mine, _OPPOSITE.get(kind, kind)
        if mine not in placed:
            rest = [each for each in placed.values() if each.known.where != "air"]
            is_below = len(placed) > 1 and known[other] == "air" != known[mine]
            put = None if is_below and rest else _put(alone[mine], placed[other], kind)
            placed[mine], placed[other] = put or (_beside(rest or [placed[other]], alone[mine]), placed[other])
            together.setdefault((other, kind), []).append(mine)
    for (number, kind), some in together.items():
        if kind in ("on", "in") and len(some) > 1:
            spread = _spread([placed[each] for each in some], placed[number])
            placed |= dict(zip(some, spread, strict=True))
    return sorted(placed.values(), key=lambda one: one.depth)


def _turn(relation: Relation, shown: Mapping[int, ScenePart]) -> Relation:
    """Returns a relation as it is meant: what a table is "with" stands on it, somebody
    on a boat sits in it, and a hat is not around its wearer."""
    subject, other = shown[relation.subject].known, shown[relation.object].known
    tops = [relation.subject, *shown] if subject.where not in ("person", "animal") else []
    carriers = {relation.subject: ("top", "seat")}
    top = next((one for one in tops if shown[one].known.where in carriers.get(one, ("top",))), relation.object)
    if relation.word == "with" and top != relation.object and other.height < shown[top].known.height:
        return Relation(relation.object, "on", top)
    if subject.where == "person" and (other.where, relation.word) in _MEANT:
        return replace(relation, word=_MEANT[other.where, relation.word])
    if subject.where == "person" and kind_of(relation.word) == "in" and other.height < _INTO * subject.height:
        return relation if other.where == "water" else replace(relation, word="doing")  # into a microscope
    return replace(relation, word="with") if other.where in _WORN and relation.word == "in" else relation


def _scale(shown: Mapping[int, ScenePart]) -> dict[int, Placed]:
    """Returns the parts, each by itself, 1 for the tallest on the floor. Their heights differ less than in the world.

    Wide things get less height, so that the area counts: a spoon is long but not large.
    """
    said = {number: part.known.height * part.size**_SAID for number, part in shown.items()}
    tallest = max([said[number] for number, part in shown.items() if part.known.where != "air"], default=0.0)
    people = [said[number] for number, part in shown.items() if part.known.where == "person"]
    tallest = min(tallest, _TOWERS * max(people, default=math.inf))
    alone = {}
    for number, part in shown.items():
        size = _IN_THE_AIR
        if part.known.where != "air" or not tallest:
            least = (_SUBJECT if number == min(shown) else _MIN) * min(1.0, part.size)
            size = max(least, min(1.0, (said[number] / tallest) ** _GROWTH if tallest else 1.0))
        _, rows, columns = part.picture.shape
        shape = min(1.0, (rows / columns) ** 0.5) if part.figure is None else part.figure.tall
        alone[number] = Placed(part.picture, part.known, part.figure, part.size, height=size * shape)
    return alone


class _Anchor(NamedTuple):
    """Anchor of a thing at another one: a point of each, which meet.

    across, up: point of the other, from the middle of its lower edge, in its widths and heights
    aside, sinks: point of the thing, in its own
    depth: before the other
    least, most: bounds of its height, by the other's
    """

    across: float = 0.0
    up: float = 0.0
    aside: float = 0.0
    sinks: float = 0.0
    depth: float = 1
    least: float = 0.0
    most: float = math.inf


@cache
def _anchors() -> list[tuple[list[str], str, _Anchor]]:
    return [(one.split(), only, _Anchor(*map(float, at.split()))) for one, only, at in read_rows("drawing/anchors.txt")]


def _put(mine: Placed, other: Placed, kind: str) -> tuple[Placed, Placed] | None:
    """Returns a thing at its place by another, and the other, whose size or place may have changed; None for beside."""
    where, other_where = mine.known.where, other.known.where
    hangs = other_where in ("air", "wall") and where not in ("air", "wall") and kind not in ("on", "in", "behind", "")
    if hangs or kind in ("beneath", "around") or (kind == "under" and other_where == "held"):
        put = _put(other, mine, "shelter" if hangs else _OPPOSITE[kind])
        return put and put[::-1]
    if kind == "on" and other_where == "seat":  # long enough for somebody who lies
        seat = mine.figure.seat / _SEAT if mine.figure else 0.0  # as high as the legs of somebody who sits are long
        other = replace(other, height=max(other.height * max(1.0, mine.width / other.width), seat * mine.height))
    anchor = _anchor(mine, other, kind)
    if anchor is None:
        return None
    height = min(max(mine.height, anchor.least * other.height), anchor.most * other.height)
    mine = replace(mine, height=height, depth=other.depth + anchor.depth)
    x = other.x + anchor.across * other.width - anchor.aside * mine.width
    mine = replace(mine, x=x, y=other.y + anchor.up * other.height - anchor.sinks * height)
    if kind == "in" and anchor.sinks:  # the inner thing looks out over the rim, before parts above it such as a sail
        deep = _rim(other.picture)[1] * other.height / height
        mine = replace(mine, hidden=anchor.sinks, dip=min(anchor.sinks, max(_BULGE, deep)))
    return mine, other


def _anchor(mine: Placed, other: Placed, kind: str) -> _Anchor | None:
    """Returns where a thing belongs at another; None for beside it."""
    where, shape = mine.known.where, mine.height / max(mine.width, 1e-6)
    meeting = [one.figure.meets for one in (other, mine) if one.figure is not None and one.figure.meets is not None]
    if len(meeting) == 2:
        return _Anchor(meeting[0], aside=meeting[1])
    if kind == "under" and mine.figure and shape < 1:  # a mechanic
        return _Anchor(0.45, depth=-1)
    if kind in RIDES:
        across, up = other.figure.holds.get(kind, _LAP) if other.figure else _LAP
        most = RIDES[kind][mine.figure is None] * min(1.0, 1.3 * shape if mine.figure is None else 1.0)
        return _Anchor(across, up, sinks=mine.figure.seat if mine.figure else 0.0, most=most)
    if kind == "on":
        is_small = mine.figure is not None or mine.height <= 0.9 * other.height or other.width >= 1.5 * mine.width
        most = math.inf if is_small else max(0.62, 0.6 * mine.height / other.height)
        if other.known.height < _DISH and other.width > _FLAT * other.height and where not in ("person", "animal"):
            return _Anchor(up=_AMID, most=_WITHIN * other.width * shape / other.height)
        if other.known.where == "seat" and where not in ("person", "animal"):
            most = min(most, _WITHIN * other.width * shape / other.height)
        up = _SEAT if other.known.where == "seat" else _top(other.picture, mine.width / max(other.width, 1e-6))
        hips = mine.figure.holds.get("hips", (0.0, 0.0)) if mine.figure else (0.0, 0.0)
        return _Anchor(up=up, aside=hips[0], sinks=(mine.figure.seat if mine.figure else 0.0) or _SINKS, most=most)
    if kind == "in" and mine.figure is not None and other.known.where == "ground":
        if other.height > mine.height:
            return _Anchor(-0.2, -0.06)  # in a house, so in front of it
        if other.known.height > _INSIDE * mine.known.height:  # in a car, at its window
            return _Anchor(up=_SILL, sinks=_TO_THE_HIPS, least=1.0, most=1.0)
    if kind == "in" and other.known.where == "clear" and where != "plant":
        return _Anchor(up=_BOTTOM, most=min(_CLEAR, _CLEAR * other.width * shape / other.height))
    if kind == "hang" and mine.figure is None:
        under = 1 - _top(other.picture.flip(1), 0.2)
        return _Anchor(up=max(under, _AMID) if other.known.where == "plant" else under, sinks=1 - _SINKS / 2)
    if kind == "in":
        hidden, (rim, deep) = _HIDDEN if mine.figure is None else _TO_THE_HIPS, _rim(other.picture)
        most, wide = (_BOUQUET, _BOUQUET) if where == "plant" else (0.8, _FITS)
        most = min(most, wide * other.width * shape / other.height)
        return _Anchor(up=rim - max(_SINKS, _ABOVE * deep), sinks=hidden, least=min(hidden, most), most=most)
    if kind in ("hold", "mouth") and other.known.where in ("animal", "air") and where != "person":
        return _at_mouth(other, shape)
    if kind == "atop" or (kind == "with" and where in _WORN):
        middle, wide = _find_head(other.picture)
        size = min(_HAT * wide * other.width * shape / other.height, _LARGEST_HAT)
        deep, sinks = (_WORN[where], 0.5) if where in ("face", "neck") else (0.0, _PULLED_DOWN)
        return _Anchor(middle, 1 - deep * wide * other.width / other.height - sinks * size, least=size, most=size)
    if kind in ("with", "hold", "doing") and other.known.where == "person" and where not in ("air", "wall"):
        return _in_hand(mine, other, kind)
    if kind == "with" and mine.height <= 0.6 * other.height and where != "held":
        return _Anchor(across=0.5, aside=-0.3)
    if kind == "shelter" and where == "held":  # an umbrella over somebody
        return _Anchor(up=0.85, depth=-1, least=max(1.25 * other.width, 0.7 * other.height) * shape / other.height)
    if kind == "shelter" and where not in ("air", "wall"):  # a tree stands behind those under it
        aloft = max(0.0, other.y) / other.height
        return _Anchor(up=-aloft, depth=-2, least=_TALLER * (1 + aloft))
    return next((anchor for kinds, only, anchor in _anchors() if kind in kinds and only in ("", where)), None)


def _at_mouth(other: Placed, shape: float) -> _Anchor:
    """Returns where a thing of a shape is that an animal has in its mouth: at the outer edge of its head."""
    seen = other.picture[3] > 0.5
    head = seen[: max(1, round(_HEAD * len(seen)))].nonzero()
    is_right = 2 * int(head[0, 1]) > seen.shape[1]  # where the highest part is
    edge = head[int(head[:, 1].argmax() if is_right else head[:, 1].argmin())].tolist()
    return _Anchor(edge[1] / seen.shape[1] - 0.5, 1 - edge[0] / len(seen), sinks=0.5, most=_BITE * min(1.0, shape))


def _in_hand(mine: Placed, other: Placed, kind: str) -> _Anchor:
    """Returns where a thing is that somebody has or works on: in the hand, or on the ground before it."""
    across, up = _HAND if other.figure is None else other.figure.hand
    where, share, floor = mine.known.where, mine.known.height / other.known.height, -max(0.0, other.y) / other.height
    shape = mine.height / max(mine.width, 1e-6)
    if where == "held":  # an umbrella is held up, and a long broom may reach the floor
        return _Anchor(across, max(up, _HAND[1]) if up > 0.5 or shape < _LENGTHY else floor, depth=-1, most=0.8)
    lives = where in ("person", "animal", "water")
    stays = lives or where in ("seat", "top") or (where == "plant" and kind == "doing")
    if share <= (_HANDLED if kind == "doing" else _CARRIED) and (not stays or kind == "hold"):
        size = min(_LIGHT * mine.height / other.height, 0.5, 0.5 * shape)
        return _Anchor(across, max(floor, up - 0.4 * size), least=size, most=size)
    side = math.copysign(1.0, across)
    return _Anchor(
        max(abs(across), 0.3) * side, floor, aside=-(0.45 if lives else 0.3) * side, depth=-1 if share > 1 else 1
    )


def _spread(some: Sequence[Placed], holder: Placed) -> list[Placed]:
    """Returns the things on or in one holder side by side over its middle, smaller if there is little room."""
    width = sum(one.width for one in some)
    scale = max(_CROWDED, min(1.0, holder.width / width))
    left, spread = holder.x - scale * width / 2, []
    for one in some:
        # A smaller thing has a smaller hidden part, so that its visible part begins at the same height.
        y = one.y + (1 - scale) * one.hidden * one.height
        spread.append(replace(one, x=left + scale * one.width / 2, y=y, height=scale * one.height))
        left += scale * one.width
    return spread


def _beside(others: Sequence[Placed], mine: Placed) -> Placed:
    """Returns a thing on the same floor, to the right of all others."""
    edge = max(one.x + one.width / 2 for one in others)
    return replace(mine, x=edge + 0.53 * mine.width, y=min(0.0, *(one.y for one in others)))


def _find_head(picture: Tensor) -> tuple[float, float]:
    """Returns the middle of the head in a picture [4, h, w], from its middle, and the head's width, in widths.

    The head is what reaches highest, with both ears, and no tail that is almost as high.
    """
    seen, columns = picture[3] > 0.5, picture.shape[2]
    reach = max(1, round(_EARS * columns))
    top = seen[: max(1, round(_CROWN * picture.shape[1]))].any(0)
    highest = int(seen.float().argmax(0).where(top, seen.shape[0]).argmin())
    at = top.nonzero().flatten()
    parts = at.tensor_split((at.diff() > reach).nonzero().flatten() + 1)
    head = next(part for part in parts if highest in part)
    middle, wide = (head[0] + head[-1] + 1) / 2, head[-1] + 1 - head[0]
    return float(middle) / columns - 0.5, float(wide) / columns


def _top(picture: Tensor, share: float) -> float:
    """Returns the height of a picture's upper edge in its middle, as a share of its height.

    share: of the width around the middle that counts
    """
    seen = picture[3] > 0.5
    middle = seen.shape[1] / 2
    half = max(1.0, min(0.3, 0.25 * share) * seen.shape[1])
    columns = seen[:, int(middle - half) : int(middle + half) + 1]
    tops = columns[:, columns.any(0)].float().argmax(0)
    return 1 - float(tops.median()) / seen.shape[0] if len(tops) else 1.0


def _rim(picture: Tensor) -> tuple[float, float]:
    """Returns the height of a container's rim, and half the height of its round opening, as shares of its height.

    Above a rim, a container is narrower than below: only a handle or a sail rises there. A container that is wide at
    its top is open there.
    """
    full = (picture[3] > 0.5).float().mean(1).flip(0)  # from below
    widest = full.cummax(0).values
    narrow = (full < _BRIMS * widest) & (widest >= _HOLDS * full.max())
    narrow[:] &= full[-len(full) // 20 :].max() < _MOUTH * full.max()
    rim = int(narrow.float().argmax()) if bool(narrow.any()) else len(full)
    arc = (full[rim:] > _ARC * full.max()).float().cumprod(0).sum() / (1 - _ARC**2) ** 0.5 / (1 - _ABOVE)
    return rim / len(full), min(float(arc), _DEEPEST * rim) / len(full)


def copies(pictures: Sequence[Tensor], where: str, seed: int, *, leans: bool = False) -> Tensor:
    """Returns several pictures of a thing as one picture [4, h, w].

    leans: True if none may be mirrored, because all lean in the wind
    where: "air" to scatter them, "seat" for one row, "bunch" for a fan; otherwise they form rows on a floor, the rear
        ones smaller
    seed: of the random positions and sizes
    """
    count = len(pictures)
    if count == 1:
        return pictures[0]
    if where == "bunch":
        spread = [_FAN * (number / (count - 1) - 0.5) for number in range(count)]
        feet = [stack([(one, 0, 0)], 2 * one.shape[1], one.shape[2]) for one in pictures]
        turned = [(turn(one, degrees), 0, 0) for one, degrees in zip(feet, spread, strict=True)]
        return crop(stack(turned, *turned[0][0].shape[1:]))
    generator = torch.Generator().manual_seed(seed)
    pictures, air = [resize(one, _SIDE / max(one.shape[1:])) for one in pictures], where == "air"
    _, high, wide = pictures[0].shape
    spots: list[tuple[Tensor, float, float]] = []  # drawing, bottom, left
    rows = 1 if count <= 3 or where == "seat" else 2 if count <= 7 else 3
    for row in range(rows):
        here = count // rows + (row < count % rows)
        for number in range(here):
            shake = torch.rand(2, generator=generator).tolist()
            copy = resize(pictures[len(spots)], 0.8**row * (0.86 + 0.14 * shake[1]))
            middle = (number - (here - 1) / 2 + 0.5 * (row % 2)) * 0.8**row * wide * (1.15 if air else 0.98)
            rise = row * (0.95 if air else 0.42) + (0.5 if air else 0.06) * shake[0]
            if number % 2 and count > 2 and where not in ("person", "seat") and not leans:  # no sign of mirror images
                copy = copy.flip(2)
            spots.append((copy, rise * high, middle - copy.shape[2] / 2))
    left = min(start for *_, start in spots)
    width = round(max(start + copy.shape[2] for copy, _, start in spots) - left) + 2
    height = round(max(bottom + copy.shape[1] for copy, bottom, _ in spots)) + 2
    spots.sort(key=lambda spot: -spot[1])
    return stack(
        [(copy, height - 1 - round(bottom) - copy.shape[1], round(start - left)) for copy, bottom, start in spots],
        height, width,
    )  # fmt: skip
