"""Rehearsal of a machine's setup over simulated controllers, in simulated time, by a person who has never done it.

The person reads a question for some seconds, then presses one key after another as the tip's place and the true place
ask for it; the keys go through the dialogue of the terminal. The machine moves at the rates of its own controller.
"""

from pathlib import Path

import numpy as np
import pytest

from frida_painter.hardware.preset import find_preset
from frida_painter.session.events import Remark, ResultFound
from frida_painter_calibration.machine_setup import SetupEvent
from machines.ebb import EbbController
from machines.newcomer import DEEPER, FIFTEEN, Newcomer, check_files, in_this_process, over_canvas, rehearse
from machines.simulated_time import SimulatedTime, simulated_time
from machines.xarm_box import XarmBox, use_ports

__all__ = ["simulated_time"]  # a fixture


def test_a_newcomer_paints_the_first_stroke_within_fifteen_minutes(
    simulated_time: SimulatedTime, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """With a plotter; tests/cli/test_setup.py sets a router up."""
    cable = simulated_time.attach(EbbController("2.8.1"))
    touch = find_preset("axidraw").lift.touch + DEEPER
    person = Newcomer(simulated_time.sleep, touch, cable.name, tmp_path / "easel")
    begun, told = simulated_time.now, []
    with in_this_process(monkeypatch, tmp_path, simulated_time):
        rehearse(person, "axidraw", told.append)
    check_files(tmp_path / "easel", "axidraw", touch)
    assert isinstance(told[-1], ResultFound) and told[-1].what == "setup" and simulated_time.now - begun <= FIFTEEN
    assert any(isinstance(event, Remark) and "minutes after" in event.sentence for event in told)


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
