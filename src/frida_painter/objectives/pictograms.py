"""A picture dictionary: the pictogram that fits words best, to begin a painting from.

The pictograms are OpenMoji's (HfG Schwäbisch Gmünd, CC BY-SA 4.0), each named by the Unicode name of its character.
"""

import io
import re
import unicodedata
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from frida_painter import extras
from frida_painter.errors import WeightsError
from frida_painter.objectives.encoders.sentence import SentenceEncoder

CREDIT = "OpenMoji (openmoji.org), CC BY-SA 4.0"
LEAST_SIMILARITY = 0.55  # of a prompt and a name, below which a pictogram would be of something else
_OUTLINES = "line"  # id of the layer that holds them
_FLAT_ENOUGH = 0.25  # of what is drawn, that must be left without outlines
_SIDE = 512  # pixels at which a pictogram is drawn
_MOST_BYTES = 2**20  # of one drawing


@dataclass(frozen=True)
class Pictogram:
    """A drawing: its name, how like the prompt that is (a cosine), and its file."""

    name: str
    similarity: float
    file: str


class Pictograms:
    """The drawings of an archive, found by what they are called.

    keep: a folder in which the names' meanings are kept. Raises WeightsError where the archive cannot be read,
    ConfigError where the package that draws them is not installed.
    """

    def __init__(self, archive: Path, sentences: SentenceEncoder, keep: Path) -> None:
        extras.require("words", "resvg_py", "Beginning a painting from a pictogram")
        self._archive = archive
        self._sentences = sentences
        try:
            with zipfile.ZipFile(archive) as opened:
                self._files = {name: file for file in sorted(opened.namelist()) if (name := _name(file))}
        except (OSError, zipfile.BadZipFile) as cause:
            raise WeightsError(f"{archive} cannot be read ({cause}); fetch openmoji again.") from cause
        self._names = list(self._files)
        self._meanings = sentences.embed_once(self._names, keep)

    def nearest(self, called: Sequence[str]) -> Pictogram | None:
        """The one whose name is most like one of the things that it may be called; None where none is like enough."""
        similarity = (self._sentences.embed(called) @ self._meanings.T).amax(0)
        found = self._pictogram(int(similarity.argmax()), similarity)
        return found if found.similarity >= LEAST_SIMILARITY else None

    def kindred(self, prompt: str, count: int) -> list[Pictogram]:
        """Those `count` whose names are most like the prompt, however little that is, the likest first."""
        similarity = self._meanings @ self._sentences.embed([prompt])[0]
        return [self._pictogram(at, similarity) for at in similarity.argsort(descending=True)[:count].tolist()]

    def singular(self, called: str) -> str:
        """What one of them is called, where a pictogram has that name and none has the plural's; else nothing."""
        return called[:-1] if called.endswith("s") and called not in self._files and called[:-1] in self._files else ""

    def _pictogram(self, at: int, similarity: Tensor) -> Pictogram:
        return Pictogram(self._names[at], float(similarity[at]), self._files[self._names[at]])

    def drawings(self, pictogram: Pictogram) -> list[Tensor]:
        """The drawing without its outlines, where enough of it is left, and with them.

        Each is cut to what is drawn: sRGB and opacity [4, h, w] in [0, 1]. Outlines are for small signs, and a brush
        gives its own edges; but some hold what makes a thing that thing.
        """
        with zipfile.ZipFile(self._archive) as opened:
            if opened.getinfo(pictogram.file).file_size > _MOST_BYTES:
                raise WeightsError(f"{pictogram.file} in {self._archive} is no pictogram; fetch openmoji again.")
            svg = opened.read(pictogram.file).decode("utf-8")
        outlined, plain = _rasterized(svg), _rasterized(_without_outlines(svg))
        enough = float(plain[3].sum()) >= _FLAT_ENOUGH * float(outlined[3].sum())
        return [_cut(plain), _cut(outlined)] if enough else [_cut(outlined)]


def _name(file: str) -> str:
    """What a file such as 1F353.svg shows; empty where it is named by more than one character, or by none."""
    marks = [mark for mark in file.removesuffix(".svg").split("-") if mark != "FE0F"]
    if len(marks) != 1 or not re.fullmatch("[0-9A-F]{4,6}", marks[0]) or int(marks[0], 16) > 0x10FFFF:
        return ""
    return unicodedata.name(chr(int(marks[0], 16)), "").lower()


def _without_outlines(svg: str) -> str:
    drawing = ElementTree.fromstring(svg)
    for layer in [part for part in drawing if part.get("id") == _OUTLINES]:
        drawing.remove(layer)
    return ElementTree.tostring(drawing, encoding="unicode")


def _rasterized(svg: str) -> Tensor:
    import resvg_py

    content = resvg_py.svg_to_bytes(svg_string=svg, width=_SIDE, height=_SIDE, skip_system_fonts=True)
    pixels = np.asarray(Image.open(io.BytesIO(bytes(content))).convert("RGBA"))
    return torch.from_numpy(pixels.copy()).permute(2, 0, 1).float() / 255


def _cut(drawing: Tensor) -> Tensor:
    """Without the empty margin."""
    drawn = drawing[3] > 0.05
    rows, columns = drawn.any(1).nonzero().flatten(), drawn.any(0).nonzero().flatten()
    if len(rows) == 0:
        return drawing
    return drawing[:, int(rows[0]) : int(rows[-1]) + 1, int(columns[0]) : int(columns[-1]) + 1].contiguous()
