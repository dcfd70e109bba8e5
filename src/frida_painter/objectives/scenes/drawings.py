"""Pictures with their opacity from files that anybody may have made: SVG drawings and pixels."""

import io
import re
import subprocess
import sys
import warnings
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import torch
from PIL import Image, ImageOps
from torch import Tensor

from frida_painter import extras
from frida_painter.errors import ImageError
from frida_painter.objectives.scenes import svg_process
from frida_painter.picture_file import FORMATS, one_line, require_size

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
    extras.require("words", "resvg_py", "Drawing an SVG")
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
