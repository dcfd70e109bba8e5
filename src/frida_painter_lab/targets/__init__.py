"""The pictures that experiments paint: those of the project, or the user's own."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.system import images

SHIPPED = ("astronaut", "cat", "coffee", "retina", "rocket")
PHOTOGRAPHS = (*SHIPPED, "cameraman", "coins", "galaxies")


@dataclass(frozen=True)
class Target:
    """Picture to paint: its name, its file, and its content, sRGB [3, H, W] in [0, 1]."""

    name: str
    path: Path
    picture: Tensor

    @classmethod
    def read(cls, path: Path) -> Self:
        """Returns the picture of a file, with the file's name. Raises ImageError."""
        return cls(path.stem, path, images.load(path))


def load_shipped_targets(names: Sequence[str] = SHIPPED) -> tuple[Target, ...]:
    """Returns the project's own pictures of these names."""
    return tuple(Target.read(next(Path(__file__).parent.glob(f"{name}.*"))) for name in names)


def load_targets(paths: Sequence[Path]) -> tuple[Target, ...]:
    """Returns the user's pictures, each with its file's name. Raises ImageError; ConfigError if two names are equal."""
    names = [path.stem for path in paths]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"Two targets are called {name!r}; rename one of the files.")
    return tuple(map(Target.read, paths))
