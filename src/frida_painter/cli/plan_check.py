"""What `check` does: asks for every motion of a plan, tells what cannot be done, and draws it."""

import sys
from dataclasses import dataclass
from pathlib import Path

from frida_painter import images
from frida_painter.calibration import Calibration
from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.reach import Reach
from frida_painter.hardware.timing import Timing
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.hardware.workspace import Workspace
from frida_painter.plan import Plan
from frida_painter.quantities import count_of
from frida_painter.render.plan_picture import render_plan
from frida_painter.report.offending_strokes import offending_strokes
from frida_painter.runs.folder import drying_of
from frida_painter.session.brushwork import choreography_at
from frida_painter.session.choreography import BrushLoad
from frida_painter.session.easel_order import EaselOrder
from frida_painter.session.easels import open_easel, robot_named
from frida_painter.session.forecast import duration
from frida_painter.session.names import MACHINES, SAWYER_SIM, SIMULATED, VIRTUAL, require_known, state_folder
from frida_painter.session.opening import loaded_record, prepare_process
from frida_painter.session.rehearsal import Rehearsal, rehearse
from frida_painter.session.timetable import Timetable
from frida_painter.session.timing import reckon
from frida_painter.virtual.sawyer.arm import TIMING
from frida_painter.virtual.sawyer.reach import SawyerReach

_TOLD = 12  # faults; the picture shows all
_ROWS = 900
_SOME_CAMERA = "opencv:0"  # a person's easel has to have one; nothing is photographed here


def check_plan(plan: Path, robot: str | None, workspace: Path | None, calibration: Path | None, out: Path) -> bool:
    """Whether all of the plan can be painted there; prints why not, and draws those strokes into `out`."""
    prepare_process()
    loaded = Plan.load(plan)
    there = _place(loaded, robot, workspace)
    place = there.workspace
    known = _known(calibration, there.calibration)
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
    """What a plan is checked against: an easel of which nothing is opened."""

    workspace: Workspace
    canvas: CanvasSize
    calibration: Calibration
    reach: Reach | None
    timing: Timing | None
    simulated: bool


def _place(plan: Plan, robot: str | None, workspace: Path | None) -> _Place:
    """Where it is to be painted: in the workspace of that file, or where a robot of that name knows its own."""
    first, *others = plan.brushes
    if workspace is not None:
        workcell = WorkcellConfig.load(workspace)
        if robot is not None and require_known(robot) in MACHINES:
            robot_named(robot, workcell.workspace)  # only to hear what is wrong with it
        reach: Reach | None = workcell.reach
        timing: Timing | None = None
        if robot == SAWYER_SIM:  # a Sawyer whose foot is the workspace's origin
            reach, timing = SawyerReach(workcell.workspace, workcell.canvas), TIMING
        known, simulated = workcell.calibration(first, others=others), robot in SIMULATED
        return _Place(workcell.workspace, workcell.canvas, known, reach, timing, simulated)
    if robot is not None and require_known(robot) in MACHINES:
        raise ConfigError(f"Where things stand around {robot[:60]!r} is not known; say it with --workspace FILE.")
    order = EaselOrder(robot or VIRTUAL, plan.canvas, plan.brushes, 0, state_folder(), camera=_SOME_CAMERA)
    easel = open_easel(order).easel
    return _Place(easel.workspace, easel.canvas, easel.calibration, easel.reach, easel.timing, easel.simulated)


def _known(record: Path | None, default: Calibration) -> Calibration:
    """The easel's record; refused where it is of another easel, brush or canvas."""
    if record is None:
        return default
    return loaded_record(record, default, simulated=False)


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
