"""Process that reads what loads arrays and tensors, which the page's process must not hold.

`python -m frida_painter_studio.reader picture` decodes one picture, with limits: a file in, a PNG out.
`python -m frida_painter_studio.reader makers NAME:TEXT...` opens picture makers, to find what is wrong; nothing is
made.
`python -m frida_painter_studio.reader canvas FILE` prints width and height of a workspace's canvas in millimetres.
It ends with status 2, and a sentence on the standard error, if something is wrong.
"""

import os
import resource
import sys
import tempfile
from pathlib import Path

from frida_painter import python_process
from frida_painter.errors import ConfigError, FridaError, ImageError

_PATIENCE = 120.0  # seconds
_MAX_PIXELS = 50_000_000
_LONGEST = 2048
_MAX_MEMORY = 2 * 2**30
_MAX_SECONDS = 20
_MAX_WRITTEN = 64 * 2**20


def ask_reader(what: str, *given: object) -> str:
    """Returns what such a process prints. Raises ConfigError with its sentence."""
    said = python_process.run("-m", "frida_painter_studio.reader", what, *given, text=True, timeout=_PATIENCE)
    if said.returncode:
        words = said.stderr.strip().splitlines() or [f"{given} cannot be read."]
        raise ConfigError(words[-1])
    return str(said.stdout)


def limit() -> None:
    """Limits memory, time and written bytes of this process."""
    for kind, most in (
        (resource.RLIMIT_AS, _MAX_MEMORY), (resource.RLIMIT_CPU, _MAX_SECONDS),
        (resource.RLIMIT_FSIZE, _MAX_WRITTEN), (resource.RLIMIT_CORE, 0),
    ):  # fmt: skip
        resource.setrlimit(kind, (most, most))


def _decode_picture() -> None:
    from PIL import Image

    from frida_painter import picture_file

    limit()
    os.nice(5)  # a painting has priority
    with tempfile.NamedTemporaryFile(prefix="upload-") as file:
        file.write(sys.stdin.buffer.read())
        file.flush()
        try:
            pixels = picture_file.decode(Path(file.name), most_pixels=_MAX_PIXELS, longest=_LONGEST)
        except ImageError as trouble:
            raise ImageError(str(trouble).replace(file.name, "The file")) from trouble
    if pixels.dtype.kind == "f":
        pixels = (pixels.clip(0, 1) * 255).round()
    Image.fromarray(pixels.astype("uint8")).save(sys.stdout.buffer, format="PNG")


def main() -> None:
    """Reads what the command line names."""
    what, *given = sys.argv[1:]
    try:
        if what == "picture":
            _decode_picture()
        elif what == "makers":
            from frida_painter_words.picture_makers.making import open_picture_maker

            for maker in given:
                try:
                    open_picture_maker(maker)
                except FridaError as fault:
                    raise ConfigError(f"--imagine {maker[:80]!r}: {fault}") from fault
        else:
            from frida_painter.hardware.workcell import WorkcellConfig

            size = WorkcellConfig.load(Path(given[0])).canvas
            print(1000 * size.width, 1000 * size.height)
    except FridaError as fault:
        print(fault, file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
