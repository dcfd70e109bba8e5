"""The command line: parse, call, show. commands.py lists the commands; a command's module is imported when it runs."""

import signal
import sys
from typing import Any

import typer
from rich.console import Console

from frida_painter.cli.commands import COMMANDS
from frida_painter.cli.deferred import group_of, nothing_first
from frida_painter.cli.stop_signal import leave_terminal
from frida_painter.errors import FridaError, PaintingPaused, RobotStopped
from frida_painter.storage import shown

_PAUSED = 3
# Typer keeps the class of all errors of usage to itself; this one of its children is public.
_UsageError: type[Exception] = typer.BadParameter.__bases__[0]


def build() -> typer.Typer:
    """The command `frida-painter` with all that it can do."""
    return typer.Typer(
        name="frida-painter",
        help="A robot painter. It plans brush strokes, paints some, looks at the canvas and replans the rest.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        context_settings={"help_option_names": ["-h", "--help"]},
        callback=nothing_first,
        cls=group_of(COMMANDS),
    )


def main() -> None:
    """Runs the command line.

    Exit status 0 when done, 2 with one sentence when something has to be mended, 3 when a painting has
    paused and can be resumed, 130 when stopped, also by the stop file. Raises KeyboardInterrupt if a signal
    ended it (__main__.py).
    """
    try:
        status = build()(prog_name="frida-painter", standalone_mode=False)
    except typer.Abort as abort:  # Typer's word for a signal
        raise KeyboardInterrupt from abort
    except FridaError as error:
        _complain(str(error))
        status = _status(error)
    except _UsageError as error:
        _complain(_advice(error))
        status = 2
    except BrokenPipeError:  # whoever read the output wants no more of it
        leave_terminal((1,))
        status = 128 + signal.SIGPIPE
    except OSError as error:
        _complain(f"{shown(str(error.filename or 'The system'))}: {error.strerror or error}; nothing more was done.")
        status = 2
    sys.exit(status)


def _status(error: FridaError) -> int:
    if isinstance(error, RobotStopped) and error.asked:
        return 128 + signal.SIGINT
    return _PAUSED if isinstance(error, PaintingPaused) else 2


def _complain(message: str) -> None:
    if message:
        Console(stderr=True, highlight=False, soft_wrap=True).print(f"[bold red]frida-painter:[/] {_plain(message)}")


def _advice(error: Any) -> str:
    """What is wrong with the command itself, and where help is; nothing where the help was just shown."""
    message = error.format_message().strip().rstrip(".")
    if not message:
        return ""
    return f"{message}; `{error.ctx.command_path if error.ctx else 'frida-painter'} --help` tells what can be given."


def _plain(message: str) -> str:
    """A message in lines without control characters (a file's name may hold them) and without rich's markup."""
    printable = "".join(
        character if character.isprintable() or character == "\n" else "\N{REPLACEMENT CHARACTER}"
        for character in message
    )
    return printable.replace("[", r"\[")
