"""Remaining time of a painting, forecast from the measured durations of each kind of work."""

from dataclasses import dataclass

from frida_painter.session.events import (
    Drying,
    Event,
    Looked,
    Planned,
    PlanningStep,
    Resumed,
    Scheduled,
    StrokeLeftOut,
    StrokePainted,
    TimelapseFrame,
)
from frida_painter.session.replan_policy import ReplanPolicy, looks_on_the_way


@dataclass
class TimeEstimate:
    """Seconds per unit of one kind of work: first a guess, then the mean of the measurements."""

    guess: float
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


class RemainingTime:
    """Remaining time of a painting, from its events.

    Planning is measured in iterations times planned strokes. Painting is measured in seconds of the robot's
    timetable, which a real robot keeps and a simulated one runs faster than.
    """

    def __init__(self, strokes: int, policy: ReplanPolicy, now: float, *, planning: int, replanning: int) -> None:
        self._strokes = strokes
        self._looks = looks_on_the_way(policy, strokes)
        self._replans = [replanning * (strokes - done) for done in self._looks]
        self._plan_left = float(planning * strokes)
        self._painted = 0
        self._last = now
        self._planning = TimeEstimate(2.5e-5)
        self._painting = TimeEstimate(0.1)  # of a stroke, until there is a timetable
        self._after: tuple[float, ...] = ()
        self._end = 0.0
        self._begun = 0
        self._walked = 0.0
        self._iteration = 0
        self._wet: float | None = None  # seconds that a layer still dries

    def hear(self, event: Event, now: float) -> None:
        """Receives an event at time `now` (seconds)."""
        passed, self._last = now - self._last, now
        if self._wet is not None:  # the time of drying is fixed and says nothing about other work
            passed = 0.0
        match event:
            case PlanningStep(phase, iteration, of):
                alive = self._strokes - self._painted
                self._planning.measure(passed, (iteration - self._iteration) * alive)
                self._iteration = iteration
                left = float((of - iteration) * alive)
                if phase == "plan":
                    self._plan_left = left
                elif self._replans:
                    self._replans[0] = int(left)
            case Planned(done=done):
                self._iteration = 0
                self._plan_left = 0.0
                if done:
                    self._forget_looks(until=done)
            case Resumed(done=done):
                self._plan_left, self._painted = 0.0, done
                self._forget_looks(until=done - 1)
            case Scheduled(timetable=timetable, done=done):
                if not self._after:
                    self._painting = TimeEstimate(0.02)
                self._after, self._end, self._begun, self._walked = timetable.after, timetable.total, done, 0.0
            case Drying(left=left):
                self._walked += 0.0 if self._wet is None else self._wet - left
                self._wet = left or None
            case StrokePainted(done=done) | StrokeLeftOut(done=done):
                self._painted = done
                self._forget_looks(until=done - 1)  # a look may not have led to a replan
                self._painting.measure(passed, self._walk(done))
            case TimelapseFrame() | Looked():
                self._painting.measure(passed, 0)
            case _:
                pass

    @property
    def remaining(self) -> float:
        """Seconds until the last stroke."""
        planning = (self._plan_left + sum(self._replans)) * self._planning.seconds
        walking = self._end - self._walked if self._after else self._strokes - self._painted
        return planning + (walking if self._painted < self._strokes else 0.0) * self._painting.seconds

    def _forget_looks(self, until: int) -> None:
        """Removes the looks up to stroke `until`, with their replans."""
        while self._looks and self._looks[0] <= until:
            del self._looks[0], self._replans[0]

    def _walk(self, done: int) -> float:
        """Returns the progress of the timetable at stroke `done`, in its seconds.

        In strokes if there is no timetable.
        """
        if not self._after:
            return 1.0
        before, self._walked = self._walked, self._after[min(done - self._begun, len(self._after)) - 1]
        return max(0.0, self._walked - before)


def duration(seconds: float) -> str:
    """Returns seconds as text for a person, such as "3 min 05 s"."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
