"""The commands that print the paper's figures and tables, and more: experiments NAME, experiments list."""

import typer

from frida_painter.experiments.painting_commands import (
    composition,
    ladder,
    replanning,
    sawyer,
    semantic,
    sim2real,
    sketch,
    style,
    text,
)
from frida_painter.experiments.stroke_commands import (
    continuous_strokes,
    real_strokes,
    robustness,
    stroke_model,
    strokes_needed,
)


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        no_args_is_help=True,
        help="Run the experiments of the paper and more. Each command measures anew and writes tables and pictures.",
    )
    group.command("list")(list_all)
    for command in (
        continuous_strokes, stroke_model, strokes_needed, real_strokes, sim2real, ladder, replanning, robustness,
        sawyer, text, style, semantic, sketch, composition,
    ):  # fmt: skip
        group.command(command.__name__.replace("_", "-"))(command)
    app.add_typer(group, name="experiments")


def list_all(context: typer.Context) -> None:
    """List the experiments."""
    assert context.parent is not None
    for name, command in context.parent.command.commands.items():  # type: ignore[attr-defined]
        if name != "list":
            print(f"{name:20} {command.get_short_help_str(100)}")
