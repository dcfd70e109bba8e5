"""Work of `trace` and `look`, for painting without a camera: outlines in the air, and a person's picture."""

from dataclasses import replace
from pathlib import Path

from frida_painter.calibration import Corners
from frida_painter.easel.connecting import allow_motions, connect_easel
from frida_painter.easel.dialogue import lead
from frida_painter.easel.kinds import NO_CAMERA
from frida_painter.errors import ConfigError, Interrupted
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.runs.look_folder import GivenPicture, LookFolder, check_picture, is_finished
from frida_painter.runs.painting_folder import history_of, read_spec
from frida_painter.runs.run import PaintingRun
from frida_painter.session.opening import load_record
from frida_painter.session.outline import plan_outlines, trace_outlines
from frida_painter.strokes.plan import Plan
from frida_painter.system import storage
from frida_painter_calibration.calibrating import easel_of
from frida_painter_calibration.options import EaselOptions
from frida_painter_calibration.procedures.paper import ask_for_corners
from frida_painter_cli.leading import confirm, tell
from frida_painter_cli.stop_signal import stop_on_signals
from frida_painter_cli.terminal import terminal_at

# Work of `trace`: the outlines of canvas and painting, in the air.


def trace_plan(plan: Path | None, robot: str, workspace: Path | None, record: Path | None, *, ask: bool) -> bool:
    """Traces the canvas, and the strokes of a plan, in the air; returns False if a person stopped it.

    ask: True if a person confirms that the way is free, and finds a lost zero.
    Raises WorkspaceViolation before anything moves, Interrupted if the person declines, RobotError and others.
    """
    loaded = None if plan is None else Plan.load(plan)
    size = f"{1000 * loaded.canvas.width}x{1000 * loaded.canvas.height}mm" if loaded and workspace is None else None
    named = EaselOptions(robot, NO_CAMERA, workspace, loaded.brushes[0] if loaded else "broad", size)
    with stop_on_signals() as stop, easel_of(named.describe()) as opened:
        known = opened.calibration
        if record is not None:
            known = load_record(record, known, simulated=opened.simulated)
        here = replace(opened, calibration=known)
        motions = plan_outlines(here, loaded)
        RobotGateway(here).check(motions)
        question = "The arm will lift, go round the canvas in the air, and move aside. Is its way free?"
        if ask and not confirm(question, default=None):
            raise Interrupted("Nothing was moved.")
        stop.at_once = here.robot.stop
        terminal = terminal_at(Path())
        here = connect_easel(here, terminal.answer if ask else allow_motions, print)
        try:
            whole = trace_outlines(here, motions, print, lambda: stop.asked)
        finally:
            here.robot.close()
    part, strokes = "" if whole else "a part of ", " and the strokes" if loaded else ""
    high = 1000 * (motions[1].position[0, 2] - known.touch_height)
    print(
        f"Traced {part}the canvas of {here.canvas}{strokes}, {high:.0f} mm above it. If the tip did not follow the "
        "edges, make [canvas] of the workspace true."
    )
    return whole


# Work of `look`: a person's picture of the canvas, for a painting without a camera.


def give_picture(folder: Path, picture: Path, corners: Corners | None, *, ask: bool) -> None:
    """Checks a picture of the canvas, and gives it to the painting in a folder, whether or not a painter is at work.

    corners: of the canvas in the picture; None if they are to be found
    ask: True if a person confirms the corners that were found
    Raises ConfigError if the painting has a camera or no stroke yet, FrameRejected and CalibrationError if the picture
    does not show this canvas, ImageError and StorageError.
    """
    spec = read_spec(folder)
    if spec.has_camera:
        raise ConfigError(
            f"The painting in {storage.abridge(folder)} has a camera ({spec.camera or 'of the virtual studio'}), which "
            "looks by itself; this command is for paintings with --camera none."
        )
    given = GivenPicture(picture, corners)
    if ask:
        pointing = ask_for_corners(given.load(), spec.canvas, corners)
        given = replace(given, corners=lead(pointing, terminal_at(folder).answer))
    seen = check_picture(folder, given)
    if is_finished(folder):
        history = history_of(folder)
        with PaintingRun.reopen(folder) as run:
            tell(run.show_picture(seen.canvas), history.progress.painted, history.sittings.seconds)
        return
    LookFolder(folder).put(picture, given.corners)
    print("It shows this canvas. The painter takes it between two strokes, and plans the rest again from it.")
