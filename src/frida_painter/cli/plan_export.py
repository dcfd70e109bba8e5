"""What `export` writes: a plan as SVG, as G-code, as a table."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from frida_painter import storage
from frida_painter.brush.weights import load_stroke_models
from frida_painter.errors import ConfigError, WorkspaceViolation
from frida_painter.export.bezier import plan_widths
from frida_painter.export.gcode import gcode
from frida_painter.export.svg import svg
from frida_painter.export.table import table
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.robot import Waypoints
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.plan import Plan
from frida_painter.runs.folder import drying_of
from frida_painter.session.brushwork import choreography_at
from frida_painter.session.choreography import Action, BrushLoad, Choreography
from frida_painter.session.events import Dipped, StrokePainted
from frida_painter.session.flatbed_workspace import FlatbedWorkspace
from frida_painter.session.opening import loaded_record
from frida_painter.session.rehearsal import rehearse


def write_svg(plan: Path, out: Path, *, keep_order: bool, dips: bool) -> Plan:
    """The plan as an SVG with a layer per paint; dips: with a pause wherever the brush is dipped."""
    loaded = Plan.load(plan)
    widths = plan_widths(loaded, load_stroke_models(loaded.brushes))
    marks = set(_dipped(_actions(loaded, FlatbedWorkspace()))) if dips else set()
    storage.write_text(out, svg(loaded, widths, keep_order=keep_order, dips=marks))
    return loaded


def write_gcode(
    plan: Path,
    out: Path,
    dialect: str,
    press: float | None,
    lift: float | None,
    workspace: Path | None,
    calibration: Path | None,
    drying: float | None,
) -> Plan:
    """The plan as a program in that dialect of G-code. press, lift: millimetres, only without a workspace;
    drying: minutes for which a layer dries, None for as long as the painting says.

    Raises ConfigError, and WorkspaceViolation where the plan cannot be painted in that workspace.
    """
    loaded = Plan.load(plan)
    dries = drying_of(plan) if drying is None else 60 * drying
    if workspace is None and calibration is None:
        flatbed = FlatbedWorkspace(
            FlatbedWorkspace.press if press is None else press / 1000,
            FlatbedWorkspace.lift if lift is None else lift / 1000,
        )
        language = Gcode(dialect, flatbed.travel_speed)
        program = gcode(loaded, _actions(loaded, flatbed), language, pauses=True, drying=dries)
    else:
        if press is not None or lift is not None:
            raise ConfigError("--press and --lift are the workspace's to say; leave them out with --workspace.")
        program = _program(loaded, workspace, calibration, dialect, dries)
    storage.write_text(out, program)
    return loaded


def write_table(plan: Path, out: Path) -> Plan:
    """The plan as CSV, a row per stroke."""
    loaded = Plan.load(plan)
    storage.write_text(out, table(loaded))
    return loaded


def _program(plan: Plan, workspace: Path | None, calibration: Path | None, dialect: str, drying: float) -> str:
    """All of a painting for a machine with wells. Raises WorkspaceViolation, where any of it cannot be done there."""
    if workspace is None:
        raise ConfigError("--calibration was given without --workspace; say where the wells stand as well.")
    workcell = WorkcellConfig.load(workspace)
    first, *others = plan.brushes
    known = workcell.calibration(first, others=others)
    if calibration is not None:
        known = loaded_record(calibration, known, simulated=False)
    found = rehearse(plan, workcell.workspace, workcell.canvas, known, workcell.reach)
    if not found.passed:
        raise WorkspaceViolation(
            f"Not all of this plan can be painted in the workspace {str(workspace)!r}, and nothing was written; "
            f"`frida-painter check PLAN --workspace {workspace}` tells what."
        )
    choreography = choreography_at(workcell.workspace, known, plan.brushes, simulated=False)
    actions = choreography.actions(plan, BrushLoad(), 0, len(plan))
    language = Gcode(dialect, workcell.workspace.travel_speed)
    motion, cleaning = choreography.motion, choreography.cleaning()
    if workcell.workspace.rack is None:
        return gcode(plan, actions, language, pauses=False, ending=cleaning, drying=drying)

    def change(held: str, brush: str) -> tuple[Waypoints, ...]:
        return (*(cleaning if held else ()), *motion.change(held, brush))

    last = plan.filled_layers()[-1].layers[0].brush if len(plan) else first
    ending = (*cleaning, motion.put_back(last))
    return gcode(plan, actions, language, pauses=False, ending=ending, drying=drying, change=change)


def _actions(plan: Plan, flatbed: FlatbedWorkspace) -> list[Action]:
    """What painting the plan at a flatbed takes, beginning with a clean brush."""
    choreography = Choreography.of(flatbed.motion(plan.canvas), plan.brushes)
    return list(choreography.actions(plan, BrushLoad(), 0, len(plan)))


def _dipped(actions: list[Action]) -> Iterator[int]:
    """Indices of the strokes before which the brush is dipped."""
    for before, action in pairwise(actions):
        if isinstance(before.done, Dipped) and isinstance(action.done, StrokePainted):
            yield action.done.done - 1
