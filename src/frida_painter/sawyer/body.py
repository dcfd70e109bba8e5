"""The arm's body and its joint controller: motors with torque limits move masses against gravity and friction.

The controller knows the arm's weight, and its friction to some per cent. It holds each joint to its
reference by a spring and a damper, and adds what the motion is known to need: the torque for the
masses' acceleration, for their weight and against friction. What is left is the arm's real error.
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

# Joint angles for places of the brush's tip, the brush upright: inverse kinematics by mink (differential, a small
# QP).
#
# Two of the arm's seven joints are left over once the tip is somewhere and the brush upright. They go
# where the arm is nearest to its resting posture, so that the same place always means the same posture.

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


_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_STEPS_PER_REFERENCE = 5
# Stiffness N m/rad and damping N m s/rad of the seven joints.
_STIFFNESS = np.array([4000.0, 4000.0, 2000.0, 2000.0, 500.0, 500.0, 150.0])
_DAMPING = np.array([170.0, 170.0, 75.0, 75.0, 14.0, 14.0, 6.0])
# The controller's friction compensation turns over within this speed, rad/s.
_CREEP = 0.004
# How well the controller knows the friction of each joint: standard deviation, share.
_KNOWN = 0.2
_AT_REST, _LONGEST_BRAKING = 1e-3, 0.5


@dataclass(frozen=True)
class Track:
    """What the arm really did.

    angles: of the joints [n, 7]; places: of the tip [n, 3], metres; one for every reference, and the
    end; seconds: how long it took; stopped: whether it was stopped on the way.
    """

    angles: NDArray[np.float64]
    places: NDArray[np.float64]
    seconds: float
    stopped: bool


class SimulatedArm:
    """The simulated arm, at rest until it is told to `track`.

    model: of the arm in its surroundings; angles: of the joints at first [7], radians; seed: of what
    the controller does not know.
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
        """The joints' angles now [7], radians."""
        return self.data.qpos.copy()

    @property
    def tip(self) -> NDArray[np.float64]:
        """Where the tip is now [3], metres."""
        return self.data.site_xpos[self._tip].copy()

    def state(self) -> tuple[float, ...]:
        """All that the physics follows from."""
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return tuple(state.tolist())

    def restore(self, state: Sequence[float]) -> None:
        """Puts the arm into a state that `state` gave."""
        mujoco.mj_setState(self.model, self.data, np.array(state), _STATE)
        mujoco.mj_step1(self.model, self.data)

    def track(
        self, reference: NDArray[np.float64], period: float, stopped: threading.Event, pace: float = 0.0
    ) -> Track:
        """Moves the joints along the references [n, 7], one every `period` s of its own.

        A second of its motion takes at least `pace` seconds of the world's.

        Heeds `stopped` at every control step (2 ms): then the arm brakes and holds where it is.
        """
        history: list[NDArray[np.float64]] = []
        taken, began = 0, time.monotonic()
        for angles, speed, acceleration in zip(*_interpolated(reference, period, self._step_time), strict=True):
            if stopped.is_set():
                break
            if taken % _STEPS_PER_REFERENCE == 0:
                history.append(self._seen())
                early = began + pace * taken * self._step_time - time.monotonic()
                if early > 0 and stopped.wait(early):
                    break
            self._step(angles, speed, acceleration)
            taken += 1
        else:
            return self._told(history, taken, stopped=False)
        taken += self._brake(history)
        return self._told(history, taken, stopped=True)

    def _brake(self, history: list[NDArray[np.float64]]) -> int:
        """Brings the arm to rest as fast as its motors can; the control steps that took."""
        longest = round(_LONGEST_BRAKING / self._step_time)
        still = np.zeros(self.model.nv)
        for step in range(longest):
            if np.abs(self.data.qvel).max() < _AT_REST:
                return step
            if step % _STEPS_PER_REFERENCE == 0:
                history.append(self._seen())
            self._step(self.data.qpos, still, still)
        return longest

    def _seen(self) -> NDArray[np.float64]:
        return np.concatenate([self.data.qpos, self.data.site_xpos[self._tip]])

    def _told(self, history: list[NDArray[np.float64]], steps: int, *, stopped: bool) -> Track:
        seen = np.array([*history, self._seen()])
        return Track(seen[:, :-3], seen[:, -3:], steps * self._step_time, stopped)

    def _step(self, angles: NDArray[np.float64], speed: NDArray[np.float64], acceleration: NDArray[np.float64]) -> None:
        """One control period towards the reference. Leaves positions and weights as they are afterwards."""
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


def _interpolated(
    reference: NDArray[np.float64], period: float, step: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Angles, speeds and accelerations [m, 7] at every control step, smooth through the references [n, 7]."""
    time = np.arange(len(reference)) * period
    curve = CubicSpline(time, reference, bc_type="clamped")
    moment = np.arange(round(time[-1] / step)) * step
    return curve(moment), curve(moment, 1), curve(moment, 2)
