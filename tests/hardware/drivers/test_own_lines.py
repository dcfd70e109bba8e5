"""A probe's contact, and a person's own lines, over simulated controllers."""

from typing import Any

import numpy as np
import pytest

from frida_painter.errors import MotionFailed
from frida_painter.hardware.gcode import Gcode, OwnGcode
from frida_painter.hardware.robot import Waypoints
from frida_painter_drivers.gcode import GcodeRobot, GrblRobot
from frida_painter_drivers.grbl import Grbl
from machines.grbl import GRBL, QUICK, GrblController
from machines.marlin import PLAIN, MarlinController
from machines.paths import a_stroke
from machines.simulated_time import SimulatedTime

HOME = (0.0, 0.0, 0.05)


def at_home(clock: SimulatedTime, machine: Any, kind: type[GcodeRobot], language: Gcode) -> GcodeRobot:
    """A connected driver; the machine stood at `HOME` when it was switched on."""
    robot = kind(clock.attach(machine).name, HOME, gcode=language)
    robot.connect()
    robot.set_zero(np.array(HOME))
    return robot


def grbl() -> GrblController:
    return GrblController(GRBL, QUICK)


def test_a_probe_finds_the_table_in_work_coordinates(simulated_time: SimulatedTime) -> None:
    machine = grbl()
    robot = at_home(simulated_time, machine, GrblRobot, Gcode("grbl", 0.2))
    robot.follow(a_stroke())
    for surface, reached in ((12.5 - 50, 0.0125), (None, 0.002)):
        machine.surface = surface
        assert robot.touch(0.002, 0.005).reached[2] == pytest.approx(reached, abs=1e-6)
        assert machine.tip[2] == pytest.approx(1000 * reached - 50, abs=1e-3)
    assert "G38.3Z2.000F300" in machine.received
    robot.close()


def test_a_probe_that_may_not_go_so_deep_is_refused_before_it_moves(
    simulated_time: SimulatedTime, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = grbl()
    robot = at_home(simulated_time, machine, GrblRobot, Gcode("grbl", 0.2))
    monkeypatch.setattr(Grbl, "box", lambda self: (np.array([0.0, -300.0, -1.0]), np.array([300.0, 0.0, 80.0])))
    with pytest.raises(MotionFailed, match=r"z = -20.0 mm at waypoint 0 is beyond the limits"):
        robot.touch(-0.02, 0.005)
    assert not any(line.startswith("G38") for line in machine.received)
    robot.close()


OWN = {
    "grbl": OwnGcode(
        start=("M8",), end=("M9",), lift=("M5",), lower=("M3 S{z}",), dip=("G4 P0.{well}",), down_below=0.02,
    ),
    "marlin": OwnGcode(
        start=("M75",), end=("M220 S100",), lift=("M105",), lower=("M220 S{z}",), dip=("G4 P{well}",), down_below=0.02,
    ),
}  # fmt: skip
WAY = ["G1 X100.000 Y50.000 F12000", "G1 X120.000 Y50.000 F3000"]
SENT = {
    "grbl": ["M8", *2 * ["G4 P0.2", "M5", WAY[0], "M3 S10.000", WAY[1], "M5"], "M9"],
    "marlin": ["M75", *2 * ["G4 P2", "M105", WAY[0], "M220 S10.000", WAY[1], "M105"], "M220 S100"],
}


@pytest.mark.parametrize(
    ("flavour", "make"), [("grbl", grbl), ("marlin", lambda: MarlinController(PLAIN))], ids=["grbl", "marlin"]
)
def test_a_persons_own_lines_come_at_start_and_end_and_move_the_brush(
    simulated_time: SimulatedTime, flavour: Any, make: Any
) -> None:
    path = np.array([(0.1, 0.05, 0.03), (0.1, 0.05, 0.01), (0.12, 0.05, 0.01), (0.12, 0.05, 0.03)])
    machine = make()
    robot = at_home(simulated_time, machine, GcodeRobot, Gcode(flavour, 0.2, own=OWN[flavour]))
    assert robot.pose()[2] == HOME[2]
    assert SENT[flavour][0] not in machine.received, "nothing happens before the first motion"
    for _ in range(2):
        report = robot.follow(Waypoints("dip into well 2", path, 0.05, ("dip", "2")))
        assert report.reached == pytest.approx(path[-1], abs=1e-5)
    robot.close()
    simulated_time.sleep(0.5)
    wanted = [line.replace(" ", "") for line in SENT[flavour]]  # GRBL drops spaces as it reads
    received = [line.replace(" ", "") for line in machine.received]
    assert [line for line in received if line in wanted] == wanted


def test_a_persons_last_lines_are_not_sent_after_a_fault(
    simulated_time: SimulatedTime, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(firmware: Grbl, tip: np.ndarray) -> None:
        raise MotionFailed("it failed")

    machine = grbl()
    robot = at_home(simulated_time, machine, GcodeRobot, Gcode("grbl", 0.2, own=OWN["grbl"]))
    monkeypatch.setattr(Grbl, "set_zero", fail)
    robot.follow(Waypoints("stroke 1", np.array([(0.1, 0.05, 0.03)]), 0.05))
    with pytest.raises(MotionFailed):
        robot.set_zero(np.zeros(3))
    robot.close()
    assert "M8" in machine.received and "M9" not in machine.received
