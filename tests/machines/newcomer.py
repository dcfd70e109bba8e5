"""Person who sets a machine up for the first time, at the dialogue of the terminal.

The person reads a question for some seconds, then presses one key after another as the tip's place and the true place
ask for it.
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
from frida_painter.easel.dialogue import Answer, Choose, Confirm, Guide, Jog, SetupQuestion
from frida_painter.easel.guard import GuardedRobot
from frida_painter.easel.open import open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import MotionLimits
from frida_painter.hardware.latch import Unlatched
from frida_painter.hardware.preset import find_preset
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter_calibration import machine_setup
from frida_painter_calibration.machine_setup import SetupEvent, lead_setup
from frida_painter_calibration.options import SetupOrder
from frida_painter_cli.terminal import GuidingKeys, Terminal
from machines.simulated_time import SimulatedTime

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
        return replace(easel, robot=GuardedRobot(easel.robot, MotionLimits(easel.workspace), Unlatched("rehearsal")))


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
        if "bottom-left" in question.text:
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
            return "o"
        ahead = int(off[axis] > 0)
        return str(((key.LEFT, key.RIGHT), (key.DOWN, key.UP), (key.PAGE_DOWN, key.PAGE_UP))[axis][ahead])


@contextmanager
def in_this_process(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, clock: SimulatedTime | None) -> Iterator[None]:
    for name in ("DATA", "CONFIG", "STATE"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / name))
    monkeypatch.setattr(machine_setup, "EaselProcess", InProcess)
    monkeypatch.setattr(machine_setup, "list_ports", lambda preset: [])
    if clock is not None:
        monkeypatch.setattr(machine_setup, "time", clock)
    yield


def rehearse(person: Newcomer, preset: str, tell: Callable[[SetupEvent], None]) -> None:
    lead_setup(SetupOrder(preset=preset, canvas=CANVAS, folder=person.folder), person.answer, tell)


def check_files(folder: Path, preset: str, touch: float, near: float = 3.1e-4) -> WorkcellConfig:
    """The files say what was true of the table; the canvas was first proposed by the preset."""
    workcell, record = WorkcellConfig.load(folder / "workspace.toml"), Calibration.load(folder / "calibration.json")
    proposed = machine_setup.Layout.propose(find_preset(preset), canvas=CANVAS)
    assert workcell.workspace.canvas_origin[:2] == pytest.approx(
        np.array(proposed.workspace.canvas_origin[:2]) + BESIDE, abs=near
    )
    assert record.touch_height == pytest.approx(touch, abs=max(near, 3e-4))
    assert record.touch_height - record.press_height == pytest.approx(-PRESSED, abs=max(near, 4e-4))
    assert len(workcell.workspace.wells) == 3
    return workcell


def over_canvas(moved: np.ndarray, workcell: WorkcellConfig) -> np.ndarray:
    """Places of the tip [k, 3] (mm) over the canvas."""
    x, y = 1000 * np.array(workcell.workspace.canvas_origin[:2])
    across, up = 1000 * workcell.canvas.width, 1000 * workcell.canvas.height
    inside = (moved[:, 0] > x) & (moved[:, 0] < x + across) & (moved[:, 1] > y) & (moved[:, 1] < y + up)
    return moved[inside]
