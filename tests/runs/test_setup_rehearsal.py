"""Rehearsal of a machine's setup over simulated controllers, in simulated time, by a person who has never done it.

The person reads a question for some seconds, then presses one key after another as the tip's place and the true place
ask for it; the keys go through the dialogue of the terminal. The machine moves at the rates of its own controller.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from readchar import key

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.cli.terminal import GuidingKeys, Terminal
from frida_painter.easel.dialogue import Answer, Choose, Confirm, Guide, Jog, SetupQuestion
from frida_painter.easel.guard import GuardedRobot
from frida_painter.easel.open import open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.latch import Unlatched
from frida_painter.hardware.preset import find_preset
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.runs import machine_setup, setup_dialogue
from frida_painter.runs.setup_dialogue import SetupEvent, SetupOrder, lead_setup
from frida_painter.session.events import Remark
from frida_painter.session.setup_events import SetupWritten
from machines.arm_bench import so101_bus
from machines.ebb import BRUSHLESS, EbbController
from machines.grbl import FLUIDNC, GRBL, QUICK, GrblController, router
from machines.marlin import PLAIN, MarlinController
from machines.simulated_time import SimulatedTime, simulated_time
from machines.sts_bus import tips
from machines.xarm_box import XarmBox, use_ports

__all__ = ["simulated_time"]  # a fixture
READING, PREPARING, PRESSING = 8.0, 30.0, 0.7  # seconds: of a question, of something at the machine, of a key
FIFTEEN = 15 * 60.0
CANVAS = CanvasSize(0.12, 0.09)
BESIDE = np.array([-0.0083, 0.0061])  # the true canvas, from where the preset proposes it
DEEPER, PRESSED = -0.0003, -0.0007  # the true touch, and the hardest press, from the preset's touch


class InProcess:
    """Easel in this process, for drivers that wait in simulated time; its robot is guarded as usual."""

    def __enter__(self) -> "InProcess":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def open(self, order: EaselOrder) -> Easel:
        easel = open_easel(order).easel
        return replace(easel, robot=GuardedRobot(easel.robot, easel.workspace, Unlatched("rehearsal")))


@dataclass
class Newcomer:
    """Person at the machine.

    spend: lets seconds pass
    touch: true height of the lightest touch, metres of the robot's frame
    port: name that is typed if it is not in the list
    """

    spend: Callable[[float], None]
    touch: float
    port: str
    folder: Path
    near: float = 0.0003  # metres from the true place at which the tip is there
    keys: int = 0
    asked: list[str] = field(default_factory=list)
    _question: Any = None
    _smaller: bool = False
    _target: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        self._terminal = Terminal(self._type, lambda line: None, self.folder, GuidingKeys(self._press))

    def answer(self, question: SetupQuestion) -> Answer:
        if not getattr(question, "again", False):
            self.asked.append(question.text)
            self.spend(PREPARING if "Done?" in question.text or "sheet of paper" in question.text else READING)
            if isinstance(question, Guide):
                self._target = self._true_place(question)
        self._question = question
        return self._terminal.answer(question)

    def _true_place(self, question: Guide) -> np.ndarray:
        place = np.array(question.position)
        if "bottom left" in question.text:
            place[:2] += BESIDE
        elif "well" in question.text or "water" in question.text or "rag" in question.text:
            place += 0.0016, -0.0012, 0.0
            place[2] = max(question.lower[2], self.touch) + 0.002
        return place

    def _type(self, prompt: str) -> str:
        self.spend(PRESSING)
        self.keys += 1
        match self._question:
            case Confirm(text=text):
                return "n" if "uneven" in text or "feel" in text else "y"
            case Choose(text=text):
                return "3" if "wells" in text else ""
            case Jog(text=text, height=height):
                left = height - (self.touch if "just touches" in text else self.touch + PRESSED)
                return "dd" if left > 0.006 else "d" if left > 0.0012 else "-" if left > 0.00015 else "ok"
        return self.port

    def _press(self) -> str:
        self.spend(PRESSING)
        self.keys += 1
        assert self.keys < 600, f"the person does not get on: {self._question}"
        if self._question.remark and not self._smaller:  # "Not moved": the step was too large
            self._smaller = True
            return "-"
        self._smaller = False
        off = self._target - np.array(self._question.position)
        axis = int(np.abs(off).argmax())
        if abs(off[axis]) < self.near:
            return str(key.ENTER)
        ahead = int(off[axis] > 0)
        return str(((key.LEFT, key.RIGHT), (key.DOWN, key.UP), (key.PAGE_DOWN, key.PAGE_UP))[axis][ahead])


def fluid() -> GrblController:
    machine = GrblController(FLUIDNC, {**QUICK, "22": 1, "130": 300.0, "131": 300.0, "132": 45.0, "25": 1500.0})
    machine.switches[:] = 278, 278, 39
    machine.stored[:] = -279, -279, -40
    return machine


MACHINES: dict[str, tuple[str, Callable[[], Any]]] = {
    "GRBL router": ("grbl-router", router),
    "GRBL router as it is sold": ("grbl-router", lambda: router({"1": 255})),  # 500 mm/min, 10 mm/s2
    "GRBL with a servo": ("grbl-plotter", lambda: GrblController(GRBL, {**QUICK, "32": 1, "30": 1000})),
    "iDraw 2": ("idraw2", lambda: GrblController(GRBL, QUICK)),
    "FluidNC": ("fluidnc", fluid),
    "Marlin": ("marlin-printer", lambda: MarlinController(PLAIN)),
    "AxiDraw": ("axidraw", lambda: EbbController("2.8.1")),
    "NextDraw": ("nextdraw", lambda: EbbController("3.0.3", lift=BRUSHLESS)),
}


@contextmanager
def in_this_process(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, clock: SimulatedTime | None) -> Iterator[None]:
    for name in ("DATA", "CONFIG", "STATE"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / name))
    monkeypatch.setattr(machine_setup, "EaselProcess", InProcess)
    monkeypatch.setattr(setup_dialogue, "list_ports", lambda preset: [])
    if clock is not None:
        monkeypatch.setattr(setup_dialogue, "time", clock)
    yield


def rehearse(person: Newcomer, preset: str, tell: Callable[[SetupEvent], None], canvas: CanvasSize = CANVAS) -> None:
    lead_setup(SetupOrder(preset=preset, canvas=canvas, folder=person.folder), person.answer, tell)


def check_files(
    folder: Path, preset: str, touch: float, canvas: CanvasSize = CANVAS, near: float = 3.1e-4
) -> WorkcellConfig:
    """The files say what was true of the table; the canvas was first proposed by the preset."""
    workcell, record = WorkcellConfig.load(folder / "workspace.toml"), Calibration.load(folder / "calibration.json")
    proposed = machine_setup.Layout.propose(find_preset(preset), canvas=canvas)
    assert workcell.workspace.canvas_origin[:2] == pytest.approx(np.array(proposed.corner[:2]) + BESIDE, abs=near)
    assert record.touch_height == pytest.approx(touch, abs=max(near, 3e-4))
    assert record.touch_height - record.press_height == pytest.approx(-PRESSED, abs=max(near, 4e-4))
    assert len(workcell.workspace.wells) == 3
    return workcell


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_a_newcomer_paints_the_first_stroke_within_fifteen_minutes(
    name: str, simulated_time: SimulatedTime, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    preset, make = MACHINES[name]
    machine = make()
    cable = simulated_time.attach(machine)
    known = find_preset(preset)
    touch = known.lift.touch + DEEPER
    person = Newcomer(simulated_time.sleep, touch, cable.name, tmp_path / "easel")
    begun, told = simulated_time.now, []
    with in_this_process(monkeypatch, tmp_path, simulated_time):
        rehearse(person, preset, told.append)
    took = simulated_time.now - begun
    workcell = check_files(tmp_path / "easel", preset, touch)
    assert isinstance(told[-1], SetupWritten)
    minutes = next(event.sentence for event in told if isinstance(event, Remark) and "minutes after" in event.sentence)
    print(f"{name}: {minutes} {took / 60:.1f} min to the end, {person.keys} keys, {len(person.asked)} questions")
    assert took <= FIFTEEN
    if known.lift.by == "axis":  # the height of a servo is no place of these controllers
        low = over_canvas(np.array(machine.moved), workcell)[:, 2].min()
        assert low == pytest.approx(1000 * workcell.press_height, abs=0.05), "the hardest stroke, and nothing lower"


def over_canvas(moved: np.ndarray, workcell: WorkcellConfig) -> np.ndarray:
    """Places of the tip [k, 3] (mm) over the canvas."""
    x, y = 1000 * np.array(workcell.workspace.canvas_origin[:2])
    across, up = 1000 * workcell.canvas.width, 1000 * workcell.canvas.height
    inside = (moved[:, 0] > x) & (moved[:, 0] < x + across) & (moved[:, 1] > y) & (moved[:, 1] < y + up)
    return moved[inside]


@pytest.mark.slow
def test_a_newcomer_sets_an_arm_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("xarm", reason="the extra `xarm` is not installed")
    thought = [0.0]

    def think(seconds: float) -> None:
        thought[0] += seconds

    touch = find_preset("xarm").lift.touch + DEEPER
    with XarmBox(pace=50) as box:
        use_ports(box, monkeypatch)
        person = Newcomer(think, touch, "127.0.0.1", tmp_path / "easel")
        with in_this_process(monkeypatch, tmp_path, None):
            rehearse(person, "xarm", lambda event: None)
        pauses = np.diff(np.array(box.at))
        moving = float(pauses[pauses < 0.5].sum())
    workcell = check_files(tmp_path / "easel", "xarm", touch)
    print(
        f"xArm: {thought[0] / 60:.1f} min of thinking and pressing, {moving / 60:.1f} min of motion, {person.keys} keys"
    )
    assert thought[0] + moving <= FIFTEEN
    low = over_canvas(np.array(box.moved)[:, :3], workcell)[:, 2].min()
    assert low == pytest.approx(1000 * workcell.press_height, abs=0.05)


@pytest.mark.slow
def test_a_newcomer_sets_a_hobbyists_arm_up(
    simulated_time: SimulatedTime, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for package in ("scservo_sdk", "mink"):
        pytest.importorskip(package, reason="the extra `so101` is not installed")
    bus, cable = so101_bus(simulated_time, monkeypatch, np.array([0.15, 0.0, 0.05]))
    touch, canvas, steps = find_preset("so101").lift.touch + DEEPER, CanvasSize(0.045, 0.09), 1.2e-3
    person = Newcomer(simulated_time.sleep, touch, cable.name, tmp_path / "easel", steps)
    begun, told = simulated_time.now, list[SetupEvent]()
    with in_this_process(monkeypatch, tmp_path, simulated_time):
        rehearse(person, "so101", told.append, canvas)
    took = simulated_time.now - begun
    workcell = check_files(tmp_path / "easel", "so101", touch, canvas, steps)
    assert isinstance(told[-1], SetupWritten) and took <= FIFTEEN
    print(f"SO-101: {took / 60:.1f} min to the end, {person.keys} keys, {len(person.asked)} questions")
    low = over_canvas(1000 * tips(np.array(bus.trace)), workcell)[:, 2].min()
    assert low == pytest.approx(1000 * workcell.press_height, abs=0.7), "a step of its servos is 0.3 mm at the tip"


def test_a_persons_hand_needs_no_setup(tmp_path: Path) -> None:
    told = list[SetupEvent]()
    person = Newcomer(lambda seconds: None, 0.0, "", tmp_path / "easel")
    rehearse(person, "human", told.append)
    (remark,) = told
    assert isinstance(remark, Remark) and "--robot human" in remark.sentence
    assert person.asked == ["Fasten the canvas so that it does not move. Done?"]
    assert not (tmp_path / "easel").exists()
