"""The commands that teach the painter its brush: strokes paint, inspect, train, evaluate."""

import typer

from frida_painter.cli.deferred import Deferred, group_of

COMMANDS = (
    Deferred(
        "paint",
        "frida_painter.cli.library",
        "Paint single strokes of all shapes in the virtual studio, photograph each, and keep them as a library.",
    ),
    Deferred(
        "inspect",
        "frida_painter.cli.library",
        "Tell which strokes of a library are dirty, and why, and write a contact sheet of all of them.",
    ),
    Deferred(
        "train",
        "frida_painter.cli.training",
        "Train the stroke model on a library: which mark a stroke of given thickness, length and bend leaves.",
    ),
    Deferred(
        "evaluate", "frida_painter.cli.evaluation", "Compare a stroke model with strokes that were really painted."
    ),
)


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        no_args_is_help=True,
        help="Teach the painter its brush from strokes that it has painted.",
        cls=group_of(COMMANDS),
    )
    app.add_typer(group, name="strokes")
