"""The picture of a colour calibration: where the checker was found, and each patch as seen, mapped and true."""

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from frida_painter.perception.checker import ACROSS, PatchReadings
from frida_painter.perception.light import to_srgb
from frida_painter.sheet import CREAM, INK, SOFT, Sheet, to_bytes

_ROWS, _COLUMNS = 650, 1500
_LEFT, _TOP, _PITCH, _SIDE, _DISC = 612, 56, 144, 110, 29
_PHOTOGRAPH = (40, 56, 532, 508)  # left, top, width, height
_FINER = 3


def checker_sheet(
    photograph: NDArray[np.uint8], readings: PatchReadings, affine: Tensor, even: Tensor, true: Tensor, off: Tensor
) -> Tensor:
    """The picture, sRGB [3, 650, 1500] in [0, 1].

    affine [3, 4]: the map; even, true [24, 3]: perceived in even light, and true, linear light; off
    [24]: CIEDE2000, written below each patch.
    """
    sheet = Sheet(_COLUMNS, _ROWS, CREAM)
    sheet.paste(_excerpt(photograph, readings), _PHOTOGRAPH[:2])
    seen, known = to_srgb(readings.light), to_srgb(true)
    mapped = to_srgb(even @ affine[:, :3].T + affine[:, 3])
    for number in range(len(seen)):
        row, column = divmod(number, ACROSS)
        left, top = _LEFT + _PITCH * column, _TOP + (_PITCH - 10) * row
        sheet.paste(_patch(*(to_bytes(colors[number]) for colors in (seen, mapped, known))), (left, top))
        text = f"{float(off[number]):.1f}"
        sheet.text((left + _SIDE / 2, top + _SIDE + 3), text, 16, SOFT, "ma")
    sheet.text((_PHOTOGRAPH[0], 20), "The checker as it was found", 20, INK)
    sheet.text((_LEFT, 20), "Left half: as photographed. Right half: corrected. Disc: true.", 20, INK)
    foot = f"Below: CIEDE2000 of patches that the fit did not see, {float(off.mean()):.2f} on average"
    sheet.text((_LEFT, _ROWS - 46), foot, 18, SOFT)
    return sheet.tensor()


def _excerpt(photograph: NDArray[np.uint8], readings: PatchReadings) -> NDArray[np.uint8]:
    """The photograph around the checker, and frames around what was looked at."""
    _, _, width, height = _PHOTOGRAPH
    places = readings.place.numpy()
    low, high = places.min(0), places.max(0)
    scale = float(min(np.array([width, height]) / (1.45 * (high - low))))
    middle = (low + high) / 2
    shift = np.array([width, height]) / 2 - scale * middle
    view = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    excerpt = cv2.warpAffine(photograph, view, (width, height), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
    frames = (16 * (readings.outline.numpy() * scale + shift)).round().astype(np.int32)
    for color, width in ((60, 60, 60), 3), ((255, 255, 255), 1):
        cv2.polylines(excerpt, list(frames), True, color, width, cv2.LINE_AA, shift=4)
    return np.asarray(excerpt, np.uint8)


def _patch(seen: tuple[int, ...], mapped: tuple[int, ...], true: tuple[int, ...]) -> Image.Image:
    """One patch: two halves, and a disc over both."""
    side, middle, disc = _FINER * _SIDE, _FINER * _SIDE // 2, _FINER * _DISC
    patch = Sheet(side, side, mapped)
    patch.draw.rectangle((0, 0, middle - 1, side), fill=seen)
    patch.draw.ellipse((middle - disc, middle - disc, middle + disc, middle + disc), fill=true)
    return patch.image.resize((_SIDE, _SIDE), Image.Resampling.LANCZOS)
