"""Process that reads what loads arrays and tensors, which the page's process must not hold.

`python -m frida_painter_studio.reader makers NAME:TEXT...` opens picture makers, to find what is wrong; nothing is
made.
`python -m frida_painter_studio.reader canvas FILE` prints width and height of a workspace's canvas in millimetres.
It ends with status 2, and a sentence on the standard error, if something is wrong.
"""

import sys
from pathlib import Path

from frida_painter import python_process
from frida_painter.errors import ConfigError, FridaError

_PATIENCE = 120.0  # seconds


def ask_reader(what: str, *given: object) -> str:
    """Returns what such a process prints. Raises ConfigError with its sentence."""
    said = python_process.run("-m", "frida_painter_studio.reader", what, *given, text=True, timeout=_PATIENCE)
    if said.returncode:
        words = said.stderr.strip().splitlines() or [f"{given} cannot be read."]
        raise ConfigError(words[-1])
    return str(said.stdout)


def main() -> None:
    """Reads what the command line names."""
    what, *given = sys.argv[1:]
    try:
        if what == "makers":
            _open_makers(given)
        else:
            _print_canvas(Path(given[0]))
    except FridaError as fault:
        print(fault, file=sys.stderr)
        sys.exit(2)


def _open_makers(makers: list[str]) -> None:
    from frida_painter_words.picture_makers.making import open_picture_maker

    for maker in makers:
        try:
            open_picture_maker(maker)
        except FridaError as fault:
            raise ConfigError(f"--imagine {maker[:80]!r}: {fault}") from fault


def _print_canvas(workspace: Path) -> None:
    from frida_painter.hardware.workcell import WorkcellConfig

    size = WorkcellConfig.load(workspace).canvas
    print(1000 * size.width, 1000 * size.height)


if __name__ == "__main__":
    main()
