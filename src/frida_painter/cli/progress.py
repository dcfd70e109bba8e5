"""Progress with a time left that can be believed: it is forecast from what each kind of work has really taken."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

from frida_painter.planning.optimize import Step
from frida_painter.session.events import (
    Event,
    Looked,
    PaintsWanted,
    Paused,
    Planned,
    PlanningStep,
    Resumed,
    Scheduled,
    StrokeLeftOut,
    StrokePainted,
    TimelapseFrame,
)
from frida_painter.session.replan_policy import ReplanPolicy, looks_on_the_way

_GROWING_COST = 1.4


@dataclass
class Pace:
    """Seconds that one unit of some work takes: guessed at first, then measured."""

    guess: float
    spent: float = 0.0
    units: float = 0.0

    def measure(self, seconds: float, units: float) -> None:
        """Takes note that `units` took `seconds`."""
        self.spent += seconds
        self.units += units

    @property
    def seconds(self) -> float:
        """Seconds per unit; the guess counts like one unit of experience in ten of the first."""
        return self.spent / self.units if self.units else self.guess


class Forecast:
    """How long a painting still takes, from its events.

    Planning is counted in iterations times strokes planned, painting in seconds of the robot's own
    timetable, which a simulated robot's run away from and a real one's keep to. `remaining` is in
    seconds.
    """

    def __init__(self, strokes: int, policy: ReplanPolicy, now: float, *, planning: int, replanning: int) -> None:
        self._strokes = strokes
        self._looks = looks_on_the_way(policy, strokes)
        self._replans = [replanning * (strokes - done) for done in self._looks]
        self._plan_left = float(planning * strokes)
        self._painted = 0
        self._last = now
        self._planning = Pace(2.5e-5)
        self._painting = Pace(0.1)  # of a stroke, until there is a timetable
        self._after: tuple[float, ...] = ()
        self._end = 0.0
        self._begun = 0
        self._walked = 0.0
        self._iteration = 0

    def hear(self, event: Event, now: float) -> None:
        """Takes note of an event at time `now` (seconds)."""
        passed, self._last = now - self._last, now
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
                    self._painting = Pace(0.02)
                self._after, self._end, self._begun, self._walked = timetable.after, timetable.total, done, 0.0
            case StrokePainted(done=done) | StrokeLeftOut(done=done):
                self._painted = done
                self._forget_looks(until=done - 1)  # after one of them nothing may have been planned again
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
        """Looks after at most so many strokes are over, with what is planned again after them."""
        while self._looks and self._looks[0] <= until:
            del self._looks[0], self._replans[0]

    def _walk(self, done: int) -> float:
        """How much farther the timetable is with stroke `done` than it was, in its seconds; in strokes without one."""
        if not self._after:
            return 1.0
        before, self._walked = self._walked, self._after[min(done - self._begun, len(self._after)) - 1]
        return max(0.0, self._walked - before)


def _bar(console: Console) -> Progress:
    return Progress(TextColumn("{task.description}"), BarColumn(bar_width=36), _TimeLeft(), console=console)


class Line:
    """A bar on the terminal, there while a `with` block lasts."""

    def __init__(self, bar: Progress) -> None:
        self._bar = bar

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()


class PaintingProgress(Line):
    """One line on the terminal: what is going on, how far it is, and the time left."""

    def __init__(self, console: Console, forecast: Forecast) -> None:
        self._forecast = forecast
        self._started = time.monotonic()
        super().__init__(
            Progress(TextColumn("{task.description}"), BarColumn(bar_width=36), _TimeLeft(), console=console)
        )
        self._task = self._bar.add_task("getting ready", total=1.0, left=forecast.remaining)

    def hear(self, event: Event) -> None:
        """Shows an event; while the painting pauses, the terminal is for questions."""
        now = time.monotonic()
        if isinstance(event, Paused):
            self._bar.stop()
        else:
            self._bar.start()
        self._forecast.hear(event, now)
        passed, left = now - self._started, self._forecast.remaining
        self._bar.update(
            self._task,
            description=_words(event) or self._bar.tasks[0].description,
            completed=passed / max(passed + left, 1e-9),
            left=left,
        )

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Leaves the terminal to a question."""
        shown = self._bar.live.is_started
        self._bar.stop()
        try:
            yield
        finally:
            if shown:
                self._bar.start()

    def say(self, words: str) -> None:
        """Shows what is going on outside the session's events."""
        self._bar.update(self._task, description=words)


class PlanningProgress(Line):
    """One line on the terminal for a plan alone."""

    def __init__(self, console: Console) -> None:
        self._started = time.monotonic()
        super().__init__(
            Progress(TextColumn("{task.description}"), BarColumn(bar_width=36), _TimeLeft(), console=console)
        )
        self._task = self._bar.add_task("getting ready", total=1.0, left=math.inf)

    def hear(self, step: Step) -> None:
        """Shows a step; later ones, with all strokes placed, take longer than the first."""
        share = (step.iteration / step.of) ** _GROWING_COST
        left = (time.monotonic() - self._started) * (1 - share) / share
        self._bar.update(self._task, description=f"planning {100 * share:3.0f} %", completed=share, left=left)


class _TimeLeft(ProgressColumn):
    """The time left in words."""

    def render(self, task: Task) -> Text:
        left = task.fields["left"]
        return Text(f"{duration(left)} left" if math.isfinite(left) else "")


def duration(seconds: float) -> str:
    """Seconds as a person says them."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def _words(event: Event) -> str:
    match event:
        case PlanningStep("plan", iteration, of):
            return f"planning {100 * iteration // of:3d} %"
        case PlanningStep(_, iteration, of):
            return f"planning the rest again {100 * iteration // of:3d} %"
        case Scheduled(timetable=timetable, done=0):
            return f"the robot will take {duration(timetable.total)}"
        case PaintsWanted(palette):
            return f"mixing {len(palette)} paints"
        case StrokePainted(done, of) | StrokeLeftOut(done, of):
            return f"stroke {done} of {of}"
        case Looked():
            return "looking at the canvas"
        case Resumed(done=done):
            return f"going on after stroke {done}"
        case Paused():
            return "paused"
        case _:
            return ""
