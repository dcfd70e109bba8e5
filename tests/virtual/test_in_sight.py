import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CameraError
from frida_painter.hardware.faults import Faults, InSight
from frida_painter.virtual.camera import CameraSpec

from .hand import Hand

SMALL = CameraSpec(photograph=(240, 320))


def photographs(faults: Faults, count: int = 3) -> list[np.ndarray]:
    hand = Hand(camera=SMALL, faults=faults)
    hand.easel.robot.home()
    return [hand.easel.camera.capture(0.0).image.astype(int) for _ in range(count)]


def test_a_hand_lies_in_the_photographs_named_from_the_lower_edge_to_its_place() -> None:
    """Over a canvas of 42 cm, a hand of 20 cm and its forearm, with all five fingers."""
    faults = Faults(in_sight=(InSight("hand", 1, 1, place=(0.4, 0.5)),))
    hand = Hand(camera=SMALL, canvas=CanvasSize(0.42, 0.297), cell=2.0, faults=faults)
    hand.easel.robot.home()
    before, during, after = (hand.easel.camera.capture(0.0).image.astype(int) for _ in range(3))
    covered = np.abs(during - before).max(2) > 40
    rows = np.flatnonzero(covered.any(1))
    assert covered[120, 128], "the palm is at its place"
    assert np.array_equal(rows, np.arange(rows[0], 240)), "in one piece, out of the lower edge"
    assert 20 < rows[0] < 60 and not covered[:, [0, -1]].any(), "the fingers end over the canvas"
    fingertips = np.diff(np.r_[0, covered[rows[0] + 20], 0]) == 1
    assert fingertips.sum() == 4
    blue = during[-1, covered[-1]]
    assert (blue[:, 2] > blue[:, 0]).mean() > 0.8, "a sleeve is what comes from below"
    assert (np.abs(after - before).max(2) > 40).mean() < 0.001


def test_glare_is_brighter_than_can_be_recorded() -> None:
    before, during, _ = photographs(Faults(in_sight=(InSight("glare", 1, 1, place=(0.6, 0.4)),)))
    row, column = round(0.4 * 239), round(0.6 * 319)
    assert (during[row, column] == 255).all() and (before[row, column] < 255).any()
    assert (during >= before - 30).all()


def test_a_frozen_camera_gives_its_last_picture_as_a_new_one() -> None:
    hand = Hand(camera=SMALL, faults=Faults(frozen_photographs=frozenset({1})))
    frames = [hand.easel.camera.capture(0.0) for _ in range(3)]
    assert np.array_equal(frames[0].image, frames[1].image) and not np.array_equal(frames[1].image, frames[2].image)
    assert frames[0].captured_at < frames[1].captured_at and frames[1].sequence == 1


def test_a_camera_without_its_cable_does_not_answer() -> None:
    hand = Hand(camera=SMALL, faults=Faults(failed_photographs=frozenset({0, 2})))
    answers = []
    for _ in range(4):
        try:
            answers.append(hand.easel.camera.capture(0.0).sequence)
        except CameraError as complaint:
            assert "does not answer" in str(complaint)
            answers.append(None)
    assert answers == [None, 1, None, 3]


@pytest.mark.parametrize("what", ["hand", "glare"])
def test_what_is_not_there_yet_is_not_seen(what: str) -> None:
    first, second, _ = photographs(Faults(in_sight=(InSight(what, 5),)))  # type: ignore[arg-type]
    assert np.abs(first - second).mean() < 3
