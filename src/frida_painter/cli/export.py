"""The command that writes plans for other programs and for machines: export."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from frida_painter.errors import ConfigError
from frida_painter.options.numbers import number


class ExportFormat(StrEnum):
    """What a plan can be turned into."""

    svg = "svg"
    gcode = "gcode"
    csv = "csv"


class Flavour(StrEnum):
    """What understands the G-code."""

    grbl = "grbl"
    marlin = "marlin"


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("export")(export)


PlanFile = Annotated[
    Path, typer.Argument(metavar="PLAN", help="A plan.json, or the folder of a painting.", show_default=False)
]


def export(
    plan: PlanFile,
    to: Annotated[
        ExportFormat,
        typer.Option(
            "--to",
            metavar="KIND",
            help="svg: for Inkscape and plotters; gcode: for GRBL and Marlin machines; csv: a table.",
        ),
    ] = ExportFormat.svg,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The file to write. [dim]strokes.svg, .gcode or .csv[/]")
    ] = None,
    regroup: Annotated[
        bool,
        typer.Option(help="svg: one layer per paint even where paints come back later (changes what lies on top)."),
    ] = False,
    dips: Annotated[
        bool, typer.Option(help="svg: a pause, as a layer of its own, wherever the brush is dipped (AxiDraw).")
    ] = False,
    flavour: Annotated[
        Flavour | None, typer.Option(metavar="NAME", help="gcode: grbl or marlin. [dim]grbl[/]", show_default=False)
    ] = None,
    press: Annotated[
        float | None,
        typer.Option(parser=number, metavar="MM", help="gcode: how deep the hardest press is; 0 for a pen. [dim]2[/]"),
    ] = None,
    lift: Annotated[
        float | None, typer.Option(parser=number, metavar="MM", help="gcode: how high the brush travels. [dim]5[/]")
    ] = None,
    workspace: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="gcode: where the wells stand (TOML), for a machine that dips by itself."),
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(metavar="FILE", help="gcode, with --workspace: the easel's calibration record.")
    ] = None,
) -> None:
    """Write the strokes of a plan in millimetres.

    SVG has a layer per paint, CSV a row per stroke. G-code has its zero at the canvas's bottom-left
    corner, with the brush at the lightest touch at Z0, and waits (M0) whenever the brush has to be
    dipped; with --workspace its zero is the workspace's, and the machine dips, rinses and wipes itself.
    """
    from frida_painter.cli.plan_export import write_gcode, write_svg, write_table

    path = out or Path(f"strokes.{to.value}")
    if path.suffix.lower() != f".{to.value}":
        raise ConfigError(f"--out was given {str(path)!r}; with --to {to.value} the file ends in .{to.value}.")
    _refuse_strangers(to, {"svg": {"--regroup": regroup, "--dips": dips}, "gcode": {"--flavour": flavour is not None,
                      "--press": press is not None, "--lift": lift is not None, "--workspace": workspace is not None,
                      "--calibration": calibration is not None}})  # fmt: skip
    match to:
        case ExportFormat.svg:
            written = write_svg(plan, path, keep_order=not regroup, dips=dips)
        case ExportFormat.gcode:
            dialect = (flavour or Flavour.grbl).value
            written = write_gcode(plan, path, dialect, press, lift, workspace, calibration)
        case ExportFormat.csv:
            written = write_table(plan, path)
    typer.echo(f"{len(written)} strokes in {len(written.palette)} paints: {path}")


def _refuse_strangers(to: ExportFormat, given: dict[str, dict[str, bool]]) -> None:
    """Raises ConfigError where an option was given that says nothing about this kind of file."""
    for kind, options in given.items():
        for option, is_given in options.items():
            if is_given and kind != to.value:
                raise ConfigError(f"{option} was given with --to {to.value}; it is for --to {kind}; leave it out.")
