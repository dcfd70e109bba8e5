"""The commands about where things stand around a robot: check a plan there, print and draw workspaces."""

from pathlib import Path
from typing import Annotated

import typer

from frida_painter.errors import ConfigError
from frida_painter.options import out_file
from frida_painter.quantities import count_of

PictureOut = Annotated[Path, typer.Option(parser=out_file, metavar="FILE", help="The picture to write, .png or .jpg.")]


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("check")(check)
    group = typer.Typer(
        no_args_is_help=True,
        help="Describe the workspace of a robot: where canvas, wells, water and rag stand, in metres.",
    )
    group.command("example")(print_example)
    group.command("draw")(draw)
    app.add_typer(group, name="workspace")


def check(
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN", help="A plan.json, or the folder of a painting.", show_default=False)
    ],
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The robot to check, as in paint --robot. [dim]any robot in the workspace, or virtual[/]",
        ),
    ] = None,
    workspace: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The workspace file of the easel (TOML). [dim]the virtual studio's own[/]"),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The easel's calibration record. [dim]the heights of the workspace[/]"),
    ] = None,
    out: PictureOut = Path("check.png"),
) -> None:
    """Check whether a robot can paint a whole plan on an easel, and how long it takes. Nothing moves.

    Every motion is asked for: strokes, dips, rinses, wipes. Where something cannot be done, it is
    told, a picture shows the strokes in red, and the exit status is 1.
    """
    from frida_painter.cli.plan_check import check_plan

    _require_picture(out)
    if not check_plan(plan, robot, workspace, calibration, out):
        raise typer.Exit(1)


def print_example() -> None:
    """Print an example of a workspace file with comments. Save it as your own file and enter your measures."""
    from frida_painter.hardware.workcell import example

    print(example(), end="")


def draw(
    workspace: Annotated[Path, typer.Argument(metavar="FILE", help="A workspace file (TOML).", show_default=False)],
    out: PictureOut = Path("workspace.png"),
) -> None:
    """Draw a workspace from above. Compare the drawing with your table."""
    from frida_painter import images
    from frida_painter.hardware.workcell import WorkcellConfig
    from frida_painter.report.workspace_plan import workspace_plan

    _require_picture(out)
    workcell = WorkcellConfig.load(workspace)
    images.save(workspace_plan(workcell.workspace, workcell.canvas, workcell.easel), out)
    print(f"{workcell.easel}: {count_of(len(workcell.workspace.wells), 'well')}, canvas of {workcell.canvas}: {out}")


def _require_picture(out: Path) -> None:
    if out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ConfigError(f"--out was given {str(out)!r}; the picture ends in .png or .jpg.")
