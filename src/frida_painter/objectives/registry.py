"""Which kinds of goals there are: those of the project, and those that other installed packages bring."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points

from frida_painter.errors import ConfigError
from frida_painter.objectives.kind import GoalKind

GROUP = "frida_painter.objectives"
"""The group of entry points in which a package names its kinds of goals."""

# They are entry points of this package as well; but an installation may be older than the code that it runs.
_OUR_OWN = tuple(
    EntryPoint(name, f"frida_painter.objectives.kinds.{name}:KIND", GROUP)
    for name in ("image", "semantic", "sketch", "text", "style")
)


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
    known = {point.name: _loaded(point) for point in _OUR_OWN}
    complaints: list[str] = []
    for point in sorted(entry_points(group=GROUP), key=lambda point: (point.name, point.value)):
        if point in _OUR_OWN:
            continue
        package = f" of {point.dist.name}" if point.dist is not None else ""
        try:
            kind = _loaded(point)
            if kind.name in known:
                raise ConfigError("there is another of that name")
            known[kind.name] = kind
        except Exception as error:  # whatever code of others raises when it is imported
            complaints.append(
                f"The kind of goal {point.name!r}{package} is left out, for it cannot be used "
                f"({type(error).__name__}: {error}); mend that package, or uninstall it."
            )
    return KnownKinds(known, tuple(complaints))


def _loaded(point: EntryPoint) -> GoalKind:
    kind = point.load()
    if not isinstance(kind, GoalKind):
        raise ConfigError(f"{point.value} is a {type(kind).__name__}; it must be a GoalKind")
    return kind
