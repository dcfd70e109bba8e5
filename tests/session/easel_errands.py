"""What tests do at an easel in a process of its own: orders, strokes, and reading what its diary tells of motions."""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import SIMULATION_LOG
from frida_painter.easel.order import EaselOrder, SimulationOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import Waypoints
from frida_painter.registry import EASELS
from frida_painter.strokes.palette import Palette
from plugins import install

PAINTS = Palette(torch.tensor([[0.9, 0.8, 0.2], [0.1, 0.1, 0.3]]))

MACHINE = "machine"
_MACHINE_KIND = """
from frida_painter.easel.kinds import EaselKind
from frida_painter.easel.virtual_easel import VIRTUAL_KIND as STUDIO
KIND = EaselKind("machine", "a virtual studio that is taken for a machine", STUDIO.open, simulated=False)
"""


def install_machine(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Registers a kind of easel of that name: a virtual studio that is guarded, watched and latched as a real robot."""
    points = {EASELS: {MACHINE: "taken_for_a_machine:KIND"}}
    install(folder, monkeypatch, "taken-for-a-machine", points, {"taken_for_a_machine": _MACHINE_KIND})


def order_in(folder: Path, **settings: object) -> EaselOrder:
    """A small virtual studio in `folder`, with its state beside it."""
    wanted = {"robot": "virtual", "canvas": CanvasSize(0.12, 0.09), "brushes": ("fine",), **settings}
    simulated = {each.name: wanted.pop(each.name) for each in fields(SimulationOrder) if each.name in wanted}
    wanted["simulation"] = SimulationOrder(**{"seed": 3, **simulated})  # type: ignore[arg-type]
    folder.mkdir(exist_ok=True)
    return EaselOrder(state=folder.parent / "state", folder=folder, **wanted)  # type: ignore[arg-type]


@contextmanager
def easel_of(order: EaselOrder) -> Iterator[tuple[Easel, EaselProcess]]:
    with EaselProcess() as process:
        easel = process.open(order)
        easel.robot.connect()
        easel.camera.connect()
        yield easel, process


def kill(process: EaselProcess) -> None:
    """As a lack of memory does it: at once, and nothing is written any more."""
    process._process.kill()
    process._process.wait(10)


def stroke(easel: Easel, number: int) -> Waypoints:
    """A stroke across the canvas, pressed lightly, number by number further up; at its pace it takes a second."""
    across = np.linspace(0.02, 0.07, 12)
    place = np.c_[across, np.full(12, 0.02 + 0.01 * number)]
    path = easel.workspace.to_robot(place, easel.calibration.height(np.full(12, 0.6)))
    above = path[[0, -1]] + np.array([0, 0, easel.workspace.hover])
    return Waypoints(f"stroke {number}", np.concatenate([above[:1], path, above[1:]]), 0.06)


def dip(easel: Easel, well: int) -> Waypoints:
    place, above = np.array(easel.workspace.wells[well]), np.array((0, 0, easel.workspace.hover))
    return Waypoints("dip", np.stack([place + above, place, place + above]), 0.2)


def paint(easel: Easel, strokes: range) -> None:
    for number in strokes:
        easel.robot.follow(dip(easel, number % 2))
        easel.robot.follow(stroke(easel, number))


def moves(folder: Path) -> list[dict[str, Any]]:
    """The motions of which a studio's diary tells: what the robot really did. A line that is being written is left."""
    lines = (folder / SIMULATION_LOG).read_bytes().split(b"\n")[:-1]
    entries = [json.loads(line.split(b" ", 2)[2]) for line in lines]
    return [entry for entry in entries if entry.get("did") == "move"]


def until(condition: Callable[[], Any], seconds: float = 30.0) -> Any:
    """What the condition says as soon as that is something. Fails where it stays nothing."""
    deadline = time.monotonic() + seconds
    while not (said := condition()):
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.005)
    return said
