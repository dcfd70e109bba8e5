"""Libraries of pictures, each with words for what its pictures show: fetched ones, and a person's own folder."""

import io
import json
import os
import re
import subprocess
import sys
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol
from xml.etree import ElementTree

import cv2
import numpy as np
import torch
from PIL import Image, ImageOps
from torch import Tensor

from frida_painter import registry, storage, weights
from frida_painter.errors import ConfigError, ImageError, WeightsError
from frida_painter.picture_file import FORMATS, one_line, require_size
from frida_painter.weights.archive import CAPTIONS, FILE, character_name
from frida_painter.words import svg_process

# Pictures with their opacity from files that anybody may have made: SVG drawings and pixels.

_SIDE = 512  # pixels of the longer side at which things are kept
MOST_BYTES = 64 * 2**20
_MOST_SVG_BYTES = 8 * 2**20
_MOST_PARTS = 200_000  # of an SVG, each counted as often as it is used
_PATIENCE = 20.0  # seconds for one SVG
_SEEN = 0.05  # opacity from which a pixel is part of a thing
_ALIKE = 14  # of 255, by which a ground's colours may differ from each other
_UNITS = {"": 1.0, "px": 1.0, "pt": 96 / 72, "pc": 16.0, "mm": 96 / 25.4, "cm": 96 / 2.54, "in": 96.0, "em": 16.0}
_LARGEST = 1e7  # units of an SVG's side
_FADING = 0.15  # of a picture's shorter side, over which its edges fade
_MARGIN = 0.3  # of a page's side, around it
_NEVER = ("script", "foreignObject", "animate", "set", "animateTransform", "animateMotion", "a")
_LINK = ("href", "{http://www.w3.org/1999/xlink}href")


def read_picture(content: bytes, name: str) -> Tensor:
    """A picture's bytes as colour and opacity [4, h, w] in [0, 1], cut to what is seen; 512 pixels at the most.

    A plain ground that reaches the edges all around is taken away. Raises ImageError, which tells the file's `name`,
    for what is no picture, is damaged, too large, or an SVG that would take too long; ConfigError where the package
    that draws SVG is not installed.
    """
    if len(content) > MOST_BYTES:
        raise ImageError(f"{name} has {len(content) >> 20} MB; a picture has at most {MOST_BYTES >> 20} MB.")
    start = content[:1024].lstrip(b"\xef\xbb\xbf \t\r\n")
    pixels = _pixels(_drawn(content, name) if start[:1] == b"<" else content, name)
    return trimmed(without_ground(torch.from_numpy(pixels).permute(2, 0, 1).float() / 255), name)


def without_outlines(svg: str, layer: str) -> str:
    """A drawing without the layer of that id."""
    drawing = ElementTree.fromstring(svg)
    for part in [part for part in drawing if part.get("id") == layer]:
        drawing.remove(part)
    return ElementTree.tostring(drawing, encoding="unicode")


def trimmed(drawing: Tensor, name: str) -> Tensor:
    """Without the empty margin. Raises ImageError where nothing is seen."""
    seen = drawing[3] > _SEEN
    rows, columns = seen.any(1).nonzero().flatten(), seen.any(0).nonzero().flatten()
    if len(rows) == 0:
        raise ImageError(f"{name} shows nothing: all of it is transparent.")
    return drawing[:, int(rows[0]) : int(rows[-1]) + 1, int(columns[0]) : int(columns[-1]) + 1].contiguous()


def faded(drawing: Tensor) -> Tensor:
    """A picture [4, h, w] whose edges fade into what is behind it."""
    rows, columns = drawing.shape[1:]
    reach = max(1.0, _FADING * min(rows, columns))
    down, across = (torch.arange(side) + 0.5 for side in (rows, columns))
    edge = torch.minimum(torch.minimum(down, rows - down)[:, None], torch.minimum(across, columns - across)[None])
    share = (edge / reach).clamp(0, 1)
    return torch.cat((drawing[:3], drawing[3:] * (share * share * (3 - 2 * share))[None]))


def without_ground(drawing: Tensor) -> Tensor:
    """An opaque picture [4, h, w] without the plain ground that reaches its edges; others as they are."""
    if float(drawing[3].mean()) < 0.98:
        return drawing
    pixels = (drawing[:3].permute(1, 2, 0) * 255).byte().numpy()
    edge = np.concatenate((pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1])).astype(float)
    ground = np.median(edge, axis=0)
    if (np.abs(edge - ground).max(1) <= _ALIKE).mean() < 0.9:
        return drawing
    rows, columns = pixels.shape[:2]
    framed = cv2.copyMakeBorder(np.ascontiguousarray(pixels), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=ground.tolist())
    mask = np.zeros((rows + 4, columns + 4), np.uint8)
    flags = 4 | cv2.FLOODFILL_MASK_ONLY | cv2.FLOODFILL_FIXED_RANGE | (1 << 8)
    cv2.floodFill(framed, mask, (0, 0), 0, (_ALIKE,) * 3, (_ALIKE,) * 3, flags)
    kept = torch.from_numpy(1 - mask[2:-2, 2:-2]).float()
    return torch.cat((drawing[:3], kept[None])) if float(kept.mean()) > 0.02 else drawing


def _pixels(content: bytes, name: str) -> np.ndarray:
    """RGBA [h, w, 4] of 8 bits, upright."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(content), formats=FORMATS) as file:
                require_size(Path(name), *file.size)
                file.draft(None, (_SIDE, _SIDE))
                layered = ImageOps.exif_transpose(file).convert("RGBA")
    except ImageError:
        raise
    except Exception as cause:  # decoders raise whatever they stumble over in a damaged file
        raise ImageError(f"{name} is a damaged picture, or none ({one_line(cause)}).") from cause
    # Premultiplied: what is transparent has no colour, whatever a palette says of it.
    share = _SIDE / max(layered.size)
    if share < 1:
        size = (max(1, round(share * layered.width)), max(1, round(share * layered.height)))
        layered = layered.convert("RGBa").resize(size, Image.Resampling.BOX).convert("RGBA")
    return np.asarray(layered).copy()


def _drawn(svg: bytes, name: str) -> bytes:
    """An SVG as PNG, drawn in a process of its own. Raises ImageError."""
    registry.require("words", "resvg_py", "Drawing an SVG")
    plain, width, height = _plain(svg, name)
    command = [sys.executable, "-I", svg_process.__file__]
    given = f"{width} {height}\n".encode() + plain
    try:
        ended = subprocess.run(command, input=given, capture_output=True, timeout=_PATIENCE, check=False)
    except subprocess.TimeoutExpired as cause:
        raise ImageError(f"{name} takes more than {_PATIENCE:g} s to draw; save it as PNG.") from cause
    except OSError as cause:
        raise ImageError(f"{name} cannot be drawn ({cause.strerror}); save it as PNG.") from cause
    if ended.returncode != 0 or not ended.stdout:
        said = ended.stderr.decode("utf-8", "replace").strip().splitlines() or ["it takes too long, or too much memory"]
        raise ImageError(f"{name} cannot be drawn ({said[-1][:120]}); save it as PNG.")
    return ended.stdout


def _plain(svg: bytes, name: str) -> tuple[bytes, int, int]:
    """An SVG without scripts and links to elsewhere, and the size in pixels that suits it. Raises ImageError."""
    if len(svg) > _MOST_SVG_BYTES:
        raise ImageError(f"{name} has {len(svg) >> 20} MB; an SVG has at most {_MOST_SVG_BYTES >> 20} MB.")
    try:
        drawing = ElementTree.fromstring(svg)  # external entities are never loaded, and expat ends entity bombs
    except (ElementTree.ParseError, ValueError, RecursionError) as cause:
        raise ImageError(f"{name} is a damaged SVG ({one_line(cause)}).") from cause
    if drawing.tag.rpartition("}")[2] != "svg":
        raise ImageError(f"{name} is XML, and no SVG.")
    for parent in list(drawing.iter()):
        for part in list(parent):
            kind = part.tag.rpartition("}")[2] if isinstance(part.tag, str) else ""
            links = [part.get(link, "") for link in _LINK]
            outside = any(link and not link.startswith(("#", "data:image/")) for link in links)
            if kind in _NEVER or outside or any("svg" in link[:20] for link in links if link.startswith("data:")):
                if kind == "a":
                    part.tag = part.tag.replace("}a", "}g")
                    continue
                parent.remove(part)
    _require_few_parts(drawing, name)
    width, height = _size(drawing, name)
    scale = (1 + 2 * _MARGIN) * _SIDE / max(width, height)
    wide, high = (max(1, round(side * scale)) for side in (width, height))
    drawing.set("width", str(wide))
    drawing.set("height", str(high))
    drawing.attrib.pop("preserveAspectRatio", None)
    return ElementTree.tostring(drawing, encoding="utf-8"), wide, high


def _size(drawing: ElementTree.Element, name: str) -> tuple[float, float]:
    """The sides of the page, which gets a margin all around: many drawings go beyond it."""
    box = [float(number) for number in re.findall(r"-?\d*\.?\d+(?:e-?\d+)?", drawing.get("viewBox", ""))]
    if len(box) != 4 or not all(0 < side < _LARGEST for side in box[2:]):
        sides = [re.fullmatch(r"\s*(\d*\.?\d+)\s*([a-z]*)\s*", drawing.get(side, "")) for side in ("width", "height")]
        box = [0.0, 0.0, *(float(found[1]) * _UNITS.get(found[2], 0.0) if found else 0.0 for found in sides)]
    left, top, width, height = box
    if not (0 < width < _LARGEST and 0 < height < _LARGEST):
        raise ImageError(f"{name} is an SVG that does not say how large it is; give it a viewBox.")
    page = (left - _MARGIN * width, top - _MARGIN * height, (1 + 2 * _MARGIN) * width, (1 + 2 * _MARGIN) * height)
    drawing.set("viewBox", " ".join(f"{number:g}" for number in page))
    return width, height


def _require_few_parts(drawing: ElementTree.Element, name: str) -> None:
    """Raises ImageError for an SVG whose parts use each other too often, or in a circle."""
    parts = {part.get("id"): part for part in drawing.iter() if part.get("id")}
    open_parts: set[int] = set()

    @cache
    def count(part: ElementTree.Element) -> int:
        if id(part) in open_parts:
            raise ImageError(f"{name} is an SVG whose parts use each other in a circle.")
        open_parts.add(id(part))
        used = next((parts[link[1:]] for one in _LINK if (link := part.get(one, ""))[1:] in parts), None)
        is_use = isinstance(part.tag, str) and part.tag.rpartition("}")[2] == "use"
        total = 1 + sum(map(count, part)) + (count(used) if is_use and used is not None else 0)
        open_parts.discard(id(part))
        return total

    try:
        if count(drawing) > _MOST_PARTS:
            raise ImageError(f"{name} is an SVG of more than {_MOST_PARTS} parts.")
    except RecursionError as cause:
        raise ImageError(f"{name} is an SVG whose parts lie too deep in each other.") from cause


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
