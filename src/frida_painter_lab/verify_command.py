"""Command that checks whether something can be made again here: verify FOLDER."""

from pathlib import Path
from typing import Annotated

import typer

from frida_painter_cli.commands import Deferred

VERIFY = Deferred(
    "verify",
    "frida_painter_lab.verify_command",
    "Check whether a plan or a painting is as it was left and can be made again here, by its record.",
)


def verify(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="A painting or a plan.", show_default=False)],
    again: Annotated[
        bool, typer.Option("--again", help="Make it again and compare, bit for bit. Nothing is written.")
    ] = False,
) -> None:
    """Check whether a plan or a painting is as it was left and can be made again here, by its record.

    Versions, plug-ins, code, device, all files that went in and all files in the folder are compared. If something
    differs, it is named, and the exit status is 1.
    """
    from frida_painter_lab.records import record  # loaded here, so that help is quick

    found = record(folder)
    checked = found.make_again() if again else found.check()
    typer.echo(str(checked))
    if not checked.passed:
        raise typer.Exit(1)


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("verify")(verify)
