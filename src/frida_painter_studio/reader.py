"""Readers in processes of their own: the page's process holds neither arrays nor tensors."""

import tempfile
from io import BytesIO
from pathlib import Path

from frida_painter.errors import ConfigError, FridaError, ImageError
from frida_painter.system.python_process import ProcessLimits, in_own_process

_PATIENCE = ProcessLimits(seconds=120.0)
_MAX_PIXELS = 50_000_000
_LONGEST = 2048
_UPLOAD = ProcessLimits(seconds=30.0, processor=20, memory=2 * 2**30, written=64 * 2**20, niceness=5)


@in_own_process(_UPLOAD, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", VIPS_CONCURRENCY="1")
def decode_upload(content: bytes) -> bytes:
    """Returns the content of a picture file as PNG, with at most 2048 pixels a side. Raises ImageError."""
    from PIL import Image

    from frida_painter.system import picture_file

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "upload")
        path.write_bytes(content)
        try:
            pixels = picture_file.decode(path, most_pixels=_MAX_PIXELS, longest=_LONGEST)
        except ImageError as trouble:
            raise ImageError(str(trouble).replace(str(path), "The file")) from trouble
    if pixels.dtype.kind == "f":
        pixels = (pixels.clip(0, 1) * 255).round()
    made = BytesIO()
    Image.fromarray(pixels.astype("uint8")).save(made, format="PNG")
    return made.getvalue()


@in_own_process(_PATIENCE)
def check_makers(makers: tuple[str, ...]) -> None:
    """Opens picture makers, each as NAME:TEXT; nothing is made. Raises ConfigError for the first that is wrong."""
    from frida_painter_words.picture_makers.making import open_picture_maker

    for maker in makers:
        try:
            open_picture_maker(maker)
        except FridaError as fault:
            raise ConfigError(f"--imagine {maker[:80]!r}: {fault}") from fault


@in_own_process(_PATIENCE)
def read_canvas(workspace: Path) -> tuple[float, float]:
    """Returns width and height of the canvas in a workspace file, in millimetres. Raises ConfigError."""
    from frida_painter.hardware.workcell import WorkcellConfig

    size = WorkcellConfig.load(workspace).canvas
    return 1000 * size.width, 1000 * size.height
