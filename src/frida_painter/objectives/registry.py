"""Which kinds of goals there are: those of the project, and those that other installed packages bring."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from frida_painter.errors import ConfigError, FridaError
from frida_painter.objectives.kind import GoalKind
from frida_painter.registry import OBJECTIVES, parts


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
