import math
import threading

import pytest

from frida_painter.errors import CameraError, ConfigError, RobotDisconnected, StaleFrame
from frida_painter.hardware.robot import Frame
from frida_painter.session.events import Event, StrokePainted, TimelapseFrame
from frida_painter.session.observer import TIMELAPSE_ROWS, CanvasObserver, FrameDeveloper, Photographer
from support.easel import PatientCamera, stub_easel


def observing(*script: tuple[float, int] | str) -> tuple[CanvasObserver, PatientCamera]:
    camera = PatientCamera(list(script))
    return CanvasObserver(stub_easel(camera=camera)), camera


def test_a_fresh_photograph_is_taken_at_once() -> None:
    looking, camera = observing()
    picture = looking.look(3.0, 45)
    assert picture.shape == (3, 45, 60) and camera.asked == [3.0]
    assert picture.min() > 0.97, "the bare canvas, lit by 240 of 255, is white"


@pytest.mark.parametrize(
    "stale",
    [
        (2.9, 5),  # taken before the arm stopped
        (3.0, 5),  # in the moment in which it stopped
        (float("nan"), 5),
        "raise",
    ],
)
def test_a_photograph_not_newer_than_the_last_motion_is_asked_for_again_three_times_at_most(
    stale: tuple[float, int] | str,
) -> None:
    looking, camera = observing(stale, stale)
    looking.look(3.0, 45)
    assert len(camera.asked) == 3
    looking, camera = observing(stale, stale, stale)
    with pytest.raises(StaleFrame, match=r"asked 3 times .*\(at 3\.0 s\)"):
        looking.look(3.0, 45)
    assert len(camera.asked) == 3


def test_a_photograph_that_was_seen_before_is_not_taken_for_a_new_one() -> None:
    looking, camera = observing((4.0, 8), (9.0, 8), (9.0, 7), (9.0, 9))
    looking.look(3.0, 45)
    looking.look(5.0, 45)
    assert len(camera.asked) == 4
    repeated, _ = observing((4.0, 8), (9.0, 8), (9.0, 8), (9.0, 8))
    repeated.look(3.0, 45)
    with pytest.raises(StaleFrame):
        repeated.look(5.0, 45)


def test_frames_are_told_in_order_by_whoever_takes_them_and_none_is_lost_where_painting_breaks_off() -> None:
    looking, _ = observing((1.0, 1), (2.0, 2), "raise", "raise", "raise", (4.0, 4), (5.0, 5))
    looking.look(0.0, 45)
    told: list[tuple[int, int]] = []

    def hear(event: Event) -> None:
        assert isinstance(event, TimelapseFrame) and len(event.photograph) == TIMELAPSE_ROWS
        told.append((event.done, threading.get_ident()))

    with pytest.raises(ConfigError), FrameDeveloper(looking, hear) as frames:
        frames.take(StrokePainted(1, 4, (0.0, 0.0, 0.0)), 1.5)
        assert not told, "it is made while the robot paints on"
        frames.take(StrokePainted(2, 4, (0.0, 0.0, 0.0)), 2.5)
        frames.wait()
        assert [done for done, _ in told] == [1], "the camera gave none after the second stroke"
        frames.take(StrokePainted(3, 4, (0.0, 0.0, 0.0)), 3.5)
        frames.take(StrokePainted(4, 4, (0.0, 0.0, 0.0)), 4.5)
        raise ConfigError("it breaks off")
    assert told == [(done, threading.get_ident()) for done in (1, 3, 4)]


def test_the_light_of_the_first_look_is_taken_out_of_the_later_ones() -> None:
    looking, _ = observing()
    first, second = looking.look(1.0, 45), looking.look(2.0, 90)
    assert second.shape == (3, 90, 120)
    assert abs(float(first.mean() - second.mean())) < 1e-3


class Complaining(PatientCamera):
    """Raises these errors first."""

    def __init__(self, *errors: Exception) -> None:
        super().__init__()
        self.errors = list(errors)

    def capture(self, newer_than: float) -> Frame:
        frame = super().capture(newer_than)
        if self.errors:
            raise self.errors.pop(0)
        return frame


@pytest.mark.parametrize("stale", [(2.9, 5), (3.0, 5), (math.nan, 5), "raise"])
def test_a_photograph_that_is_not_newer_than_the_last_motion_is_never_given(stale: tuple[float, int] | str) -> None:
    camera = PatientCamera([stale, stale])
    assert Photographer(camera).photograph(3.0).captured_at > 3.0
    assert camera.asked == [3.0, 3.0, 3.0]
    with pytest.raises(StaleFrame, match=r"asked 3 times .*\(at 3\.0 s\)"):
        Photographer(PatientCamera([stale, stale, stale])).photograph(3.0)


def test_no_photograph_is_given_twice() -> None:
    photographer = Photographer(PatientCamera([(4.0, 8), (9.0, 8), (9.0, 7), (9.0, 9), *3 * [(20.0, 9)]]))
    assert [photographer.photograph(3.0).sequence, photographer.photograph(5.0).sequence] == [8, 9]
    with pytest.raises(StaleFrame):
        photographer.photograph(10.0)


def test_what_a_camera_complains_of_is_tried_again_and_then_passed_on() -> None:
    out, blocked = CameraError("out of battery"), CameraError("blocked")
    assert Photographer(Complaining(out, out)).photograph(1.0).captured_at == 1.5
    with pytest.raises(CameraError, match="blocked"):
        Photographer(Complaining(StaleFrame("old"), out, blocked)).photograph(1.0)
    with pytest.raises(StaleFrame, match="asked 3 times"):
        Photographer(Complaining(out, blocked, StaleFrame("old"))).photograph(1.0)


def test_a_camera_whose_process_is_gone_is_asked_once() -> None:
    camera = Complaining(RobotDisconnected("gone"))
    with pytest.raises(RobotDisconnected):
        Photographer(camera).photograph(1.0)
    assert len(camera.asked) == 1
