import pytest

from easels import PatientCamera, stub_easel
from frida_painter.errors import StaleFrame
from frida_painter.session.canvas_observer import CanvasObserver


def observing(*script: tuple[float, int] | str) -> tuple[CanvasObserver, PatientCamera]:
    camera = PatientCamera(list(script))
    return CanvasObserver(stub_easel(camera=camera), (1.0, 1.0, 1.0)), camera


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


def test_the_light_of_the_first_look_is_taken_out_of_the_later_ones() -> None:
    looking, _ = observing()
    first, second = looking.look(1.0, 45), looking.look(2.0, 90)
    assert second.shape == (3, 90, 120)
    assert abs(float(first.mean() - second.mean())) < 1e-3
