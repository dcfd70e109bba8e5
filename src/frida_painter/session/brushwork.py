"""The hand of the painter: performs what the choreography sets, and knows what is on its brush."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from frida_painter.brush.dip import Dip
from frida_painter.brush.endurance import dip_shown
from frida_painter.brush.kinds import BrushKind, brush_kind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.calibration import Calibration
from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints
from frida_painter.hardware.workspace import Workspace
from frida_painter.plan import Plan
from frida_painter.planning.fading import Fading
from frida_painter.planning.placement import Placement
from frida_painter.session.choreography import Action, BrushLoad, Choreography
from frida_painter.session.events import Dipped, StrokeLeftOut, StrokePainted
from frida_painter.session.stroke_order import put_in_order
from frida_painter.session.timetable import DRYING, Timetable
from frida_painter.session.timing import Looks, reckon


@dataclass
class Brushwork:
    """Paints plans on an easel, stroke by stroke.

    The robot is sent beside where a stroke is meant to be by as much as `placement` says that
    strokes land beside it. load: what is on the brush; drying: seconds that a layer is let dry before the next one;
    others: the brushes of later layers; held: the one that is in the holder, "" for none, None where that is not known.
    Where the workspace has a rack, all of them are in it at first.
    """

    easel: Easel
    brush: BrushKind
    placement: Placement = field(default_factory=Placement.unknown)
    load: BrushLoad = field(default_factory=BrushLoad)
    drying: float = DRYING
    others: tuple[BrushKind, ...] = ()
    held: str | None = field(init=False)
    _gateway: RobotGateway = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._gateway = RobotGateway(self.easel)
        self.learn(self.placement)
        self.held = self.brush.name if self.easel.workspace.rack is None else ""

    @property
    def last_motion(self) -> float:
        """When the robot last moved, s of its clock."""
        return self._gateway.last_motion

    def learn(self, placement: Placement) -> None:
        """From now on the robot is sent by that; where it could not go as low, to the heights that it was sent to."""
        calibration = self.easel.calibration
        record = placement.touch.corrected(calibration)
        presses = [record.press_height, *(one.press_height for one in record.others.values())]
        if not min(presses) >= self.easel.workspace.lower[2]:
            placement = replace(placement, touch=self.placement.touch)
        self.placement = placement
        self._gateway.follow_touch(max(map(placement.touch.correction, (calibration.brush, *calibration.others))))

    def arranged(self, plan: Plan, count: int, fading: Fading | None = None) -> Plan:
        """The plan with its first `count` strokes in an order that is good to paint; the plan's picture stays.

        fading: what it costs that strokes lack paint, None: nothing.
        """
        return put_in_order(plan, count, self._choreography(), self.load, fading)

    def timetable(self, plan: Plan, looks: Looks, load: BrushLoad | None = None) -> Timetable:
        """How long painting the plan takes, with its looks.

        load: what is on the brush then, None for what is on it now.
        """
        return reckon(plan, self._choreography(), load or self.load, looks, self.easel.timing, self.drying, self.held)

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

    @property
    def has_rack(self) -> bool:
        """Whether the robot takes its brushes from a rack by itself."""
        return self.easel.workspace.rack is not None

    def require_rack(self) -> None:
        """Where there is a rack, it holds all brushes, and the robot gets to them.

        Raises ConfigError and WorkspaceViolation, before anything moves.
        """
        rack = self.easel.workspace.rack
        if rack is None:
            return
        names = [kind.name for kind in (self.brush, *self.others)]
        missing = [name for name in names if name not in rack.places]
        if missing:
            raise ConfigError(
                f"The rack of the workspace holds {', '.join(rack.places)}, and this painting needs "
                f"{' and '.join(missing)}; paint with those that are there (--brushes), or give "
                f"{'it' if len(missing) == 1 else 'them'} a place ([rack] places)."
            )
        motion = self._choreography().motion
        self._gateway.check(each for name in names for each in motion.change(name, name))

    def changing(self, brush: str) -> list[tuple[Waypoints, str]]:
        """How the robot has a brush of the rack in its hand, "" for none: motions, and what it holds after each."""
        motion = self._choreography().motion
        steps: list[tuple[Waypoints, str]] = []
        if self.held and self.held != brush:
            steps.append((motion.put_back(self.held), ""))
        if brush and self.held != brush:
            steps.append((motion.take(brush), brush))
        return steps

    def move_brush(self, motion: Waypoints, held: str) -> None:
        """Puts a clean brush into the rack or takes one from it, after which the robot holds the brush `held`."""
        self.held = None
        self._gateway.perform((motion,))
        self.held, self.load = held, BrushLoad()

    def change_brush(self, name: str) -> None:
        """Has a person put the brush of a layer into the holder; the one before is clean and aside.

        Raises Interrupted where nobody does it.
        """
        self.held = None
        self.easel.operator.change_brush(name)
        self.held, self.load = name, BrushLoad()

    def _choreography(self) -> Choreography:
        record = self.placement.corrected(self.easel.calibration, self.easel.canvas)
        return _choreography(self.easel.workspace, record, (self.brush, *self.others))


def choreography_at(
    workspace: Workspace, record: Calibration, brushes: Sequence[str], *, simulated: bool
) -> Choreography:
    """What moves these brushes, the first of which is in the holder, at the easel of a record.

    Raises ConfigError where a brush is not known, CalibrationError where the record does not know it.
    """
    kinds = [refilled(brush_kind(name), record, simulated=simulated) for name in brushes]
    return _choreography(workspace, record, kinds)


def _choreography(workspace: Workspace, record: Calibration, kinds: Sequence[BrushKind]) -> Choreography:
    first, *others = kinds
    later = {kind.name: Choreography(Motion(workspace, record.of_brush(kind.name)), kind) for kind in others}
    return Choreography(Motion(workspace, record), first, later)


STROKES_PER_DIP = 4
"""Where nothing is known of a brush: what the program that was published with the paper took for all."""


def refilled(kind: BrushKind, record: Calibration, *, simulated: bool) -> BrushKind:
    """The brush with what one dip of it is good for at the easel of that record.

    That is what the record's stroke library shows; where it does not, or there is none, a fixed number of
    strokes, but in the virtual studio what is known of the project's own brushes. Raises LibraryError
    where the library is damaged.
    """
    if kind.name in record.others:
        record = record.of_brush(kind.name)
    if record.library is not None and record.brush == kind.name:
        shown = dip_shown(StrokeLibrary.load(Path(record.library.path)), kind.width)
        if shown is not None:
            return replace(kind, known_dip=shown)
    return kind if simulated else replace(kind, known_dip=Dip.of_strokes(STROKES_PER_DIP))
