"""Arrangement of a scene: positions and sizes of its things, from the prompt's prepositions and their real sizes.

Lengths are relative: x points right, y up from the floor. The composition scales the scene to the canvas.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.words.compositing import resize
from frida_painter.words.reading import Relation

# Sizes and usual places of things, from known things of similar meaning.

_ALIKE = 0.25  # least similarity to some known thing
_NEIGHBOURS = 3
_PERSON, _VOTES = 0.018, 0.12  # margin towards people above which a name means one, and the part of neighbours in it
_SHARPNESS = 0.05  # difference of similarity at which a neighbour's weight falls to 1/e


class Known(NamedTuple):
    """Known thing: its height in the real world, and its usual place.

    name: of the thing
    height: metres
    where: "ground", "air" or "water"; "person" for people, on the ground; "worn": clothes; "held": its holder lifts
        it; "head": worn on the head; "top": things stand on it; "seat": they sit in it; "facing": a thing on it appears
        in front of it, as on a web
    """

    name: str
    height: float
    where: str


@cache
def known_things() -> tuple[Known, ...]:
    """Returns the table of `world.txt`."""
    lines = (resources.files(__package__) / "world.txt").read_text("utf-8").splitlines()
    rows = [line.rsplit(" ", 2) for line in lines if line and not line.startswith("#")]
    return tuple(Known(name, float(height), where) for name, height, where in rows)


def known_like(name: str, sentences: SentenceEncoder) -> Known:
    """Returns an estimate for a named thing, from the known things of most similar meaning.

    The height is a weighted mean of theirs; the usual place is that of the most similar one.
    """
    things = known_things()
    meanings = sentences.embed([name, *(thing.name for thing in things)])
    similarity, nearest = (meanings[1:] @ meanings[0]).topk(_NEIGHBOURS)
    share = (similarity / _SHARPNESS).softmax(0)
    heights = torch.tensor([things[at].height for at in nearest.tolist()])
    return Known(name, float((share * heights.log()).sum().exp()), things[int(nearest[0])].where)


def is_person(name: str, sentences: SentenceEncoder) -> bool:
    """Returns True if a name means a person.

    It must be nearer to the mean of known people than to that of known things; its nearest known things count too.
    """
    of_people = torch.tensor([thing.where == "person" for thing in known_things()])
    meanings = sentences.embed([name, *(thing.name for thing in known_things())])
    people, others = meanings[1:][of_people].mean(0), meanings[1:][~of_people].mean(0)
    toward = functional.normalize(people - others, dim=0)
    similarity, nearest = (meanings[1:] @ meanings[0]).topk(_NEIGHBOURS)
    votes = float((similarity / _SHARPNESS).softmax(0) @ of_people[nearest].float())
    leans = float(meanings[0] @ toward - (people + others) @ toward / 2) + _VOTES * votes
    return leans > _PERSON and float(similarity[0]) > _ALIKE


_GROWTH = 0.35  # exponent from the height in the world to the height in a picture
_MIN = 0.3  # least height of a thing, relative to the tallest
_SUBJECT = 0.5  # least height of the first thing of a prompt, relative to the tallest
_IN_THE_AIR = 0.38  # height of a thing in the sky, beside a thing of height 1
_SINKS = 0.1  # share of its height by which a thing overlaps the thing below it

_INSIDE = 0.4  # least height of a thing inside another, relative to that
_HIDDEN = 0.4  # hidden share of the height of a thing inside another
_CROWDED = 0.6  # least share of its size that a thing keeps among others on the same thing
_BRIMS = 0.8  # share of the fullest row below; a row with less is above the rim
_HOLDS = 0.6  # share of a picture's fullest row; rows with less belong to a foot
_FITS, _SPREADS = 0.85, 1.7  # greatest width of a thing inside another, relative to that; the same for a neck
_NECK = 0.25  # share of a picture's fullest row that every row of a neck has
_ON_A_FACE = 0.45  # greatest height of a thing on a facing thing, relative to that

_HELD, _HAND = 0.8, 0.45  # relative to the holder: greatest height of a held thing, height of the hand
_SMALL, _IN_THE_HANDS = 0.62, 0.4  # of a person: greatest height of a thing for the hands, and in them
_SEAT = 0.5  # share of the height of a seat's picture at which somebody sits
_PLAYED = 0.55  # greatest height of an instrument, relative to its player
_STANDS = 0.85  # the same, above which an instrument stands on the floor
_ENDS = 0.95  # share of the height up to which a neck is examined, because its end may be round
_SIDE = 256  # pixels of one of several copies
_OF_WORD = {
    "on": "on", "on top of": "on", "upon": "on", "onto": "on", "riding": "on",
    "in": "in", "inside": "in", "into": "in", "within": "in", "of": "around", "out of": "in", "from": "in",
    "under": "under", "below": "under", "beneath": "under", "underneath": "under",
    "over": "over", "above": "over", "across": "over", "crossing": "on",
    **dict.fromkeys(("beside", "next to"), "beside"), **dict.fromkeys(("near", "by", "along", "around", "at"), "near"),
    "behind": "behind", "in front of": "front", "before": "front", "against": "front", "between": "between",
    "with": "with", "holding": "with", "carrying": "with", "playing": "playing",
    **dict.fromkeys(("eating", "reading", "drinking", "smoking"), "hands"),
}  # fmt: skip
_CROWN = 0.1  # share of a picture's height at its top that counts as the head
_HAT, _MIN_HEAD, _LARGEST_HAT, _PULLED_DOWN = 1.25, 0.12, 0.35, 0.3  # of a head's width, and of heights
_STOOD_BY = ("on", "in", "under", "over", "behind", "between")  # the objects of these relations are placed first
_OPPOSITE = {
    "on": "beneath", "beneath": "on", "in": "around", "around": "in", "under": "over", "over": "under",
    "behind": "front", "front": "behind",
}  # fmt: skip


def kind_of(word: str) -> str:
    """Returns the kind of arrangement of a preposition or a verb, such as "on"; "" puts things side by side."""
    return _OF_WORD.get(word, "")


@dataclass(frozen=True)
class ScenePart:
    """Thing to be placed.

    picture: all its copies as one picture, colour and opacity [4, h, w]
    known: its height and usual place
    """

    picture: Tensor
    known: Known


@dataclass(frozen=True)
class Placed:
    """Picture at its place in a scene.

    picture: colour and opacity [4, h, w]
    x, y: middle of its lower edge
    height: of the picture
    depth: order of drawing; a greater depth is in front
    hidden: share of the height, from below, that the thing around it hides
    """

    picture: Tensor
    x: float
    y: float
    height: float
    depth: int = 0
    hidden: float = 0.0

    @property
    def width(self) -> float:
        """Width, from the picture's proportions."""
        return self.height * self.picture.shape[2] / self.picture.shape[1]


def arrange_parts(parts: Sequence[ScenePart | None], relations: Sequence[Relation]) -> list[Placed]:
    """Returns the parts at their places, from rear to front.

    parts: None for a part without a picture
    relations: their numbers are indices of `parts`
    """
    shown = [number for number, part in enumerate(parts) if part is not None]
    if not shown:
        return []
    sizes = _sizes(parts, shown)
    known = [part.known.where if part is not None else "" for part in parts]
    placed: dict[int, Placed] = {}
    usable = [
        _usual(one, parts[one.subject], parts[one.object])
        for one in relations
        if {one.subject, one.object} <= set(shown) and one.subject != one.object
    ]
    floor = [number for number in shown if known[number] != "air"] or shown
    standing = (one.object for one in usable if kind_of(one.word) in _STOOD_BY)
    first = next(standing, floor[0])
    placed[first] = _alone(parts, first, sizes)
    together: dict[tuple[int, str], list[int]] = {}  # things on or in the same thing
    rest = list(usable)
    while rest:
        one = next((one for one in rest if {one.subject, one.object} & set(placed)), None)
        if one is None:
            one = rest[0]
            placed[one.object] = _beside(list(placed.values()), _alone(parts, one.object, sizes))
        rest.remove(one)
        kind = kind_of(one.word)
        if known[one.object] == "air" and (one.word == "at" or (one.word.endswith("ing") and not kind)):
            kind = "with"  # flown kites and a howled-at moon are in the air
        if one.word == "from" and any(two.subject == one.subject and two.word.endswith("ing") for two in usable):
            kind = "beside"  # an animal that eats leaves from a tree is not in the tree
        if one.subject not in placed:
            mine, other, number = _alone(parts, one.subject, sizes), placed[one.object], one.subject
            placed[number], placed[one.object] = _put(mine, other, kind, known[number], known[one.object])
            together.setdefault((one.object, kind), []).append(number)
        elif one.object not in placed:
            mine, other, number = _alone(parts, one.object, sizes), placed[one.subject], one.object
            turned = _OPPOSITE.get(kind, kind)
            placed[number], placed[one.subject] = _put(mine, other, turned, known[number], known[one.subject])
            together.setdefault((one.subject, turned), []).append(number)
    for (number, kind), some in together.items():
        if kind in ("on", "in") and len(some) > 1:
            spread = _spread([placed[each] for each in some], placed[number])
            placed |= dict(zip(some, spread, strict=True))
    for number in shown:
        if number not in placed:
            mine = _alone(parts, number, sizes)
            in_the_air = known[number] == "air" and any(known[other] != "air" for other in placed)
            everything = list(placed.values())
            placed[number] = (
                _put(mine, everything[0], "over", "air", "")[0] if in_the_air else _beside(everything, mine)
            )
    return sorted(placed.values(), key=lambda one: one.depth)


def _usual(relation: Relation, subject: ScenePart | None, other: ScenePart | None) -> Relation:
    """Returns a relation as it is meant: what a table is "with" stands on it, and a hat is not around its wearer."""
    assert subject is not None and other is not None
    if relation.word == "with" and subject.known.where == "top" and other.known.height < subject.known.height:
        return Relation(relation.object, "on", relation.subject)
    is_worn = other.known.where == "head" and relation.word in ("in", "wearing")
    return replace(relation, word="with") if is_worn else relation


def _alone(parts: Sequence[ScenePart | None], number: int, sizes: dict[int, float]) -> Placed:
    part = parts[number]
    assert part is not None
    # Wide things get less height, so that the area counts: a spoon is long but not large.
    _, rows, columns = part.picture.shape
    stretch = (rows / columns) ** 0.5 if columns > rows else 1.0
    return Placed(part.picture, 0.0, 0.0, sizes[number] * stretch)


def _sizes(parts: Sequence[ScenePart | None], shown: Sequence[int]) -> dict[int, float]:
    """Returns the heights of the parts, 1 for the tallest on the floor. They differ less than in the world."""
    known = {number: part.known for number in shown if (part := parts[number]) is not None}
    standing = [one.height for one in known.values() if one.where != "air"] or [1.0]
    sizes = {}
    for number, one in known.items():
        in_the_air = one.where == "air" and any(other.where != "air" for other in known.values())
        size = _IN_THE_AIR if in_the_air else max(_MIN, min(1.0, (one.height / max(standing)) ** _GROWTH))
        sizes[number] = max(size, _SUBJECT if number == shown[0] and not in_the_air else 0.0)
    return sizes


def _put(mine: Placed, other: Placed, kind: str, where: str, other_where: str) -> tuple[Placed, Placed]:
    """Returns a thing at its place beside another, and the other, whose size may have changed."""
    kind = "with" if kind == "hands" else kind
    if kind in ("beneath", "around"):
        other, mine = _put(other, mine, _OPPOSITE[kind], other_where, where)
        return mine, other
    if kind == "on" and other_where == "facing":
        size = min(mine.height, _ON_A_FACE * other.height)
        return _at(mine, other, up=0.5 - 0.5 * size / other.height, most=size), other
    if kind == "on":
        if mine.height > 0.9 * other.height and other.width < 1.5 * mine.width:
            mine = replace(mine, height=max(0.62 * other.height, 0.6 * mine.height))
        share = _SEAT if other_where == "seat" else _top(other.picture, mine.width / max(other.width, 1e-6))
        return _at(mine, other, up=share - _SINKS * mine.height / other.height), other
    if kind == "in":
        # The inner thing looks out over the rim, in front of parts above the rim such as a handle or a sail.
        rim, necked = _rim(other.picture)
        wide = (_SPREADS if necked else _FITS) * other.width * mine.height / max(mine.width, 1e-6)
        mine = replace(mine, height=min(0.8 * other.height, wide, max(mine.height, _INSIDE * other.height)))
        inner = _at(mine, other, up=rim - _HIDDEN * mine.height / other.height, depth=-1 if necked else 1)
        return replace(inner, hidden=0.0 if necked else _HIDDEN), other  # flowers hang over the sides of a vase
    if kind == "under" and other_where == "held":  # a person under an umbrella has it overhead
        over = max(1.25 * mine.width, 0.7 * mine.height) * other.height / other.width
        return mine, _at(replace(other, height=over), mine, up=0.85, depth=-1)
    if kind == "under" and other_where == "air":
        return mine, replace(other, x=mine.x + 0.35 * max(mine.width, 0.6), y=0.95 * mine.height)
    if kind == "under" and _hollow(other.picture):
        return _at(mine, other, most=min(0.5 * other.height, 0.5 * other.width * mine.height / mine.width)), other
    if kind == "under" and where == other_where == "water":
        return _at(mine, other, up=-0.95 * mine.height / other.height, depth=-1), other
    if kind == "under":
        return _at(mine, other, across=-0.2, up=-0.4 * mine.height / other.height), other
    if kind == "over":
        side = 0.0 if where != "air" else 0.28 * max(other.width, 0.6) / other.width
        return _at(mine, other, across=side, up=1.04, depth=-1), other
    if kind == "behind":
        return _at(replace(mine, height=max(mine.height, 0.85 * other.height)), other, 0.45, 0.08, depth=-1), other
    if kind == "front":
        return _at(mine, other, across=-0.3, up=-0.06), other
    if kind == "with" and where == "air":
        return replace(mine, x=other.x + 0.5 * (other.width + mine.width), y=0.75 * other.height), other
    if kind == "playing" and mine.height < _STANDS * other.height:
        return _at(mine, other, across=0.1, up=0.7 * _HAND, most=_PLAYED * other.height), other
    if kind == "with" and where == "head":
        middle, wide = _head(other.picture)
        size = _HAT * max(wide, _MIN_HEAD) * other.width * mine.height / mine.width
        size = min(size, _LARGEST_HAT * other.height)
        return _at(replace(mine, height=size), other, middle, 1 - _PULLED_DOWN * size / other.height), other
    if kind == "with" and where == "held":
        return _at(mine, other, across=0.4, up=_HAND, depth=-1, most=_HELD * other.height), other
    if kind == "with" and other_where == "person" and mine.height <= _SMALL * other.height:
        size = min(mine.height, _IN_THE_HANDS * other.height, 1.3 * other.width * mine.height / mine.width)
        return _at(mine, other, across=0.12, up=_HAND - 0.4 * size / other.height, most=size), other
    if kind == "with":
        mine = replace(mine, height=min(mine.height, 0.8 * other.width * mine.height / mine.width))
        if mine.height <= 0.6 * other.height:
            return _at(mine, other, across=0.4), other
    return (_at(mine, other) if kind == "between" else _beside([other], mine)), other


def _at(
    mine: Placed, other: Placed, across: float = 0.0, up: float = 0.0, *, depth: int = 1, most: float = math.inf
) -> Placed:
    """Returns a thing at a place of another.

    across, up: from the middle of the other's lower edge, in its widths and heights
    depth: before the other
    most: greatest height
    """
    size, x, y = min(mine.height, most), other.x + across * other.width, other.y + up * other.height
    return replace(mine, height=size, x=x, y=y, depth=other.depth + depth)


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
    return replace(mine, x=edge + 0.53 * mine.width, y=min(one.y for one in others))


def _top(picture: Tensor, share: float) -> float:
    """Returns the height of a picture's upper edge in its middle, as a share of its height.

    share: of the width around the middle that counts
    """
    seen = picture[3] > 0.5
    middle = seen.shape[1] / 2
    half = max(1.0, min(0.3, 0.25 * share) * seen.shape[1])
    columns = seen[:, int(middle - half) : int(middle + half) + 1]
    tops = [int(column.nonzero()[0]) for column in columns.T if bool(column.any())]
    return 1 - sorted(tops)[len(tops) // 2] / seen.shape[0] if tops else 1.0


def _rim(picture: Tensor) -> tuple[float, bool]:
    """Returns the height of a container's rim as a share of its height, and True if the rim is that of a neck.

    Above a rim, a container is narrower than below: only a handle or a sail rises there. A neck, as of a vase, is
    filled up to its blunt end.
    """
    seen = (picture[3] > 0.5).flip(0)  # from below
    full = seen.float().mean(1)
    widest = full.cummax(0).values
    narrow = (full < _BRIMS * widest) & (widest >= _HOLDS * full.max())
    if not bool(narrow.any()):
        return 1.0, False
    first, end = int(narrow.nonzero()[0]), round(_ENDS * len(full))
    above = seen[first : max(end, first + 1)]
    runs = (above[:, 1:] & ~above[:, :-1]).sum(1) + above[:, 0]
    is_neck = bool((full[first : max(end, first + 1)] >= _NECK * full.max()).all()) and bool((runs == 1).all())
    return (1.0, True) if is_neck else (first / len(full), False)


def _head(picture: Tensor) -> tuple[float, float]:
    """Returns the middle (as an offset) and the width of a picture's head, in widths of the picture.

    The head is the highest connected part. The offset is measured from the picture's middle.
    """
    seen = picture[3] > 0.5
    first = int(seen.any(1).float().argmax())
    columns = seen[first : first + max(1, round(_CROWN * seen.shape[0]))].any(0)
    peak = int(seen[first].float().argmax())
    if not bool(columns[peak]):
        return 0.0, 1.0
    left = peak - int((~columns[: peak + 1].flip(0)).float().cumsum(0).eq(0).sum()) + 1
    right = peak + int((~columns[peak:]).float().cumsum(0).eq(0).sum())  # part connected with the peak
    return (left + right) / 2 / seen.shape[1] - 0.5, (right - left) / seen.shape[1]


def _hollow(picture: Tensor) -> bool:
    """Returns True if there is room in the lower half of a picture, as under a table or a tree."""
    lower = picture[3, picture.shape[1] // 2 :]
    return float(lower.mean()) < 0.5


def copies(pictures: Sequence[Tensor], count: int, where: str, seed: int, *, apart: bool = False) -> Tensor:
    """Returns several copies of pictures as one picture [4, h, w].

    pictures: taken in turn, all as high as the first
    count: number of copies
    where: "air" to scatter the copies; otherwise they form rows on a floor, the rear ones smaller
    seed: of the random positions and sizes
    apart: True to leave room for another thing between the copies
    """
    if count == 1:
        return pictures[0]
    generator = torch.Generator().manual_seed(seed)
    high = max(1, round(pictures[0].shape[1] * _SIDE / max(pictures[0].shape[1:])))
    ones = [resize(picture, high / picture.shape[1]) for picture in pictures[:count]]
    wide = max(one.shape[2] for one in ones)
    spots: list[tuple[float, float, float]] = []  # left, bottom, size
    rows = 1 if count <= 3 else 2 if count <= 7 else 3
    for row in range(rows):
        here = count // rows + (row < count % rows)
        size = 0.8**row
        step = (2.2 if apart else 0.98) * size * wide
        for number in range(here):
            shake = torch.rand(3, generator=generator)
            jitter = 0.5 if where == "air" else 0.06
            left = (number - (here - 1) / 2 + (0.5 if row % 2 else 0.0)) * step * (1.15 if where == "air" else 1.0)
            rise = row * (0.95 if where == "air" else 0.42) * high + jitter * float(shake[0]) * high
            spots.append((left, rise, size * (0.86 + 0.14 * float(shake[1]))))
    left = min(x - size * wide / 2 for x, _, size in spots)
    right = max(x + size * wide / 2 for x, _, size in spots)
    height = max(y + size * high for _, y, size in spots)
    together = torch.zeros(4, round(height) + 2, round(right - left) + 2)  # colours times opacity
    for number, (x, y, size) in sorted(enumerate(spots), key=lambda spot: -spot[1][1]):
        copy = resize(ones[number % len(ones)], size)
        copy = copy.flip(2) if number // len(ones) % 2 else copy
        top, start = max(0, round(height - y - copy.shape[1])), round(x - copy.shape[2] / 2 - left)
        sides = (start, together.shape[2] - start - copy.shape[2], top, together.shape[1] - top - copy.shape[1])
        over = functional.pad(torch.cat((copy[:3] * copy[3:], copy[3:])), sides)
        together = over + (1 - over[3:]) * together
    return torch.cat((together[:3] / together[3:].clamp(min=1e-4), together[3:])).clamp(0, 1)
