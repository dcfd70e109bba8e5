"""What a kind of goal says of itself to whoever asks people for goals."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING, Any

from frida_painter.errors import ConfigError, FridaError
from frida_painter.registry import OBJECTIVES, parts

if TYPE_CHECKING:
    from frida_painter.goal import Term

_NAME = re.compile("[a-z][a-z0-9_]{0,29}")
_TAKEN = ("goal", "initial", "photo", "weight", "clip", "pictures")


class Gives(Enum):
    """What a person gives for a goal; the value is how help pages call it."""

    PICTURE = "FILE"
    WORDS = "WORDS"


@dataclass(frozen=True)
class GoalKind:
    """One kind of goal. Its file, objectives/kinds/NAME.py or one of somebody's own, says all that there is to say.

    name: of the option --NAME, of its weight's --NAME-weight, and of the key in goal files: small letters, digits, _;
    gives: a picture's file or words; help: of the option, one sentence; label: what records call such a goal;
    open: the file or the words, and the weight, to a term; raises ConfigError and ImageError for what makes none;
    begin: the same for what a painting only begins with; None: as `open` with a weight of 1;
    initial_help: of the option --init-NAME; "": there is none (goal files may still begin with this kind);
    networks: groups of names of weights, of each of which one must have been fetched, best first.
    Raises ConfigError for a name that cannot be.
    """

    name: str
    gives: Gives
    help: str
    label: str
    open: Callable[[Any, float], Term]
    begin: Callable[[Any], Term] | None = None
    initial_help: str = ""
    networks: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        free = self.name not in _TAKEN and not self.name.startswith("init_") and not self.name.endswith("_weight")
        if not _NAME.fullmatch(self.name) or not free:
            raise ConfigError(
                f"A kind of goal was called {self.name[:40]!r}; a name has up to 30 small letters, digits and _, does "
                f"not begin with init_ or end with _weight, and is none of {', '.join(_TAKEN)}."
            )

    @property
    def option(self) -> str:
        """The option of the command line."""
        return f"--{self.name.replace('_', '-')}"

    @property
    def initial_option(self) -> str:
        """The option for what a painting begins with."""
        return f"--init-{self.name.replace('_', '-')}"

    def opened(self, value: Any, weight: float, *, beginning: bool) -> Term:
        """The term of a file or of words. Raises ConfigError, which names the option, and ImageError."""
        try:
            if not beginning:
                return self.open(value, weight)
            return self.open(value, 1.0) if self.begin is None else self.begin(value)
        except ConfigError as error:
            option = self.initial_option if beginning else self.option
            raise ConfigError(f"{option} {str(value)[:60]}: {error}") from error


@dataclass(frozen=True)
class KnownKinds:
    """The kinds of goals by their names, the project's own first; complaints: a sentence for each that was left out."""

    by_name: Mapping[str, GoalKind]
    complaints: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> GoalKind:
        """The kind of that name. Raises ConfigError where there is none."""
        if name not in self.by_name:
            raise ConfigError(f"There is no kind of goal called {name[:40]!r}; there are {', '.join(self.by_name)}.")
        return self.by_name[name]


@cache
def goal_kinds() -> KnownKinds:
    """The kinds of goals. Neither networks nor PyTorch are loaded for it.

    A kind of another package that cannot be loaded, or whose name is taken, is left out with a complaint.
    """
    known: dict[str, GoalKind] = {}
    complaints: list[str] = []
    for name, part in parts(OBJECTIVES).items():
        try:
            known[name] = part.load(GoalKind)
        except FridaError as error:
            complaints.append(f"A kind of goal is left out: {error}")
    return KnownKinds(known, tuple(complaints))
