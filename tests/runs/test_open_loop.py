"""A hundred strokes without a camera on each kind of machine that is played, killed in mid-stroke and resumed.

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
from frida_painter.errors import ZeroUnknown
from frida_painter.event_log import EventLog
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.latch import latches
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.controls import Controls
from frida_painter.session.journal import History
from killing import _read_pictures_alone
from machines.bench import tell_zero
from machines.ebb import Ebb
from machines.grbl import GRBL, QUICK, GrblController
from machines.marlin import Build, MarlinController
from machines.simulated_time import Living
from machines.xarm_box import XarmBox, use_ports
from marks import coarse_table
from support.plans import made_up_strokes
from support.plotter import PLOTTER

TRUE_PHOTOGRAPHS = True

COUNT, KILLED = 100, 41  # strokes; the one in which it is killed
SIZE = CanvasSize(0.14, 0.1)
FAST, SLOW = 400.0, 0.02  # times as fast as real; slow enough to be stopped within a stroke
Points = NDArray[np.float64]


class Machine:
    """A machine that is played: its name, its workspace, and the points that it is sent, in the robot's metres.

    In the middle of the wanted stroke it becomes slow, and says so by a file, which another process can see.
    exact: metres by which a point may lie beside the curve of its stroke, or above or below it.
    """

    workspace = example().replace("width = 0.3556", "width = 0.14").replace("height = 0.2794", "height = 0.1")
    exact = 1e-6
    loses_zero = False

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.in_the_stroke = folder / "in-the-stroke"
        (folder / "easel.toml").write_text(self.workspace)
        self.cell = WorkcellConfig.load(folder / "easel.toml")
        self.slows, self.low, self.strokes, self.points = True, False, 0, 0

    @contextlib.contextmanager
    def played(self) -> Iterator[str]:
        """Plays the machine; yields its name, as --robot has it."""
        raise NotImplementedError
        yield ""

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


class Grbl(Machine):
    @contextlib.contextmanager
    def played(self) -> Iterator[str]:
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


class Marlin(Machine):
    """A machine that may lose steps when it is stopped (M410): a person confirms that the tip is where it says."""

    loses_zero = True

    @contextlib.contextmanager
    def played(self) -> Iterator[str]:
        machine = self

        class Kept(MarlinController):
            def _move(self, words: dict[str, float]) -> None:
                if set("XYZ") <= set(words):
                    living.pace = machine.keep(np.array([words[axis] for axis in "XYZ"]) / 1000)
                super()._move(words)

            def hear(self, content: bytes) -> None:
                if b"M410" in content:
                    machine.slows, living.pace = False, FAST
                super().hear(content)

        wide = Build(lowest=(-1000.0, -1000.0, -1000.0), highest=(1000.0, 1000.0, 1000.0))
        living = Living(Kept(wide), pace=FAST, step=0.05)
        with living:
            tell_zero(Gcode("marlin"), living.name, (0.1, -0.25, 0.25))
            yield f"marlin:{living.name}"


class Plotter(Machine):
    """A plotter: its points are whole steps of 1/80 mm (8.8 um off at most) on chords of 1 mm between waypoints."""

    workspace = PLOTTER
    exact = 2.5e-5

    @contextlib.contextmanager
    def played(self) -> Iterator[str]:
        machine = self

        class Kept(Ebb):
            sent = np.zeros(3)

            def _obey(self, name: str, values: list[str]) -> None:
                if name == "QS":  # a stop has dropped what was sent and not done
                    first, second = self.count
                    self.sent[:2] = np.array([first + second, second - first]) / 160_000
                if name == "S2" and int(values[0]):
                    self.sent[2] = -0.002 + (int(values[0]) - 9855) / (27831 - 9855) * 0.012
                if name == "XM":
                    self.sent[:2] += np.array([int(values[1]), -int(values[2])]) / 80_000
                    self.pace = machine.keep(self.sent.copy())
                super()._obey(name, values)

            def pass_time(self, seconds: float) -> None:
                if not machine.slows:
                    self.pace = FAST
                super().pass_time(seconds)

        with Kept(self.folder / "plotter", pace=FAST) as board:
            yield f"axidraw:{board.port},servo=-0.002/9855/0.010/27831"


class Xarm(Machine):
    """The maker's SDK, in the easel's process, speaks to a control box in this one."""

    @contextlib.contextmanager
    def played(self) -> Iterator[str]:
        machine = self

        class Kept(XarmBox):
            def _queue_line(self, values: tuple[float, ...]) -> None:
                self.pace = machine.keep(np.array(values[:3]) / 1000)
                super()._queue_line(values)

            def _obey(self, register: int, values: bytes) -> bytes:
                if not machine.slows:
                    self.pace = FAST
                return super()._obey(register, values)

        with Kept(pace=FAST) as box, pytest.MonkeyPatch.context() as patch:
            box.pose[:3] = (100.0, -250.0, 250.0)
            use_ports(box, patch)
            yield "xarm:127.0.0.1"


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


def require_exact(points: Points, way: Points, machine: Machine, *, whole: bool) -> float:
    """Every point lies on the way, they follow it in order, and a whole stroke has all of it; the largest distance."""
    off = np.linalg.norm(points[:, None, :2] - way[None, :, :2], axis=2)
    nearest = off.argmin(1)
    worst = max(float(off.min(1).max()), float(np.abs(points[:, 2] - way[nearest, 2]).max()))
    assert worst <= machine.exact + 2e-6, (
        f"{1000 * worst:.4f} mm beside its stroke"
    )  # the curve is taken at 20001 places
    assert (np.diff(nearest) >= 0).all(), "it goes along the stroke, and never back"
    if whole:
        ends = np.linalg.norm(points[[0, -1], :2] - way[[0, -1], :2], axis=1)
        assert (ends <= machine.exact + 1.1e-3 * isinstance(machine, Plotter)).all(), "it begins and ends where planned"
        assert np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).max() <= 1.1e-3, "and leaves nothing out"
    return worst


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


def told(folder: Path) -> History:
    return History.of(EventLog.read(folder / "journal"), folder)


@pytest.mark.parametrize("repaint", [True, False], ids=["painted again", "given up"])
@pytest.mark.parametrize("kind", [Grbl, Marlin, Plotter, Xarm])
def test_a_hundred_strokes_are_sent_as_planned_and_none_twice_after_a_kill(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: type[Machine], repaint: bool
) -> None:
    """Fault F1: the painting process is killed in mid-stroke."""
    monkeypatch.setattr("frida_painter.runs.settle.cached_table", coarse_table)
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (140, 100), (200, 180, 90)).save("goal.png")
    machine, plan, folder, asked = kind(tmp_path), a_plan(), tmp_path / "it", list[str]()
    with machine.played() as name:
        spec = RunSpec.of(
            goal=[{"image": "goal.png"}], strokes=COUNT, colors=2, brush="fine", render_height=64, robot=name,
            camera="none", workspace=tmp_path / "easel.toml", film=False, layers=1,
        )  # fmt: skip

        def paint() -> None:
            with PaintingRun(spec, folder, controls=Controls(answer=lambda question: True)) as run:
                run.start(plan)

        kill_in_the_stroke(machine, paint)
        assert (told(folder).painted, told(folder).in_doubt) == (KILLED - 1, KILLED)
        with PaintingRun.reopen(folder) as run:

            def look(question: Any) -> bool:
                asked.append(question.text)
                return True

            run.controls = Controls(answer=look, repaint=lambda number, picture: repaint)
            outcome = run.resume()
    zeros = [text for text in asked if "does not know where its brush is" in text]
    assert len(zeros) == int(machine.loses_zero), "only a machine whose stop may lose steps asks where it stands"
    assert outcome.trouble is None and outcome.page is not None
    history = told(folder)
    assert history.finished and history.painted == COUNT and history.runs == 2
    assert history.given_up == ([] if repaint else [KILLED])
    assert {planning.digest for planning in history.plannings} == {plan.digest}, "nothing was planned again"
    found = strokes_of(machine.sent(), machine)
    before, again = list(range(KILLED)), [*([KILLED - 1] if repaint else []), *range(KILLED, COUNT)]
    assert len(found) == len(before) + len(again), "every stroke once, and the one in doubt as it was decided"
    worst = 0.0
    for number, (index, points) in enumerate(zip([*before, *again], found, strict=True)):
        whole = number != KILLED - 1  # it was killed in that one
        worst = max(worst, require_exact(points, curve(plan, index, machine), machine, whole=whole))
    print(f"{kind.__name__}: {len(found)} strokes of {len(machine.sent())} points, at most {1e6 * worst:.1f} um off")


def test_a_machine_that_lost_its_zero_is_not_resumed_before_a_person_has_found_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("frida_painter.runs.settle.cached_table", coarse_table)
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (140, 100), (200, 180, 90)).save("goal.png")
    (tmp_path / "easel.toml").write_text(PLOTTER)
    folder, asked = tmp_path / "it", []

    def answer(question: Any) -> bool:
        asked.append(question.text)
        return True

    with Ebb(tmp_path / "plotter", pace=FAST) as board:
        spec = RunSpec.of(
            goal=[{"image": "goal.png"}], strokes=4, colors=2, brush="fine", render_height=64, film=False, layers=1,
            robot=f"axidraw:{board.port},servo=-0.002/9855/0.010/27831", camera="none", workspace="easel.toml",
        )  # fmt: skip
        with PaintingRun(spec, folder) as run:
            session = lambda: run.session and run.session.so_far  # noqa: E731
            run.controls = Controls(answer=answer, stop_asked=lambda: bool(session() and session().painted >= 2))
            assert run.start(a_plan().part(slice(4))).trouble is None
        assert told(folder).painted == 2
        board.pull_out()
        board.plug_in()
        heard, asked[:] = len(board.received), []
        with PaintingRun.reopen(folder) as run, pytest.raises(ZeroUnknown, match="does not know where its brush is"):
            run.resume()
        assert not [line for line in board.received[heard:] if line.startswith("XM")], "nothing moved"
        with PaintingRun.reopen(folder) as run:
            run.controls = Controls(answer=answer)
            outcome = run.resume()
    assert outcome.trouble is None and told(folder).finished and told(folder).painted == 4
    assert "does not know where its brush is" in asked[0]
