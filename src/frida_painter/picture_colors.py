"""The meaning of a picture's numbers: what its file says about them, and how they become sRGB on white paper.

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
_ROWS = 256  # are converted at a time
_SAME = 2  # of 255: a profile that differs less from sRGB is sRGB


@dataclass(frozen=True)
class Light:
    """How numbers from 0 to 1 become light: their curve, and the light of the three primaries.

    exponent: of the power law; None: the curve of sRGB. primaries: chromaticities x, y of red, green, blue and white.
    """

    exponent: float | None = None
    primaries: tuple[tuple[float, float], ...] = _SRGB

    @property
    def is_srgb(self) -> bool:
        """Whether nothing changes, as far as eight bits can tell: a power of 2.2 alone stands for sRGB, too."""
        same = bool(np.allclose(self.primaries, _SRGB, atol=0.002))
        return same and (self.exponent is None or 2.1 <= self.exponent <= 2.3)


SRGB_LIGHT = Light()
ADOBE_LIGHT = Light(563 / 256, _ADOBE)


def light_of_code_points(name: str, primaries: int, transfer: int) -> Light:
    """The light of a picture that states H.273's code points; `name` begins messages ("photo.png").

    Curves of television are taken for that of sRGB, as viewers of still pictures do. Raises ImageError for high
    dynamic range (PQ, HLG), which has no white, and for code points of no meaning here.
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
    return Light(exponents[transfer], _PRIMARIES.get(primaries, _SRGB))


@dataclass(frozen=True)
class Meaning:
    """What the numbers of a picture mean, channel by channel; more channels than these mean nothing.

    most: the number that stands for all the light, or all the ink; alpha: how the channel after the colours weighs
    them, if there is one; profile: the ICC profile that the file holds, obeyed if it fits.
    """

    space: Space
    most: float
    alpha: Alpha = "none"
    light: Light = SRGB_LIGHT
    profile: bytes = b""

    @property
    def bands(self) -> int:
        """How many channels count."""
        return COLOR_BANDS[self.space] + (self.alpha != "none")


def shrink(image: "pyvips.Image", meaning: Meaning, longest: int) -> tuple["pyvips.Image", Meaning]:
    """The picture with at most `longest` pixels on its longer side, by areas; hidden colours do not shine through."""
    share = longest / max(image.width, image.height)
    if share >= 1:
        return image, meaning
    if meaning.alpha == "straight":
        image, meaning = image.premultiply(max_alpha=meaning.most), replace(meaning, alpha="premultiplied")
    width, height = (max(1, round(side * share)) for side in (image.width, image.height))
    smaller = image.resize(width / image.width, vscale=height / image.height, kernel="linear")
    if meaning.most == 65535 and meaning.alpha == "premultiplied" and smaller.format == "float":
        smaller = smaller.rint().cast("ushort")  # half the memory, and as fine
    return smaller, meaning


def to_srgb(image: "pyvips.Image", meaning: Meaning) -> Bytes | Floats:
    """The picture in sRGB on white, [H, W, 3]: bytes for a picture of bytes, else float32 in [0, 1]."""
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
    if meaning.alpha != "none":
        share = image[count] / meaning.most
        colors = colors * share + share.linear(-most, most)
        colors = colors if most == 1 else colors.rint()
    return _pixels(colors, most, deep=meaning.most != 255)


def _pixels(colors: "pyvips.Image", most: float, *, deep: bool) -> Bytes | Floats:
    """Numbers from 0 to `most`, grey or red, green and blue, as an array."""
    whole = 1.0 if deep else 255.0
    scaled = colors if most == whole else colors * (whole / most)
    if not deep and scaled.format != "uchar":
        scaled = scaled.rint()
    pixels = scaled.cast("float" if deep else "uchar").numpy().reshape(colors.height, colors.width, -1)
    return np.broadcast_to(pixels, (colors.height, colors.width, 3))


def usable_profile(content: bytes, space: Space) -> bytes | None:
    """The profile, if it can be read, is of that colour space, and says other than sRGB; whatever it is called."""
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
        return None  # a foreign or damaged profile says nothing about the colours
    if seen is None or mode == "CMYK":
        return content
    difference = np.asarray(seen).astype(int) - np.asarray(probe.convert("RGB"))
    return content if np.abs(difference).max() > _SAME else None


def _probe(space: Space) -> Image.Image:
    """Colours all over the space, as Pillow's picture."""
    if space == "grey":
        return Image.fromarray(np.arange(256, dtype=np.uint8)[None])
    steps = np.stack(np.meshgrid(*[np.linspace(0, 255, 9).astype(np.uint8)] * 3), -1).reshape(1, -1, 3)
    if space == "rgb":
        return Image.fromarray(steps)
    return Image.new("CMYK", (1, 1))


def _by_profile(colors: "pyvips.Image", profile: bytes, depth: int) -> "pyvips.Image":
    """Whole numbers, of `depth` bits, as their profile says, in sRGB."""
    import pyvips

    count = colors.bands
    kinds = {1: ("b-w", "grey16"), 3: ("srgb", "rgb16"), 4: ("cmyk", "cmyk")}[count]
    with_profile = colors.copy(interpretation=kinds[depth == 16])
    with_profile.set_type(pyvips.GValue.blob_type, "icc-profile-data", profile)
    return with_profile.icc_transform("srgb", embedded=True, intent="perceptual", depth=depth)


def _of_lab(colors: "pyvips.Image") -> "pyvips.Image":
    """CIE L*a*b* of 2 degrees and D50 in its own units, as sRGB from 0 to 65535."""
    return colors.cast("float").copy(interpretation="lab").icc_export(output_profile="srgb", pcs="lab", depth=16)


def lab_of_8_bits(image: "pyvips.Image") -> "pyvips.Image":
    """L*a*b* in its own units, of bytes: L of 255 is 100, a and b of 128 are 0."""
    return image.linear([100 / 255, 1, 1], [0, -128, -128])


def lab_of_16_bits(image: "pyvips.Image", *, icc: bool) -> "pyvips.Image":
    """L*a*b* in its own units, of 16 bits, as the ICC encodes it (version 2), or as TIFF does.

    libvips halves the L of TIFF's own, whose a and b have a sign.
    """
    if icc:
        return image.linear([100 / 65280, 1 / 256, 1 / 256], [0, -128, -128])
    return image.linear([100 / 32767.5, 1 / 256, 1 / 256], [0, 0, 0])


def are_primaries(primaries: tuple[tuple[float, float], ...]) -> bool:
    """Whether these are chromaticities of three lights that span colours, and of a white among them."""
    points = np.array(primaries)
    if not (np.isfinite(points).all() and (points[:, 1] > 0.01).all() and (np.abs(points) <= 1).all()):
        return False
    columns = np.array([_xyz(point) for point in primaries[:3]]).T
    return abs(np.linalg.det(columns)) > 1e-3 and bool((np.linalg.solve(columns, _xyz(primaries[3])) > 0).all())


def _by_light(colors: "pyvips.Image", most: float, light: Light) -> tuple["pyvips.Image", float]:
    """The colours, whose numbers are that light, as sRGB in the same numbers."""
    import pyvips

    numbers = colors.numpy().reshape(colors.height, colors.width, -1)
    matrix = _rgb_to_xyz(_SRGB)
    matrix = np.linalg.inv(matrix) @ _adapted(light.primaries[3], _D65) @ _rgb_to_xyz(light.primaries)
    seen = np.empty(numbers.shape, np.float32)
    for top in range(0, len(numbers), _ROWS):
        part = numbers[top : top + _ROWS] / np.float32(most)
        linear = _linear(part) if light.exponent is None else part**light.exponent
        if linear.shape[2] == 3:
            linear = linear @ matrix.T.astype(np.float32)
        seen[top : top + _ROWS] = _encoded(linear.clip(0, 1))
    image = cast("pyvips.Image", pyvips.Image.new_from_array(seen)) * most
    return (image if most == 1 else image.rint()), most


def _linear(values: Floats) -> Floats:
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4).astype(np.float32)


def _encoded(light: Floats) -> Floats:
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055).astype(np.float32)


def _rgb_to_xyz(primaries: tuple[tuple[float, float], ...]) -> NDArray[np.float64]:
    """From light of the primaries to X, Y, Z, so that all of it is the white, with Y = 1."""
    columns = np.array([_xyz(point) for point in primaries[:3]]).T
    return columns * np.linalg.solve(columns, _xyz(primaries[3]))


def _xyz(point: tuple[float, float]) -> NDArray[np.float64]:
    x, y = point
    return np.array([x / y, 1.0, (1 - x - y) / y])


def _adapted(source: tuple[float, float], target: tuple[float, float]) -> NDArray[np.float64]:
    """What turns the source's white into the target's, by Bradford's cones."""
    gains = (_BRADFORD @ _xyz(target)) / (_BRADFORD @ _xyz(source))
    return np.linalg.inv(_BRADFORD) @ np.diag(gains) @ _BRADFORD
