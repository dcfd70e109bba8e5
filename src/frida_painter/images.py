"""Pictures in and out: from any file that a person may give to sRGB in [0, 1], and back to PNG or JPEG."""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor
from torch.nn import functional

from frida_painter import picture_file, storage
from frida_painter.errors import ImageError

_PNG_LEVEL = 4  # of zlib: a fiftieth larger than 6, in less than half the time
_JPEG_QUALITY = 92


def load(
    path: str | Path, *, most_pixels: int = picture_file.MOST_PIXELS, longest: int = picture_file.LONGEST
) -> Tensor:
    """A picture file as sRGB, [3, H, W] float32 in [0, 1], decoded as picture_file.py says. Raises ImageError."""
    pixels = picture_file.decode(Path(path), most_pixels=most_pixels, longest=longest)
    planes = torch.from_numpy(pixels).permute(2, 0, 1).contiguous()
    return planes.float() / 255 if planes.dtype == torch.uint8 else planes.clamp_(0, 1)


def save(image: Tensor, path: str | Path) -> None:
    """Writes sRGB [3, H, W] in [0, 1] to `path`, atomically: .png without loss, .jpg small. Raises StorageError."""
    path = Path(path)
    picture = Image.fromarray(to_uint8(image))
    with storage.replacing(path) as temporary:
        if path.suffix.lower() in (".jpg", ".jpeg"):
            picture.save(temporary, format="JPEG", quality=_JPEG_QUALITY, subsampling=0, optimize=True)
        else:
            picture.save(temporary, format="PNG", compress_level=_PNG_LEVEL)


def save_exactly(pixels: NDArray[np.uint8], path: Path) -> None:
    """Writes bytes [H, W, 3] as PNG, atomically and quickly rather than as small as can be. Raises StorageError."""
    with storage.replacing(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", compress_level=1)


def load_exactly(path: Path) -> NDArray[np.uint8]:
    """The bytes [H, W, 3] that `save_exactly` wrote. Raises ImageError where the file is gone or damaged."""
    try:
        with (
            storage.opened(path, "a picture", storage.MAX_BYTES, ImageError) as content,
            Image.open(content, formats=("PNG",)) as file,
        ):
            picture_file.require_size(path, *file.size)
            return np.array(file.convert("RGB"))
    except ImageError:
        raise
    except Exception as cause:  # decoders raise whatever they stumble over in a damaged file
        raise ImageError(
            f"{path} is gone or damaged ({picture_file.one_line(cause)}); take an undamaged copy."
        ) from cause


def to_uint8(image: Tensor) -> NDArray[np.uint8]:
    """sRGB [3, H, W] in [0, 1] to the bytes [H, W, 3] that cameras, films and files speak."""
    return (image.detach().clamp(0, 1) * 255).round().to(torch.uint8).permute(1, 2, 0).contiguous().cpu().numpy()


def from_uint8(pixels: NDArray[np.uint8]) -> Tensor:
    """Bytes [H, W, 3] to sRGB [3, H, W] float32 in [0, 1]."""
    return torch.from_numpy(np.array(pixels)).permute(2, 0, 1).contiguous().float() / 255


def fit(image: Tensor, rows: int, columns: int) -> Tensor:
    """The picture [3, H, W] as it fills `rows` x `columns`: its middle, cropped to that shape, resampled.

    Smaller is averaged under a triangle as wide as two new pixels, larger is interpolated; the result stays in [0, 1].
    """
    middle = _middle(image, rows, columns)
    if middle.shape[1:] == (rows, columns):
        return middle.contiguous()
    resampled = functional.interpolate(middle[None], (rows, columns), mode="bilinear", antialias=True)
    return resampled[0].clamp(0, 1)


def averaged(image: Tensor, rows: int, columns: int) -> Tensor:
    """The picture [3, H, W] as `fit` has it, but each pixel is the mean of the area that it covers.

    That keeps detail which `fit` softens, and is how pictures of two sizes are compared. What is to grow is
    interpolated. Not differentiable.
    """
    import cv2  # few who carry pictures compare them

    middle = _middle(image, rows, columns)
    if middle.shape[1] < rows or middle.shape[2] < columns:
        return fit(middle, rows, columns)
    pixels = np.ascontiguousarray(middle.detach().permute(1, 2, 0).cpu().numpy())
    shrunk = cv2.resize(pixels, (columns, rows), interpolation=cv2.INTER_AREA)
    return torch.from_numpy(shrunk).permute(2, 0, 1).contiguous().to(image)


def _middle(image: Tensor, rows: int, columns: int) -> Tensor:
    """The middle of a picture [3, H, W], cropped to the proportions of `rows` x `columns`."""
    _, height, width = image.shape
    scale = min(height / rows, width / columns)
    kept_rows = min(height, max(1, round(rows * scale)))
    kept_columns = min(width, max(1, round(columns * scale)))
    top, left = (height - kept_rows) // 2, (width - kept_columns) // 2
    return image[:, top : top + kept_rows, left : left + kept_columns]


def blurred(picture: Tensor, spread: float) -> Tensor:
    """A picture [c, h, w] blurred by a Gaussian with a standard deviation of `spread` > 0 pixels; edges go on."""
    reach = max(1, round(2.5 * spread))
    steps = torch.arange(-reach, reach + 1).to(picture)
    kernel = torch.exp(-steps.square() / (2 * spread**2))
    kernel = kernel / kernel.sum()
    padded = functional.pad(picture[:, None], (reach,) * 4, mode="replicate")
    rows = functional.conv2d(padded, kernel[None, None, :, None])
    return functional.conv2d(rows, kernel[None, None, None, :])[:, 0]


def pad(image: Tensor, rows: int, columns: int) -> Tensor:
    """The whole picture [3, H, W] in the middle of `rows` x `columns`, on white, resampled as `fit` does."""
    _, height, width = image.shape
    scale = min(rows / height, columns / width)
    inner_rows, inner_columns = max(1, round(height * scale)), max(1, round(width * scale))
    padded = image.new_ones(3, rows, columns)
    top, left = (rows - inner_rows) // 2, (columns - inner_columns) // 2
    padded[:, top : top + inner_rows, left : left + inner_columns] = fit(image, inner_rows, inner_columns)
    return padded


def sized(image: Tensor, pixels: int) -> Tensor:
    """The picture [3, H, W] with about so many pixels, in its own proportions, no side below 16; differentiable."""
    _, rows, columns = image.shape
    scale = (pixels / (rows * columns)) ** 0.5
    size = [max(16, round(rows * scale)), max(16, round(columns * scale))]
    return functional.interpolate(image[None], size, mode="bilinear", antialias=True)[0]
