"""The command that writes plans for other programs and for machines: export."""

from collections.abc import Iterator
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import typer

from frida_painter import storage
from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.weights import load_stroke_model
from frida_painter.calibration import Calibration
from frida_painter.cli.numbers import number
from frida_painter.errors import ConfigError, WorkspaceViolation
from frida_painter.export.bezier import mark_widths
from frida_painter.export.gcode import gcode
from frida_painter.export.svg import svg
from frida_painter.export.table import table
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.plan import Plan
from frida_painter.session.choreography import Action, BrushLoad, Choreography
from frida_painter.session.events import Dipped, StrokePainted
from frida_painter.session.flatbed_workspace import FlatbedWorkspace
from frida_painter.session.procedures.calibration_status import require
from frida_painter.session.refilling import refilled
from frida_painter.session.rehearsal import rehearse


class ExportFormat(StrEnum):
    """What a plan can be turned into."""

    svg = "svg"
    gcode = "gcode"
    csv = "csv"


class Flavour(StrEnum):
    """What understands the G-code."""

    grbl = "grbl"
    marlin = "marlin"


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
    path = out or Path(f"strokes.{to.value}")
    if path.suffix.lower() != f".{to.value}":
        raise ConfigError(f"--out was given {str(path)!r}; with --to {to.value} the file ends in .{to.value}.")
    _refuse_strangers(to, {"svg": {"--regroup": regroup, "--dips": dips}, "gcode": {"--flavour": flavour is not None,
                      "--press": press is not None, "--lift": lift is not None, "--workspace": workspace is not None,
                      "--calibration": calibration is not None}})  # fmt: skip
    loaded = Plan.load(plan)
    if to is ExportFormat.svg:
        widths = mark_widths(loaded.strokes, load_stroke_model(loaded.brush))
        marks = set(_dipped(_actions(loaded, FlatbedWorkspace()))) if dips else set()
        storage.write_text(path, svg(loaded, widths, keep_order=not regroup, dips=marks))
    elif to is ExportFormat.gcode:
        dialect = (flavour or Flavour.grbl).value
        if workspace is None and calibration is None:
            desk = FlatbedWorkspace(
                FlatbedWorkspace.press if press is None else press / 1000,
                FlatbedWorkspace.lift if lift is None else lift / 1000,
            )
            program = gcode(loaded, _actions(loaded, desk), Gcode(dialect, desk.travel_speed), pauses=True)
        else:
            if press is not None or lift is not None:
                raise ConfigError("--press and --lift are the workspace's to say; leave them out with --workspace.")
            program = _program(loaded, workspace, calibration, dialect)
        storage.write_text(path, program)
    else:
        storage.write_text(path, table(loaded))
    typer.echo(f"{len(loaded)} strokes in {len(loaded.palette)} paints: {path}")


def _refuse_strangers(to: ExportFormat, given: dict[str, dict[str, bool]]) -> None:
    """Raises ConfigError where an option was given that says nothing about this kind of file."""
    for kind, options in given.items():
        for option, is_given in options.items():
            if is_given and kind != to.value:
                raise ConfigError(f"{option} was given with --to {to.value}; it is for --to {kind}; leave it out.")


def _program(plan: Plan, workspace: Path | None, calibration: Path | None, dialect: str) -> str:
    """All of a painting for a machine with wells. Raises WorkspaceViolation, where any of it cannot be done there."""
    if workspace is None:
        raise ConfigError("--calibration was given without --workspace; say where the wells stand as well.")
    stand = WorkcellConfig.load(workspace)
    known = stand.calibration(plan.brush)
    if calibration is not None:
        record = Calibration.load(calibration)
        require(record, known, ())
        known = record
    found = rehearse(plan, stand.workspace, stand.canvas, known, stand.reach)
    if not found.passed:
        raise WorkspaceViolation(
            f"Not all of this plan can be painted in the workspace {str(workspace)!r}, and nothing was written; "
            f"`frida-painter check PLAN --workspace {workspace}` tells what."
        )
    brush = refilled(brush_kind(load_stroke_model(plan.brush).brush), known, simulated=False)
    choreography = Choreography(Motion(stand.workspace, known), brush)
    actions = choreography.actions(plan, BrushLoad(), 0, len(plan))
    language = Gcode(dialect, stand.workspace.travel_speed)
    return gcode(plan, actions, language, pauses=False, ending=choreography.cleaning())


def _actions(plan: Plan, desk: FlatbedWorkspace) -> list[Action]:
    """What painting the plan at a desk takes, beginning with a clean brush."""
    brush = brush_kind(load_stroke_model(plan.brush).brush)
    choreography = Choreography(desk.motion(plan.canvas), brush)
    return list(choreography.actions(plan, BrushLoad(), 0, len(plan)))


def _dipped(actions: list[Action]) -> Iterator[int]:
    """Indices of the strokes before which the brush is dipped."""
    for before, action in pairwise(actions):
        if isinstance(before.done, Dipped) and isinstance(action.done, StrokePainted):
            yield action.done.done - 1
