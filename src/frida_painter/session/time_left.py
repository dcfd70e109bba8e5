"""Remaining time of work, from two estimators: the measured pace of computing, and the robot's timetable.

`Pace` serves all computing: plans, replans, experiments and sweeps. `Scheduled` (events.py) serves the machine;
choreography.py computes it from the robot's speeds and accelerations.
"""

import math
import time
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

from frida_painter.session import events
from frida_painter.session.events import Event

# Guesses before a measurement, in seconds: of an iteration of one stroke, of a painted stroke without a timetable,
# and of a second of a simulated robot's timetable.
_PLANNING, _STROKE, _TIMETABLE = 2.5e-5, 0.1, 0.02
_TOO_SHORT = 0.5  # seconds of a processor that do not tell yet how busy a machine is
_LONGEST_STEP = 3600.0  # seconds between two events of one sitting
_GROWING_COST = 1.4  # later iterations of a plan, with all strokes placed, take longer than the first


@dataclass
class Pace:
    """Pace of one kind of work, in seconds per unit: first a guess, then the mean of the measurements.

    guess: seconds per unit before the first measurement; infinite if unknown.
    spent, units: measured seconds, and the work that they did. The unit of planning is an iteration of one stroke.
    """

    guess: float = math.inf
    spent: float = 0.0
    units: float = 0.0

    def measure(self, seconds: float, units: float) -> None:
        """Adds a measurement: `units` took `seconds`."""
        self.spent += seconds
        self.units += units

    @property
    def seconds(self) -> float:
        """Seconds per unit: the mean of the measurements, or the guess before the first one."""
        return self.spent / self.units if self.units else self.guess

    def time_for(self, units: float) -> float:
        """Returns the seconds for that much work; infinite if neither a guess nor a measurement is known."""
        return units * self.seconds if units > 0 else 0.0


def measure_step(before: float, after: float) -> float:
    """Returns the seconds between two times of one sitting, in [0, 3600].

    The clock may be set back or forward in between, and the machine may sleep.
    """
    return min(max(0.0, after - before), _LONGEST_STEP)


def share_of_plan(iteration: int, of: int) -> float:
    """Returns the share of a plan's work that is done after an iteration, in [0, 1]."""
    return float((iteration / of) ** _GROWING_COST)


def remaining_seconds(passed: float, share: float) -> float:
    """Returns the remaining seconds of work if its part `share` took `passed` seconds; infinite if share is 0."""
    return Pace(spent=passed, units=share).time_for(1 - share)


class PlanTime:
    """Remaining time of a single plan, from its beginning on; used in the thread that plans.

    expected: seconds of the plan if nothing else runs on the machine; None if unknown
    clock, processor: seconds that pass, and seconds in which the processor works for this thread

    Their ratio so far tells how busy the machine is. The pace of a plan with a known time counts for little: networks
    see more views of a picture later.
    """

    def __init__(
        self,
        expected: float | None,
        clock: Callable[[], float] = time.monotonic,
        processor: Callable[[], float] = time.thread_time,
    ) -> None:
        self._expected, self._clock, self._processor = expected, clock, processor
        self._began, self._worked = clock(), processor()

    def find_remaining(self, share: float) -> float:
        """Returns the remaining seconds after a part `share` of the work, in [0, 1]."""
        passed = self._clock() - self._began
        if self._expected is None:
            return remaining_seconds(passed, share)
        busy = max(1.0, passed / max(self._processor() - self._worked, _TOO_SHORT))
        return (1 - share) * max(self._expected * busy, passed)


_PERSON = frozenset({events.Paused, events.PaintsWanted, events.Asked, events.StrokeOfPerson})
"""A person is waited for after these."""
_ROBOT = frozenset({
    events.WentOn, events.MotionBegan, events.Dipped, events.LayerBegun, events.BrushInHand, events.StrokePainted,
    events.StrokeLeftOut,
})  # fmt: skip
"""The robot is at work again."""
_COMPUTING = frozenset({events.PlanningStep, events.PlanAdopted, events.Planned, events.Scheduled})
"""The time before these was no painting."""


class RemainingTime:
    """Remaining time of a painting, from its events.

    Planning is measured in iterations times planned strokes. Painting is measured in seconds of the robot's
    timetable, which a real robot keeps and a simulated one runs faster than. Time that a person takes is neither, and
    the paint dries as long as the timetable says. Seconds count as painting only if a stroke follows.
    """

    def __init__(self) -> None:
        self._looks: list[int] = []
        self._replans: list[float] = []
        self._plan_left = 0.0
        self._painted = 0
        self._last: float | None = None
        self._planning = Pace(_PLANNING)
        self._painting = Pace(_STROKE)
        self._plan = events.Scheduled(0, 0)
        self._walked = 0.0
        self._dries = 0.0  # seconds of drying in the rest of the timetable
        self._share = 0.0  # of the current plan or replan
        self._wet: float | None = None  # seconds that a layer still dries, by the robot's clock
        self._steps = False  # True after an iteration of a plan
        self._waits = False  # True while a person is waited for
        self._since: float | None = 0.0  # seconds of painting since the last stroke; None if a person had some of them

    def hear(self, event: Event, now: float) -> None:
        """Receives an event at time `now` (seconds)."""
        passed, self._last = measure_step(now if self._last is None else self._last, now), now
        kind = type(event)
        steps, self._steps = self._steps, kind is events.PlanningStep
        person = kind in _PERSON or (isinstance(event, events.BrushInHand) and event.brush is None)
        counts = self._wet is None and not person and (not self._waits or (steps and self._steps))
        if self._wet is None and not counts:
            self._since = None
        elif self._since is not None and counts and kind not in _COMPUTING:
            self._since += passed
        self._waits = person or (self._waits and kind not in _ROBOT)
        match event:
            case events.StrokePainted(done=done) | events.StrokeLeftOut(done=done):
                self._painted = done
                self._forget_looks(until=done - 1)  # a look may not have led to a replan
                walked, since, self._since = self._walk(done), self._since, 0.0
                if since is not None:
                    self._painting.measure(since, walked)
            case events.Scheduled(done, strokes, looks):
                if event.after and not self._plan.after:
                    self._painting = Pace(_TIMETABLE)
                self._looks, self._painted = list(looks), done
                self._replans = [float(event.replanning * (strokes - look)) for look in looks]
                self._plan_left = float(event.planning * strokes)
                if event.seconds is not None or not self._plan.after:  # a sitting keeps its plan until it has looked
                    self._plan, self._walked, self._dries = event, 0.0, event.drying
            case events.PlanningStep(phase, iteration, of):
                work = float(of * (self._plan.strokes - self._painted))
                share = share_of_plan(iteration, of) if phase == "plan" else iteration / of
                if counts:
                    self._planning.measure(passed, max(0.0, share - self._share) * work)
                self._share = share
                if phase == "plan":
                    self._plan_left = (1 - share) * work
                elif self._replans:
                    self._replans[0] = (1 - share) * work
            case events.Planned(done=done):
                self._share = self._plan_left = 0.0
                if done:
                    self._forget_looks(until=done)
                else:
                    self._since = 0.0
            case events.SessionResumed():  # the break was no work, and what dried then is known from the next event
                self._wet, self._waits, self._since, self._share = None, False, 0.0, 0.0
            case events.Drying(left=left):
                dried = 0.0 if self._wet is None else self._wet - left
                self._walked, self._dries = self._walked + dried, self._dries - dried
                self._wet = left or None
            case events.Dipped() | events.LayerBegun() | events.BrushInHand(str()) | events.WentOn():
                self._since = self._since or 0.0

    @property
    def remaining(self) -> float:
        """Seconds until the last stroke."""
        plan, painting = self._plan, 0.0
        if self._painted < plan.strokes:
            walking = (plan.seconds or 0.0) - self._walked - self._dries if plan.after else plan.strokes - self._painted
            painting = self._painting.time_for(walking) + self._dries * plan.pace
        return self._planning.time_for(self._plan_left + sum(self._replans)) + painting

    def _forget_looks(self, until: int) -> None:
        """Removes the looks up to stroke `until`, with their replans."""
        while self._looks and self._looks[0] <= until:
            del self._looks[0], self._replans[0]

    def _walk(self, done: int) -> float:
        """Returns the progress of the timetable at stroke `done`, in its seconds without drying.

        In strokes if there is no timetable.
        """
        after, stroke = self._plan.after, done - self._plan.done
        if not after:
            return 1.0
        before, at = self._walked + self._dries, min(bisect_left(after, (stroke,)), len(after) - 1)
        (first, known, dried), (last, later, dry) = after[max(0, at - 1)], after[at]
        share = min(1.0, (stroke - first) / (last - first)) if last > first else 1.0
        self._walked = known + share * (later - known)
        self._dries = self._plan.drying - (dried + share * (dry - dried))
        return max(0.0, self._walked + self._dries - before)


def duration(seconds: float) -> str:
    """Returns seconds as text for a person, such as "3 min 05 s"."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
