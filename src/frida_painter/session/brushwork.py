"""The hand of the painter: performs what the choreography sets, and knows what is on its brush."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from frida_painter.brush.kinds import BrushKind
from frida_painter.errors import PoseMismatch
from frida_painter.hardware import limits
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter.plan import Plan
from frida_painter.planning.placement import Placement
from frida_painter.session.choreography import Action, BrushLoad, Choreography
from frida_painter.session.events import Dipped, StrokeLeftOut, StrokePainted
from frida_painter.session.timetable import Timetable
from frida_painter.session.timing import reckon
from frida_painter.session.travel import shorten_travel

_ARRIVED = 0.002


@dataclass
class Brushwork:
    """Paints plans on an easel, stroke by stroke.

    The robot is sent beside where a stroke is meant to be by as much as `placement` says that
    strokes land beside it. load: what is on the brush; last_motion: when the robot last moved, s of
    its clock.
    """

    easel: Easel
    brush: BrushKind
    placement: Placement = field(default_factory=Placement.unknown)
    load: BrushLoad = field(default_factory=BrushLoad)
    last_motion: float = field(default=0.0, init=False)

    def arranged(self, plan: Plan, count: int) -> Plan:
        """The plan with its first `count` strokes in an order that is quicker to paint and gives the same picture."""
        return shorten_travel(plan, count, self._choreography(), self.load)

    def timetable(self, plan: Plan, looks: Callable[[int], int]) -> Timetable:
        """How long painting the plan takes, `looks(k)` looks coming after its stroke k."""
        return reckon(plan, self._choreography(), self.load, looks, self.easel.timing)

    def prepare(self, plan: Plan, already_done: int, of: int) -> list[Action]:
        """Everything that painting the plan takes, checked as a whole against the workspace, and foretold.

        Raises WorkspaceViolation before anything moves.
        """
        actions = list(self._choreography().actions(plan, self.load, already_done, of))
        motions = [motion for action in actions for motion in action.motions]
        self._check(motions)
        self.easel.foretell(motions)
        return actions

    def perform(self, action: Action) -> Dipped | StrokePainted | StrokeLeftOut:
        """Does it, and tells what was done. Raises RobotError and its kinds."""
        left_out = self._follow(action.motions)
        self.load = action.load
        done = action.done
        return StrokeLeftOut(done.done, done.of) if left_out and isinstance(done, StrokePainted) else done

    def step_aside(self) -> None:
        """Moves the arm out of the camera's sight."""
        self._take_note(self.easel.robot.home())

    def cleaning(self) -> tuple[Waypoints, ...]:
        """The motions of `clean`."""
        return self._choreography().cleaning()

    def clean(self) -> None:
        """Rinses and wipes the brush as before another paint; afterwards it holds none."""
        washing = self.cleaning()
        self._check(washing)
        self._follow(washing)
        self.load = BrushLoad()

    def _choreography(self) -> Choreography:
        calibration = self.placement.corrected(self.easel.calibration, self.easel.canvas)
        return Choreography(Motion(self.easel.workspace, calibration), self.brush)

    def _check(self, motions: Iterable[Waypoints]) -> None:
        surface = limits.Surface(self.easel.canvas, self.easel.calibration.press_height)
        limits.check(motions, self.easel.workspace, surface, self.easel.reach)

    def _follow(self, motions: Iterable[Waypoints]) -> bool:
        """Whether any of them was left out by whoever paints by hand."""
        left_out = False
        for motion in motions:
            report = self.easel.robot.follow(motion)
            self._take_note(report)
            away = float(np.linalg.norm(report.reached - motion.position[-1]))
            if not away <= _ARRIVED:
                raise PoseMismatch(
                    f"{motion.label}: the robot says it is done, but its tip is {away * 1000:.1f} mm from where it "
                    f"was sent; allowed are {_ARRIVED * 1000:g} mm. Look at the robot, then repeat the robot "
                    "calibration."
                )
            left_out |= report.left_out
        return left_out

    def _take_note(self, report: MotionReport) -> None:
        self.last_motion = report.finished_at
