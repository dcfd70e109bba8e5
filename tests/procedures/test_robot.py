import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Confirm, lead
from frida_painter.errors import CalibrationError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.faults import Bump, Faults, PlacementError
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Workspace
from frida_painter.perception.landmarks import match_dots
from frida_painter.strokes.strokes import Strokes
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, VirtualStudio, open_studio
from frida_painter_calibration.procedures.canvas import canvas
from frida_painter_calibration.procedures.robot import DOTS, FEWEST_DOTS, robot
from papers import proposed

SIZE = CanvasSize(0.24, 0.18)
CAMERA = CameraSpec(photograph=(600, 800))


def askew(seed: int) -> PlacementError:
    """4 mm in some direction, 2 degrees to one side."""
    return PlacementError((0.004 * math.cos(2.4 * seed), 0.004 * math.sin(2.4 * seed)), math.radians(2) * (-1) ** seed)


def opened(seed: int, brush: str = "medium", faults: Faults | None = None) -> VirtualStudio:
    settings = StudioSettings(camera=CAMERA, placement_error=askew(seed))
    studio = open_studio(SIZE, brush, seed=seed, settings=settings, faults=faults)
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return studio


def seeing(studio: VirtualStudio) -> Easel:
    """Its easel, which knows where the canvas is."""
    record = lead(canvas(studio.easel), proposed).enter(studio.easel.calibration)
    return replace(studio.easel, calibration=record)


def strokes_off(studio: VirtualStudio, easel: Easel, count: int, seed: int) -> np.ndarray:
    """How far straight strokes land from where they are meant, metres [count], as the studio itself knows.

    Each is painted there and back on canvases of their own: where their paint lies on average is the
    middle of the line, however far the tuft trails behind.
    """
    chance = np.random.default_rng(seed)
    motion = Motion(easel.workspace, easel.calibration)
    size = np.array([SIZE.width, SIZE.height])
    off = []
    for _ in range(count):
        angle = chance.uniform(0, 2 * math.pi)
        way = 0.04 * np.array([math.cos(angle), math.sin(angle)])
        middle = chance.uniform(0.045, size - 0.045)
        marks = []
        for start, turn in ((middle - way / 2, 0), (middle + way / 2, math.pi)):
            easel.operator.lay_paper()
            stroke = Strokes(
                torch.from_numpy(start[None]), torch.tensor([angle + turn]), torch.tensor([0.04]), torch.zeros(1),
                torch.tensor([0.3]), torch.zeros(1, 3),
            )  # fmt: skip
            easel.robot.follow(motion.dip(0))
            easel.robot.follow(motion.stroke(stroke, 0))
            wet = studio.table.canvas.wet[..., 0] > 0.003
            marks.append((np.argwhere(wet).mean(0)[::-1] + 0.5) * studio.table.canvas.cell / 1000)
        off.append(np.linalg.norm(np.mean(marks, axis=0) - middle))
    return np.array(off)


def test_strokes_land_where_they_are_meant_to() -> None:
    seed = 1
    studio = opened(seed)
    easel = seeing(studio)
    found = lead(robot(easel), proposed)
    record = found.enter(easel.calibration)
    assert "6 of 6 dots were found." in found.sentence and record.done["robot"].residual < 0.001
    shift, turn = re.search(
        r"painted (.*) mm beside where it was sent, turned by (.*) degrees", found.sentence
    ).groups()
    assert float(shift) == pytest.approx(4, abs=0.5)
    assert float(turn) == pytest.approx(2 * (-1) ** seed, abs=0.3)
    assert strokes_off(studio, studio.easel, 2, seed).mean() > 0.003, "without the correction"
    assert strokes_off(studio, replace(easel, calibration=record), 5, seed).mean() < 0.0005
    assert found.picture is not None and found.picture.shape[0] == 3


def spotted(easel: Easel, spots: int) -> Easel:
    """An easel on which paint drips, too, whenever dots are painted."""
    chance = np.random.default_rng(7)
    places = chance.uniform(0.02, np.array([SIZE.width, SIZE.height]) - 0.02, (spots, 2))

    class Dripping:
        dots = 0

        def __getattr__(self, name: str):
            return getattr(easel.robot, name)

        def follow(self, waypoints):
            if waypoints.label.startswith("dot"):
                self.dots += 1
                if self.dots <= spots:
                    position = waypoints.position.copy()
                    there = easel.workspace.to_robot(places[self.dots - 1][None], np.array([0.0]))[0, :2]
                    position[:, :2] = there
                    easel.robot.follow(replace(waypoints, position=position, label="drip"))
            return easel.robot.follow(waypoints)

    return replace(easel, robot=Dripping())


def test_spots_that_are_no_dots_and_a_missing_dot_are_survived() -> None:
    studio = opened(4, faults=Faults(dropped_touches=frozenset([9])))  # behind the six spots
    easel = seeing(studio)
    found = lead(robot(spotted(easel, 6)), proposed)
    dots, strangers = re.match(
        r"(\d+) of 6 dots were found and (\d+) other spots that do not count", found.sentence
    ).groups()
    assert int(strangers) >= 4 and int(dots) == 5
    assert strokes_off(studio, replace(easel, calibration=found.enter(easel.calibration)), 4, 4).mean() < 0.0005


@pytest.mark.parametrize(
    ("faults", "says"),
    [
        (Faults(dropped_touches=frozenset(range(6))), "0 were found .* is there paint|0 were found"),
        (Faults(dropped_touches=frozenset([0, 3])), "4 were found"),
        (Faults(bumps=(Bump(3, (0.012, 0.006)),)), "were found within|off the best placement"),
    ],
    ids=["no dots", "two are missing", "the canvas was knocked"],
)
def test_what_would_be_a_wrong_placement_is_refused(faults: Faults, says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        lead(robot(opened(6, faults=faults).easel), proposed)


@pytest.mark.parametrize(
    ("sign", "says"), [((-1, 1), "mirrored from left"), ((1, -1), "mirrored from top"), ((-1, -1), "upside")]
)
def test_a_robot_that_paints_the_wrong_way_round_is_found_out(sign: tuple[int, int], says: str) -> None:
    easel = opened(6).easel
    middle = np.array([SIZE.width, SIZE.height]) / 2
    to_robot = easel.workspace.to_robot

    class Wrong(Workspace):
        def to_robot(self, position, height):
            return to_robot((position - middle) * sign + middle, height)

    with pytest.raises(CalibrationError, match=says):
        lead(robot(replace(easel, workspace=Wrong(**vars(easel.workspace)))), proposed)


@pytest.mark.parametrize("size", [CanvasSize(0.12, 0.09), SIZE, CanvasSize(0.279, 0.356), CanvasSize(1.0, 0.3)])
def test_the_dots_lie_evenly_on_the_canvas_and_look_the_same_from_one_side_only(size: CanvasSize) -> None:
    places = np.array(DOTS) * (size.width, size.height)
    assert (places > 0.1 * np.array([size.width, size.height])).all()
    assert (places < 0.9 * np.array([size.width, size.height])).all()
    near = {
        "reach": 0.175 * min(size.width, size.height),
        "tolerance": min(0.0025, 0.021 * min(size.width, size.height)),
    }
    assert len(match_dots(places, places, **near).meant) == len(DOTS)
    for sign in ((-1, 1), (1, -1), (-1, -1)):
        turned = places * sign + np.where(np.array(sign) < 0, (size.width, size.height), 0)
        assert len(match_dots(places, turned, **near).meant) < FEWEST_DOTS


def test_a_person_is_asked_for_a_canvas_and_may_decline() -> None:
    easel = opened(0).easel

    class Absent:
        def fill_wells(self, palette) -> None: ...

        def lay_paper(self) -> bool:
            return False

    asked = []
    with pytest.raises(CalibrationError, match="was not calibrated"):
        lead(robot(replace(easel, operator=Absent())), lambda question: asked.append(question))
    assert isinstance(asked[0], Confirm) and "6 small black dots" in asked[0].text
