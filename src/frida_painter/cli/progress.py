"""Progress with a time left that can be believed: it is forecast from what each kind of work has really taken."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Self

import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

from frida_painter.palette import to_hex
from frida_painter.planning.optimize import Step
from frida_painter.session.events import (
    Drying,
    Event,
    GroundWanted,
    LayerBegun,
    Looked,
    PaintsWanted,
    Paused,
    Planned,
    PlanningStep,
    Resumed,
    Scheduled,
    StrokeLeftOut,
    StrokePainted,
    TouchCorrected,
)
from frida_painter.session.forecast import Forecast, duration
from frida_painter.session.page_events import Finishing
from frida_painter.sweeps.progress import SweepProgress

_GROWING_COST = 1.4


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


class PaintingLine(Line):
    """One line on the terminal: what is going on, how far it is, and the time left."""

    def __init__(self, console: Console, forecast: Forecast) -> None:
        self._forecast = forecast
        self._started = time.monotonic()
        super().__init__(_bar(console))
        self._task = self._bar.add_task("getting ready", total=1.0, left=forecast.remaining)

    def hear(self, event: Event) -> None:
        """Shows an event; while the painting pauses, the terminal is for questions."""
        now = time.monotonic()
        if isinstance(event, Paused):
            self._bar.stop()
        else:
            self._bar.start()
        if isinstance(event, TouchCorrected):
            self._bar.console.print(event.sentence)
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


class PlanningLine(Line):
    """One line on the terminal for a plan alone."""

    def __init__(self, console: Console) -> None:
        self._started = time.monotonic()
        super().__init__(_bar(console))
        self._task = self._bar.add_task("getting ready", total=1.0, left=math.inf)

    def hear(self, step: Step) -> None:
        """Shows a step; later ones, with all strokes placed, take longer than the first."""
        share = (step.iteration / step.of) ** _GROWING_COST
        left = (time.monotonic() - self._started) * (1 - share) / share
        self._bar.update(self._task, description=f"planning {100 * share:3.0f} %", completed=share, left=left)


class SweepLine(Line):
    """One line on the terminal for many runs."""

    def __init__(self, console: Console) -> None:
        super().__init__(_bar(console))
        self._task = self._bar.add_task("getting ready", total=1.0, left=math.inf)

    def hear(self, progress: SweepProgress) -> None:
        """Shows how far it is."""
        ended = progress.done + progress.failed
        failed = f", {progress.failed} failed" if progress.failed else ""
        left = math.inf if progress.seconds_left is None else progress.seconds_left
        self._bar.update(
            self._task,
            description=f"{progress.done} of {progress.total} runs done{failed}, {progress.slots} at the same time",
            completed=ended / max(progress.total, 1),
            left=left,
        )


class _TimeLeft(ProgressColumn):
    """The time left in words."""

    def render(self, task: Task) -> Text:
        left = task.fields["left"]
        return Text(f"{duration(left)} left" if math.isfinite(left) else "")


def _words(event: Event) -> str:
    match event:
        case PlanningStep("plan", iteration, of):
            return f"planning {100 * iteration // of:3d} %"
        case PlanningStep(_, iteration, of):
            return f"planning the rest again {100 * iteration // of:3d} %"
        case Planned(forecast=forecast) if forecast is not None:
            return f"planned: {forecast}"
        case Scheduled(timetable=timetable, done=0):
            return f"the robot will take {duration(timetable.total)}"
        case GroundWanted(color):
            return f"toning the canvas in {to_hex(torch.tensor(color))}"
        case PaintsWanted(palette):
            return f"mixing {len(palette)} paints"
        case StrokePainted(done, of) | StrokeLeftOut(done, of):
            return f"stroke {done} of {of}"
        case Drying(left=left) if left > 0:
            return f"letting the paint dry, {duration(left)} more"
        case LayerBegun(layer=layer, brush=brush):
            return f"layer {layer}, with the {brush} brush"
        case Looked():
            return "looking at the canvas"
        case Resumed(done=done):
            return f"going on after stroke {done}"
        case Paused():
            return "paused"
        case Finishing():
            return "finishing the film and the page"
        case _:
            return ""
