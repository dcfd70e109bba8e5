"""What a fetch tells while it goes on: nothing is taken from a network without having been announced."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Announced:
    """A source is about to be asked. size: bytes that will come; remote: whether a network is used."""

    name: str
    source: str
    size: int
    remote: bool


@dataclass(frozen=True)
class Received:
    """Bytes that have come so far, of all that will."""

    name: str
    done: int
    of: int


@dataclass(frozen=True)
class Refused:
    """A source did not give what was wanted, and why; the next one is asked."""

    name: str
    source: str
    reason: str


Notice = Announced | Received | Refused
Listener = Callable[[Notice], None]
