"""The pictures that experiments paint: those that come with the project, or a person's own."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from torch import Tensor

from frida_painter import images
from frida_painter.errors import ConfigError

SHIPPED = ("astronaut", "cat", "coffee", "retina", "rocket")
PHOTOGRAPHS = (*SHIPPED, "cameraman", "coins", "galaxies")
STYLES = ("tissue", "galaxies")
DRAWINGS = ("sailing-boat", "mug", "pear", "house")


@dataclass(frozen=True)
class Target:
    """A picture to paint, sRGB [3, H, W] in [0, 1]: what it is called, and its file."""

    name: str
    path: Path
    picture: Tensor

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process reads the file."""
        return Target.read, (self.path,)

    @classmethod
    def read(cls, path: Path) -> Self:
        """The picture of a file, called as the file. Raises ImageError."""
        return cls(path.stem, path, images.load(path))


def shipped(names: Sequence[str] = SHIPPED) -> tuple[Target, ...]:
    """The project's own pictures of these names."""
    return tuple(
        Target.read(Path(__file__).with_name(f"{name}.{'png' if name in DRAWINGS else 'jpg'}")) for name in names
    )


def given(paths: Sequence[Path]) -> tuple[Target, ...]:
    """A person's pictures, each called as its file. Raises ImageError; ConfigError where two are called the same."""
    names = [path.stem for path in paths]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"Two targets are called {name!r}; rename one of the files.")
    return tuple(map(Target.read, paths))
