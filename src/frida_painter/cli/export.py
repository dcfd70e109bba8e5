"""The command that writes plans for other programs and for machines: export."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from frida_painter.errors import ConfigError
from frida_painter.options import number, number_within, out_file


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
            help="svg is for Inkscape and plotters, gcode for GRBL and Marlin machines, csv is a table.",
        ),
    ] = ExportFormat.svg,
    out: Annotated[
        Path | None,
        typer.Option(parser=out_file, metavar="FILE", help="The file to write. [dim]strokes.svg, .gcode or .csv[/]"),
    ] = None,
    regroup: Annotated[
        bool,
        typer.Option(
            help="svg: exactly one layer per paint in each layer of the plan, even if a paint returns later. Changes "
            "which strokes lie on top."
        ),
    ] = False,
    dips: Annotated[
        bool, typer.Option(help="svg: add a layer with a pause for every dip of the brush (AxiDraw).")
    ] = False,
    flavour: Annotated[
        Flavour | None,
        typer.Option(metavar="NAME", help="gcode: the dialect, grbl or marlin. [dim]grbl[/]", show_default=False),
    ] = None,
    press: Annotated[
        float | None,
        typer.Option(
            parser=number, metavar="MM", help="gcode: depth of the hardest press in mm; 0 for a pen. [dim]2[/]"
        ),
    ] = None,
    lift: Annotated[
        float | None, typer.Option(parser=number, metavar="MM", help="gcode: height of travel moves in mm. [dim]5[/]")
    ] = None,
    workspace: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="gcode: the workspace file (TOML), for a machine that dips by itself."),
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(metavar="FILE", help="gcode, with --workspace: the easel's calibration record.")
    ] = None,
    drying: Annotated[
        float | None,
        typer.Option(
            parser=number_within(0, 1440),
            metavar="MINUTES",
            help="gcode: how long a layer dries before the next one. [dim]as the painting's settings say, else 20[/]",
        ),
    ] = None,
) -> None:
    """Export the strokes of a plan as SVG, G-code or CSV, in millimetres.

    SVG has one layer per paint, and names the brush where there are several. CSV has one row per stroke.
    The zero of the G-code is the bottom-left corner of the canvas, and Z0 is the lightest touch. The machine
    pauses (M0) at every dip of the brush. With --workspace, the zero is that of the workspace, and the machine
    dips, rinses and wipes by itself.
    """
    from frida_painter.cli.plan_export import write_gcode, write_svg, write_table

    path = out or Path(f"strokes.{to.value}")
    if path.suffix.lower() != f".{to.value}":
        raise ConfigError(f"--out was given {str(path)!r}; with --to {to.value} the file ends in .{to.value}.")
    _refuse_strangers(to, {"svg": {"--regroup": regroup, "--dips": dips}, "gcode": {"--flavour": flavour is not None,
                      "--press": press is not None, "--lift": lift is not None, "--workspace": workspace is not None,
                      "--calibration": calibration is not None, "--drying": drying is not None}})  # fmt: skip
    match to:
        case ExportFormat.svg:
            written = write_svg(plan, path, keep_order=not regroup, dips=dips)
        case ExportFormat.gcode:
            dialect = (flavour or Flavour.grbl).value
            written = write_gcode(plan, path, dialect, press, lift, workspace, calibration, drying)
        case ExportFormat.csv:
            written = write_table(plan, path)
    typer.echo(f"{len(written)} strokes in {len(written.palette)} paints: {path}")


def _refuse_strangers(to: ExportFormat, given: dict[str, dict[str, bool]]) -> None:
    """Raises ConfigError where an option was given that says nothing about this kind of file."""
    for kind, options in given.items():
        for option, is_given in options.items():
            if is_given and kind != to.value:
                raise ConfigError(f"{option} was given with --to {to.value}; it is for --to {kind}; leave it out.")
