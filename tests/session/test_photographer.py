import math

import pytest

from easels import PatientCamera
from frida_painter.errors import CameraError, RobotDisconnected, StaleFrame
from frida_painter.hardware.camera import Frame
from frida_painter.session.photographer import Photographer


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
