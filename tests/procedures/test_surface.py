"""The surface procedure over a machine that feels, over one that does not, and from a file."""

import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Confirm, Jog, JogMove, lead
from frida_painter.errors import CalibrationError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter_calibration.procedures.surface import POINTS, read_surface, surface
from support.easel import CALIBRATION, WORKSPACE

SIZE = CanvasSize(0.3, 0.2)
LOWEST = WORKSPACE.lower[2]


class Machine:
    """A machine over a canvas of that height (a function of canvas metres), which it may feel."""

    def __init__(self, height, feels="contact"):
        self.height, self._feels = height, feels
        self.tip = np.array([0.0, 0.0, 0.2])
        self.deepest = np.inf  # of the tip above the canvas
        self.touches = 0

    def feels(self):
        return self._feels

    def pose(self):
        return self.tip.copy()

    def follow(self, waypoints: Waypoints) -> MotionReport:
        for point in waypoints.position:
            self.tip = np.array(point)
            self.deepest = min(self.deepest, float(self.tip[2] - self.ground()))
        return MotionReport(waypoints.label, time.monotonic(), time.monotonic(), self.tip)

    def ground(self):
        return float(self.height(*WORKSPACE.to_canvas(self.tip[None])[0]))

    def touch(self, lowest, speed):
        self.touches += 1
        self.tip[2] = max(lowest, self.ground())
        return MotionReport("touch", time.monotonic(), time.monotonic(), self.tip.copy())


def easel(machine) -> Easel:
    known = replace(CALIBRATION, canvas=SIZE)
    return Easel(machine, None, None, WORKSPACE, known, SIZE)


def mapped(found):
    """The height map of a finding."""
    return found.enter(replace(CALIBRATION, canvas=SIZE)).surface


def bowl(x, y):
    return CALIBRATION.touch_height + 0.004 * ((x / 0.3 - 0.5) ** 2 + (y / 0.2 - 0.5) ** 2) - 0.001


@pytest.mark.parametrize("points", [POINTS, 5])
def test_a_machine_that_feels_measures_a_canvas_that_nobody_touches_otherwise(points):
    machine = Machine(bowl)
    found = lead(surface(easel(machine), points=points), lambda question: isinstance(question, Confirm))
    assert machine.deepest > 0.01, "between the touches it travels above the canvas"
    assert machine.touches == points**2 and f"({points**2} points)" in found.sentence and found.picture.shape[0] == 3
    places = np.array([(x, y) for x in np.linspace(0.01, 0.29, points) for y in np.linspace(0.01, 0.19, points)])
    measured, true = mapped(found).at(places), np.array([bowl(x, y) for x, y in places]) - CALIBRATION.touch_height
    at_edge = (np.abs(places / (0.3, 0.2) - 0.5) > 0.4).any(1)
    assert np.allclose(measured[~at_edge], true[~at_edge], atol=1e-5)
    assert np.allclose(measured, true, atol=4e-4), "edges follow by straight lines"


def test_a_person_lowers_the_brush_at_nine_points():
    machine, asked = Machine(bowl, feels=None), []

    def answer(question):
        assert isinstance(question, Jog)
        asked.append(question)
        down = machine.ground() - question.height
        return JogMove(settled=True) if abs(down) < 1e-9 else JogMove(max(down, -0.01))

    found = lead(surface(easel(machine)), answer)
    assert sum(not question.again for question in asked) == 9
    assert abs(mapped(found).at(np.array([[0.15, 0.1]]))[0] - (-0.001)) < 1e-6


def test_an_arm_that_feels_by_its_force_fits_a_plane_through_five_noisy_points():
    noise = iter((0.3, -0.2, 0.1, -0.3, 0.2))

    def tilted(x, y):
        return CALIBRATION.touch_height + 0.02 * x - 0.01 * y + 1e-3 * next(noise)

    machine = Machine(lambda x, y: -1.0, feels="force")
    machine.ground = lambda: CALIBRATION.touch_height - 0.05
    machine.touch = lambda lowest, speed: _stand_at(machine, tilted(*WORKSPACE.to_canvas(machine.tip[None])[0]))
    asked = []
    found = lead(surface(easel(machine)), lambda question: asked.append(question) or True)
    assert len(asked) == 1 and "a probe's contact" not in asked[0].text and "by its force" in asked[0].text
    corners = np.array([(0, 0), (0.3, 0), (0, 0.2), (0.3, 0.2), (0.15, 0.1)])
    assert mapped(found).at(corners) == pytest.approx(corners @ (0.02, -0.01), abs=4e-4)
    assert 0 < float(re.search(r"5 points, in a plane within (.*) mm", found.sentence)[1]) < 0.3


def _stand_at(machine, height):
    machine.tip[2] = height
    return MotionReport("touch", time.monotonic(), time.monotonic(), machine.tip.copy())


def test_an_arm_that_feels_a_bowl_goes_on_to_nine_points_and_touches_none_twice():
    machine = Machine(lambda x, y: CALIBRATION.touch_height + 4 * (bowl(x, y) - CALIBRATION.touch_height), "force")
    found = lead(surface(easel(machine)), lambda question: True)
    assert "plane" not in found.sentence and machine.touches == 9 and "(9 points)" in found.sentence
    assert mapped(found).at(np.array([[0.15, 0.1]]))[0] == pytest.approx(-0.004, abs=1e-5)


def test_where_nothing_is_felt_it_says_so():
    with pytest.raises(CalibrationError, match=r"Point 1 of 9: nothing was felt down to 50\.0 mm"):
        lead(surface(easel(Machine(lambda x, y: -1.0))), lambda question: True)


GOOD = """
across = [0.01, 0.15, 0.29]
up = [0.01, 0.19]
height = [[0.100, 0.101, 0.100], [0.100, 0.102, 0.101]]
"""


@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        ({"lower": (*WORKSPACE.lower[:2], CALIBRATION.press_height - 0.0005)}, "lower \\[bounds\\] lower"),
        (
            {"upper": (*WORKSPACE.upper[:2], CALIBRATION.touch_height + WORKSPACE.hover + 0.0005)},
            "the tip would travel",
        ),
    ],
)
def test_a_map_that_the_workspace_has_no_room_for_is_refused(tmp_path: Path, bounds, said) -> None:
    (tmp_path / "map.toml").write_text(GOOD.replace("0.101, 0.100]", "0.099, 0.100]"))
    tight = replace(easel(Machine(bowl)), workspace=replace(WORKSPACE, **bounds))
    with pytest.raises(CalibrationError, match=said):
        read_surface(tmp_path / "map.toml", tight)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GOOD.replace("0.102", "nan"), "has a hole"),
        (GOOD.replace(", 0.102", ""), r"rows of \[3, 2\] numbers"),
        (GOOD.replace("0.29", "0.20"), "from 10 to 200 mm of a side of 300 mm"),
        (GOOD.replace("0.01, 0.15", "0.15, 0.01"), "they ascend"),
        (GOOD.replace("0.102", "102.0"), "says 101900.0 mm"),
        (GOOD.replace("up", "upward"), "up is not as it must be"),
        (GOOD + "offset = 3", "offset is not as it must be"),
        ("height", "not TOML"),
        (GOOD.replace("0.102", "true"), "height.1.1 is not as it must be"),
    ],
)
def test_a_file_that_is_no_map_of_this_canvas_is_refused_in_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(CalibrationError, match=said) as told:
        read_surface(tmp_path / "map.toml", easel(Machine(bowl)))
    assert "\n" not in str(told.value)


def test_a_map_from_a_file_is_relative_to_the_lightest_touch(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(GOOD)
    found = read_surface(tmp_path / "map.toml", easel(Machine(bowl)))
    assert mapped(found).at(np.array([[0.15, 0.1]]))[0] == pytest.approx(0.0015, abs=1e-5)
