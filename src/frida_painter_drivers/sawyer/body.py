"""The arm's body and its joint controller: motors with torque limits move masses against gravity and friction.

The controller knows the arm's weight exactly, and its friction to about 20 %. It pulls each joint to its reference
by a spring and a damper. It adds the torque for the masses' acceleration, for their weight and against friction.
The remaining deviation is the arm's real error.
"""

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass

import mink
import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

# Inverse kinematics: joint angles for positions of the tip with an upright brush, by mink (differential, a
# small QP). The position and the brush's direction leave two of the seven joints free. They take the values nearest to
# the resting posture, so that the same position always has the same posture.

Angles = NDArray[np.float64]

# Weights of the costs: a radian off upright counts as much as _UPRIGHT metres off the position.
_UPRIGHT, _RESTING = 0.3, 0.001
_STEPS, _CLOSE = 60, 2e-6
# Greatest error (m) of a reached position; every how many references a posture is checked.
_MISSED, _LOOK_EVERY = 2e-4, 8
# Greatest speeds of the joints, rad/s (the maker's figures, as in sawyer.xml).
_FASTEST = np.array([1.74, 1.328, 1.957, 1.957, 3.485, 3.485, 4.545])


class Kinematics:
    """Kinematics of one arm in its surroundings. The model names the resting posture and the tip."""

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
        """Returns the position of the tip [3], metres, for joint angles [7]."""
        self._around.qpos[:] = angles
        mujoco.mj_kinematics(self.model, self._around)
        return self._around.site_xpos[self._tip].copy()

    def follow(self, places: NDArray[np.float64], start: Angles, stopped: threading.Event) -> Angles:
        """Returns joint angles [n, 7] that lead the tip through dense positions [n, 3], starting near `start`.

        Unreachable positions are approached as far as possible; `miss` measures the error. Returns fewer rows if
        `stopped` is set.
        """
        found = np.empty((len(places), self.model.nq))
        self._arm.update(start)
        for k, place in enumerate(places):
            if stopped.is_set():
                return found[:k]
            self._iterate(place)
            found[k] = self._arm.q
        return found

    def posture(self, place: NDArray[np.float64]) -> Angles:
        """Returns the joint angles [7] for a single position [3], sought from the resting posture."""
        self._arm.update(self.resting)
        for _ in range(_STEPS):
            before = self._arm.q.copy()
            self._iterate(place)
            if np.abs(self._arm.q - before).max() < _CLOSE:
                break
        return self._arm.q.copy()

    def miss(self, angles: Angles, place: NDArray[np.float64]) -> float:
        """Returns the error of the tip (m) at a position [3] for joint angles; one of the brush adds to it."""
        off = float(np.linalg.norm(self.tip(angles) - place))
        return off + 1 + float(self._around.site_xmat[self._tip][8])

    def touching(self, angles: Angles) -> str | None:
        """Returns the contact of the arm at these joint angles in words; None if it touches nothing."""
        self._around.qpos[:] = angles
        mujoco.mj_kinematics(self.model, self._around)
        mujoco.mj_collision(self.model, self._around)
        for contact in self._around.contact:
            names = [self.model.geom(number).name.replace("_", " ") for number in contact.geom]
            return f"its {names[0]} would touch its {names[1]}".replace("its table", "the table")
        return None

    def hindrance(self, angles: Angles, places: NDArray[np.float64], period: float) -> str | None:
        """Returns the reason why the arm cannot follow the angles [n, 7]; None if it can.

        angles: [n, 7], one row every `period` s
        places: [n, 3], intended positions of the tip
        """
        turning = np.abs(np.diff(angles, axis=0)) / period
        # Reach first: near its limit the joints already race before the arm misses.
        for k in range(0, len(angles), _LOOK_EVERY):
            place = "({:.3f}, {:.3f}, {:.3f}) m".format(*places[k])
            if not self.miss(angles[k], places[k]) <= _MISSED:
                return f"the arm does not reach {place} with the brush upright"
            if (touched := self.touching(angles[k])) is not None:
                return f"on the way to {place} {touched}"
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


_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_STEPS_PER_REFERENCE = 5
# Stiffness N m/rad and damping N m s/rad of the seven joints.
_STIFFNESS = np.array([4000.0, 4000.0, 2000.0, 2000.0, 500.0, 500.0, 150.0])
_DAMPING = np.array([170.0, 170.0, 75.0, 75.0, 14.0, 14.0, 6.0])
# Speed below which the friction compensation changes its sign gradually, rad/s.
_CREEP = 0.004
# Standard deviation of the controller's error about each joint's friction, as a share.
_KNOWN = 0.2
_AT_REST, _LONGEST_BRAKING = 1e-3, 0.5


@dataclass(frozen=True)
class Track:
    """Real motion of the arm.

    angles: of the joints [n, 7], for each reference and the end
    places: of the tip [n, 3], metres, likewise
    seconds: duration
    stopped: True if it was stopped on the way
    """

    angles: NDArray[np.float64]
    places: NDArray[np.float64]
    seconds: float
    stopped: bool


class SimulatedArm:
    """Simulated arm, at rest until `track`.

    model: arm in its surroundings
    angles: initial joint angles [7], radians
    seed: of the controller's error about the friction
    """

    def __init__(self, model: mujoco.MjModel, angles: NDArray[np.float64], seed: int) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        self._tip = model.site("tip").id
        self._step_time = float(model.opt.timestep)
        known = np.random.default_rng(seed).normal(1.0, _KNOWN, model.nv)
        self._friction = model.dof_frictionloss * known
        self._viscosity = model.dof_damping * known
        self._most = model.actuator_ctrlrange[:, 1].copy()
        self.data.qpos[:] = angles
        mujoco.mj_forward(model, self.data)

    @property
    def angles(self) -> NDArray[np.float64]:
        """Current joint angles [7], radians."""
        return self.data.qpos.copy()

    @property
    def tip(self) -> NDArray[np.float64]:
        """Current position of the tip [3], metres."""
        return self.data.site_xpos[self._tip].copy()

    def state(self) -> tuple[float, ...]:
        """Returns the complete state of the physics."""
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return tuple(state.tolist())

    def restore(self, state: Sequence[float]) -> None:
        """Restores a state from `state`."""
        mujoco.mj_setState(self.model, self.data, np.array(state), _STATE)
        mujoco.mj_step1(self.model, self.data)

    def track(
        self, reference: NDArray[np.float64], period: float, stopped: threading.Event, pace: float = 0.0
    ) -> Track:
        """Moves the joints along the references [n, 7], one every `period` s of simulated time.

        pace: least real seconds per simulated second

        If `stopped` is set, the arm brakes and holds its position. This is checked at every control step (2 ms).
        """
        history: list[NDArray[np.float64]] = []
        taken, began = 0, time.monotonic()
        for angles, speed, acceleration in zip(*_interpolate(reference, period, self._step_time), strict=True):
            if stopped.is_set():
                break
            if taken % _STEPS_PER_REFERENCE == 0:
                history.append(self._look_up_pose())
                early = began + pace * taken * self._step_time - time.monotonic()
                if early > 0 and stopped.wait(early):
                    break
            self._step(angles, speed, acceleration)
            taken += 1
        else:
            return self._make_track(history, taken, stopped=False)
        taken += self._brake(history)
        return self._make_track(history, taken, stopped=True)

    def _brake(self, history: list[NDArray[np.float64]]) -> int:
        """Stops the arm as fast as its motors can; returns the number of control steps."""
        longest = round(_LONGEST_BRAKING / self._step_time)
        still = np.zeros(self.model.nv)
        for step in range(longest):
            if np.abs(self.data.qvel).max() < _AT_REST:
                return step
            if step % _STEPS_PER_REFERENCE == 0:
                history.append(self._look_up_pose())
            self._step(self.data.qpos, still, still)
        return longest

    def _look_up_pose(self) -> NDArray[np.float64]:
        return np.concatenate([self.data.qpos, self.data.site_xpos[self._tip]])

    def _make_track(self, history: list[NDArray[np.float64]], steps: int, *, stopped: bool) -> Track:
        seen = np.array([*history, self._look_up_pose()])
        return Track(seen[:, :-3], seen[:, -3:], steps * self._step_time, stopped)

    def _step(self, angles: NDArray[np.float64], speed: NDArray[np.float64], acceleration: NDArray[np.float64]) -> None:
        """Makes one control step towards the reference. Positions and dynamics are up to date afterwards."""
        data = self.data
        inertial = np.empty(self.model.nv)
        mujoco.mj_mulM(self.model, data, inertial, acceleration)
        torque = (
            _STIFFNESS * (angles - data.qpos)
            + _DAMPING * (speed - data.qvel)
            + inertial
            + data.qfrc_bias
            + self._friction * np.tanh(speed / _CREEP)
            + self._viscosity * speed
        )
        data.ctrl[:] = np.clip(torque, -self._most, self._most)
        mujoco.mj_step2(self.model, data)
        mujoco.mj_step1(self.model, data)


def _interpolate(
    reference: NDArray[np.float64], period: float, step: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Returns angles, speeds and accelerations [m, 7] at every control step, on a smooth curve through `reference`."""
    time = np.arange(len(reference)) * period
    curve = CubicSpline(time, reference, bc_type="clamped")
    moment = np.arange(round(time[-1] / step)) * step
    return curve(moment), curve(moment, 1), curve(moment, 2)
