"""Painting together by words at the terminal: the option, and questions to a person."""

import select
import sys
from collections.abc import Callable
from io import TextIOWrapper
from typing import Annotated

import typer

from frida_painter.errors import ConfigError, Interrupted
from frida_painter.registry import Later

ProposeOption = Annotated[
    str | None,
    typer.Option(
        "--propose",
        metavar="NAME:TEXT",
        help="Picture maker for changes by words: while it paints, type what shall change and press Enter, then choose "
        "one of its pictures, which begin from the canvas; diffusers:FOLDER, or command:PROGRAM with {canvas}. "
        "[dim]nothing is proposed[/]",
        rich_help_panel="What to paint",
    ),
]
_require_canvas_maker = Later("frida_painter.picture_makers.making:require_canvas_maker")
_GLANCE = 0.2  # seconds between two looks whether the person has stopped


def require_proposer(maker: str | None, *, together: bool) -> None:
    """Raises ConfigError if a maker is wanted that is not there or takes no canvas, or without a goal to change."""
    if maker is not None and together:
        raise ConfigError("--propose changes a goal, and --together has none; leave out one.")
    if maker is not None:
        _require_canvas_maker(maker)


def ask_at_terminal(prompt: str, stop_asked: Callable[[], bool]) -> str:
    """Returns the line that is typed after a prompt; "" after Ctrl-D, which says no more than Enter.

    Raises EOFError if nobody can type, Interrupted after a stop.
    """
    print(prompt, end="", flush=True)
    while sys.stdin.isatty() and not select.select([sys.stdin], [], [], _GLANCE)[0]:
        if stop_asked():
            print()
            raise Interrupted("You stopped; what was painted is kept.")
    line = read_line()
    if not line and not sys.stdin.isatty():
        raise EOFError
    return line


def read_line() -> str:
    """Returns the next line that is typed; bytes that are no text become marks."""
    if not isinstance(sys.stdin, TextIOWrapper):
        return sys.stdin.readline()
    return sys.stdin.buffer.readline().decode(sys.stdin.encoding, "replace")
