"""Libraries of pictures, each with words for what its pictures show: fetched ones, and a person's own folder."""

import json
import os
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol

from torch import Tensor

from frida_painter import storage, weights
from frida_painter.errors import ConfigError, ImageError, WeightsError
from frida_painter.objectives.scenes.drawings import MOST_BYTES, read_picture, without_outlines
from frida_painter.weights.picture_archive import CAPTIONS, FILE, character_name

GROUP = "frida_painter.picture_libraries"
"""The group of entry points in which a package names its picture libraries."""

_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".svg", ".gif", ".bmp", ".tif", ".tiff")
_MOST_FILES = 20_000  # of a person's own: their captions are read in about a minute
_MOST_CAPTION, _MOST_CAPTIONS = 300, 2**20  # bytes of the first line, and of all
_LATIN = re.compile("[A-Za-z]{2}")
_OUTLINES = "line"  # id of the layer of a pictogram that holds them
_PHOTOGRAPH = 0.8  # realism
_DRAWN = {
    "stamps": 0.4,
    "abcs": 0.4,
    "openclipart": 0.4,
    "fluent": 0.35,
    "flashcards": 0.2,
    "gcompris": 0.3,
    "costumes": 0.2,
    "furniture": 0.6,
    "silhouettes": 0.0,
}  # realism of drawings
_FLAT_ENOUGH = 0.25  # of what is drawn, that must be left without outlines


@dataclass(frozen=True)
class Captioned:
    """A picture of a library: its file, and what it shows: a title, and perhaps keywords after it.

    realism: how much it looks like the thing itself, from 0, a sign, to 1, a photograph.
    """

    file: str
    captions: tuple[str, ...]
    realism: float = 0.5


class PictureLibrary(Protocol):
    """Pictures that can be found by what they show.

    name: for a person; credit: who made them, and under which licence; "": nobody needs to be named; is_own: whether
    they are the person's own, which go before others.
    """

    name: str
    credit: str
    is_own: bool

    def captioned(self) -> Sequence[Captioned]:
        """All pictures. Raises WeightsError and ConfigError where the library cannot be read."""
        ...

    def pictures(self, file: str) -> list[Tensor]:
        """A picture in the ways in which it can be shown, colour and opacity [4, h, w] in [0, 1]. Raises ImageError."""
        ...


class PictureArchive:
    """A fetched library: a zip of pictures with their captions.

    drawn: how much its drawings look like the things themselves, from 0, a sign, to 1, a photograph.
    """

    is_own = False

    def __init__(self, name: str, credit: str, archive: Path, drawn: float = 0.4) -> None:
        self.name, self.credit = name, credit
        self._archive, self._drawn = archive, drawn

    def captioned(self) -> Sequence[Captioned]:
        """The pictures by the archive's own list. Raises WeightsError."""
        try:
            with zipfile.ZipFile(self._archive) as opened:
                known: dict[str, list[str]] = json.loads(opened.read(CAPTIONS))
        except (OSError, zipfile.BadZipFile, KeyError, ValueError) as cause:
            raise WeightsError(f"{self._archive} cannot be read ({cause}); fetch {self.name} again.") from cause
        return [Captioned(file, tuple(captions), self._realism(file)) for file, captions in sorted(known.items())]

    def pictures(self, file: str) -> list[Tensor]:
        """The picture. Raises WeightsError where the archive is damaged, ImageError where the picture is."""
        return [read_picture(_member(self._archive, file, self.name), f"{self.name}: {file}")]

    def _realism(self, file: str) -> float:
        """Pixels are photographs, but for those that say otherwise."""
        return self._drawn if file.endswith(".svg") or "cartoon" in file else _PHOTOGRAPH


class Pictograms:
    """OpenMoji's pictograms, each by the Unicode name of its character."""

    name, credit, is_own = "openmoji", "OpenMoji (openmoji.org), CC BY-SA 4.0", False

    def __init__(self, archive: Path) -> None:
        self._archive = archive

    def captioned(self) -> Sequence[Captioned]:
        """The pictograms of a single character. Raises WeightsError."""
        try:
            with zipfile.ZipFile(self._archive) as opened:
                files = sorted(opened.namelist())
        except (OSError, zipfile.BadZipFile) as cause:
            raise WeightsError(f"{self._archive} cannot be read ({cause}); fetch openmoji again.") from cause
        return [Captioned(file, (name,), 0.0) for file in files if (name := character_name(file.removesuffix(".svg")))]

    def pictures(self, file: str) -> list[Tensor]:
        """The drawing without its outlines, where enough of it is left, and with them.

        Outlines are for small signs, and a brush gives its own edges; but some hold what makes a thing that thing.
        """
        svg = _member(self._archive, file, self.name)
        outlined = read_picture(svg, f"openmoji: {file}")
        try:
            plain = read_picture(without_outlines(svg.decode("utf-8"), _OUTLINES).encode(), f"openmoji: {file}")
        except ImageError:
            return [outlined]
        enough = float(plain[3].sum()) >= _FLAT_ENOUGH * float(outlined[3].sum())
        return [plain, outlined] if enough else [outlined]


class PictureFolder:
    """A person's own pictures, each by a text beside it of the same name (`cat.txt` for `cat.png`), or by its name.

    Folders below are read as well; links to folders are not followed. unnamed: how many of them nothing was found to
    say of. Raises ConfigError where there is no picture, or too many.
    """

    name, credit, is_own = "your pictures", "", True

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.unnamed = 0
        if not folder.is_dir():
            raise ConfigError(f"--pictures {folder} is no folder; give a folder with pictures of things.")

    def captioned(self) -> Sequence[Captioned]:
        """The pictures that have a name or a caption in words."""
        said = {path: _said_of(path) for path in self._files()}
        found = [Captioned(str(path), (words,), 1.0) for path, words in said.items() if words]
        self.unnamed = len(said) - len(found)
        if not found:
            raise ConfigError(
                f"--pictures {self._folder} holds no picture with a name; name PNG, JPEG or SVG files by what they "
                "show, like red-fox.png, or put a text beside them, like IMG_1.txt."
            )
        return found

    def pictures(self, file: str) -> list[Tensor]:
        """The picture. Raises ImageError."""
        return [read_picture(storage.read_bytes(Path(file), "a picture", MOST_BYTES, ImageError), Path(file).name)]

    def _files(self) -> Iterator[Path]:
        count = 0
        for place, folders, files in os.walk(self._folder):
            folders.sort()
            for file in sorted(files):
                if file.lower().endswith(_SUFFIXES) and not file.startswith("."):
                    count += 1
                    if count > _MOST_FILES:
                        raise ConfigError(
                            f"--pictures {self._folder} holds more than {_MOST_FILES} pictures, which would take long "
                            "to read; give a folder with those of the things that you want to paint."
                        )
                    yield Path(place) / file


def _member(archive: Path, file: str, name: str) -> bytes:
    """A file of a fetched library. Raises WeightsError where the library is damaged."""
    try:
        with zipfile.ZipFile(archive) as opened:
            return opened.read(file)
    except (OSError, zipfile.BadZipFile, zlib.error, EOFError, KeyError) as cause:
        raise WeightsError(f"{archive} is damaged ({cause}); fetch {name} again.") from cause


def _said_of(path: Path) -> str:
    """What a picture of a person's own shows; "" where nothing says it."""
    said, beside = "", path.with_suffix(".txt")
    if beside.is_file() and not beside.is_symlink():
        with suppress(ImageError), storage.opened(beside, "a caption", _MOST_CAPTIONS, ImageError) as file:
            said = " ".join(file.readline(_MOST_CAPTION).decode("utf-8", "replace").split())
    if not _LATIN.search(said):  # the sentence encoder knows English
        said = " ".join(re.sub(r"[^a-zA-Z]+|(?<=[a-z])(?=[A-Z])", " ", path.stem).split()).lower()
        said = re.sub(r"^(img|dsc|dscn|pict?|image|photo|picture|screenshot|scan|untitled|unnamed|copy of)\b", "", said)
    return said.strip() if _LATIN.search(said) else ""


def libraries_at_hand(cache: Path | None = None, own: Path | None = None) -> list[PictureLibrary]:
    """The person's own folder, what was fetched, and what installed packages bring.

    A package brings a library as an entry point of the group `frida_painter.picture_libraries`, a callable without
    arguments that returns one. Raises WeightsError where what was fetched is altered, or a package's library cannot
    be used, and ConfigError where the folder holds no pictures.
    """
    found: list[PictureLibrary] = [] if own is None else [PictureFolder(own)]
    for point in entry_points(group=GROUP):
        try:
            found.append(point.load()())
        except Exception as error:  # whatever code of others raises
            raise WeightsError(
                f"The picture library {point.name!r} cannot be used ({type(error).__name__}: {error}); mend or remove "
                "the package that brings it."
            ) from error
    for name, drawn in _DRAWN.items():
        if (folder := weights.find(name, cache)) is not None:
            credit = f"{weights.named(name).credit}, {weights.named(name).licence}"
            found.append(PictureArchive(name, credit, folder / FILE, drawn))
    if (folder := weights.find("openmoji", cache)) is not None:
        found.append(Pictograms(folder / "pictograms.zip"))
    return found
