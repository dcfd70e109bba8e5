"""Height map learned from marks that a brush leaves on an uneven table, in a camera's and in a phone's picture.

The marks are drawn here, by a law that the procedure does not know: the width saturates with depth, and scatters.
"""

import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from frida_painter.brush.kinds import BrushKind, Dip
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Confirm, lead
from frida_painter.errors import CalibrationError, ConfigError, FrameRejected
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Frame, MotionReport, Waypoints
from frida_painter.strokes.strokes import StrokeLimits, Strokes
from frida_painter_calibration.procedures.surface_marks import (
    MarkGrid,
    fit_heights,
    learn_surface,
    surface_by_marks,
    surface_in_picture,
)
from support.easel import CALIBRATION, WORKSPACE

SIZE = CanvasSize(0.24, 0.18)
BRUSH = BrushKind("small", StrokeLimits((0.01, 0.04), (-0.01, 0.01)), 0.006, Dip(0.01))
DEEP, SHALLOW = CALIBRATION.touch_height, CALIBRATION.press_height  # 10 mm between
SPAN = DEEP - SHALLOW
SCALE = 4000  # pixels per metre of the paper


def sloped(x: float, y: float) -> float:
    """Height of the table above its middle, metres: 4 mm from corner to corner, with a dent."""
    tilt = 0.0022 * (x / SIZE.width - 0.5) - 0.0018 * (y / SIZE.height - 0.5)
    return tilt + 0.0008 * (1 - np.exp(-((x - 0.12) ** 2 + (y - 0.09) ** 2) / 0.004))


class Table:
    """A robot over an uneven table with paper, and a camera above it."""

    def __init__(self, height=sloped, seed: int = 0, noise: float = 0.05) -> None:
        self.height, self.random, self.noise = height, np.random.default_rng(seed), noise
        self.paper = np.full((round(SIZE.height * SCALE), round(SIZE.width * SCALE)), 235, np.uint8)
        self.tip = np.array([0.0, 0.0, 0.2])
        self.deepest = 0.0
        self.laid = True

    def pose(self):
        return self.tip.copy()

    def home(self):
        self.tip = np.array([-0.25, -0.25, 0.2])
        return MotionReport("home", time.monotonic(), time.monotonic(), self.tip)

    def follow(self, waypoints: Waypoints) -> MotionReport:
        place = WORKSPACE.to_canvas(waypoints.position)
        scatter = abs(1 + self.noise * self.random.standard_normal())
        for (x, y), z in zip(place, waypoints.position[:, 2], strict=True):
            if not (0 < x < SIZE.width and 0 < y < SIZE.height):
                continue
            depth = DEEP + self.height(x, y) - z
            self.deepest = max(self.deepest, depth)
            if depth > 0:
                width = scatter * 0.006 * (1 - np.exp(-depth / 0.005))
                middle = round(16 * x * SCALE), round(16 * (SIZE.height - y) * SCALE)
                cv2.circle(self.paper, middle, round(16 * width / 2 * SCALE), 20, -1, cv2.LINE_AA, 4)
        self.tip = np.array(waypoints.position[-1])
        return MotionReport(waypoints.label, time.monotonic(), time.monotonic(), self.tip)

    def lay_paper(self) -> bool:
        return self.laid

    def fill_wells(self, palette) -> None:
        assert palette.color.max() < 0.1

    def seen(self) -> torch.Tensor:
        """The canvas from straight above, in uneven light, on pixels of half a millimetre."""
        small = cv2.resize(self.paper, (480, 360), interpolation=cv2.INTER_AREA).astype(np.float32) / 255
        light = np.linspace(0.75, 1.0, 480, dtype=np.float32)[None]
        return torch.tensor(small * light)[None].repeat(3, 1, 1)


def easel(table: Table) -> Easel:
    return Easel(table, None, table, WORKSPACE, replace(CALIBRATION, canvas=SIZE), SIZE, has_camera=False)


def painted(**table) -> tuple[Table, Easel]:
    """The table with the marks, as it is without a camera."""
    machine = Table(**table)
    here = easel(machine)
    found = lead(surface_by_marks(here, BRUSH), lambda question: True)
    assert "--picture FILE" in found.sentence and found.enter(here.calibration) == here.calibration
    return machine, here


def misses(finding) -> np.ndarray:
    """Errors of the heights at the points, metres; the middle of the canvas is 0 by definition."""
    points = MarkGrid.plan(SIZE, BRUSH, 3).points()
    true = np.array([sloped(x, y) for x, y in points]) - sloped(SIZE.width / 2, SIZE.height / 2)
    assert np.ptp(true) > 0.003
    return finding.enter(replace(CALIBRATION, canvas=SIZE)).surface.at(points) - true


@pytest.mark.parametrize("seed", range(3))
def test_heights_follow_from_the_widths_of_marks(seed):
    table, here = painted(seed=seed)
    assert table.deepest < 0.75 * SPAN + 0.003, "the hardest mark leaves room for a canvas that is higher there"
    found = learn_surface(table.seen(), here, BRUSH)
    assert np.sqrt((misses(found) ** 2).mean()) < 0.0003 and np.abs(misses(found)).max() < 0.0007
    assert "9 points" in found.sentence and found.picture.shape[0] == 3


def test_every_stroke_then_follows_the_map():
    table, here = painted()
    known = learn_surface(table.seen(), here, BRUSH).enter(here.calibration)
    again = Table(noise=0.0)
    for place in ((0.03, 0.03), (0.12, 0.09), (0.2, 0.15)):
        stroke = Strokes(
            position=torch.tensor([place]), angle=torch.zeros(1), length=torch.tensor([0.012]), bend=torch.zeros(1),
            thickness=torch.tensor([0.5]), color=torch.zeros(1, 3),
        )  # fmt: skip
        again.deepest = 0.0
        again.follow(Motion(WORKSPACE, known).stroke(stroke, 0))
        assert again.deepest == pytest.approx(SPAN / 2, abs=0.0009), "as deep everywhere"


def test_a_phones_picture_from_the_other_side_of_the_table_tells_the_same():
    table, here = painted()
    picture, corners = by_phone(table.paper)
    found = lead(surface_in_picture(picture, here, BRUSH), lambda question: corners)
    assert np.abs(misses(found)).max() < 0.0007
    with pytest.raises(FrameRejected):
        bare = by_phone(np.full_like(table.paper, 235))[0]
        lead(surface_in_picture(bare, here, BRUSH), lambda question: corners)
    with pytest.raises(CalibrationError, match="cannot be told"):
        lead(surface_in_picture(np.full_like(picture, 90), here, BRUSH), lambda question: question.proposal)


def by_phone(paper: np.ndarray) -> tuple[np.ndarray, tuple[tuple[float, float], ...]]:
    """A picture from the far side, askew, on a brown table, and the corners clockwise."""
    rows, columns = paper.shape
    there = np.array([[1420, 1010], [90, 960], [190, 110], [1300, 160]], np.float32)  # top left of the canvas first
    matrix = cv2.getPerspectiveTransform(
        np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], np.float32), there
    )
    table = np.full((1100, 1500, 3), (90, 110, 140), np.uint8)
    colored = np.repeat(paper[..., None], 3, 2)
    seen = cv2.warpPerspective(colored, matrix, (1500, 1100), flags=cv2.INTER_AREA)
    inside = cv2.warpPerspective(np.full_like(paper, 255), matrix, (1500, 1100)) > 250
    table[inside] = seen[inside]
    return table, tuple((float(x), float(y)) for x, y in np.roll(there, 1, 0))


def test_what_cannot_be_told_is_refused():
    with pytest.raises(ConfigError, match="no room"):
        MarkGrid.plan(CanvasSize(0.1, 0.08), BRUSH, 3)
    table, here = painted(height=lambda x, y: -0.02 if x < 0.08 and y < 0.06 else 0.0)
    with pytest.raises(CalibrationError, match="fewer than 2 of 6 marks"):
        learn_surface(table.seen(), here, BRUSH)
    table, here = painted(noise=0.6)
    with pytest.raises(CalibrationError, match=r"contradict|map"):
        learn_surface(table.seen(), here, BRUSH)
    machine = Table()
    machine.laid = False
    with pytest.raises(CalibrationError, match="Without paper"):
        lead(surface_by_marks(easel(machine), BRUSH), lambda question: not isinstance(question, Confirm))
    assert machine.deepest == 0.0


def test_the_curve_is_learned_with_the_heights():
    true = np.array([0.0, 0.3, -0.25, 0.1])
    depth = np.array((-0.5, -0.25, 0.0, 0.25, 0.5, 0.75))[None] + true[:, None]
    width = 0.004 * np.sqrt(np.clip(depth, 0, None))
    found, residual = fit_heights(width)
    assert np.allclose(found - found[0], true, atol=0.06) and residual < 0.0003


def test_a_camera_looks_at_the_canvas_as_soon_as_the_marks_are_painted():
    class Camera:
        def capture(self, newer_than):
            picture = np.repeat(cv2.resize(table.paper, (960, 720), interpolation=cv2.INTER_AREA)[..., None], 3, 2)
            return Frame(np.pad(picture, ((40, 40), (40, 40), (0, 0)), constant_values=90), newer_than + 1, 1)

    table = Table()
    corners = ((39.5, 39.5), (999.5, 39.5), (999.5, 759.5), (39.5, 759.5))
    known = replace(CALIBRATION, canvas=SIZE, corners=corners, photograph=(800, 1040))
    here = replace(easel(table), camera=Camera(), calibration=known, has_camera=True)
    assert np.abs(misses(lead(surface_by_marks(here, BRUSH), lambda question: True))).max() < 0.0007
