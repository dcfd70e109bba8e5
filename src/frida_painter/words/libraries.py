"""Picture libraries with captions: fetched libraries, libraries of packages, and the user's own folder."""

import io
import json
import re
import subprocess
import sys
import warnings
import zipfile
import zlib
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import entry_points
from itertools import islice
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import torch
from PIL import Image, ImageOps
from torch import Tensor

from frida_painter import registry, storage, weights
from frida_painter.errors import ConfigError, ImageError, WeightsError
from frida_painter.objectives.picture_library import Captioned, PictureLibrary
from frida_painter.picture_file import FORMATS, one_line, require_size
from frida_painter.weights.archive import CAPTIONS, FILE
from frida_painter.words import svg_process

# Pictures with opacity from untrusted files: SVG drawings and pixels.

_SIDE = 512  # pixels of the longer side of stored things
MAX_BYTES = 64 * 2**20
_MAX_SVG_BYTES = 8 * 2**20
_PATIENCE = 20.0  # seconds for one SVG
_SEEN = 0.05  # opacity above which a pixel is part of a thing
_ALIKE = 14  # of 255, by which the colours of a plain ground may differ
_UNITS = {"": 1.0, "px": 1.0, "pt": 96 / 72, "pc": 16.0, "mm": 96 / 25.4, "cm": 96 / 2.54, "in": 96.0, "em": 16.0}
_LARGEST = 1e7  # units of an SVG's side
_MARGIN = 0.3  # margin around a page, as a share of its side
_LINK, _INSIDE = ("href", "{http://www.w3.org/1999/xlink}href"), "#|data:image/(?!svg)"


def read_picture(content: bytes, name: str) -> Tensor:
    """Returns a picture file as colour and opacity [4, h, w] in [0, 1], trimmed; at most 512 pixels.

    content: bytes of the file
    name: of the file, for messages

    A plain ground that reaches all edges is removed.
    Raises ImageError if the file is no picture, damaged or too large, or an SVG that takes too long.
    Raises ConfigError if the package that draws SVG is not installed.
    """
    if len(content) > MAX_BYTES:
        raise ImageError(f"{name} has {len(content) >> 20} MB; a picture has at most {MAX_BYTES >> 20} MB.")
    start = content[:1024].lstrip(b"\xef\xbb\xbf \t\r\n")
    pixels = _pixels(_draw_svg(content, name) if start[:1] == b"<" else content, name)
    return trim(without_ground(torch.from_numpy(pixels).permute(2, 0, 1).float() / 255), name)


def trim(drawing: Tensor, name: str) -> Tensor:
    """Returns a drawing without its empty margin. Raises ImageError if it is transparent."""
    seen = drawing[3] > _SEEN
    rows, columns = seen.any(1).nonzero().flatten(), seen.any(0).nonzero().flatten()
    if len(rows) == 0:
        raise ImageError(f"{name} shows nothing: all of it is transparent.")
    return drawing[:, int(rows[0]) : int(rows[-1]) + 1, int(columns[0]) : int(columns[-1]) + 1].contiguous()


def without_ground(drawing: Tensor) -> Tensor:
    """Returns an opaque picture [4, h, w] without the plain ground that reaches its edges; others unchanged."""
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
    """Returns RGBA [h, w, 4] of 8 bits, upright."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(content), formats=FORMATS) as file:
                require_size(Path(name), *file.size)
                file.draft(None, (_SIDE, _SIDE))
                layered = ImageOps.exif_transpose(file).convert("RGBA")
    except ImageError:
        raise
    except Exception as cause:  # decoders raise many exceptions for damaged files
        raise ImageError(f"{name} is a damaged picture, or none ({one_line(cause)}).") from cause
    # Premultiplied in the resampling, because transparent pixels have arbitrary colours.
    share = _SIDE / max(layered.size)
    if share < 1:
        size = (max(1, round(share * layered.width)), max(1, round(share * layered.height)))
        layered = layered.convert("RGBa").resize(size, Image.Resampling.BOX).convert("RGBA")
    return np.asarray(layered).copy()


def _draw_svg(svg: bytes, name: str) -> bytes:
    """Returns an SVG as PNG, drawn in a separate process. Raises ImageError."""
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
    """Returns an SVG without external links, and its size in pixels. Raises ImageError. Scripts are never run."""
    if len(svg) > _MAX_SVG_BYTES:
        raise ImageError(f"{name} has {len(svg) >> 20} MB; an SVG has at most {_MAX_SVG_BYTES >> 20} MB.")
    try:
        drawing = ElementTree.fromstring(svg)  # external entities are never loaded, and expat stops entity bombs
    except (ElementTree.ParseError, ValueError, RecursionError) as cause:
        raise ImageError(f"{name} is a damaged SVG ({one_line(cause)}).") from cause
    if drawing.tag.rpartition("}")[2] != "svg":
        raise ImageError(f"{name} is XML, and no SVG.")
    for part in drawing.iter():
        for link in _LINK:
            if not re.match(_INSIDE, part.get(link, "#")):
                del part.attrib[link]
    width, height = _size(drawing, name)
    scale = (1 + 2 * _MARGIN) * _SIDE / max(width, height)
    wide, high = (max(1, round(side * scale)) for side in (width, height))
    drawing.set("width", str(wide))
    drawing.set("height", str(high))
    drawing.attrib.pop("preserveAspectRatio", None)
    try:
        return ElementTree.tostring(drawing, encoding="utf-8"), wide, high
    except RecursionError as cause:
        raise ImageError(f"{name} is an SVG whose parts lie too deep in each other.") from cause


def _size(drawing: ElementTree.Element, name: str) -> tuple[float, float]:
    """Returns the sides of the page, and adds a margin to it, because many drawings exceed their page."""
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


GROUP = "frida_painter.picture_libraries"
"""Group of entry points for the picture libraries of packages."""

_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".svg", ".gif", ".bmp", ".tif", ".tiff")
_MAX_FILES = 20_000  # in the user's folder; their captions are read in about a minute
_MAX_CAPTION, _MAX_CAPTIONS = 300, 2**20  # bytes of the first line, and of the file
_LATIN = re.compile("[A-Za-z]{2}")
_ARCHIVES = (
    "stamps",
    "abcs",
    "openclipart",
    "fluent",
    "flashcards",
    "gcompris",
    "costumes",
    "furniture",
    "silhouettes",
)
_PHOTOGRAPH, _DRAWN = 0.8, 0.4  # realism of a photograph, and of a drawing
_DRAWN_IN = {"flashcards": 0.2, "costumes": 0.2, "furniture": 0.6, "silhouettes": 0.0}


class PictureArchive:
    """Fetched library: a zip of pictures with their captions."""

    is_own = False

    def __init__(self, name: str, credit: str, archive: Path) -> None:
        self.name, self.credit, self._archive = name, credit, archive

    def list_captioned(self) -> Sequence[Captioned]:
        """Returns the pictures of the archive's own list. Raises WeightsError."""
        try:
            known: dict[str, list[str]] = json.loads(self._read(CAPTIONS))
        except ValueError as cause:
            raise WeightsError(f"{self._archive} has damaged captions ({cause}); fetch {self.name} again.") from cause
        return [Captioned(file, tuple(captions), self._realism(file)) for file, captions in sorted(known.items())]

    def pictures(self, file: str) -> list[Tensor]:
        """Returns the picture. Raises WeightsError if the archive is damaged, ImageError if the picture is."""
        return [read_picture(self._read(file), f"{self.name}: {file}")]

    def _read(self, file: str) -> bytes:
        try:
            with zipfile.ZipFile(self._archive) as opened:
                return opened.read(file)
        except (OSError, zipfile.BadZipFile, zlib.error, EOFError, KeyError) as cause:
            raise WeightsError(f"{self._archive} is damaged ({cause}); fetch {self.name} again.") from cause

    def _realism(self, file: str) -> float:
        """Returns the realism of a file: pixels are photographs, unless the name says "cartoon"."""
        is_drawn = file.endswith(".svg") or "cartoon" in file
        return _DRAWN_IN.get(self.name, _DRAWN) if is_drawn else _PHOTOGRAPH


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

    def list_captioned(self) -> Sequence[Captioned]:
        """Returns the pictures that have a caption in words. Raises ConfigError for none or too many pictures."""
        said = {path: _read_caption(path) for path in self._files()}
        found = [Captioned(str(path), (words,), 1.0) for path, words in said.items() if words]
        self.unnamed = len(said) - len(found)
        if not found:
            raise ConfigError(
                f"--pictures {self._folder} holds no picture with a name; name PNG, JPEG or SVG files by what they "
                "show, like red-fox.png, or put a text beside them, like IMG_1.txt."
            )
        return found

    def pictures(self, file: str) -> list[Tensor]:
        """Returns the picture. Raises ImageError."""
        return [read_picture(storage.read_bytes(Path(file), "a picture", MAX_BYTES, ImageError), Path(file).name)]

    def _files(self) -> list[Path]:
        """Returns the picture files below the folder, sorted."""
        inside = (
            path for path in self._folder.rglob("[!.]*") if path.suffix.lower() in _SUFFIXES and not path.is_dir()
        )
        found = sorted(islice(inside, _MAX_FILES + 1))
        if len(found) > _MAX_FILES:
            raise ConfigError(
                f"--pictures {self._folder} holds more than {_MAX_FILES} pictures, which would take long to read; "
                "give a folder with those of the things that you want to paint."
            )
        return found


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
    """Returns the user's own folder, the libraries of installed packages, and the fetched ones.

    A package adds a library by an entry point of the group `frida_painter.picture_libraries`: a callable without
    arguments that returns the library.
    Raises WeightsError if a fetched library was altered, or a package's library cannot be used.
    Raises ConfigError if the user's folder does not exist.
    """
    found: list[PictureLibrary] = [] if own is None else [PictureFolder(own)]
    for point in entry_points(group=GROUP):
        try:
            found.append(point.load()())
        except Exception as error:  # code of others may raise any exception
            raise WeightsError(
                f"The picture library {point.name!r} cannot be used ({type(error).__name__}: {error}); mend or remove "
                "the package that brings it."
            ) from error
    for name in _ARCHIVES:
        if (folder := weights.find(name, cache)) is not None:
            known = weights.find_weights(name)
            found.append(PictureArchive(name, f"{known.credit}, {known.licence}", folder / FILE))
    return found
