"""Pictures that people give: decoded, checked, and written anew, so that nothing of the file itself is kept."""

import secrets
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from frida_painter import picture_file, storage
from frida_painter.errors import ImageError
from frida_painter.web.folder import require_disk

_MOST_PIXELS = 50_000_000
_LONGEST = 2048


def keep(content: bytes, folder: Path) -> str:
    """Puts a picture into `folder` as PNG under a new id, which is returned.

    Raises ImageError, in words that name no path, for what is not a picture or is too large; StorageError.
    """
    if not content:
        raise ImageError("The file is empty; choose another picture.")
    with tempfile.NamedTemporaryFile(prefix="upload-") as file:
        file.write(content)
        file.flush()
        try:
            picture = picture_file.decode(Path(file.name), most_pixels=_MOST_PIXELS, longest=_LONGEST)
        except ImageError as trouble:
            raise ImageError(str(trouble).replace(file.name, "The file")) from trouble
    identifier = secrets.token_hex(16)
    folder.mkdir(parents=True, exist_ok=True)
    require_disk(folder, 2**26)
    with storage.replacing(folder / f"{identifier}.png") as temporary:
        _of_bytes(picture).save(temporary, format="PNG")
    return identifier


def _of_bytes(picture: Image.Image) -> Image.Image:
    """The picture with one byte for each value; grey of 16 bits is rounded."""
    if picture.mode != "F":
        return picture
    return Image.fromarray((np.asarray(picture).clip(0, 1) * 255).round().astype(np.uint8))
