"""Where the things of a scene stand: by the words between them, and by how large they are in the world.

Lengths are relative; x goes right, y up from the floor. The composition fits all of it to the canvas.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import NamedTuple

import torch
from torch import Tensor

from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.words.compositing import resized
from frida_painter.words.reading import MOST_THINGS, Reading, Relation, Thing

# How large things are and where they are found, known from things of similar meaning.

_PEOPLE = ("person", "man", "woman", "child", "boy", "girl")
_NEIGHBOURS = 3
_SHARPNESS = 0.05  # of similarity, over which a neighbour's say falls to a third


class Known(NamedTuple):
    """A thing in the world: its height in metres, and where it is.

    where: "ground", "air" or "water"; "worn"; "held": who has it holds it up; "head": it is worn there; "facing":
    what is on it lies before it, as on a web.
    """

    name: str
    height: float
    where: str


@cache
def known_things() -> tuple[Known, ...]:
    """The table `world.txt`."""
    lines = (resources.files(__package__) / "world.txt").read_text("utf-8").splitlines()
    rows = [line.rsplit(" ", 2) for line in lines if line and not line.startswith("#")]
    return tuple(Known(name, float(height), where) for name, height, where in rows)


def known_like(name: str, sentences: SentenceEncoder) -> Known:
    """A thing of that name: as high as the things that are most like it, in the mean; where the nearest is."""
    things = known_things()
    similarity, nearest = _likeness(name, sentences).topk(_NEIGHBOURS)
    share = (similarity / _SHARPNESS).softmax(0)
    heights = torch.tensor([things[at].height for at in nearest.tolist()])
    return Known(name, float((share * heights.log()).sum().exp()), things[int(nearest[0])].where)


def is_person(name: str, sentences: SentenceEncoder) -> bool:
    """Whether what is called so is most like people, of all that is known."""
    return known_things()[int(_likeness(name, sentences).argmax())].name in _PEOPLE


def _likeness(name: str, sentences: SentenceEncoder) -> torch.Tensor:
    """How like each of the known things it is, [n]."""
    meanings = sentences.embed([name, *(thing.name for thing in known_things())])
    return meanings[1:] @ meanings[0]


_GROWTH = 0.35  # power of the height in the world that the height in a picture follows
_LEAST = 0.3  # of the tallest thing's height, that every thing has
_SUBJECT = 0.5  # the same of the thing that a prompt names first
_IN_THE_AIR = 0.38  # height of what hangs in the sky beside a thing of height 1
_SINKS = 0.1  # of its height, by which a thing on another overlaps it
_INSIDE = 0.4  # of the height of what it is in, that a thing has at least
_HIDDEN = 0.4  # of its height, which is hidden in what it is in
_CROWDED = 0.6  # of its size, that a thing has at least beside others on the same thing
_BRIMS = 0.8  # of the fullest row below it, from which a row of a picture is below the rim
_HOLDS = 0.6  # of a picture's fullest row, that a row of what holds something has: a foot does not
_FITS, _SPREADS = 0.85, 1.7  # of the width of what it is in, that a thing has at most; the same of a neck's
_NECK = 0.25  # of a picture's fullest row, that every row of a neck has
_ON_A_FACE = 0.45  # of the height of what faces us, that a thing on it has at most
_HELD, _HAND = 0.8, 0.45  # of who holds it, the height of what is held up at most, and that of the hand
_PLAYED = 0.55  # of who plays it, the height that an instrument has at most
_STANDS = 0.85  # the same from which it stands by itself
_ENDS = 0.95  # of the height, up to which a neck is looked at: an end may be round
_SIDE = 256  # pixels of one of several copies
_OF_WORD = {
    "on": "on", "on top of": "on", "upon": "on", "onto": "on", "riding": "on",
    "in": "in", "inside": "in", "into": "in", "within": "in", "of": "around", "out of": "in", "from": "in",
    "under": "under", "below": "under", "beneath": "under", "underneath": "under",
    "over": "over", "above": "over", "across": "over", "crossing": "on",
    "behind": "behind", "in front of": "front", "before": "front", "against": "front", "between": "between",
    "with": "with", "holding": "with", "carrying": "with", "eating": "with", "playing": "playing",
}  # fmt: skip
_CROWN = 0.1  # of a picture's height, the part from its top that is taken for a head
_HAT, _LEAST_HEAD, _LARGEST_HAT, _PULLED_DOWN = 1.25, 0.12, 0.35, 0.3  # of a head's width, and of heights
_STOOD_BY = ("on", "in", "under", "over", "behind", "between")  # what these speak of is placed first
_OPPOSITE = {
    "on": "beneath", "in": "around", "around": "in", "under": "over", "over": "under", "behind": "front",
    "front": "behind",
}  # fmt: skip


@dataclass(frozen=True)
class ScenePart:
    """A thing to be placed: its picture, colour and opacity [4, h, w], all copies in one, and what is known of it."""

    picture: Tensor
    known: Known


@dataclass(frozen=True)
class Placed:
    """A picture in a scene: the middle of its lower edge, its height, and what it is drawn before; hidden: share of its
    height, from below, that is hidden in what it stands in."""

    picture: Tensor
    x: float
    y: float
    height: float
    depth: int = 0
    hidden: float = 0.0

    @property
    def width(self) -> float:
        """By the picture's proportions."""
        return self.height * self.picture.shape[2] / self.picture.shape[1]


def arranged(parts: Sequence[ScenePart | None], relations: Sequence[Relation]) -> list[Placed]:
    """The parts as they stand to each other; those that are None have no picture. The relations' numbers are parts'."""
    shown = [number for number, part in enumerate(parts) if part is not None]
    if not shown:
        return []
    sizes = _sizes(parts, shown)
    known = [part.known.where if part is not None else "" for part in parts]
    placed: dict[int, Placed] = {}
    usable = [
        replace(one, word="with") if known[one.object] == "head" and one.word in ("in", "wearing") else one
        for one in relations
        if {one.subject, one.object} <= set(shown) and one.subject != one.object
    ]
    floor = [number for number in shown if known[number] != "air"] or shown
    standing = (one.object for one in usable if _OF_WORD.get(one.word) in _STOOD_BY)
    first = next(standing, floor[0])
    placed[first] = _alone(parts, first, sizes)
    together: dict[tuple[int, str], list[int]] = {}  # what is on or in one thing
    rest = list(usable)
    while rest:
        one = next((one for one in rest if {one.subject, one.object} & set(placed)), None)
        if one is None:
            one = rest[0]
            placed[one.object] = _beside(list(placed.values()), _alone(parts, one.object, sizes))
        rest.remove(one)
        kind = _OF_WORD.get(one.word, "beside")
        if known[one.object] == "air" and (one.word == "at" or one.word.endswith("ing")) and one.word not in _OF_WORD:
            kind = "with"  # a kite that is flown, and the moon that is howled at, are up
        if one.word == "from" and any(two.subject == one.subject and two.word.endswith("ing") for two in usable):
            kind = "beside"  # who eats leaves from a tree is not in it
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


def _alone(parts: Sequence[ScenePart | None], number: int, sizes: dict[int, float]) -> Placed:
    part = parts[number]
    assert part is not None
    # As large in area as it is high: a spoon is long and not large.
    _, rows, columns = part.picture.shape
    stretch = (rows / columns) ** 0.5 if columns > rows else 1.0
    return Placed(part.picture, 0.0, 0.0, sizes[number] * stretch)


def _sizes(parts: Sequence[ScenePart | None], shown: Sequence[int]) -> dict[int, float]:
    """Heights of the parts, 1 for the tallest that stands on the floor: nearer to each other than in the world."""
    known = {number: part.known for number in shown if (part := parts[number]) is not None}
    standing = [one.height for one in known.values() if one.where != "air"] or [1.0]
    sizes = {}
    for number, one in known.items():
        in_the_air = one.where == "air" and any(other.where != "air" for other in known.values())
        size = _IN_THE_AIR if in_the_air else max(_LEAST, min(1.0, (one.height / max(standing)) ** _GROWTH))
        sizes[number] = max(size, _SUBJECT if number == shown[0] and not in_the_air else 0.0)
    return sizes


def _put(mine: Placed, other: Placed, kind: str, where: str, other_where: str) -> tuple[Placed, Placed]:
    """A thing at its place by another, and that one, which may have changed its size."""
    if kind in ("on", "beneath"):
        upper, lower = (mine, other) if kind == "on" else (other, mine)
        if (other_where if kind == "on" else where) == "facing":
            upper = replace(
                upper, height=min(upper.height, _ON_A_FACE * lower.height), x=lower.x, depth=lower.depth + 1
            )
            upper = replace(upper, y=lower.y + 0.5 * (lower.height - upper.height))
            return (upper, lower) if kind == "on" else (lower, upper)
        if upper.height > 0.9 * lower.height and lower.width < 1.5 * upper.width:
            upper = replace(upper, height=max(0.62 * lower.height, 0.6 * upper.height))
        top = lower.y + lower.height * _top(lower.picture, upper.width / max(lower.width, 1e-6))
        upper = replace(upper, x=lower.x, y=top - _SINKS * upper.height, depth=lower.depth + 1)
        return (upper, lower) if kind == "on" else (lower, upper)
    if kind in ("in", "around"):
        inner, outer = (mine, other) if kind == "in" else (other, mine)
        # It looks out over the rim, before what rises above that, as a handle or a sail.
        rim, necked = _rim(outer.picture)
        most = min(
            0.8 * outer.height, (_SPREADS if necked else _FITS) * outer.width * inner.height / max(inner.width, 1e-6)
        )
        size = min(most, max(inner.height, _INSIDE * outer.height))
        rim = outer.y + outer.height * rim
        inner = replace(inner, height=size, x=outer.x, y=rim - _HIDDEN * size, depth=outer.depth + 1, hidden=_HIDDEN)
        if necked:  # flowers hang over the sides of a vase, which stands before them
            inner = replace(inner, depth=outer.depth - 1, hidden=0.0)
        return (inner, outer) if kind == "in" else (outer, inner)
    if kind == "under" and other_where == "held":  # who is under an umbrella has it over him
        over = max(1.25 * mine.width, 0.7 * mine.height) * other.height / other.width
        return mine, replace(other, height=over, x=mine.x, y=mine.y + 0.85 * mine.height, depth=mine.depth - 1)
    if kind == "under":
        if other_where == "air":
            return mine, replace(other, x=mine.x + 0.35 * max(mine.width, 0.6), y=0.95 * mine.height)
        if _hollow(other.picture):
            height = min(mine.height, 0.5 * other.height, 0.5 * other.width * mine.height / mine.width)
            return replace(mine, x=other.x, y=other.y, height=height, depth=other.depth + 1), other
        if where == other_where == "water":
            return replace(mine, x=other.x, y=other.y - 0.95 * mine.height, depth=other.depth - 1), other
        return replace(mine, x=other.x - 0.2 * other.width, y=other.y - 0.4 * mine.height, depth=other.depth + 1), other
    if kind == "over":
        side = 0.0 if where != "air" else 0.28 * max(other.width, 0.6)
        return replace(mine, x=other.x + side, y=other.y + 1.04 * other.height, depth=other.depth - 1), other
    if kind == "behind":
        size = max(mine.height, 0.85 * other.height)
        return replace(
            mine, x=other.x + 0.45 * other.width, y=other.y + 0.08, height=size, depth=other.depth - 1
        ), other
    if kind == "front":
        return replace(mine, x=other.x - 0.3 * other.width, y=other.y - 0.06, depth=other.depth + 1), other
    if kind == "with" and where == "air":
        return replace(mine, x=other.x + 0.5 * (other.width + mine.width), y=0.75 * other.height), other
    if kind == "playing" and mine.height < _STANDS * other.height:
        mine = replace(mine, height=min(mine.height, _PLAYED * other.height), x=other.x + 0.1 * other.width)
        return replace(mine, y=other.y + 0.7 * _HAND * other.height, depth=other.depth + 1), other
    if kind == "with" and where == "head":
        middle, wide = _head(other.picture)
        size = _HAT * max(wide, _LEAST_HEAD) * other.width * mine.height / mine.width
        height = min(size, _LARGEST_HAT * other.height)
        x, y = other.x + middle * other.width, other.y + other.height - _PULLED_DOWN * height
        return replace(mine, height=height, x=x, y=y, depth=other.depth + 1), other
    if kind == "with" and where == "held":
        mine = replace(mine, height=min(mine.height, _HELD * other.height), x=other.x + 0.4 * other.width)
        return replace(mine, y=other.y + _HAND * other.height, depth=other.depth - 1), other
    if kind == "with" and mine.width > 0.8 * other.width:
        mine = replace(mine, height=mine.height * 0.8 * other.width / mine.width)
    if kind == "with" and mine.height <= 0.6 * other.height:
        return replace(mine, x=other.x + 0.4 * other.width, y=other.y, depth=other.depth + 1), other
    if kind == "between":
        return replace(mine, x=other.x, y=other.y, depth=other.depth + 1), other
    return _beside([other], mine), other


def _spread(some: Sequence[Placed], holder: Placed) -> list[Placed]:
    """Things on or in one thing, side by side over its middle, smaller where there is little room."""
    width = sum(one.width for one in some)
    scale = max(_CROWDED, min(1.0, holder.width / width))
    left, spread = holder.x - scale * width / 2, []
    for one in some:
        # What is hidden of a smaller thing is less: its upper part begins where it did.
        y = one.y + (1 - scale) * one.hidden * one.height
        spread.append(replace(one, x=left + scale * one.width / 2, y=y, height=scale * one.height))
        left += scale * one.width
    return spread


def _beside(others: Sequence[Placed], mine: Placed) -> Placed:
    """On the same floor, to the right of all others."""
    edge = max(one.x + one.width / 2 for one in others)
    return replace(mine, x=edge + 0.53 * mine.width, y=min(one.y for one in others))


def _top(picture: Tensor, share: float) -> float:
    """How high a picture reaches in its middle, as a share of its height; `share`: of its width, that counts."""
    seen = picture[3] > 0.5
    middle = seen.shape[1] / 2
    half = max(1.0, min(0.3, 0.25 * share) * seen.shape[1])
    columns = seen[:, int(middle - half) : int(middle + half) + 1]
    tops = [int(column.nonzero()[0]) for column in columns.T if bool(column.any())]
    return 1 - sorted(tops)[len(tops) // 2] / seen.shape[0] if tops else 1.0


def _rim(picture: Tensor) -> tuple[float, bool]:
    """How high the rim of what holds something is, as a share of its height, and whether it is that of a neck.

    Above a rim, what holds something is narrower than below: there rise a handle or a sail. A neck, as of a vase, is
    full up to its end, which is no point.
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
    """Where the highest part of a picture is, which is a head: its middle from that of the picture, and its width."""
    seen = picture[3] > 0.5
    first = int(seen.any(1).float().argmax())
    columns = seen[first : first + max(1, round(_CROWN * seen.shape[0]))].any(0)
    peak = int(seen[first].float().argmax())
    if not bool(columns[peak]):
        return 0.0, 1.0
    left = peak - int((~columns[: peak + 1].flip(0)).float().cumsum(0).eq(0).sum()) + 1
    right = peak + int((~columns[peak:]).float().cumsum(0).eq(0).sum())  # of what hangs together with the highest
    return (left + right) / 2 / seen.shape[1] - 0.5, (right - left) / seen.shape[1]


def _hollow(picture: Tensor) -> bool:
    """Whether there is room in the lower half of a picture, as under a table or a tree."""
    lower = picture[3, picture.shape[1] // 2 :]
    return float(lower.mean()) < 0.5


def copies(pictures: Sequence[Tensor], count: int, where: str, seed: int, *, apart: bool = False) -> Tensor:
    """So many copies of pictures as one [4, h, w]: in rows on a floor, the rear ones smaller; scattered in the air.

    The pictures take turns, as high as the first one. apart: with room for another thing between them.
    """
    if count == 1:
        return pictures[0]
    generator = torch.Generator().manual_seed(seed)
    high = max(1, round(pictures[0].shape[1] * _SIDE / max(pictures[0].shape[1:])))
    ones = [resized(picture, high / picture.shape[1]) for picture in pictures[:count]]
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
    colors, opacity = (
        torch.zeros(3, round(height) + 2, round(right - left) + 2),
        torch.zeros(1, round(height) + 2, round(right - left) + 2),
    )
    for number, (x, y, size) in sorted(enumerate(spots), key=lambda spot: -spot[1][1]):
        copy = resized(ones[number % len(ones)], size)
        copy = copy.flip(2) if number // len(ones) % 2 else copy
        top, start = round(height - y - copy.shape[1]), round(x - copy.shape[2] / 2 - left)
        area = slice(max(0, top), max(0, top) + copy.shape[1]), slice(start, start + copy.shape[2])
        over = copy[3:, : colors[:, area[0], area[1]].shape[1], : colors[:, area[0], area[1]].shape[2]]
        paint = copy[:3, : over.shape[1], : over.shape[2]]
        colors[:, area[0], area[1]] = paint * over + (1 - over) * colors[:, area[0], area[1]]
        opacity[:, area[0], area[1]] = over + (1 - over) * opacity[:, area[0], area[1]]
    return torch.cat((colors / opacity.clamp(min=1e-4), opacity)).clamp(0, 1)


# Words for people whom no picture shows as such: a couple is a woman and a man, children are a girl and a boy.

_SHOWN_BY = {
    "couple": ("woman", "man"), "people": ("woman", "man"), "person": ("woman", "man"), "human": ("woman", "man"),
    "lover": ("woman", "man"), "friend": ("girl", "boy"), "child": ("girl", "boy"), "kid": ("girl", "boy"),
    "mother": ("woman",), "father": ("man",), "lady": ("woman",), "gentleman": ("man",), "guy": ("man",),
    "teenager": ("girl", "boy"),
}  # fmt: skip
_ALWAYS_TWO = "couple"


def with_figures(reading: Reading, has_own: Callable[[Thing], bool]) -> Reading:
    """The reading, where people who do something, or are somewhere, are such as pictures from head to foot show.

    Somebody alone, of whom nothing more is said, stays: that is a portrait. has_own: whether a person's own pictures
    show somebody; who is shown by them stays too.
    """
    things, relations = list(reading.things), list(reading.relations)
    for number, thing in enumerate(reading.things):
        who = _SHOWN_BY.get(thing.noun)
        adjective = thing.name.removesuffix(thing.noun).strip()
        if who is None or not (reading.relations or thing.doing or adjective or thing.noun == _ALWAYS_TWO):
            continue
        if has_own(thing):
            continue
        several = thing.shown > 1 or thing.noun == _ALWAYS_TWO
        count = 2 if thing.noun == _ALWAYS_TWO else thing.shown
        figures = [replace(thing, name=f"{adjective} {noun}".strip(), noun=noun, plural="", count=1) for noun in who]
        if not several or len(figures) == 1:
            things[number] = replace(figures[0], count=thing.count)
        elif len(things) < MOST_THINGS:
            things[number] = replace(figures[0], count=count - count // 2)
            relations.append(Relation(len(things), "beside", number))
            things.append(replace(figures[1], count=count // 2))
    return replace(reading, things=tuple(things), relations=tuple(relations))
