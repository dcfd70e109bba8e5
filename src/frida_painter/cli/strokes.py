"""The commands that teach the painter its brush: strokes paint, inspect, train, evaluate."""

import typer

from frida_painter.cli.deferred import Deferred, group_of

COMMANDS = (
    Deferred(
        "paint",
        "frida_painter.cli.library",
        "Paint single strokes of all shapes in the virtual studio, photograph each, and save them as a library.",
    ),
    Deferred(
        "inspect",
        "frida_painter.cli.library",
        "Find the flawed strokes of a library, give the reasons, and write a contact sheet of all strokes.",
    ),
    Deferred(
        "train",
        "frida_painter.cli.training",
        "Train a stroke model on a library. It predicts a stroke's mark from its thickness, length and bend.",
    ),
    Deferred(
        "evaluate",
        "frida_painter.cli.evaluation",
        "Measure the error of a stroke model on strokes that were really painted.",
    ),
)


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        no_args_is_help=True,
        help="Collect a library of strokes, and train and test stroke models on it.",
        cls=group_of(COMMANDS),
    )
    app.add_typer(group, name="strokes")
