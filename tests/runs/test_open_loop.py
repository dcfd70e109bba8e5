"""A hundred strokes without a camera on a GRBL that is played, killed in mid-stroke and resumed.

The points that the machine was sent are compared with the curve of each planned stroke. That curve is written here
once more, from the paper: a cubic Bezier on the canvas, and the brush's height as another (0.2, h, h, 0.2).
"""

import contextlib
import os
import re
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from filelock import FileLock
from numpy.typing import NDArray
from PIL import Image

from frida_painter.brush.kinds import FINE
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import state_folder
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.latch import latches
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.controls import Controls
from frida_painter.session.fold import PaintingState
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.system.event_log import EventLog
from killing import _read_pictures_alone
from machines.bench import tell_zero
from machines.grbl import GRBL, QUICK, GrblController
from machines.simulated_time import Living
from marks import coarse_table
from support.plans import made_up_strokes

TRUE_PHOTOGRAPHS = True

EXACT = 1e-6  # metres by which a point may lie beside the curve of its stroke, or above or below it
COUNT, KILLED = 100, 41  # strokes; the one in which it is killed
SIZE = CanvasSize(0.14, 0.1)
FAST, SLOW = 400.0, 0.02  # times as fast as real; slow enough to be stopped within a stroke
Points = NDArray[np.float64]


class Machine:
    """A GRBL that is played: its workspace, and the points that it is sent, in the robot's metres.

    In the middle of the wanted stroke it becomes slow, and says so by a file, which another process can see.
    """

    workspace = example().replace("width = 0.3556", "width = 0.14").replace("height = 0.2794", "height = 0.1")

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.in_the_stroke = folder / "in-the-stroke"
        (folder / "easel.toml").write_text(self.workspace)
        self.cell = WorkcellConfig.load(folder / "easel.toml")
        self.slows, self.low, self.strokes, self.points = True, False, 0, 0

    def keep(self, place: Points) -> float:
        """Keeps a point [3] that it is sent, in a file; returns how fast it goes there, times as fast as real."""
        with (self.folder / "sent.txt").open("a") as file:
            file.write(" ".join(map(repr, place.tolist())) + "\n")
        low = self.is_low(place)
        self.strokes += int(low and not self.low)
        self.points = self.points + 1 if low and self.low else 0
        self.low = low
        if self.strokes == KILLED and self.points == 3 and self.slows:
            self.in_the_stroke.touch()
        return SLOW if self.slows and self.in_the_stroke.exists() else FAST

    def is_low(self, place: Points) -> bool:
        """True if the brush touches the canvas there."""
        origin = np.array(self.cell.workspace.canvas_origin)
        across, up = place[:2] - origin[:2]
        inside = -0.001 < across < SIZE.width + 0.001 and -0.001 < up < SIZE.height + 0.001
        return bool(inside and place[2] < self.cell.touch_height - 1e-7)

    def sent(self) -> Points:
        """All points that it was sent, [k, 3]."""
        return np.loadtxt(self.folder / "sent.txt", ndmin=2)

    @contextlib.contextmanager
    def played(self) -> Iterator[str]:
        """Plays the machine; yields its name, as --robot has it."""
        machine = self

        class Kept(GrblController):
            def _execute(self, text: str) -> None:
                if text.startswith("G1X"):
                    living.pace = machine.keep(_of_gcode(text))
                super()._execute(text)

            def hear(self, content: bytes) -> None:
                if b"!" in content:
                    machine.slows, living.pace = False, FAST  # it brakes at its own rate
                super().hear(content)

        living = Living(Kept(GRBL, QUICK), pace=FAST, step=0.05)
        with living:
            tell_zero(Gcode("grbl"), living.name, (0.1, -0.25, 0.25))
            yield f"gcode:{living.name}"


def _of_gcode(line: str) -> Points:
    """The place of a G1, in metres; these lines name all axes."""
    return np.array([float(re.search(rf"{axis}(-?[\d.]+)", line)[1]) for axis in "XYZ"]) / 1000  # type: ignore[index]


def strokes_of(sent: Points, machine: Machine) -> list[Points]:
    """The points of each stroke that was begun, in order: those between two ways through the air."""
    found: list[list[Points]] = []
    before = False
    for place in sent:
        low = machine.is_low(place)
        if low and not before:
            found.append([])
        if low:
            found[-1].append(place)
        before = low
    return [np.array(each) for each in found]


def curve(plan: Plan, index: int, machine: Machine) -> Points:
    """The way of the brush's tip in one stroke, as the paper has it, densely: [20001, 3] in the robot's metres."""
    values = {
        name: plan.strokes.arrays()[name][index].double().numpy()
        for name in ("position", "angle", "length", "bend", "thickness")
    }
    t = np.linspace(0, 1, 20001)[:, None]
    weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    length, bend, angle = (float(values[name]) for name in ("length", "bend", "angle"))
    flat = weights @ np.array([(0, 0), (length / 3, bend), (2 * length / 3, bend), (length, 0)])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    press = weights @ np.array([0.2, values["thickness"], values["thickness"], 0.2])
    height = machine.cell.touch_height + press * (machine.cell.press_height - machine.cell.touch_height)
    corner = np.array(machine.cell.workspace.canvas_origin[:2])
    return np.c_[corner + values["position"] + flat @ turn.T, height]


def require_exact(points: Points, way: Points, *, whole: bool) -> None:
    """Every point lies on the way, they follow it in order, and a whole stroke has all of it."""
    off = np.linalg.norm(points[:, None, :2] - way[None, :, :2], axis=2)
    nearest = off.argmin(1)
    worst = max(float(off.min(1).max()), float(np.abs(points[:, 2] - way[nearest, 2]).max()))
    assert worst <= EXACT + 2e-6, f"{1000 * worst:.4f} mm beside its stroke"  # the curve is taken at 20001 places
    assert (np.diff(nearest) >= 0).all(), "it goes along the stroke, and never back"
    if whole:
        ends = np.linalg.norm(points[[0, -1], :2] - way[[0, -1], :2], axis=1)
        assert (ends <= EXACT).all(), "it begins and ends where planned"
        assert np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).max() <= 1.1e-3, "and leaves nothing out"


def a_plan() -> Plan:
    """A hundred random strokes in two paints, of which the darker is painted last."""
    torch.manual_seed(5)
    strokes = replace(made_up_strokes(COUNT, 3, SIZE).project(FINE.limits, SIZE))
    palette = Palette.sort_light_to_dark(torch.tensor([[0.9, 0.6, 0.2], [0.1, 0.2, 0.4]]))
    paint = (torch.arange(COUNT) >= COUNT // 2).long()
    return Plan.of(strokes, palette, paint, canvas=SIZE, brush="fine", limits=FINE.limits)


def kill_in_the_stroke(machine: Machine, work: Callable[[], Any]) -> None:
    """Does the work in a process that is killed while the machine is in the middle of the wanted stroke."""
    child = os.fork()
    if child == 0:
        try:
            _read_pictures_alone()
            work()
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(1)
    until = time.monotonic() + 120
    while not machine.in_the_stroke.exists() and os.waitpid(child, os.WNOHANG) == (0, 0):
        time.sleep(0.01)
    assert machine.in_the_stroke.exists(), "the stroke never came"
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    while not (held := latches(state_folder())) and time.monotonic() < until:
        time.sleep(0.05)
    assert held, "the easel's process stopped the machine, and nobody may move it before a person has looked"
    held[0].release()
    machine.slows = False
    for path in state_folder().rglob("*.lock"):  # it ends a moment later
        with FileLock(path, timeout=60, preserve_lock_file=True):
            pass


def told(folder: Path) -> PaintingState:
    return PaintingState.of_journal(EventLog.read(folder / "journal"), folder)


def test_a_hundred_strokes_are_sent_as_planned_and_none_twice_after_a_kill(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fault F1: the painting process is killed in mid-stroke."""
    monkeypatch.setattr("frida_painter.planning.materials.cached_table", coarse_table)
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (140, 100), (200, 180, 90)).save("goal.png")
    machine, plan, folder, asked = Machine(tmp_path), a_plan(), tmp_path / "it", list[str]()
    with machine.played() as name:
        spec = RunSpec.of(
            goal=[{"image": "goal.png"}], strokes=COUNT, colors=2, brush="fine", render_height=64, robot=name,
            camera="none", workspace=tmp_path / "easel.toml", film=False, layers=1,
        )  # fmt: skip

        def paint() -> None:
            with PaintingRun(spec, folder, controls=Controls(answer=lambda question: True)) as run:
                run.start(plan)

        kill_in_the_stroke(machine, paint)
        assert (told(folder).progress.painted, told(folder).progress.in_doubt) == (KILLED - 1, KILLED)
        with PaintingRun.reopen(folder) as run:

            def look(question: Any) -> bool:
                asked.append(question.text)
                return True

            run.controls = Controls(answer=look, repaint=lambda number, picture: True)
            outcome = run.resume()
    assert not [text for text in asked if "does not know where its brush is" in text], "it knows where it stands"
    assert outcome.trouble is None and outcome.page is not None
    history = told(folder)
    assert history.end.finished and history.progress.painted == COUNT and history.sittings.count == 2
    assert history.progress.given_up == []
    assert {planning.plan for planning in history.planning.adopted} == {plan.digest}, "nothing was planned again"
    found = strokes_of(machine.sent(), machine)
    before, again = list(range(KILLED)), list(range(KILLED - 1, COUNT))
    assert len(found) == len(before) + len(again), "every stroke once, and the one in doubt as it was decided"
    for number, (index, points) in enumerate(zip([*before, *again], found, strict=True)):
        require_exact(points, curve(plan, index, machine), whole=number != KILLED - 1)  # it was killed in that one
