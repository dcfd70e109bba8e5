"""Input and output of pictures: any picture file to sRGB in [0, 1], and back to PNG or JPEG."""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor
from torch.nn import functional

from frida_painter import picture_file, storage
from frida_painter.errors import ImageError

_PNG_LEVEL = 4  # zlib level: files 2 % larger than at 6, in less than half the time
_JPEG_QUALITY = 92


def load(
    path: str | Path, *, most_pixels: int = picture_file.MAX_PIXELS, longest: int = picture_file.LONGEST
) -> Tensor:
    """Reads a picture file as sRGB [3, H, W] float32 in [0, 1]; picture_file.py decodes it. Raises ImageError."""
    pixels = picture_file.decode(Path(path), most_pixels=most_pixels, longest=longest)
    planes = torch.from_numpy(pixels).permute(2, 0, 1).contiguous()
    return planes.float() / 255 if planes.dtype == torch.uint8 else planes.clamp_(0, 1)


def save(image: Tensor, path: str | Path) -> None:
    """Writes sRGB [3, H, W] in [0, 1] to `path` atomically: .jpg as JPEG, else lossless PNG. Raises StorageError."""
    path = Path(path)
    picture = Image.fromarray(to_uint8(image))
    with storage.replacing(path) as temporary:
        if path.suffix.lower() in (".jpg", ".jpeg"):
            picture.save(temporary, format="JPEG", quality=_JPEG_QUALITY, subsampling=0, optimize=True)
        else:
            picture.save(temporary, format="PNG", compress_level=_PNG_LEVEL)


def save_exactly(pixels: NDArray[np.uint8], path: Path) -> None:
    """Writes bytes [H, W, 3] as PNG atomically; fast, with little compression. Raises StorageError."""
    with storage.replacing(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", compress_level=1)


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
    return (image.detach().clamp(0, 1) * 255).round().to(torch.uint8).permute(1, 2, 0).contiguous().cpu().numpy()


def from_uint8(pixels: NDArray[np.uint8]) -> Tensor:
    """Converts bytes [H, W, 3] to sRGB [3, H, W] float32 in [0, 1]."""
    return torch.from_numpy(np.array(pixels)).permute(2, 0, 1).contiguous().float() / 255


def fit(image: Tensor, rows: int, columns: int) -> Tensor:
    """Returns the middle of a picture [3, H, W], cropped to the proportions of `rows` x `columns` and resampled to it.

    To shrink, pixels are averaged with a triangular filter that is two new pixels wide. To enlarge, they are
    interpolated. The result stays in [0, 1].
    """
    middle = _middle(image, rows, columns)
    if middle.shape[1:] == (rows, columns):
        return middle.contiguous()
    resampled = functional.interpolate(middle[None], (rows, columns), mode="bilinear", antialias=True)
    return resampled[0].clamp(0, 1)


def resize_by_area(image: Tensor, rows: int, columns: int) -> Tensor:
    """Returns the picture [3, H, W] cropped like `fit`, but each new pixel is the mean of its area.

    This keeps detail that `fit` softens; use it to compare pictures of different sizes. A larger size is
    interpolated. Not differentiable.
    """
    import cv2  # loaded here because few callers need it

    middle = _middle(image, rows, columns)
    if middle.shape[1] < rows or middle.shape[2] < columns:
        return fit(middle, rows, columns)
    pixels = np.ascontiguousarray(middle.detach().permute(1, 2, 0).cpu().numpy())
    shrunk = cv2.resize(pixels, (columns, rows), interpolation=cv2.INTER_AREA)
    return torch.from_numpy(shrunk).permute(2, 0, 1).contiguous().to(image)


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
    steps = torch.arange(-reach, reach + 1).to(picture)
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
