"""Kinematics of a Franka that are known before it is connected: joint limits, reach, rotations, paths that go on."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

JOINT_MARGIN = math.radians(3)
"""Distance that is kept from the joint limits, radians."""
LOWER_JOINTS = np.array([-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159])
UPPER_JOINTS = np.array([2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159])
"""Joint limits of the Franka Research 3 in radians, which are inside those of the Panda.

Source: Franka's data sheet; the arm sends them in its model, too.
"""
_STARTING = 10  # periods of a path in which the arm comes from rest to its speed

# Lengths of the arm in metres (Denavit-Hartenberg table of Franka's documentation), from its base to the tool frame
# of its hand: to the shoulder, to the elbow and to the wrist, with the elbow's offset, and the offset and length of
# the hand.
_SHOULDER, _UPPER, _FORE, _ELBOW, _WRIST, _HAND = 0.333, 0.316, 0.384, 0.0825, 0.088, 0.107 + 0.1034


@dataclass(frozen=True)
class FrankaReach:
    """Reach of a Franka with its hand, the brush upright and the elbow up: inverse kinematics in closed form.

    Implements hardware.robot.Reach. The driver itself solves with the model that the arm sends; this one is
    known before the arm is.

    brush_length, turn: as in FrankaSettings
    """

    brush_length: float
    turn: float = 0.0

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each position [k, 3] (m) that the tip reaches within the limits of all joints: [k]."""
        joints = self.solve(position)
        with np.errstate(invalid="ignore"):
            inside = (joints >= LOWER_JOINTS + JOINT_MARGIN) & (joints <= UPPER_JOINTS - JOINT_MARGIN)
        return np.asarray(inside.all(1))

    def solve(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the joint angles [k, 7] (radians) at positions [k, 3] (m); NaN at those beyond the arm's length."""
        x, y, z = np.asarray(position, np.float64).T
        across = np.hypot(x, y) - _WRIST
        up = z + self.brush_length + _HAND - _SHOULDER
        upper, fore = math.hypot(_UPPER, _ELBOW), math.hypot(_FORE, _ELBOW)
        bent_upper, bent_fore = math.atan2(_ELBOW, _UPPER), math.atan2(_ELBOW, _FORE)
        away = np.hypot(across, up)
        with np.errstate(invalid="ignore", divide="ignore"):
            at_elbow = np.arccos((upper**2 + fore**2 - away**2) / (2 * upper * fore))
            at_shoulder = np.arccos((upper**2 + away**2 - fore**2) / (2 * upper * away))
        base, rest = np.arctan2(y, x), np.zeros_like(x)
        second = np.arctan2(across, up) - at_shoulder - bent_upper
        fourth = at_elbow - math.pi - bent_upper - bent_fore
        last = math.pi / 4 + base - math.radians(self.turn)
        last = (last + math.pi) % (2 * math.pi) - math.pi
        return np.stack([base, second, rest, fourth, rest, second - fourth, last], -1)


def resume_path(joints: NDArray[np.float64], here: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns joint angles [m, 7] at every period for the rest of a path, from rest at a place beside its first angles.

    joints [n, 7]: at every period, the first beside the standing arm, the last at rest
    here [7]: angles of the standing arm
    """
    left = len(joints) - 1
    start = np.arange(2 * _STARTING) ** 2 / (4 * _STARTING)  # periods of the path, from rest to full speed
    along = np.r_[start, np.arange(_STARTING, max(_STARTING, left) + 1)] * min(1.0, left / _STARTING)
    path = np.stack([np.interp(along, np.arange(left + 1), joint) for joint in joints.T], 1)
    share = np.minimum(1, np.arange(len(path)) / len(start))
    return path + (here - joints[0]) * (1 - share**2 * (3 - 2 * share))[:, None]


def make_upright(turn: float) -> NDArray[np.float64]:
    """Returns the rotation of the tool [3, 3] with the brush pointing straight down. turn: of the hand, degrees"""
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    return np.array([[cos, sin, 0.0], [sin, -cos, 0.0], [0.0, 0.0, -1.0]])


def rotation_vector(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the axis of a rotation [3, 3] times its angle in radians [3]."""
    axis = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    sine, cosine = float(np.linalg.norm(axis)) / 2, (float(np.trace(rotation)) - 1) / 2
    angle = math.atan2(sine, cosine)
    return axis / 2 if sine < 1e-12 else axis * (angle / (2 * sine))


def make_rotation(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the rotation [3, 3] about a vector [3] by its length in radians (Rodrigues' formula)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
