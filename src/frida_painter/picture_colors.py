"""Colours of a picture file, converted to sRGB on white paper by libvips.

Sources: ITU-T H.273 for code points of primaries and curves; Lindbloom for the matrices of primaries.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ImageError

if TYPE_CHECKING:
    import pyvips


Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]

_D65 = (0.3127, 0.3290)
_SRGB = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *_D65)
ADOBE = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *_D65)
_SMPTE = (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *_D65)
_PRIMARIES = {  # H.273, table 2
    0: _SRGB, 1: _SRGB, 2: _SRGB, 5: (0.64, 0.33, 0.29, 0.60, 0.15, 0.06, *_D65), 6: _SMPTE, 7: _SMPTE,
    9: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_D65), 12: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_D65),
}  # fmt: skip
_EXPONENTS = {0: None, 1: None, 2: None, 4: 2.2, 5: 2.8, 6: None, 8: 1.0, 13: None, 14: None, 15: None}  # table 3
_FROM_XYZ = np.array(  # to linear sRGB (Lindbloom)
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
_SAME = 2 / 255  # a profile that moves no pixel further counts as sRGB


@dataclass(frozen=True)
class Light:
    """Conversion of numbers in [0, 1] to light.

    exponent: exponent of the power law; None for the curve of sRGB, as which one near 2.2 counts
    matrix: from light of the file's primaries to that of sRGB; None if they are the same
    """

    exponent: float | None = None
    matrix: NDArray[np.float64] | None = None


def light_of(exponent: float | None, primaries: Sequence[float]) -> Light:
    """Returns the light that a file states.

    primaries: x, y of red, green, blue and white; if they are not such that span colours, those of sRGB count
    """
    exponent = None if exponent is None or 2.1 <= exponent <= 2.3 else exponent
    own = _to_xyz(primaries)
    if own is None or np.allclose(primaries, _SRGB, atol=0.002):
        return Light(exponent)
    matrix = _FROM_XYZ @ own
    return Light(exponent, matrix / matrix.sum(1, keepdims=True))  # white becomes white


def _to_xyz(primaries: Sequence[float]) -> NDArray[np.float64] | None:
    """Returns the matrix from light of the primaries to X, Y, Z; None if they span no colours with a white."""
    if len(primaries) != 8 or not min(primaries[1::2]) > 0.01 or not max(primaries) <= 1:
        return None
    x, y = np.reshape(primaries, (4, 2)).T
    xyz = np.stack((x / y, np.ones(4), (1 - x - y) / y))
    if abs(np.linalg.det(xyz[:, :3])) < 1e-3:
        return None
    shares = np.linalg.solve(xyz[:, :3], xyz[:, 3])
    return xyz[:, :3] * shares if (shares > 0).all() else None


def light_of_code_points(path: Path, primaries: int, transfer: int) -> Light:
    """Returns the light for H.273 code points of a picture file.

    The curves of television count as that of sRGB, as in viewers of still pictures. Raises ImageError for high
    dynamic range, which has no white, and for unknown code points.
    """
    if transfer not in _EXPONENTS or primaries not in _PRIMARIES:
        kind = {16: "high dynamic range (PQ)", 18: "high dynamic range (HLG)"}.get(transfer, "a kind not known here")
        raise ImageError(
            f"{path} has colours of {kind} (H.273: primaries {primaries}, transfer {transfer}); save it as sRGB."
        )
    return light_of(_EXPONENTS[transfer], _PRIMARIES[primaries])


def to_srgb(image: "pyvips.Image", light: Light, longest: int, *, layered: bool) -> Bytes | Floats:
    """Converts a picture to upright sRGB on white, [H, W, 3]: bytes, or float32 in [0, 1] if it has 16 bits.

    image: grey, RGB or CMYK by its interpretation; one channel more is its opacity
    light: what the numbers mean if the picture has no profile that fits
    longest: a picture with a longer side is shrunk to it, by areas
    layered: True for colour and opacity instead, [H, W, 4]
    """
    most = 65535.0 if image.format == "ushort" else 255.0
    # Into memory: the large picture is released, and a turned one is not read from top to bottom.
    image = _shrink(image, longest, most).copy_memory().autorot()
    colors, opacity = (image[:-1], image[-1]) if image.hasalpha() else (image, None)
    seen = _by_profile(colors, most)
    colors = _by_light(colors, light, most) if seen is None else seen
    if layered:
        colors = colors.bandjoin(most if opacity is None else opacity)
    elif opacity is not None:
        share = opacity / most
        colors = _whole(colors * share + share.linear(-most, most), most)
    pixels: Bytes = colors.numpy()
    return pixels if most == 255 else (pixels / np.float32(most)).astype(np.float32, copy=False)


def _whole(image: "pyvips.Image", most: float) -> "pyvips.Image":
    """Rounds to whole numbers from 0 to `most`."""
    return image.rint().cast("uchar" if most == 255 else "ushort")


def _shrink(image: "pyvips.Image", longest: int, most: float) -> "pyvips.Image":
    """Shrinks to at most `longest` pixels on the longer side; transparent pixels do not affect their neighbours."""
    share = longest / max(image.width, image.height)
    if share >= 1:
        return image
    across, down = (max(1, round(side * share)) / side for side in (image.width, image.height))
    if not image.hasalpha():
        return image.resize(across, vscale=down, kernel="linear")
    smaller = image.premultiply(max_alpha=most).resize(across, vscale=down, kernel="linear")
    return _whole(smaller.unpremultiply(max_alpha=most), most)


def _by_profile(colors: "pyvips.Image", most: float) -> "pyvips.Image | None":
    """Converts by the ICC profile; None if there is none, or one that is damaged, does not fit or is that of sRGB."""
    import pyvips

    if not colors.get_typeof("icc-profile-data"):
        return None
    with contextlib.suppress(pyvips.Error):
        seen = colors.icc_transform("srgb", embedded=True, intent="perceptual", depth=16 if most == 65535 else 8)
        if colors.interpretation == "cmyk" or (seen - colors).abs().max() > _SAME * most:
            return seen
    return None


def _by_light(colors: "pyvips.Image", light: Light, most: float) -> "pyvips.Image":
    """Converts by curve and primaries; CMYK as light that ideal inks leave."""
    if colors.interpretation == "cmyk":
        return _whole(colors[:3].linear(-1, most) * colors[3].linear(-1, most) / most, most)
    kind = "srgb" if most == 255 else "rgb16"
    colors = (colors.bandjoin([colors, colors]) if colors.bands == 1 else colors).copy(interpretation=kind)
    if light.exponent is None and light.matrix is None:
        return colors
    linear = colors.colourspace("scrgb") if light.exponent is None else (colors / most) ** light.exponent
    linear = linear if light.matrix is None else linear.recomb(light.matrix.tolist())
    return linear.copy(interpretation="scrgb").colourspace(kind)
