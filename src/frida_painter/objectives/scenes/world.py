"""How large things are and where they are found, known from things of similar meaning."""

from functools import cache
from importlib import resources
from typing import NamedTuple

import torch

from frida_painter.objectives.encoders.sentence import SentenceEncoder

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
