"""The hand of the painter: performs what the choreography sets, and knows what is on its brush."""

from collections.abc import Callable
from dataclasses import dataclass, field

from frida_painter.brush.kinds import BrushKind
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints
from frida_painter.plan import Plan
from frida_painter.planning.placement import Placement
from frida_painter.session.choreography import Action, BrushLoad, Choreography
from frida_painter.session.events import Dipped, StrokeLeftOut, StrokePainted
from frida_painter.session.timetable import Timetable
from frida_painter.session.timing import reckon
from frida_painter.session.travel import shorten_travel


@dataclass
class Brushwork:
    """Paints plans on an easel, stroke by stroke.

    The robot is sent beside where a stroke is meant to be by as much as `placement` says that
    strokes land beside it. load: what is on the brush.
    """

    easel: Easel
    brush: BrushKind
    placement: Placement = field(default_factory=Placement.unknown)
    load: BrushLoad = field(default_factory=BrushLoad)
    _gateway: RobotGateway = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._gateway = RobotGateway(self.easel)

    @property
    def last_motion(self) -> float:
        """When the robot last moved, s of its clock."""
        return self._gateway.last_motion

    def arranged(self, plan: Plan, count: int) -> Plan:
        """The plan with its first `count` strokes in an order that is quicker to paint and gives the same picture."""
        return shorten_travel(plan, count, self._choreography(), self.load)

    def timetable(self, plan: Plan, looks: Callable[[int], int]) -> Timetable:
        """How long painting the plan takes, `looks(k)` looks coming after its stroke k."""
        return reckon(plan, self._choreography(), self.load, looks, self.easel.timing)

    def prepare(self, plan: Plan, already_done: int, of: int) -> list[Action]:
        """Everything that painting the plan takes, checked as a whole by the gateway, and foretold.

        Raises WorkspaceViolation before anything moves.
        """
        actions = list(self._choreography().actions(plan, self.load, already_done, of))
        motions = [motion for action in actions for motion in action.motions]
        self._gateway.check(motions)
        self.easel.foretell(motions)
        return actions

    def perform(self, action: Action) -> Dipped | StrokePainted | StrokeLeftOut:
        """Does it, and tells what was done. Raises RobotError and its kinds."""
        left_out = self._gateway.perform(action.motions)
        self.load = action.load
        done = action.done
        return StrokeLeftOut(done.done, done.of) if left_out and isinstance(done, StrokePainted) else done

    def step_aside(self) -> None:
        """Moves the arm out of the camera's sight."""
        self._gateway.step_aside()

    def cleaning(self) -> tuple[Waypoints, ...]:
        """The motions of `clean`."""
        return self._choreography().cleaning()

    def clean(self) -> None:
        """Rinses and wipes the brush as before another paint; afterwards it holds none."""
        self._gateway.perform(self.cleaning())
        self.load = BrushLoad()

    def _choreography(self) -> Choreography:
        calibration = self.placement.corrected(self.easel.calibration, self.easel.canvas)
        return Choreography(Motion(self.easel.workspace, calibration), self.brush)
