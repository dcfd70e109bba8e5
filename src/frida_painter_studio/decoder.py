"""Process that decodes one picture: `python -m frida_painter_studio.decoder`, a file in, a PNG out.

It ends with status 2, and a sentence on the standard error, if the file is no picture.
"""

import os
import resource
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from frida_painter import picture_file
from frida_painter.errors import ImageError

_MAX_PIXELS = 50_000_000
_LONGEST = 2048
_MAX_MEMORY = 2 * 2**30
_MAX_SECONDS = 20
_MAX_WRITTEN = 64 * 2**20


def limit() -> None:
    """Limits memory, time and written bytes of this process."""
    for kind, most in (
        (resource.RLIMIT_AS, _MAX_MEMORY), (resource.RLIMIT_CPU, _MAX_SECONDS),
        (resource.RLIMIT_FSIZE, _MAX_WRITTEN), (resource.RLIMIT_CORE, 0),
    ):  # fmt: skip
        resource.setrlimit(kind, (most, most))


def main() -> None:
    """Decodes the picture from the standard input."""
    limit()
    os.nice(5)  # a painting has priority
    with tempfile.NamedTemporaryFile(prefix="upload-") as file:
        file.write(sys.stdin.buffer.read())
        file.flush()
        try:
            pixels = picture_file.decode(Path(file.name), most_pixels=_MAX_PIXELS, longest=_LONGEST)
        except ImageError as trouble:
            print(str(trouble).replace(file.name, "The file"), file=sys.stderr)
            sys.exit(2)
    Image.fromarray(_of_bytes(pixels)).save(sys.stdout.buffer, format="PNG")


def _of_bytes(pixels: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.uint8]:
    """Returns the picture in 8 bits; deeper values are rounded."""
    if pixels.dtype == np.uint8:
        return pixels.astype(np.uint8)
    return (pixels.clip(0, 1) * 255).round().astype(np.uint8)


if __name__ == "__main__":
    main()
