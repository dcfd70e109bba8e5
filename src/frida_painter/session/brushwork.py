"""The hand of the painter: which paint is on the brush, when to clean and refill it, and the strokes themselves."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch

from frida_painter.brush.kinds import BrushKind
from frida_painter.errors import PoseMismatch
from frida_painter.hardware import limits
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter.plan import Plan
from frida_painter.planning.placement import Placement
from frida_painter.session.events import Dipped, StrokePainted

_ARRIVED = 0.002
_DIP_SHARE = 0.6  # of the largest mark of the brush


@dataclass(frozen=True)
class Action:
    """One thing to do with the brush: motions that belong together, what to tell then, and the area painted, m2."""

    motions: tuple[Waypoints, ...]
    done: Dipped | StrokePainted
    area: float = 0.0


@dataclass
class Brushwork:
    """Paints plans on an easel, stroke by stroke.

    The brush is refilled before it runs out, by the area it has painted, and rinsed, wiped and
    dipped anew where the colour changes (paper, "Robot Setup Details"). The robot is sent beside
    where a stroke is meant to be by as much as `placement` says that strokes land beside it.
    """

    easel: Easel
    brush: BrushKind
    placement: Placement = field(default_factory=Placement.unknown)
    last_motion: float = field(default=0.0, init=False)
    _paint: int | None = field(default=None, init=False)
    _left: float = field(default=0.0, init=False)

    @property
    def _dip_area(self) -> float:
        """What one dip paints before the next, m2: the stroke model was learned from strokes of a full brush."""
        return _DIP_SHARE * self.brush.limits.length[1] * self.brush.width

    def prepare(self, plan: Plan, already_done: int, of: int) -> list[Action]:
        """Everything that painting the plan takes, checked as a whole against the workspace.

        Raises WorkspaceViolation before anything moves.
        """
        actions = list(self._actions(plan, already_done, of))
        limits.check((motion for action in actions for motion in action.motions), self.easel.workspace)
        return actions

    def perform(self, action: Action) -> None:
        """Does it. Raises RobotError and its kinds."""
        for motion in action.motions:
            self._follow(motion)
        if isinstance(action.done, Dipped):
            self._paint, self._left = action.done.paint, self._dip_area
        self._left -= action.area

    def step_aside(self) -> None:
        """Moves the arm out of the camera's sight."""
        self._take_note(self.easel.robot.home())

    def clean(self) -> None:
        """Rinses and wipes the brush; afterwards it holds no paint."""
        motion = Motion(self.easel.workspace, self.easel.calibration)
        limits.check([motion.rinse(), motion.wipe()], self.easel.workspace)
        self._follow(motion.rinse())
        self._follow(motion.wipe())
        self._paint = None

    def _actions(self, plan: Plan, already_done: int, of: int) -> Iterator[Action]:
        motion = Motion(self.easel.workspace, self.placement.corrected(self.easel.calibration, self.easel.canvas))
        strokes = plan.strokes.detach().to(torch.float64)
        areas = strokes.length * self.brush.width * (0.25 + 0.75 * strokes.thickness)
        on_brush, left = self._paint, self._left
        for index, (paint, area) in enumerate(zip(plan.paint.tolist(), areas.tolist(), strict=True)):
            if paint != on_brush:
                washing = () if on_brush is None else 2 * (motion.rinse(), motion.wipe())
                yield Action((*washing, motion.dip(paint)), Dipped(paint, cleaned=on_brush is not None))
                on_brush, left = paint, self._dip_area
            elif left < area:
                yield Action((motion.dip(paint),), Dipped(paint, cleaned=False))
                left = self._dip_area
            left -= area
            number = already_done + index + 1
            red, green, blue = strokes.color[index].tolist()
            waypoints = motion.stroke(strokes, index, f"stroke {number}")
            yield Action((waypoints,), StrokePainted(number, of, (red, green, blue)), area)

    def _follow(self, motion: Waypoints) -> None:
        report = self.easel.robot.follow(motion)
        self._take_note(report)
        away = float(np.linalg.norm(report.reached - motion.position[-1]))
        if not away <= _ARRIVED:
            raise PoseMismatch(
                f"{motion.label}: the robot says it is done, but its tip is {away * 1000:.1f} mm from where it was "
                f"sent; allowed are {_ARRIVED * 1000:g} mm. Look at the robot, then repeat the robot calibration."
            )

    def _take_note(self, report: MotionReport) -> None:
        self.last_motion = report.finished_at
