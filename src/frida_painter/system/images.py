"""Input and output of pictures: any picture file to sRGB in [0, 1], and back to PNG or JPEG."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor
from torch.nn import functional

from frida_painter.errors import ImageError
from frida_painter.system import picture_file, storage

_PNG_LEVEL = 4  # zlib level: files 2 % larger than at 6, in less than half the time
_JPEG_QUALITY = 92


def load(
    path: str | Path, *, most_pixels: int = picture_file.MAX_PIXELS, longest: int = picture_file.LONGEST
) -> Tensor:
    """Reads a picture file as sRGB [3, H, W] float32 in [0, 1]; picture_file.py decodes it. Raises ImageError.

    `longest` limits the longer side:

        >>> import frida_painter as fp
        >>> picture = fp.load_picture("photo.jpg", longest=50)
        >>> max(picture.shape), picture.dtype
        (50, torch.float32)
    """
    return _as_planes(picture_file.decode(Path(path), most_pixels=most_pixels, longest=longest))


def load_with_opacity(content: bytes, name: str, *, longest: int) -> Tensor:
    """Reads the content of a picture file as `load` does, with its opacity: [4, H, W]. name: for messages."""
    return _as_planes(picture_file.decode_with_opacity(content, name, longest=longest))


def _as_planes(pixels: NDArray[np.uint8] | NDArray[np.float32]) -> Tensor:
    planes = torch.from_numpy(pixels).permute(2, 0, 1).contiguous()
    return planes.float() / 255 if planes.dtype == torch.uint8 else planes.clamp_(0, 1)


AnyPicture = str | Path | Tensor | NDArray[Any] | Image.Image
"""Picture of public functions: a file, sRGB [3, H, W] of PyTorch or NumPy, bytes [H, W, 3], or one of Pillow."""
_ROUNDING = 1e-3  # beyond [0, 1], of pictures that were computed


def as_picture(given: AnyPicture) -> Tensor:
    """Returns a picture in any of its forms as sRGB [3, H, W], floating point, in [0, 1]. Raises ImageError."""
    if isinstance(given, str | Path):
        return load(given)
    if isinstance(given, Image.Image):
        paper = Image.new("RGBA", given.size, "white")
        paper.alpha_composite(given.convert("RGBA"))
        return from_uint8(np.asarray(paper.convert("RGB")))
    if isinstance(given, np.ndarray):
        if given.dtype == np.uint8 and given.ndim == 3 and given.shape[2] == 3:
            return from_uint8(given)
        given = torch.from_numpy(np.ascontiguousarray(given))
    if not isinstance(given, Tensor):
        raise ImageError(f"A picture was given as {type(given).__name__}; give a file, or a tensor [3, height, width].")
    shape = tuple(given.shape)
    if len(shape) != 3 or shape[0] != 3:
        turned = "; turn it: picture.permute(2, 0, 1)" if len(shape) == 3 and shape[2] == 3 else ""
        raise ImageError(f"A picture of shape {shape} was given; it is [3, height, width]{turned}.")
    if 0 in shape or not given.is_floating_point():
        kind = str(given.dtype).removeprefix("torch.")
        raise ImageError(f"A picture of shape {shape} in {kind} was given; it is floating point in [0, 1], not empty.")
    low, high = (float(edge) for edge in given.detach().aminmax())
    if not (low >= -_ROUNDING and high <= 1 + _ROUNDING):
        raise ImageError(f"A picture with values from {low:g} to {high:g} was given; it is sRGB in [0, 1].")
    return given


def save(image: AnyPicture, path: str | Path) -> None:
    """Writes a picture to `path` atomically: .jpg as JPEG, else lossless PNG. Raises StorageError and ImageError.

    Any picture will do:

        >>> import frida_painter as fp, torch
        >>> fp.save_picture(torch.rand(3, 48, 64), "noise.png")
        >>> fp.load_picture("noise.png").shape
        torch.Size([3, 48, 64])
    """
    path = Path(path)
    if not (isinstance(image, np.ndarray) and image.dtype == np.uint8 and image.shape[2:] == (3,)):
        image = to_uint8(as_picture(image))
    picture = Image.fromarray(image)
    with storage.replacing(path) as temporary:
        if path.suffix.lower() in (".jpg", ".jpeg"):
            picture.save(temporary, format="JPEG", quality=_JPEG_QUALITY, subsampling=0)
        else:
            picture.save(temporary, format="PNG", compress_level=_PNG_LEVEL)


def save_exactly(pixels: NDArray[np.uint8], path: Path) -> None:
    """Writes bytes [H, W, 3] as PNG atomically; fast, with little compression. Raises StorageError."""
    import cv2

    how = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)
    _, content = cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), how)
    storage.write_bytes(path, content.tobytes())


def load_exactly(path: Path) -> NDArray[np.uint8]:
    """Returns the bytes [H, W, 3] that `save_exactly` wrote. Raises ImageError if the file is missing or damaged."""
    try:
        with (
            storage.open_checked(path, "a picture", storage.MAX_BYTES, ImageError) as content,
            Image.open(content, formats=("PNG",)) as file,
        ):
            picture_file.require_size(path, *file.size)
            return np.array(file.convert("RGB"))
    except ImageError:
        raise
    except Exception as cause:  # decoders raise any error for a damaged file
        raise ImageError(
            f"{path} is gone or damaged ({picture_file.one_line(cause)}); take an undamaged copy."
        ) from cause


def to_uint8(image: Tensor) -> NDArray[np.uint8]:
    """Converts sRGB [3, H, W] in [0, 1] to bytes [H, W, 3], the format of cameras, films and files."""
    return (image.detach() * 255).round_().clamp_(0, 255).to(torch.uint8).permute(1, 2, 0).contiguous().cpu().numpy()


def from_uint8(pixels: NDArray[np.uint8]) -> Tensor:
    """Converts bytes [H, W, 3] to sRGB [3, H, W] float32 in [0, 1]."""
    return torch.from_numpy(np.array(pixels)).permute(2, 0, 1).contiguous().float() / 255


def fit(image: Tensor, rows: int, columns: int) -> Tensor:
    """Returns the middle of a picture [3, H, W], cropped to the proportions of `rows` x `columns` and resampled to it.

    To shrink, pixels are averaged with a triangular filter that is two new pixels wide; to enlarge, interpolated.
    """
    middle = _middle(image, rows, columns)
    if middle.shape[1:] == (rows, columns):
        return middle.contiguous()
    resampled = functional.interpolate(middle[None], (rows, columns), mode="bilinear", antialias=True)
    return resampled[0].clamp(0, 1)


def resize_by_area(image: Tensor, rows: int, columns: int) -> Tensor:
    """Returns the picture [3, H, W] cropped like `fit`, but each new pixel is the mean of its area.

    It keeps detail that `fit` softens, to compare pictures. A larger size is interpolated. Not differentiable.
    """
    import cv2  # loaded here because few callers need it

    middle = _middle(image, rows, columns)
    if middle.shape[1] < rows or middle.shape[2] < columns:
        return fit(middle, rows, columns)
    pixels = np.ascontiguousarray(middle.detach().permute(1, 2, 0).cpu().numpy())
    shrunk = cv2.resize(pixels, (columns, rows), interpolation=cv2.INTER_AREA)
    return torch.from_numpy(shrunk).permute(2, 0, 1).contiguous().to(image)


def shrink_to_compare(image: Tensor, rows: int, columns: int) -> Tensor:
    """Returns the picture in bytes, each new pixel the mean of its area: by Pillow, so that anybody can do it."""
    return from_uint8(np.asarray(Image.fromarray(to_uint8(image)).resize((columns, rows), Image.Resampling.BOX)))


def crop(image: Tensor, box: tuple[float, float, float, float]) -> Tensor:
    """Returns a part of a picture [3, H, W], in whole pixels and at least one.

    box: left, top, width and height as shares of the picture's sides; the part lies inside the picture.
    """
    left, top, width, height = box
    (x, columns), (y, rows) = (
        _span(start, length, pixels)
        for start, length, pixels in ((left, width, image.shape[2]), (top, height, image.shape[1]))
    )
    return image[:, y : y + rows, x : x + columns].contiguous()


def _span(start: float, length: float, pixels: int) -> tuple[int, int]:
    """Returns the first pixel and the number of pixels of a part of a side."""
    first = min(pixels - 1, round(start * pixels))
    return first, max(1, min(pixels, round((start + length) * pixels)) - first)


def _middle(image: Tensor, rows: int, columns: int) -> Tensor:
    """Returns the middle of a picture [3, H, W], cropped to the proportions of `rows` x `columns`."""
    _, height, width = image.shape
    scale = min(height / rows, width / columns)
    kept_rows = min(height, max(1, round(rows * scale)))
    kept_columns = min(width, max(1, round(columns * scale)))
    top, left = (height - kept_rows) // 2, (width - kept_columns) // 2
    return image[:, top : top + kept_rows, left : left + kept_columns]


def gaussian_blur(picture: Tensor, spread: float) -> Tensor:
    """Blurs a picture [c, h, w] with a Gaussian of standard deviation `spread` > 0 pixels; edge pixels are repeated."""
    reach = max(1, round(2.5 * spread))
    steps = torch.arange(-reach, reach + 1, dtype=picture.dtype, device=picture.device)
    kernel = torch.exp(-steps.square() / (2 * spread**2))
    kernel = kernel / kernel.sum()
    padded = functional.pad(picture[:, None], (reach,) * 4, mode="replicate")
    rows = functional.conv2d(padded, kernel[None, None, :, None])
    return functional.conv2d(rows, kernel[None, None, None, :])[:, 0]


def pad(image: Tensor, rows: int, columns: int) -> Tensor:
    """Returns the whole picture [3, H, W] centred on white in `rows` x `columns`, resampled like `fit`."""
    _, height, width = image.shape
    scale = min(rows / height, columns / width)
    inner_rows, inner_columns = max(1, round(height * scale)), max(1, round(width * scale))
    padded = image.new_ones(3, rows, columns)
    top, left = (rows - inner_rows) // 2, (columns - inner_columns) // 2
    padded[:, top : top + inner_rows, left : left + inner_columns] = fit(image, inner_rows, inner_columns)
    return padded


def resize_to_pixels(image: Tensor, pixels: int) -> Tensor:
    """Resizes a picture [3, H, W] to about `pixels` pixels, no side below 16; keeps proportions. Differentiable."""
    _, rows, columns = image.shape
    scale = (pixels / (rows * columns)) ** 0.5
    size = [max(16, round(rows * scale)), max(16, round(columns * scale))]
    return functional.interpolate(image[None], size, mode="bilinear", antialias=True)[0]


# Conversion between sRGB and linear light, in which light adds up and averages (IEC 61966-2-1).


def to_linear(srgb: Tensor) -> Tensor:
    """Converts sRGB in [0, 1] to linear light in [0, 1], any shape."""
    return torch.where(srgb <= 0.04045, srgb / 12.92, ((srgb.clamp(min=0.04045) + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: Tensor) -> Tensor:
    """Converts linear light to sRGB, any shape; clips to [0, 1]."""
    linear = linear.clamp(0, 1)
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp(min=0.0031308) ** (1 / 2.4) - 0.055)


def light_of_bytes(photograph: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Converts a photograph in sRGB bytes to linear light in [0, 1], any shape."""
    import cv2

    tones: NDArray[np.float32] = to_linear(torch.linspace(0, 1, 256)).numpy()
    light = cv2.LUT(photograph.reshape(-1), tones) if photograph.size else tones[photograph]
    return np.asarray(light, np.float32).reshape(photograph.shape)
