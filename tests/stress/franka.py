"""Everything that a Franka of franky-sim is asked to do, measured: touch, a painting, stops, a reflex, a power cut.

    make stress PROGRAM=franka OPTIONS="--strokes 60"

The whole program works, in processes of its own, over franky's network protocol: `calibrate surface` feels a tilted
table, `paint` follows it. The positions of the tip come from the simulator's true joint angles and the table that
Franka publishes, so that neither the driver's model nor the simulator's judges. A stroke counts if the tip went down
and along it in its turn.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from frida_painter.brush.kinds import stroke_path
from frida_painter.calibration import Calibration
from frida_painter.easel.guard import GuardedRobot
from frida_painter.errors import MotionFailed, RobotError, RobotStopped
from frida_painter.hardware.gateway import MotionLimits
from frida_painter.hardware.latch import Latch
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.preset import find_preset
from frida_painter.hardware.robot import Waypoints
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.strokes.plan import Plan
from frida_painter.virtual.bristles import find_brush
from frida_painter_drivers.franka import FrankaRobot
from support import data

sys.path.insert(0, str(Path(__file__).parents[1]))
import contextlib

from machines.driven_arm import DrivenArm, DrivenPainting, before_the_arm, to_segment
from machines.driven_arm import paint as paint_in_studio
from machines.franky_arm import BRUSH, HEIGHT, FrankyArm, table_height, tip_positions
from machines.newcomer import DEEPER, FIFTEEN, Newcomer, check_files, in_this_process, over_canvas, rehearse
from support.virtual_painting import VirtualPainting

WORST = 3e-4
"""Greatest root mean square of the tip's distance from the strokes, metres."""
TILT = (0.02, -0.03)
"""Slope of the table along x and y."""
HOME = (0.40, 0.0, 0.30)
_THIN = 10  # milliseconds between two places of a tip in the virtual studio
_STANDS = 2e-6  # metres in a millisecond; a slower tip creeps back to where its motors hold it
_NEAR = 0.001  # metres above the table at which the tip counts as on the canvas
_PRESS = 0.004
_WORKSPACE = f"""
easel = "franky-sim"
[bounds]
lower = [0.30, -0.30, {HEIGHT - 0.01}]
upper = [0.65, 0.30, 0.45]
[canvas]
width = 0.14
height = 0.10
corner = [0.43, -0.07, {HEIGHT}]
turn = 0.0
[brush]
touch_height = {HEIGHT}
press_height = {HEIGHT - _PRESS}
[paint]
wells = [[0.36, -0.10, {HEIGHT}], [0.36, -0.05, {HEIGHT}]]
water = [0.36, 0.02, {HEIGHT}]
rag = [0.36, 0.12, {HEIGHT}]
rag_width = 0.04
[motion]
hover = 0.02
painting_speed = 0.03
travel_speed = 0.2
home = [0.40, 0.0, 0.30]
"""
_PLAN = ("--render-height", "64", "--effort", "0.05", "--brush", "fine", "--colors", "2")


@dataclass(frozen=True)
class Painted:
    """Strokes painted in their turn, root mean square and greatest distance from them (m), and simulated seconds."""

    strokes: int
    rms: float
    worst: float
    seconds: float


@dataclass(frozen=True)
class Stop:
    """Stop in motion: real milliseconds until the arm heard it; the arm's own until it stood; greatest way, metres."""

    heard: float
    stood: int
    way: float


def main() -> int:
    """Measures and prints the figures. Returns 1 if one of them is not as wanted."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--strokes", type=int, default=60, help="of the painting without a camera")
    options.add_argument("--seen", type=int, default=12, help="strokes of the painting in the closed loop")
    asked = options.parse_args()
    with tempfile.TemporaryDirectory() as place, FrankyArm(Path(place), tilt=TILT) as arm:
        folder = Path(place)
        prepare(folder)
        off = touch(folder, arm)
        print(f"touch: five points; the map is {1000 * off:.2f} mm off the true table at most", flush=True)
        found = paint(folder, arm, asked.strokes)
        print(
            f"painting: {found.strokes} of {asked.strokes} strokes in {found.seconds:.0f} s of the arm; tip "
            f"{1000 * found.rms:.3f} mm off (root mean square), {1000 * found.worst:.3f} mm at most",
            flush=True,
        )
        stops = [stop(arm, speed) for speed in (0.03, 0.1, 0.2)]
        for speed, one in zip((0.03, 0.1, 0.2), stops, strict=True):
            print(
                f"stop at {speed} m/s: heard after {one.heard:.1f} ms, stood {one.stood} ms later, after "
                f"{1000 * one.way:.1f} mm",
                flush=True,
            )
        refused = reflex(folder, arm)
        print(f"reflex: {refused or 'refused until a person cleared it at the arm and armed the robot'}", flush=True)
    with tempfile.TemporaryDirectory() as place:
        thought, moved = set_up(Path(place))
        print(
            f"setup by a newcomer: {thought / 60:.1f} min of thinking and pressing, {moved / 60:.1f} min of motion",
            flush=True,
        )
    with tempfile.TemporaryDirectory() as place:
        seen = closed_loop(Path(place), asked.seen, 2)
        print(
            f"closed loop in the virtual studio: {seen.strokes} of {asked.seen} strokes, {seen.looks} looks; tip "
            f"{1000 * seen.rms:.3f} mm off (root mean square), {1000 * seen.worst:.3f} mm at most",
            flush=True,
        )
    with tempfile.TemporaryDirectory() as place:
        wrong = power_cut(Path(place))
    cut = wrong or "refused until armed, then resumed; all strokes but the broken one are painted"
    print(f"power cut in a stroke: {cut}")
    good = found.strokes == asked.strokes and found.rms < WORST and off < 5e-4
    good = good and seen.strokes == asked.seen and seen.rms < WORST and thought + moved <= FIFTEEN
    return 0 if good and all(one.heard < 100 for one in stops) and not refused and not wrong else 1


def set_up(folder: Path) -> tuple[float, float]:
    """Returns the seconds of thinking and of motion that a newcomer takes for `setup`."""
    thought = [0.0]

    def think(seconds: float) -> None:
        thought[0] += seconds

    height, near = find_preset("franka").lift.touch + DEEPER, 8e-4
    with FrankyArm(folder, table=False) as arm, pytest.MonkeyPatch.context() as patched:
        person = Newcomer(think, height, arm.address, folder / "easel", near)
        with in_this_process(patched, folder, None):
            rehearse(person, "franka", lambda event: None)
        joints = arm.joints()
    workcell = check_files(folder / "easel", "franka", height, near=near)
    low = over_canvas(1000 * tip_positions(joints, brush=0.0), workcell)[:, 2].min()
    assert low == pytest.approx(1000 * workcell.press_height, abs=0.5), "the hardest stroke, and nothing lower"
    return thought[0], float((np.abs(np.diff(joints, axis=0)).max(1) > 1e-7).sum()) / 1000


def prepare(folder: Path) -> None:
    """Writes the workspace and the picture."""
    (folder / "easel.toml").write_text(_WORKSPACE)
    Image.fromarray(data.coffee()).resize((140, 100)).save(folder / "coffee.png")


def command(folder: Path, *words: str, said: str = "") -> subprocess.CompletedProcess[str]:
    """Returns the result of a command, with a person who types `said`."""
    return subprocess.run(
        [sys.executable, "-m", "frida_painter", *words],
        cwd=folder,
        env={
            **os.environ,
            "XDG_STATE_HOME": str(folder / "state"),
            "XDG_DATA_HOME": str(folder / "data"),
            "FRIDA_PAINTER_STOPS": "",
        },
        input=said,
        capture_output=True,
        text=True,
        check=False,
    )


def require_done(run: subprocess.CompletedProcess[str]) -> None:
    """Raises RuntimeError with the words of a command that failed."""
    if run.returncode != 0:
        raise RuntimeError(f"exit status {run.returncode}: {(run.stdout + run.stderr).strip()[-800:]}")


def at(arm: FrankyArm) -> tuple[str, ...]:
    """Returns the options that name the arm and its workspace."""
    return ("--robot", f"franka:{arm.address},brush_length={BRUSH}", "--camera", "none", "--workspace", "easel.toml")


def touch(folder: Path, arm: FrankyArm) -> float:
    """Has the arm feel the canvas; returns how far the map is from the true table at most, metres."""
    record = ("--brush", "fine", "--record", "easel.json")
    require_done(command(folder, "calibrate", "surface", *at(arm), *record, said="y\n" * 9))
    workcell = WorkcellConfig.load(folder / "easel.toml")
    surface = Calibration.load(folder / "easel.json").surface
    assert surface is not None
    size = workcell.canvas
    places = np.array([(x, y) for x in np.linspace(0, size.width, 5) for y in np.linspace(0, size.height, 5)])
    there = workcell.workspace.to_robot(places, np.zeros(len(places)))[:, :2]
    return float(np.abs(workcell.touch_height + surface.at(places) - table_height(there, TILT)).max())


def paint(folder: Path, arm: FrankyArm, strokes: int) -> Painted:
    """Paints a picture of so many strokes, without a camera. Raises RuntimeError if that fails."""
    since, out = len(arm.joints()), folder / "painting"
    words = ("paint", "coffee.png", *_PLAN, "--strokes", str(strokes), *at(arm), "--calibration", "easel.json")
    require_done(command(folder, *words, "--out", str(out), "--yes", "--no-film"))
    tips = tip_positions(arm.joints()[since:])
    assert json.loads((out / "result.json").read_text())["strokes_painted"] == strokes
    workcell, known = WorkcellConfig.load(folder / "easel.toml"), Calibration.load(folder / "easel.json")
    return judge(tips, sent(Plan.load(out / "plan.json"), Motion(workcell.workspace, known), known))


def closed_loop(folder: Path, strokes: int, replans: int, colors: int = 3) -> DrivenPainting:
    """Paints in the virtual studio: its brush is where the tip of the simulated Franka is."""
    layout = before_the_arm(0.06, 0.42, HEIGHT, find_brush("fine").press_depth / 1000)
    with FrankyArm(folder, table=False) as arm:
        robot = FrankaRobot(arm.address, layout.home, layout.workspace.travel_speed, brush_length=BRUSH)
        seen, read = [np.empty((0, 3))], 0

        def tips() -> np.ndarray:
            nonlocal read
            if len(fresh := arm.joints()[read::_THIN]):
                seen.append(tip_positions(fresh))
                read += _THIN * len(fresh)
            return np.concatenate(seen)

        driven = DrivenArm(robot, tips, lambda: len(arm.joints()) / 1000)
        return paint_in_studio(driven, layout, strokes, replans, VirtualPainting.made(), colors)


def stop(arm: FrankyArm, speed: float) -> Stop:
    """Stops the arm in motion, from another thread."""
    robot = FrankaRobot(arm.address, HOME, brush_length=BRUSH)
    robot.connect()
    robot.follow(Waypoints("above", np.array([[0.4, -0.1, 0.25]]), 0.2))
    asked, before = [], len(arm.stops())

    def press() -> None:
        while arm.tip()[1] < 0.0:
            time.sleep(0.002)
        asked.append(time.monotonic())
        robot.stop()

    thread = threading.Thread(target=press)
    thread.start()
    with contextlib.suppress(RobotStopped):
        robot.follow(Waypoints("stroke", np.array([[0.4, -0.1, 0.25], [0.4, 0.25, 0.25]]), speed))
    thread.join()
    robot.close()
    step, when = arm.stops()[before]
    _wait_for(arm, step + 1500)
    tips = tip_positions(arm.joints()[step - 1 : step + 1500])
    moving = np.flatnonzero(np.linalg.norm(tips[5:] - tips[:-5], axis=1) > 5 * _STANDS)
    way = float(np.linalg.norm(tips - tips[0], axis=1).max())
    return Stop(1000 * (when - asked[0]), int(moving[-1]) + 5 if len(moving) else 0, way)


def reflex(folder: Path, arm: FrankyArm) -> str:
    """Has the arm run into something; returns what was wrong, "" if nothing."""
    workspace = WorkcellConfig.load(folder / "easel.toml").workspace
    latch = Latch(folder / "stopped" / "studio.json", "studio")
    robot = GuardedRobot(FrankaRobot(arm.address, HOME, brush_length=BRUSH), MotionLimits(workspace), latch)
    robot.connect()
    robot.home()

    def run_into_something() -> None:
        while arm.tip()[1] > 0.1 or arm.tip()[2] > 0.26:
            time.sleep(0.002)
        arm.order(mode="kReflex", errors=[7], abort="kReflexAborted")

    bump = threading.Thread(target=run_into_something)
    robot.follow(Waypoints("above", np.array([[0.45, 0.2, 0.25]]), 0.2))
    bump.start()
    try:
        robot.follow(Waypoints("stroke", np.array([[0.45, 0.2, 0.25], [0.45, -0.2, 0.25]]), 0.05))
        return "the motion ended as if nothing had been"
    except MotionFailed:
        pass
    bump.join()
    robot.close()
    moves = arm.moves()
    for cleared, armed in ((False, True), (True, False)):
        arm.order(mode=None if cleared else "kReflex", errors=[] if cleared else [7])
        if armed:
            latch.release()
        elif latch.read() is None:
            latch.engage("a reflex")
        again = GuardedRobot(FrankaRobot(arm.address, HOME, brush_length=BRUSH), MotionLimits(workspace), latch)
        try:
            again.connect()
            again.home()
            return f"it moved although it was {'not armed' if cleared else 'not cleared'}"
        except RobotError:
            again.close()
    if arm.moves() != moves or arm.recoveries():
        return "it moved or recovered by itself"
    latch.release()
    again = GuardedRobot(FrankaRobot(arm.address, HOME, brush_length=BRUSH), MotionLimits(workspace), latch)
    again.connect()
    again.home()
    again.close()
    return ""


def power_cut(folder: Path, strokes: int = 4) -> str:
    """Kills the simulation in a stroke, starts it again, arms and resumes; returns what was wrong, "" if nothing."""
    prepare(folder)
    out = folder / "painting"
    with FrankyArm(folder) as arm:
        words = ("paint", "coffee.png", *_PLAN, "--strokes", str(strokes), *at(arm), "--out", str(out), "--yes")
        cut = threading.Thread(target=_cut_in_a_stroke, args=(arm,), daemon=True)
        cut.start()
        broken = command(folder, *words, "--no-film")
        cut.join(1)
        joints, address = arm.joints()[-1], arm.address
    if broken.returncode == 0 or "Franka" not in broken.stderr + broken.stdout:
        return f"the painting ended with {broken.returncode}: {broken.stderr[-200:]}"
    with FrankyArm(folder, start=joints.tolist(), address=address) as arm:
        if command(folder, "resume", str(out), "--yes").returncode == 0 or arm.moves():
            return "it went on although nobody armed the robot"
        require_done(command(folder, "arm", "--yes"))
        require_done(command(folder, "resume", str(out), "--yes"))
    painted = json.loads((out / "result.json").read_text())["strokes_painted"]
    # Without a camera nobody sees how much of the broken stroke is there: it is left out.
    return "" if painted in (strokes - 1, strokes) else f"{painted} of {strokes} strokes were painted"


def _cut_in_a_stroke(arm: FrankyArm) -> None:
    """Kills the simulation as the tip is on the canvas for the second time."""
    visits, on_it = 0, False
    while visits < 2:
        tip = tip_positions(arm.joints()[-1:])[0]
        touching = bool(tip[0] > 0.42 and tip[2] < HEIGHT)
        visits, on_it = visits + (touching and not on_it), touching
        time.sleep(0.01)
    arm.kill()


def _wait_for(arm: FrankyArm, step: int) -> None:
    while len(arm.joints()) < step:
        time.sleep(0.02)


def sent(plan: Plan, motion: Motion, known: Calibration) -> list[np.ndarray]:
    """Returns the path [k, 3] of each stroke on the canvas, robot frame, in painting order."""
    paths = []
    for part in plan.filled_layers():
        for index in range(len(part)):
            place, thickness = stroke_path(part.strokes, index, step=0.0005)
            height = known.height(thickness) + known.unevenness(place)
            paths.append(motion.workspace.to_robot(known.place(place), height))
    return paths


def judge(tips: np.ndarray, paths: list[np.ndarray]) -> Painted:
    """Compares the tip at every millisecond [n, 3] with the paths of the strokes."""
    over = (tips[:, 0] > 0.40) & (tips[:, 2] < table_height(tips[:, :2], TILT) + _NEAR)
    edges = np.flatnonzero(np.diff(np.r_[False, over, False].astype(int)))
    visits = [tips[start:end] for start, end in zip(edges[::2], edges[1::2], strict=True)]
    done, apart = 0, []
    for visit, path in zip(visits, paths, strict=False):
        up = np.array([0, 0, _NEAR])
        there = np.concatenate([path[:1] + up, path, path[-1:] + up])  # down to it, and up from it
        seen = visit[::5]
        off = np.min([to_segment(seen, one, other) for one, other in pairwise(there)], 0)
        left_out = max(np.linalg.norm(visit - point, axis=1).min() for point in path)
        done += left_out < 0.002
        apart.append(off)
    if len(visits) != len(paths):
        done = min(done, len(visits))
    away = np.concatenate(apart)
    return Painted(done, float(np.sqrt((away**2).mean())), float(away.max()), len(tips) / 1000)


if __name__ == "__main__":
    sys.exit(main())
