import numpy as np

from frida_painter.hardware.robot import ArmLength


def test_an_arm_gets_between_two_spheres_around_its_shoulder() -> None:
    arm = ArmLength((0.1, 0.0, 0.2), 0.2, 0.5)
    places = np.array([[0.1, 0.0, 0.2], [0.35, 0.0, 0.2], [0.61, 0.0, 0.2], [0.1, 0.3, 0.6], [np.nan, 0.0, 0.0]])
    assert arm.reachable(places).tolist() == [False, True, False, True, False]
