"""What only a person can see or know of a machine's lift: a setup asks for it."""

from pathlib import Path

import numpy as np
import pytest

from frida_painter.easel.dialogue import Answer, Confirm, SetupQuestion, lead
from frida_painter.easel.operator import AbsentOperator
from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.preset import Layout, find_preset
from frida_painter.hardware.robot import Waypoints
from frida_painter_calibration.machine_setup import lead_setup
from frida_painter_calibration.options import SetupOrder
from frida_painter_calibration.procedures.workspace import Bench, try_lift
from machines import grbl
from machines.simulated_time import SimulatedTime, simulated_time
from support.easel import CALIBRATION, CANVAS, NotingRobot, PatientCamera

__all__ = ["simulated_time"]  # a fixture


def bench(robot: NotingRobot) -> Bench:
    layout = Layout.propose(find_preset("nextdraw"), "it", CANVAS)
    workspace = layout.workcell().workspace
    robot.motions.append(Waypoints("stands", np.array([[0.02, -0.03, 0.01]]), 0.1))
    return Bench(Easel(robot, PatientCamera(), AbsentOperator(), workspace, CALIBRATION, CANVAS), layout)


@pytest.mark.parametrize("sees", [[True], [False, True, True]])
def test_a_person_sees_whether_the_lift_moves(sees: list[bool]) -> None:
    """M5: at the wrong pin the board says OK, and the brush stays."""
    robot, asked = NotingRobot(), list[str]()

    def answer(question: SetupQuestion) -> Answer:
        asked.append(question.text)
        return sees[len(asked) - 1]

    lead(try_lift(bench(robot)), answer)
    assert "Did it move?" in asked[0] and len(asked) == len(sees)
    tried = [motion for motion in robot.motions if motion.label == "lift"]
    assert len(tried) == (len(sees) + 1) // 2
    for motion in tried:
        assert np.ptp(motion.position[:, :2], axis=0).max() == 0, "straight down and up"
        assert motion.position[:, 2].tolist() == pytest.approx([0.01, 0.005, 0.01]), "and not as far as the canvas"


def test_a_lift_that_does_not_move_ends_the_setup() -> None:
    with pytest.raises(ConfigError, match=r"another pin, or another kind of lift\. Choose another preset"):
        lead(try_lift(bench(NotingRobot())), lambda question: False)


def test_a_machine_whose_motors_rest_is_refused_if_the_brush_sinks(
    simulated_time: SimulatedTime, tmp_path: Path
) -> None:
    """M18: no controller knows that."""
    machine = grbl.GrblController(grbl.GRBL)
    cable, asked = simulated_time.attach(machine), list[str]()

    def answer(question: SetupQuestion) -> Answer:
        assert isinstance(question, Confirm)
        asked.append(question.text)
        return "Does the brush stay" not in question.text

    order = SetupOrder(preset="grbl-router", port=cable.name, canvas=CANVAS, folder=tmp_path / "easel")
    with pytest.raises(ConfigError, match=r"It releases its motors 25 ms after each motion .*Set \$1=255"):
        lead_setup(order, answer, lambda event: None)
    assert any("Does the brush stay at its height then" in text for text in asked) and not machine.moved
