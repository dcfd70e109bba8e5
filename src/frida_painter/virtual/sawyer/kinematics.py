"""Joint angles for places of the brush's tip, the brush upright: inverse kinematics by mink (differential, a small QP).

Two of the arm's seven joints are left over once the tip is somewhere and the brush upright. They go
where the arm is nearest to its resting posture, so that the same place always means the same posture.
"""

import threading

import mink
import mujoco
import numpy as np
from numpy.typing import NDArray

Angles = NDArray[np.float64]

# Costs against one another: a radian off upright weighs as much as _UPRIGHT metres off the place.
_UPRIGHT, _RESTING = 0.3, 0.001
_STEPS, _CLOSE = 60, 2e-6
# A place counts as reached within this (m); postures are looked at every so many references.
_MISSED, _LOOK_EVERY = 2e-4, 8
# How fast the joints can turn, rad/s (the maker's figures, as in sawyer.xml).
_FASTEST = np.array([1.74, 1.328, 1.957, 1.957, 3.485, 3.485, 4.545])


class Kinematics:
    """The geometry of one arm in its surroundings; its description names the posture it likes best, and the tip."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.resting: Angles = model.key("neutral").qpos.copy()
        self._tip = model.site("tip").id
        self._arm = mink.Configuration(model, self.resting)
        self._place = mink.FrameTask("tip", "site", position_cost=1.0, orientation_cost=0.0)
        self._upright = mink.AxisAlignTask("tip", "site", axis=(0.0, 0.0, 1.0), cost=_UPRIGHT)
        self._upright.set_target(np.array([0.0, 0.0, -1.0]))
        self._posture = mink.PostureTask(model, cost=_RESTING)
        self._posture.set_target(self.resting)
        self._limits = (mink.ConfigurationLimit(model),)
        self._around = mujoco.MjData(model)

    def tip(self, angles: Angles) -> NDArray[np.float64]:
        """Where the tip is [3], metres, with the joints at these angles [7]."""
        self._around.qpos[:] = angles
        mujoco.mj_kinematics(self.model, self._around)
        return self._around.site_xpos[self._tip].copy()

    def follow(self, places: NDArray[np.float64], start: Angles, stopped: threading.Event) -> Angles:
        """Angles [n, 7] that lead the tip through places [n, 3], which lie close together, beginning near `start`.

        What is out of reach is come as near to as possible: `miss` tells. Ends early, with fewer rows,
        once `stopped` is set.
        """
        found = np.empty((len(places), self.model.nq))
        self._arm.update(start)
        for k, place in enumerate(places):
            if stopped.is_set():
                return found[:k]
            self._iterate(place)
            found[k] = self._arm.q
        return found

    def posture(self, place: NDArray[np.float64], start: Angles | None = None) -> Angles:
        """The angles [7] for a single place [3], however far from `start` (None: the resting posture)."""
        self._arm.update(self.resting if start is None else start)
        for _ in range(_STEPS):
            before = self._arm.q.copy()
            self._iterate(place)
            if np.abs(self._arm.q - before).max() < _CLOSE:
                break
        return self._arm.q.copy()

    def miss(self, angles: Angles, place: NDArray[np.float64]) -> float:
        """How far (m) the tip is from a place [3] with the joints at these angles, leaning counted as a miss."""
        off = float(np.linalg.norm(self.tip(angles) - place))
        lean = 1 + float(self._around.site_xmat[self._tip][8])  # the brush's way down is world -z
        return off + lean

    def touching(self, angles: Angles) -> str | None:
        """What the arm would touch with the joints at these angles, in words; None for nothing."""
        self._around.qpos[:] = angles
        mujoco.mj_kinematics(self.model, self._around)
        mujoco.mj_collision(self.model, self._around)
        for contact in self._around.contact:
            names = [self.model.geom(number).name.replace("_", " ") for number in contact.geom]
            return f"its {names[0]} would touch its {names[1]}".replace("its table", "the table")
        return None

    def hindrance(self, angles: Angles, places: NDArray[np.float64], period: float) -> str | None:
        """Why the arm cannot go through angles [n, 7], one every `period` s, to places [n, 3]; None where it can."""
        turning = np.abs(np.diff(angles, axis=0)) / period
        # Far out the joints race before the arm misses, so that reach is asked first.
        for k in range(0, len(angles), _LOOK_EVERY):
            if not self.miss(angles[k], places[k]) <= _MISSED:
                return f"the arm does not reach {_told(places[k])} with the brush upright"
            touched = self.touching(angles[k])
            if touched is not None:
                return f"on the way to {_told(places[k])} {touched}"
        if not (turning <= _FASTEST).all():
            joint = int((turning / _FASTEST).max(0).argmax())
            fastest = turning[:, joint].max()
            return f"joint {joint} would have to turn at {fastest:.1f} rad/s; it can at {_FASTEST[joint]:.1f}"
        return None

    def _iterate(self, place: NDArray[np.float64]) -> None:
        self._place.set_target(mink.SE3.from_translation(place))
        velocity = mink.solve_ik(
            self._arm, (self._place, self._upright, self._posture), 1.0, solver="daqp", limits=self._limits
        )
        self._arm.integrate_inplace(velocity, 1.0)


def _told(place: NDArray[np.float64]) -> str:
    return "({:.3f}, {:.3f}, {:.3f}) m".format(*place)
