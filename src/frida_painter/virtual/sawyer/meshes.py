"""The maker's own shapes, from a folder that a person has, to be looked at in the film; the arm's physics needs none.

A part's shape is PART.obj or PART.stl, or all such files in a folder PART, as robosuite keeps them;
PART.mtl, where there is one, has the colours that OBJ files name.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from frida_painter import storage
from frida_painter.errors import ConfigError

Color = tuple[float, float, float]

PARTS = ("base", "head", "l0", "l1", "l2", "l3", "l4", "l5", "l6")
_KINDS = (".obj", ".stl")
_MOST_BYTES = 300 * 2**20
_HEAD_LINES = 100  # of an OBJ file, in which it names its colour
_GREY: Color = (0.45, 0.45, 0.47)


@dataclass(frozen=True)
class Piece:
    """One mesh of a part, in metres in the frame of the part's body, and its colour, sRGB in [0, 1]."""

    part: str
    path: Path
    color: Color


@dataclass(frozen=True)
class Meshes:
    """All pieces of an arm."""

    pieces: tuple[Piece, ...]

    @classmethod
    def in_folder(cls, folder: Path) -> Self:
        """Raises ConfigError where a part is missing, nothing can be read, or all of it is too large."""
        if not folder.is_dir():
            raise ConfigError(f"{folder} is no folder; give the one with the meshes {', '.join(PARTS)}.")
        found = {part: list(_files(folder, part)) for part in PARTS}
        missing = [part for part, files in found.items() if not files]
        if missing:
            raise ConfigError(
                f"{folder} has no mesh of {', '.join(missing)}; of every part ({', '.join(PARTS)}) there must be "
                "PART.obj or PART.stl, or a folder PART of such files."
            )
        try:
            size = sum(path.stat().st_size for files in found.values() for path in files)
            if size > _MOST_BYTES:
                most = _MOST_BYTES / 2**20
                raise ConfigError(
                    f"The meshes in {folder} have {size / 2**20:.0f} MB; at most {most:.0f} MB are taken."
                )
            return cls(
                tuple(
                    Piece(part, path, _color(path, colors))
                    for part, files in found.items()
                    for colors in [_colors(folder / f"{part}.mtl")]
                    for path in files
                )
            )
        except OSError as cause:
            raise ConfigError(f"A mesh in {folder} cannot be read ({cause}).") from cause


def _files(folder: Path, part: str) -> Iterator[Path]:
    inside = folder / part
    if inside.is_dir():
        yield from sorted(path for path in inside.iterdir() if path.suffix.lower() in _KINDS)
    else:
        yield from [path for kind in _KINDS if (path := folder / f"{part}{kind}").is_file()][:1]


def _colors(path: Path) -> dict[str, Color]:
    """The diffuse colours of an MTL file by their names; none where there is no such file."""
    if not path.is_file():
        return {}
    colors, name = {}, ""
    content = storage.read_bytes(path, "the colours of a mesh (MTL)", _MOST_BYTES, ConfigError)
    for line in content.decode("utf-8", "replace").splitlines():
        if named := re.match(r"\s*newmtl\s+(\S+)", line):
            name = named[1]
        elif diffuse := re.match(r"\s*Kd\s+([\d.]+)\s+([\d.]+)\s+([\d.]+)", line):
            red, green, blue = (min(1.0, float(part)) for part in diffuse.groups())
            colors[name] = (red, green, blue)
    return colors


def _color(path: Path, colors: dict[str, Color]) -> Color:
    """The colour that an OBJ file names first."""
    if not colors or path.suffix.lower() != ".obj":
        return _GREY
    with storage.opened(path, "a mesh (OBJ)", _MOST_BYTES, ConfigError) as lines:
        for _, line in zip(range(_HEAD_LINES), lines, strict=False):
            if named := re.match(r"\s*usemtl\s+(\S+)", line.decode("utf-8", "replace")):
                return colors.get(named[1], _GREY)
    return _GREY
