"""The command line: parse, call, show. One module for each group of commands."""

import sys

import typer
from rich.console import Console

from frida_painter.cli.painting import register
from frida_painter.cli.strokes import build as strokes
from frida_painter.errors import FridaError


def build() -> typer.Typer:
    """The command `frida-painter` with all that it can do."""
    app = typer.Typer(
        name="frida-painter",
        help="A robot that paints with you: it plans brush strokes, paints some, looks at the canvas, and plans again.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    register(app)
    app.add_typer(strokes(), name="strokes")
    return app


def main() -> None:
    """Runs the command line: exit status 0 when done, 2 with one sentence when something has to be mended."""
    try:
        build()()
    except FridaError as error:
        Console(stderr=True, highlight=False, soft_wrap=True).print(f"[bold red]frida-painter:[/] {_plain(str(error))}")
        sys.exit(2)


def _plain(message: str) -> str:
    """A message without control characters (a file's name may hold them) and without rich's markup."""
    printable = "".join(character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in message)
    return printable.replace("[", r"\[")
