"""Picture libraries with captions: fetched libraries, libraries of packages, and the user's own folder."""

import json
import re
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import registry
from frida_painter.errors import ConfigError, ImageError, ProcessLost, WeightsError
from frida_painter.objectives import weights
from frida_painter.objectives.encoders.base import PictureLibrary
from frida_painter.objectives.weights.archive import CAPTIONS
from frida_painter.objectives.weights.catalogue import PICTURES as FILE
from frida_painter.system import images, picture_file, storage
from frida_painter_words import svg_process

_SUFFIXES = (*picture_file.SUFFIXES, ".svg")
_MAX_BYTES = 64 * 2**20  # of a picture in the user's folder
_MAX_FILES = 20_000  # in the user's folder; their captions are read in about a minute
_MAX_CAPTION, _MAX_CAPTIONS = 300, 2**20  # bytes of the first line, and of the file
_LATIN = re.compile("[A-Za-z]{2}")
_LONGEST = 1024  # pixels of the longer side of a ground
SHIPPED = "drawn"  # the library that comes with this package
KINDS = SUBJECT, GROUND, MOOD = "subject", "ground", "mood"  # folders of titles only; the last two fill the canvas
_SEEN = 0.05  # opacity above which a pixel is part of a thing
_PLAIN = 0.83  # share of the edge of a picture that has the colour of its ground
_SPECK = 0.03  # size of a remnant of the ground, by that of the largest piece of a thing
_ALIKE = 14.5 / 255  # by which the colours of a plain ground may differ


class PictureArchive:
    """Fetched library: a zip of pictures with their captions."""

    is_own = False

    def __init__(self, name: str, credit: str, archive: Path) -> None:
        self.name, self.credit, self._archive = name, credit, archive

    def captions(self) -> Mapping[str, Sequence[str]]:
        """Returns the archive's own list. Raises WeightsError."""
        known: dict[str, list[str]] = json.loads(self._read(CAPTIONS))
        return known

    def picture(self, file: str) -> Tensor:
        """Returns the picture. Raises WeightsError if the archive is damaged, ImageError if the picture is."""
        content, name = self._read(file), f"{self.name}: {file}"
        if file.partition("/")[0] in (GROUND, MOOD):
            return images.load_with_opacity(content, name, longest=_LONGEST)
        return read_picture(content, name)

    def _read(self, file: str) -> bytes:
        try:
            with zipfile.ZipFile(self._archive) as opened:
                return opened.read(file)
        except (OSError, zipfile.BadZipFile, zlib.error, EOFError, KeyError) as cause:
            raise WeightsError(f"{self._archive} is damaged ({cause}); fetch {self.name} again.") from cause


class PictureFolder:
    """Library of the user's own pictures.

    The caption of a picture is the text file beside it (`cat.txt` for `cat.png`), or its name. Subfolders are
    included; links to folders are not followed.
    unnamed: number of pictures without a usable caption
    Raises ConfigError if the folder does not exist.
    """

    name, credit, is_own = "your pictures", "", True

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.unnamed = 0
        if not folder.is_dir():
            raise ConfigError(f"--pictures {folder} is no folder; give a folder with pictures of things.")

    def captions(self) -> Mapping[str, Sequence[str]]:
        """Returns the pictures that have a caption in words. Raises ConfigError for none or too many pictures."""
        every = (path for path in self._folder.rglob("[!.]*") if path.suffix.lower() in _SUFFIXES and not path.is_dir())
        files = sorted(islice(every, _MAX_FILES + 1))
        if len(files) > _MAX_FILES:
            raise ConfigError(
                f"--pictures {self._folder} holds more than {_MAX_FILES} pictures, which would take long to read; "
                "give a folder with those of the things that you want to paint."
            )
        found = {str(path): (words,) for path in files if (words := _read_caption(path))}
        self.unnamed = len(files) - len(found)
        if not found:
            raise ConfigError(
                f"--pictures {self._folder} holds no picture with a name; name PNG, JPEG or SVG files by what they "
                "show, like red-fox.png, or put a text beside them, like IMG_1.txt."
            )
        return found

    def picture(self, file: str) -> Tensor:
        """Returns the picture. Raises ImageError."""
        return read_picture(storage.read_bytes(Path(file), "a picture", _MAX_BYTES, ImageError), Path(file).name)


def _read_caption(path: Path) -> str:
    """Returns the caption of one of the user's pictures; "" if there is none."""
    said, beside = "", path.with_suffix(".txt")
    if beside.is_file() and not beside.is_symlink():
        with suppress(ImageError), storage.open_checked(beside, "a caption", _MAX_CAPTIONS, ImageError) as file:
            said = " ".join(file.readline(_MAX_CAPTION).decode("utf-8", "replace").split())
    if not _LATIN.search(said):  # the sentence encoder knows English
        said = " ".join(re.sub(r"[^a-zA-Z]+|(?<=[a-z])(?=[A-Z])", " ", path.stem).split()).lower()
        said = re.sub(r"^(img|dsc|dscn|pict?|image|photo|picture|screenshot|scan|untitled|unnamed|copy of)\b", "", said)
    return said.strip() if _LATIN.search(said) else ""


def libraries_at_hand(cache: Path | None = None, own: Path | None = None) -> list[PictureLibrary]:
    """Returns the user's own folder, the libraries of installed packages, the shipped one, and the fetched ones.

    Of two pictures of a thing, that of the earlier library is usually taken. A package adds a library by an entry point
    of the group `frida_painter.picture_libraries`: a callable without arguments that returns it.
    Raises WeightsError if a fetched library was altered, PluginError if a package's library cannot be loaded, and
    ConfigError if the user's folder does not exist.
    """
    found: list[PictureLibrary] = [] if own is None else [PictureFolder(own)]
    makers: list[Any] = [part.load(object) for part in registry.parts(registry.PICTURE_LIBRARIES).values()]
    found += [make() for make in makers]
    found.append(PictureArchive(SHIPPED, "", Path(__file__).with_name(f"{SHIPPED}.zip")))
    for known in weights.all_weights():
        folder = weights.find(known.name, cache) if known.pictures else None
        if folder is not None:
            found.append(PictureArchive(known.name, f"{known.credit}, {known.licence}", folder / FILE))
    return found


def read_picture(content: bytes, name: str) -> Tensor:
    """Returns the content of a picture file as colour and opacity [4, h, w] in [0, 1], trimmed; at most 512 pixels.

    name: of the file, for messages
    A plain ground that reaches all edges is removed.
    Raises ImageError if the file is no picture, damaged or too large, or an SVG that takes too long.
    Raises ConfigError if the package that draws SVG is not installed.
    """
    if content[:1024].lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        content = _draw_svg(content, name)
    drawing = without_ground(images.load_with_opacity(content, name, longest=svg_process.SIDE))
    left, top, width, height = cv2.boundingRect((drawing[3] > _SEEN).byte().numpy())
    if width == 0:
        raise ImageError(f"{name} shows nothing: all of it is transparent.")
    return drawing[:, top : top + height, left : left + width].contiguous()


def without_ground(drawing: Tensor) -> Tensor:
    """Returns an opaque picture [4, h, w] without the plain ground that reaches its edges; others unchanged."""
    if float(drawing[3].mean()) < 0.98:
        return drawing
    colors = drawing[:3]
    edge = torch.cat((colors[:, 0], colors[:, -1], colors[:, :, 0], colors[:, :, -1]), 1)
    ground = edge.median(1).values
    if ((edge - ground[:, None]).abs().amax(0) <= _ALIKE).float().mean() < _PLAIN:
        return drawing
    is_ground = (colors - ground[:, None, None]).abs().amax(0) <= _ALIKE
    framed = functional.pad(is_ground.byte(), (1, 1, 1, 1), value=1).numpy()
    _, parts = cv2.connectedComponents(framed, connectivity=4)
    inside = np.asarray(parts != parts[0, 0], np.uint8)[1:-1, 1:-1]
    _, pieces, sizes, _ = cv2.connectedComponentsWithStats(inside)  # the ground is piece 0
    is_large = sizes[:, cv2.CC_STAT_AREA] >= _SPECK * sizes[1:, cv2.CC_STAT_AREA].max(initial=0)
    kept = torch.from_numpy((is_large & (np.arange(len(sizes)) > 0))[pieces])[None].float()
    return torch.cat((colors, kept)) if float(kept.mean()) > 0.02 else drawing


def _draw_svg(svg: bytes, name: str) -> bytes:
    """Returns an SVG as PNG, drawn in a separate process. Raises ImageError."""
    registry.require("words", "resvg_py", "Drawing an SVG")
    try:
        return svg_process.draw(svg, name)
    except ProcessLost as lost:
        raise ImageError(f"{name} takes too long, or too much memory, to be drawn ({lost}) Save it as PNG.") from lost
