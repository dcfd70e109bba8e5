"""Frames of the virtual studio's camera: good ones, and all the ways in which they are not."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.errors import FrameRejected
from frida_painter.hardware.faults import Faults, InSight, LightChange, LostFocus, PlacementError
from frida_painter.perception.frame_check import Expected
from frida_painter.session.observer import CanvasObserver
from frida_painter.virtual.camera import CameraSpec
from virtual.hand import CANVAS, Hand


@dataclass
class Stage:
    """A canvas of 12 x 9 cm with three strokes, of which an observer knows how it should look."""

    hand: Hand
    observer: CanvasObserver
    expected: Expected

    def photograph(self, *, faults: Faults | None = None, knock: PlacementError | None = None) -> NDArray[np.uint8]:
        studio = self.hand.studio
        studio.break_things(faults or Faults())
        studio.table.knock = knock or PlacementError((0.0, 0.0), 0.0)
        image = self.hand.easel.camera.capture(0.0).image
        studio.break_things(Faults())
        studio.table.knock = PlacementError((0.0, 0.0), 0.0)
        return image

    def judge(self, image: NDArray[np.uint8], expected: Expected | None) -> None:
        assert self.observer.good is not None
        self.observer.good.require(image, self.observer.see(image, 270), expected)


@pytest.fixture(scope="module")
def stage() -> Iterator[Stage]:
    hand = Hand([0.1, 0.15, 0.4], [0.6, 0.25, 0.1], camera=CameraSpec(photograph=(600, 800)))
    hand.easel.robot.home()
    observer = CanvasObserver(hand.easel)
    observer.examine(0.0, 270)
    for number, (x, y) in enumerate(((0.02, 0.03), (0.05, 0.06), (0.06, 0.02))):
        hand.dip(number % 2)
        hand.stroke(x, y, 0.045)
    hand.easel.robot.home()
    yield Stage(hand, observer, Expected(torch.ones(3, 270, 360), hand.studio.truth(270)))


def test_a_good_photograph_is_trusted(stage: Stage) -> None:
    for _ in range(3):
        stage.judge(stage.photograph(), stage.expected)
        stage.judge(stage.photograph(), None)


@pytest.mark.parametrize(
    ("faults", "reason"),
    [
        (Faults(in_sight=(InSight("hand", 0),)), "Something reaches over the edge"),
        (Faults(in_sight=(InSight("hand", 0, place=(0.3, 0.75)),)), "Something reaches over the edge"),
        (Faults(in_sight=(InSight("glare", 0),)), "blown out"),
        (Faults(light_changes=(LightChange(0, (0.5, 0.5, 0.5)),)), "is dark: the canvas shows [45]. %"),
        (Faults(light_changes=(LightChange(0, (0.02, 0.02, 0.02)),)), "dark"),
        (Faults(light_changes=(LightChange(0, (3.0, 3.0, 3.0)),)), "blown out|too bright"),
        (Faults(lost_focus=(LostFocus(0, blur=0.01),)), "is blurred"),
    ],
)
def test_what_cannot_be_trusted_is_refused_with_the_reason(stage: Stage, faults: Faults, reason: str) -> None:
    """Fault F23: the photograph cannot be trusted."""
    with pytest.raises(FrameRejected, match=reason):
        stage.judge(stage.photograph(faults=faults), stage.expected)


@pytest.mark.parametrize("shift", [(0.005, 0.0), (0.0, -0.005), (-0.003, 0.004), (0.004, 0.003)])
def test_a_canvas_that_was_bumped_by_5_mm_is_noticed_also_when_anything_may_be_on_it(
    stage: Stage, shift: tuple[float, float]
) -> None:
    """Fault F23: the photograph cannot be trusted."""
    image = stage.photograph(knock=PlacementError(shift, 0.0))
    for expected in (stage.expected, None):
        with pytest.raises(FrameRejected, match=r"no longer where it was: its edge is (4\.[5-9]|5\.[0-5]) mm away"):
            stage.judge(image, expected)


def test_a_millimetre_is_not_worth_an_alarm(stage: Stage) -> None:
    stage.judge(stage.photograph(knock=PlacementError((0.0007, 0.0007), 0.0)), stage.expected)


def test_a_lens_that_was_turned_is_noticed(stage: Stage) -> None:
    """Fault F23: the photograph cannot be trusted."""
    image = stage.photograph()
    rows, columns = image.shape[:2]
    nearer = cv2.getRotationMatrix2D((columns / 2, rows / 2), 0, 1.06)
    with pytest.raises(FrameRejected, match="no longer where it was"):
        stage.judge(np.asarray(cv2.warpAffine(image, nearer, (columns, rows), borderMode=cv2.BORDER_REPLICATE)), None)


def test_the_robots_own_arm_is_in_the_way(stage: Stage) -> None:
    easel = stage.hand.easel
    stage.hand.stroke(0.02, 0.03, 0.01, thickness=0.0)
    image = easel.camera.capture(0.0).image
    easel.robot.home()
    with pytest.raises(FrameRejected, match="reaches over the edge"):
        stage.judge(image, stage.expected)


def test_what_nobody_has_painted_is_strange_and_what_was_painted_beside_its_place_is_not(stage: Stage) -> None:
    def shifted(rows: int, columns: int) -> Tensor:
        return torch.roll(stage.expected.after, (rows, columns), (1, 2))

    beside = Expected(stage.expected.before, shifted(15, 15))  # 5 mm and 5 mm
    stage.judge(stage.photograph(), beside)
    nothing = Expected(stage.expected.before, stage.expected.before)
    with pytest.raises(FrameRejected, match="nobody has painted"):
        stage.judge(stage.photograph(), nothing)
    stage.judge(stage.photograph(), None)


def test_a_stroke_that_left_no_mark_is_nothing_strange(stage: Stage) -> None:
    more = stage.expected.after.clone()
    more[:, 200:230, 40:160] = 0.1
    stage.judge(stage.photograph(), Expected(stage.expected.after, more))


def test_changes_are_told_from_none(stage: Stage) -> None:
    assert stage.expected.changes(CANVAS)
    assert not Expected(stage.expected.after, stage.expected.after).changes(CANVAS)
