"""Meaning of the numbers in a picture file, and their conversion to sRGB on white paper.

Sources: ICC.1:2022 for profiles (by LittleCMS); ITU-T H.273 for code points of primaries and curves; the PNG
specification, third edition, 13.12 for gamma; IEC 61966-2-1 for sRGB; Lindbloom for the matrices of primaries.
"""

import io
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms

from frida_painter.errors import ImageError

if TYPE_CHECKING:
    import pyvips


Space = Literal["grey", "rgb", "cmyk", "lab"]
Alpha = Literal["none", "straight", "premultiplied"]
Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]

COLOR_BANDS: dict[Space, int] = {"grey": 1, "rgb": 3, "cmyk": 4, "lab": 3}
_PROFILE_SPACES: dict[Space, str] = {"grey": "GRAY", "rgb": "RGB", "cmyk": "CMYK", "lab": "Lab"}
_PILLOW_MODES: dict[Space, str] = {"grey": "L", "rgb": "RGB", "cmyk": "CMYK", "lab": "LAB"}

_D65 = (0.3127, 0.3290)
_SRGB = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), _D65)
_ADOBE = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), _D65)
_PRIMARIES = {  # H.273, table 2: red, green, blue, white
    1: _SRGB,
    5: ((0.64, 0.33), (0.29, 0.60), (0.15, 0.06), _D65),
    6: ((0.630, 0.340), (0.310, 0.595), (0.155, 0.070), _D65),
    7: ((0.630, 0.340), (0.310, 0.595), (0.155, 0.070), _D65),
    9: ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), _D65),
    11: ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), (0.314, 0.351)),
    12: ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), _D65),
}
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
_ROWS = 256  # converted at a time
_SAME = 2  # of 255: a profile with a smaller difference from sRGB counts as sRGB


@dataclass(frozen=True)
class LightSource:
    """Conversion of numbers in [0, 1] to light: the transfer curve and the primaries.

    exponent: exponent of the power law; None for the curve of sRGB
    primaries: chromaticities x, y of red, green, blue and white
    """

    exponent: float | None = None
    primaries: tuple[tuple[float, float], ...] = _SRGB

    @property
    def is_srgb(self) -> bool:
        """True if the light equals sRGB within the precision of eight bits. An exponent near 2.2 counts as sRGB."""
        same = bool(np.allclose(self.primaries, _SRGB, atol=0.002))
        return same and (self.exponent is None or 2.1 <= self.exponent <= 2.3)


SRGB_LIGHT = LightSource()
ADOBE_LIGHT = LightSource(563 / 256, _ADOBE)


def light_of_code_points(name: str, primaries: int, transfer: int) -> LightSource:
    """Returns the light for H.273 code points of a picture.

    name: start of messages ("photo.png")
    The curves of television count as that of sRGB, as in viewers of still pictures. Raises ImageError for high
    dynamic range (PQ, HLG), which has no white, and for unknown code points.
    """
    if transfer in (16, 18):
        kind = "PQ" if transfer == 16 else "HLG"
        raise ImageError(f"{name} is a picture of high dynamic range ({kind}); save it as SDR, or as sRGB.")
    exponents = {0: None, 1: None, 2: None, 4: 2.2, 5: 2.8, 6: None, 8: 1.0, 13: None, 14: None, 15: None}
    if transfer not in exponents or (primaries not in _PRIMARIES and primaries not in (0, 2)):
        raise ImageError(
            f"{name} states colours of code points that are not known here (primaries {primaries}, transfer "
            f"{transfer}); save it as sRGB."
        )
    return LightSource(exponents[transfer], _PRIMARIES.get(primaries, _SRGB))


@dataclass(frozen=True)
class Meaning:
    """Meaning of the channels of a picture; further channels are ignored.

    most: number for full light or full ink
    alpha: kind of the opacity channel after the colours
    profile: ICC profile of the file; used if it fits
    """

    space: Space
    most: float
    alpha: Alpha = "none"
    light: LightSource = SRGB_LIGHT
    profile: bytes = b""

    @property
    def bands(self) -> int:
        """Number of channels that are used."""
        return COLOR_BANDS[self.space] + (self.alpha != "none")


def shrink(image: "pyvips.Image", meaning: Meaning, longest: int) -> tuple["pyvips.Image", Meaning]:
    """Shrinks the picture to at most `longest` pixels on its longer side, by areas.

    Colours are weighted by opacity, so transparent pixels do not affect their neighbours.
    """
    share = longest / max(image.width, image.height)
    if share >= 1:
        return image, meaning
    if meaning.alpha == "straight":
        image, meaning = image.premultiply(max_alpha=meaning.most), replace(meaning, alpha="premultiplied")
    width, height = (max(1, round(side * share)) for side in (image.width, image.height))
    smaller = image.resize(width / image.width, vscale=height / image.height, kernel="linear")
    if meaning.most == 65535 and meaning.alpha == "premultiplied" and smaller.format == "float":
        smaller = smaller.rint().cast("ushort")  # half the memory, same precision
    return smaller, meaning


def to_srgb(image: "pyvips.Image", meaning: Meaning, *, layered: bool = False) -> Bytes | Floats:
    """Converts the picture to sRGB on white, [H, W, 3]: bytes if the picture has bytes, else float32 in [0, 1].

    layered: True for colour and opacity instead, [H, W, 4]
    """
    count = COLOR_BANDS[meaning.space]
    if meaning.alpha == "premultiplied":
        image = image[: count + 1].unpremultiply(max_alpha=meaning.most, alpha_band=count)
    most = 255.0 if meaning.most == 255 else 65535.0
    whole = "uchar" if most == 255 else "ushort"
    is_float = meaning.most == 1.0 and not meaning.profile
    colors = image[:count]
    if meaning.space == "lab":
        colors, most = _of_lab(colors), 65535.0
    elif is_float:
        most = 1.0
    else:
        scaled = colors if meaning.most == most else colors * (most / meaning.most)
        colors = scaled if scaled.format == whole else scaled.rint().cast(whole)
    profile = None if meaning.space == "lab" else usable_profile(meaning.profile, meaning.space)
    if profile is not None:
        colors = _by_profile(colors, profile, 8 if most == 255 else 16)
    elif meaning.space == "cmyk":
        light = colors[:3].linear(-1, most) * colors[3].linear(-1, most) / most
        colors = light if most == 1 else light.rint()
    elif not meaning.light.is_srgb and meaning.space in ("grey", "rgb"):
        colors, most = _by_light(colors, most, meaning.light)
    share = image[count] / meaning.most if meaning.alpha != "none" else None
    if share is not None and not layered:
        colors = colors * share + share.linear(-most, most)
        colors = colors if most == 1 else colors.rint()
    deep = meaning.most != 255
    pixels = _pixels(colors, most, 3, deep=deep)
    if not layered:
        return pixels
    full = np.full_like(pixels[..., :1], 1 if deep else 255)
    opacity = full if share is None else _pixels(share, 1.0, 1, deep=deep)
    return cast("Bytes | Floats", np.concatenate((pixels, opacity), 2))


def _pixels(values: "pyvips.Image", most: float, bands: int, *, deep: bool) -> Bytes | Floats:
    """Returns values from 0 to `most` as an array of `bands` channels."""
    whole = 1.0 if deep else 255.0
    scaled = values if most == whole else values * (whole / most)
    if not deep and scaled.format != "uchar":
        scaled = scaled.rint()
    pixels = scaled.cast("float" if deep else "uchar").numpy().reshape(values.height, values.width, -1)
    return np.broadcast_to(pixels, (values.height, values.width, bands))


def usable_profile(content: bytes, space: Space) -> bytes | None:
    """Returns the profile if it is readable, fits the colour space and differs from sRGB; else None."""
    if not content:
        return None
    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(content))
        if profile.profile.xcolor_space.strip() != _PROFILE_SPACES[space]:
            return None
        mode = _PILLOW_MODES[space]
        probe = _probe(space)
        seen = ImageCms.profileToProfile(probe, profile, ImageCms.createProfile("sRGB"), outputMode="RGB")
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError):
        return None  # a damaged or unfit profile is ignored
    if seen is None or mode == "CMYK":
        return content
    difference = np.asarray(seen).astype(int) - np.asarray(probe.convert("RGB"))
    return content if np.abs(difference).max() > _SAME else None


def _probe(space: Space) -> Image.Image:
    """Returns a test picture with colours from the whole space."""
    if space == "grey":
        return Image.fromarray(np.arange(256, dtype=np.uint8)[None])
    steps = np.stack(np.meshgrid(*[np.linspace(0, 255, 9).astype(np.uint8)] * 3), -1).reshape(1, -1, 3)
    if space == "rgb":
        return Image.fromarray(steps)
    return Image.new("CMYK", (1, 1))


def _by_profile(colors: "pyvips.Image", profile: bytes, depth: int) -> "pyvips.Image":
    """Converts integers of `depth` bits to sRGB by their profile."""
    import pyvips

    count = colors.bands
    kinds = {1: ("b-w", "grey16"), 3: ("srgb", "rgb16"), 4: ("cmyk", "cmyk")}[count]
    with_profile = colors.copy(interpretation=kinds[depth == 16])
    with_profile.set_type(pyvips.GValue.blob_type, "icc-profile-data", profile)
    return with_profile.icc_transform("srgb", embedded=True, intent="perceptual", depth=depth)


def _of_lab(colors: "pyvips.Image") -> "pyvips.Image":
    """Converts CIE L*a*b* (2 degrees, D50) in its own units to sRGB from 0 to 65535."""
    return colors.cast("float").copy(interpretation="lab").icc_export(output_profile="srgb", pcs="lab", depth=16)


def lab_of_8_bits(image: "pyvips.Image") -> "pyvips.Image":
    """Converts bytes to L*a*b* in its own units: byte 255 is L = 100, byte 128 is a or b = 0."""
    return image.linear([100 / 255, 1, 1], [0, -128, -128])


def lab_of_16_bits(image: "pyvips.Image", *, icc: bool) -> "pyvips.Image":
    """Converts 16-bit values to L*a*b* in its own units.

    icc: True for the encoding of the ICC (version 2), False for that of TIFF. libvips halves the L of TIFF's
    encoding; its a and b are signed.
    """
    if icc:
        return image.linear([100 / 65280, 1 / 256, 1 / 256], [0, -128, -128])
    return image.linear([100 / 32767.5, 1 / 256, 1 / 256], [0, 0, 0])


def are_primaries(primaries: tuple[tuple[float, float], ...]) -> bool:
    """Returns True if the chromaticities are three primaries that span colours, with a white among them."""
    points = np.array(primaries)
    if not (np.isfinite(points).all() and (points[:, 1] > 0.01).all() and (np.abs(points) <= 1).all()):
        return False
    columns = np.array([_xyz(point) for point in primaries[:3]]).T
    return abs(np.linalg.det(columns)) > 1e-3 and bool((np.linalg.solve(columns, _xyz(primaries[3])) > 0).all())


def _by_light(colors: "pyvips.Image", most: float, light: LightSource) -> tuple["pyvips.Image", float]:
    """Converts colours of that light to sRGB in the same range of numbers."""
    import pyvips

    numbers = colors.numpy().reshape(colors.height, colors.width, -1)
    matrix = _rgb_to_xyz(_SRGB)
    matrix = np.linalg.inv(matrix) @ _adapt_white(light.primaries[3], _D65) @ _rgb_to_xyz(light.primaries)
    seen = np.empty(numbers.shape, np.float32)
    for top in range(0, len(numbers), _ROWS):
        part = numbers[top : top + _ROWS] / np.float32(most)
        linear = _linear(part) if light.exponent is None else part**light.exponent
        if linear.shape[2] == 3:
            linear = linear @ matrix.T.astype(np.float32)
        seen[top : top + _ROWS] = _encode(linear.clip(0, 1))
    image = cast("pyvips.Image", pyvips.Image.new_from_array(seen)) * most
    return (image if most == 1 else image.rint()), most


def _linear(values: Floats) -> Floats:
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4).astype(np.float32)


def _encode(light: Floats) -> Floats:
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055).astype(np.float32)


def _rgb_to_xyz(primaries: tuple[tuple[float, float], ...]) -> NDArray[np.float64]:
    """Returns the matrix from light of the primaries to X, Y, Z; full light gives the white with Y = 1."""
    columns = np.array([_xyz(point) for point in primaries[:3]]).T
    return columns * np.linalg.solve(columns, _xyz(primaries[3]))


def _xyz(point: tuple[float, float]) -> NDArray[np.float64]:
    x, y = point
    return np.array([x / y, 1.0, (1 - x - y) / y])


def _adapt_white(source: tuple[float, float], target: tuple[float, float]) -> NDArray[np.float64]:
    """Returns the matrix that adapts the source white to the target white (Bradford)."""
    gains = (_BRADFORD @ _xyz(target)) / (_BRADFORD @ _xyz(source))
    return np.linalg.inv(_BRADFORD) @ np.diag(gains) @ _BRADFORD
