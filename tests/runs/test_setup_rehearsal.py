"""Rehearsal of a machine's setup over simulated controllers, in simulated time, by a person who has never done it.

The person reads a question for some seconds, then presses one key after another as the tip's place and the true place
ask for it; the keys go through the dialogue of the terminal. The machine moves at the rates of its own controller.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from frida_painter.hardware.preset import find_preset
from frida_painter.session.events import Remark
from frida_painter.session.setup_events import SetupWritten
from frida_painter_calibration.machine_setup import SetupEvent
from machines.ebb import EbbController
from machines.grbl import router
from machines.newcomer import (
    DEEPER,
    FIFTEEN,
    Newcomer,
    check_files,
    in_this_process,
    over_canvas,
    rehearse,
)
from machines.simulated_time import SimulatedTime, simulated_time
from machines.xarm_box import XarmBox, use_ports

__all__ = ["simulated_time"]  # a fixture


MACHINES: dict[str, tuple[str, Callable[[], Any]]] = {
    "GRBL router": ("grbl-router", router),
    "AxiDraw": ("axidraw", lambda: EbbController("2.8.1")),
}
"""An axis Z with limit switches, and a servo with a home corner; firmwares differ in the table of behaviours."""


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


def test_a_persons_hand_needs_no_setup(tmp_path: Path) -> None:
    told = list[SetupEvent]()
    person = Newcomer(lambda seconds: None, 0.0, "", tmp_path / "easel")
    rehearse(person, "human", told.append)
    (remark,) = told
    assert isinstance(remark, Remark) and "--robot human" in remark.sentence
    assert person.asked == ["Fasten the canvas so that it does not move. Done?"]
    assert not (tmp_path / "easel").exists()
