"""Work of `export` and `check`: writes plans for other programs, and checks if a plan can be painted."""

import sys
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.brush.kinds import stroke_path
from frida_painter.brush.weights import load_models_of
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.connecting import examine_robot
from frida_painter.easel.kinds import NO_CAMERA, VIRTUAL, easel_kind, is_machine, is_simulated, state_folder
from frida_painter.easel.open import find_reach, make_robot, open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.virtual_easel import studio_brush
from frida_painter.errors import ConfigError, RobotError, WorkspaceViolation
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import PersonCanvas, PersonStroke
from frida_painter.hardware.gcode import Gcode, read_own
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Examination, LooseRobot, Reach, TimedRobot, Waypoints, Workspace
from frida_painter.hardware.timing import AxisTiming, Timing, TravelLimits
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.render.exporter import ExporterKind, ExportOptions
from frida_painter.render.painting import render_plan
from frida_painter.report.gcode import gcode
from frida_painter.report.sheets import offending_strokes
from frida_painter.report.vector import letter, plan_widths, svg, table
from frida_painter.runs.painting_folder import spec_beside
from frida_painter.session.choreography import DRYING, Action, BrushLoad, Choreography, Timetable, reckon
from frida_painter.session.events import Dipped, StrokePainted
from frida_painter.session.hand import choreography_at
from frida_painter.session.open_loop import NOBODY_LOOKS
from frida_painter.session.opening import load_record
from frida_painter.session.rehearsal import FlatbedWorkspace, Rehearsal, rehearse
from frida_painter.session.time_left import duration
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter.system.devices import prepare_process
from frida_painter.system.storage import count_of

# A plan in all its detail, as a hand without noise would paint it in the virtual studio.

_STEP = 0.001  # of a path, metres
_PACE = 10.0  # seconds between strokes, as those of the studio's robot


def lay_with_bristles(plan: Plan, rows: int) -> NDArray[np.uint8] | None:
    """Returns the plan [rows, columns, 3], sRGB, as bristles lay it; None if the studio has no such brush."""
    from frida_painter.virtual.bristles import brush_names  # loads compiled loops
    from frida_painter.virtual.studio import StudioSettings, open_studio

    brushes = {name: studio_brush(name) for name in plan.brushes}
    if not set(brushes.values()) <= set(brush_names()):
        return None
    columns = PixelGrid.of_height(plan.canvas, rows).columns
    settings = StudioSettings(ground=plan.ground, print_pixels=max(rows, columns))
    operator = open_studio(plan.canvas, settings=settings).easel.operator
    assert isinstance(operator, PersonCanvas)
    number = 0
    for part in plan.filled_layers():
        operator.let_dry(DRYING)
        operator.fill_wells(part.palette)
        for index, well in enumerate(part.paint.tolist()):
            place, press = stroke_path(part.strokes, index, step=_STEP)
            upright, number = np.zeros(len(press)), number + 1
            brush = brushes[part.layers[0].brush]
            operator.paint_stroke(PersonStroke(number, brush, well, place, press, upright, upright, _PACE))
    laid = operator.print_canvas()
    return np.asarray(cv2.resize(np.asarray(laid), (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)


# Exporters of plans: SVG, G-code and a table.


def _make_svg(plan: Plan, options: ExportOptions) -> str:
    """Returns the plan as an SVG with a layer per paint; with `dips`, a pause at each dip of the brush."""
    if options.refill is not None and not options.dips:
        raise ConfigError("--refill says where the brush is dipped, and an SVG shows that with --dips only; give both.")
    widths = plan_widths(plan, load_models_of(plan))
    marks = set()
    if options.dips:
        for before, action in pairwise(_actions(plan, FlatbedWorkspace(), options)):
            if isinstance(before.done, Dipped) and isinstance(action.done, StrokePainted):
                marks.add(action.done.done - 1)
    text = letter(plan.canvas, options.title, options.signature)
    return svg(plan, widths, keep_order=not options.regroup, dips=marks, lettering=text)


def _make_gcode(plan: Plan, options: ExportOptions) -> str:
    """Returns the plan as a G-code program.

    press, lift: millimetres, only without a workspace.
    own: file of a person's own G-code.
    drying: drying time of a layer in minutes. None: that of the painting.
    Raises ConfigError, and WorkspaceViolation if the plan cannot be painted in that workspace.
    """
    dialect, press, lift = options.flavour or DIALECTS[0], options.press, options.lift
    if dialect not in DIALECTS:
        raise ConfigError(f"--flavour was given {dialect[:40]!r}; it is one of {', '.join(DIALECTS)}.")
    settled = DRYING if options.source is None else 60 * spec_beside(options.source).drying
    dries = settled if options.drying is None else 60 * options.drying
    if options.workspace is None and options.calibration is None:
        flatbed = FlatbedWorkspace(
            FlatbedWorkspace.press if press is None else press / 1000,
            FlatbedWorkspace.lift if lift is None else lift / 1000,
        )
        motion = flatbed.motion(plan.canvas)
        language = Gcode(dialect, flatbed.travel_speed, own=read_own(options.own, motion.workspace))
        actions, text = _actions(plan, flatbed, options), _lettering(plan, options, motion)
        return gcode(plan, actions, language, pauses=True, drying=dries, lettering=text)
    if press is not None or lift is not None:
        raise ConfigError("--press and --lift are the workspace's to say; leave them out with --workspace.")
    return _program(plan, options, dialect, dries)


DIALECTS = ("grbl", "marlin")
_FOR_BOTH = ("refill", "title", "signature")
SVG = ExporterKind("svg", "Paths in millimetres for plotters.", _make_svg, ("regroup", "dips", *_FOR_BOTH))
GCODE = ExporterKind(
    "gcode",
    "A program for GRBL and Marlin machines.",
    _make_gcode,
    ("flavour", "press", "lift", "workspace", "calibration", "drying", "own", *_FOR_BOTH),
)
CSV = ExporterKind("csv", "A table with one row per stroke.", lambda plan, options: table(plan))


def _program(plan: Plan, options: ExportOptions, dialect: str, drying: float) -> str:
    """Returns the program for a machine with wells.

    Raises WorkspaceViolation if a part of the plan cannot be painted.
    """
    workspace = options.workspace
    if workspace is None:
        raise ConfigError("--calibration was given without --workspace; say where the wells stand as well.")
    workcell = WorkcellConfig.load(workspace)
    first, *others = plan.brushes
    known = _load_record(options.calibration, workcell.calibration(first, others=others))
    found = rehearse(plan, workcell.workspace, workcell.canvas, known, workcell.reach)
    if not found.passed:
        raise WorkspaceViolation(
            f"Not all of this plan can be painted in the workspace {str(workspace)!r}, and nothing was written; "
            f"`frida-painter check PLAN --workspace {workspace}` tells what."
        )
    choreography = choreography_at(workcell.workspace, known, plan.brushes, simulated=False, refill=_refill(options))
    actions = choreography.actions(plan, BrushLoad(), 0, len(plan))
    language = Gcode(dialect, workcell.workspace.travel_speed, own=read_own(options.own, workcell.workspace))
    motion, cleaning = choreography.motion, choreography.cleaning()
    text = _lettering(plan, options, motion)
    if workcell.workspace.rack is None:
        return gcode(plan, actions, language, pauses=False, ending=cleaning, drying=drying, lettering=text)

    def change(held: str, brush: str) -> tuple[Waypoints, ...]:
        return (*(cleaning if held else ()), *motion.change(held, brush))

    last = plan.filled_layers()[-1].layers[0].brush if len(plan) else first
    ending = (*cleaning, motion.put_back(last))
    return gcode(plan, actions, language, pauses=False, ending=ending, drying=drying, change=change, lettering=text)


def _lettering(plan: Plan, options: ExportOptions, motion: Motion) -> list[Waypoints]:
    """Returns the motions of a pen that touches the canvas lightly."""
    lines = letter(plan.canvas, options.title, options.signature)
    return [motion.line(f"line {at} of the lettering", line, np.zeros(len(line))) for at, line in enumerate(lines, 1)]


def _refill(options: ExportOptions) -> float | None:
    """Returns the millimetres of a dip: those given, else the painting's own."""
    return options.refill or (None if options.source is None else spec_beside(options.source).refill)


def _actions(plan: Plan, flatbed: FlatbedWorkspace, options: ExportOptions) -> list[Action]:
    """Returns the actions of painting the plan on a flatbed, beginning with a clean brush."""
    choreography = Choreography.of(flatbed.motion(plan.canvas), plan.brushes, _refill(options))
    return list(choreography.actions(plan, BrushLoad(), 0, len(plan)))


_TOLD = 12  # faults; the picture shows all
_ROWS = 900
_SOME_CAMERA = "opencv:0"  # a person's easel needs one; nothing is photographed here


def check_plan(
    plan: Path, robot: str | None, workspace: Path | None, calibration: Path | None, out: Path, camera: str = ""
) -> bool:
    """Returns True if all of the plan can be painted.

    Otherwise prints the faults and draws their strokes into `out`.
    camera: name of the easel's camera. "": that of the painting that the plan belongs to.
    """
    prepare_process()
    loaded = Plan.load(plan)
    there = _place(loaded, robot, workspace)
    place = there.workspace
    settings = spec_beside(plan)
    camera = camera or settings.camera
    known = _load_record(calibration, there.calibration, camera)
    if camera == NO_CAMERA:
        print(NOBODY_LOOKS)
    found = rehearse(loaded, place, there.canvas, known, there.reach, there.travel)
    found = replace(found, mismatches=(*there.refusals, *found.mismatches))
    if found.passed:
        print(
            f"{count_of(len(loaded), 'stroke')} in {count_of(len(loaded.palette), 'paint')}: all of it can be painted."
        )
        choreography = choreography_at(place, known, loaded.brushes, simulated=there.simulated, refill=settings.refill)
        _tell_time(reckon(loaded, choreography, BrushLoad(), timing=there.timing, drying=60 * settings.drying))
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
    """Data of an easel for a check; nothing moves.

    refusals: sentences of a controller that cannot paint like this
    """

    workspace: Workspace
    canvas: CanvasSize
    calibration: Calibration
    reach: Reach | None
    timing: Timing | AxisTiming | None
    simulated: bool
    travel: TravelLimits | None = None
    refusals: tuple[str, ...] = ()


def _tell_play(driver: LooseRobot, workcell: WorkcellConfig) -> None:
    """Prints how far the play of a robot's gears lets its tip be off over the canvas."""
    size = workcell.canvas
    corners = np.array([(0, 0), (size.width, 0), (size.width, size.height), (0, size.height)], np.float64)
    play = driver.play(workcell.workspace.to_robot(corners, np.full(4, workcell.touch_height)))
    if np.isfinite(play).any():
        print(
            f"The play of its gears lets the tip be up to {1000 * np.nanmax(play):.1f} mm off on this canvas; fine "
            "strokes waver by as much."
        )


def _place(plan: Plan, robot: str | None, workspace: Path | None) -> _Place:
    """Returns the place of painting: the workspace of that file, or that of a robot with its own workspace."""
    first, *others = plan.brushes
    if workspace is not None:
        workcell = WorkcellConfig.load(workspace)
        reach: Reach | None = workcell.reach
        timing: Timing | AxisTiming | None = None
        told: Examination | None = None
        if robot is not None and is_machine(robot):
            driver = make_robot(robot, workcell.workspace)
            reach = find_reach(workcell, driver)
            timing = driver.timing() if isinstance(driver, TimedRobot) else None
            if isinstance(driver, LooseRobot):
                _tell_play(driver, workcell)
            try:
                told = examine_robot(robot, workcell.workspace)
            except RobotError as silent:
                print(f"Its controller could not be asked, so its own limits are not checked: {silent}")
            for fact in () if told is None else told.facts:
                if fact.weight == "warning":
                    print(f"Warning: {fact.text}")
            timing = timing if told is None or told.timing is None else told.timing
        kind = None if robot is None else easel_kind(robot)
        if kind is not None and kind.reach_from is not None:  # its base is the workspace's origin
            reach, timing = kind.reach_from(workcell.workspace, workcell.canvas)
        known, simulated = workcell.calibration(first, others=others), robot is not None and is_simulated(robot)
        travel, facts = (None, ()) if told is None else (told.travel, told.facts)
        refusals = tuple(fact.text for fact in facts if fact.weight == "refusal")
        return _Place(workcell.workspace, workcell.canvas, known, reach, timing, simulated, travel, refusals)
    if robot is not None and is_machine(robot):
        raise ConfigError(f"Where things stand around {robot[:60]!r} is not known; say it with --workspace FILE.")
    order = EaselOrder(robot or VIRTUAL, plan.canvas, plan.brushes, state_folder(), camera=_SOME_CAMERA)
    easel = open_easel(order).easel
    return _Place(easel.workspace, easel.canvas, easel.calibration, easel.reach, easel.timing, easel.simulated)


def _load_record(record: Path | None, default: Calibration, camera: str = "") -> Calibration:
    """Returns the easel's record. Raises CalibrationError if it is of another easel, brush, camera or canvas.

    camera: that looks while the plan is painted. "": that of the record, because none looks here.
    """
    if record is None:
        return default
    camera = camera or Calibration.load(record).camera
    return load_record(record, replace(default, camera=camera))


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
    parts |= {name: time for name, time in (("changing brushes", table.changes), ("drying", table.drying)) if time}
    spent = ", ".join(f"{name} {duration(seconds)}" for name, seconds in parts.items())
    print(f"The robot takes {duration(table.total)} without looks and planning: {spent}.")
