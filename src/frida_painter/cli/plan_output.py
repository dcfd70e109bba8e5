"""Work of `export` and `check`: writes plans for other programs, and checks if a plan can be painted."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from frida_painter import images, storage
from frida_painter.brush.weights import load_stroke_models
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.devices import prepare_process
from frida_painter.easel.kinds import MACHINES, SIMULATED, VIRTUAL, easel_kind, require_known, state_folder
from frida_painter.easel.open import make_robot, open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.errors import ConfigError, WorkspaceViolation
from frida_painter.export.gcode import gcode
from frida_painter.export.vector import plan_widths, svg, table
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.robot import Reach, Timing, Waypoints, Workspace
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.plan import Plan
from frida_painter.render.painting import render_plan
from frida_painter.report.sheets import offending_strokes
from frida_painter.runs.painting_folder import drying_of
from frida_painter.session.choreography import Action, BrushLoad, Choreography, reckon
from frida_painter.session.events import Dipped, StrokePainted, Timetable
from frida_painter.session.hand import choreography_at
from frida_painter.session.opening import load_record
from frida_painter.session.rehearsal import FlatbedWorkspace, Rehearsal, rehearse
from frida_painter.session.time_left import duration
from frida_painter.storage import count_of

# Output of `export`: a plan as SVG, G-code or a table.


def write_svg(plan: Path, out: Path, *, keep_order: bool, dips: bool) -> Plan:
    """Writes the plan as an SVG with a layer per paint; with `dips`, a pause at each dip of the brush."""
    loaded = Plan.load(plan)
    widths = plan_widths(loaded, load_stroke_models(loaded.brushes))
    marks = set(_find_dips(_actions(loaded, FlatbedWorkspace()))) if dips else set()
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
    """Writes the plan as a G-code program in that dialect.

    press, lift: millimetres, only without a workspace.
    drying: drying time of a layer in minutes. None: that of the painting.
    Raises ConfigError, and WorkspaceViolation if the plan cannot be painted in that workspace.
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
    """Writes the plan as CSV, one row per stroke."""
    loaded = Plan.load(plan)
    storage.write_text(out, table(loaded))
    return loaded


def _program(plan: Plan, workspace: Path | None, calibration: Path | None, dialect: str, drying: float) -> str:
    """Returns the program for a machine with wells.

    Raises WorkspaceViolation if a part of the plan cannot be painted.
    """
    if workspace is None:
        raise ConfigError("--calibration was given without --workspace; say where the wells stand as well.")
    workcell = WorkcellConfig.load(workspace)
    first, *others = plan.brushes
    known = workcell.calibration(first, others=others)
    if calibration is not None:
        known = load_record(calibration, known, simulated=False)
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
    """Returns the actions of painting the plan on a flatbed, beginning with a clean brush."""
    choreography = Choreography.of(flatbed.motion(plan.canvas), plan.brushes)
    return list(choreography.actions(plan, BrushLoad(), 0, len(plan)))


def _find_dips(actions: list[Action]) -> Iterator[int]:
    """Yields the indices of strokes that follow a dip."""
    for before, action in pairwise(actions):
        if isinstance(before.done, Dipped) and isinstance(action.done, StrokePainted):
            yield action.done.done - 1


_TOLD = 12  # faults; the picture shows all
_ROWS = 900
_SOME_CAMERA = "opencv:0"  # a person's easel needs one; nothing is photographed here


def check_plan(plan: Path, robot: str | None, workspace: Path | None, calibration: Path | None, out: Path) -> bool:
    """Returns True if all of the plan can be painted.

    Otherwise prints the faults and draws their strokes into `out`.
    """
    prepare_process()
    loaded = Plan.load(plan)
    there = _place(loaded, robot, workspace)
    place = there.workspace
    known = _load_record(calibration, there.calibration)
    found = rehearse(loaded, place, there.canvas, known, there.reach)
    if found.passed:
        print(
            f"{count_of(len(loaded), 'stroke')} in {count_of(len(loaded.palette), 'paint')}: all of it can be painted."
        )
        choreography = choreography_at(place, known, loaded.brushes, simulated=there.simulated)
        _tell_time(reckon(loaded, choreography, BrushLoad(), timing=there.timing, drying=drying_of(plan)))
        for name in loaded.brushes:
            print(f"The {name} brush is dipped again after {choreography.with_brush(name).brush.dip}.")
        return True
    _tell(found, len(loaded))
    if found.strokes:
        images.save(offending_strokes(loaded, render_plan(loaded, _ROWS), found.strokes), out)
        print(f"  The strokes in red: {out}", file=sys.stderr)
    return False


@dataclass(frozen=True)
class _Place:
    """Data of an easel for a check; no device is opened."""

    workspace: Workspace
    canvas: CanvasSize
    calibration: Calibration
    reach: Reach | None
    timing: Timing | None
    simulated: bool


def _place(plan: Plan, robot: str | None, workspace: Path | None) -> _Place:
    """Returns the place of painting: the workspace of that file, or that of a robot with its own workspace."""
    first, *others = plan.brushes
    if workspace is not None:
        workcell = WorkcellConfig.load(workspace)
        if robot is not None and require_known(robot) in MACHINES:
            make_robot(robot, workcell.workspace)  # only to raise its errors
        reach: Reach | None = workcell.reach
        timing: Timing | None = None
        kind = None if robot is None else easel_kind(robot)
        if kind is not None and kind.reach_from is not None:  # its base is the workspace's origin
            reach, timing = kind.reach_from(workcell.workspace, workcell.canvas)
        known, simulated = workcell.calibration(first, others=others), robot in SIMULATED
        return _Place(workcell.workspace, workcell.canvas, known, reach, timing, simulated)
    if robot is not None and require_known(robot) in MACHINES:
        raise ConfigError(f"Where things stand around {robot[:60]!r} is not known; say it with --workspace FILE.")
    order = EaselOrder(robot or VIRTUAL, plan.canvas, plan.brushes, 0, state_folder(), camera=_SOME_CAMERA)
    easel = open_easel(order).easel
    return _Place(easel.workspace, easel.canvas, easel.calibration, easel.reach, easel.timing, easel.simulated)


def _load_record(record: Path | None, default: Calibration) -> Calibration:
    """Returns the easel's record. Raises CalibrationError if it is of another easel, brush or canvas."""
    if record is None:
        return default
    return load_record(record, default, simulated=False)


def _tell(found: Rehearsal, strokes: int) -> None:
    print("This plan cannot be painted here:", file=sys.stderr)
    faults = [*found.others, *found.strokes.values()]
    told = [*found.mismatches, *(f"{fault.label}: {fault.reason}" for fault in faults)]
    for line in told[:_TOLD]:
        print(f"  {line}", file=sys.stderr)
    if len(told) > _TOLD:
        print(f"  and {len(told) - _TOLD} more", file=sys.stderr)
    if found.strokes:
        print(f"  {len(found.strokes)} of {count_of(strokes, 'stroke')} are concerned.", file=sys.stderr)
    for remedy in dict.fromkeys(fault.remedy for fault in faults):
        print(f"  What to do: {remedy}.", file=sys.stderr)


def _tell_time(table: Timetable) -> None:
    parts = {"strokes": table.strokes, "dips": table.dips, "washing": table.washing, "travel": table.travel}
    if table.changes:
        parts["changing brushes"] = table.changes
    if table.drying:
        parts["drying"] = table.drying
    spent = ", ".join(f"{name} {duration(seconds)}" for name, seconds in parts.items())
    print(f"The robot takes {duration(table.total)} without looks and planning: {spent}.")
