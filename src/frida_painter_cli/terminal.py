"""Terminal: progress lines, and calibration dialogues by printed questions and typed answers."""

import math
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text
from torch import Tensor

from frida_painter.easel.dialogue import (
    JOG_STEPS,
    Answer,
    Choose,
    Confirm,
    Corners,
    EnterAddress,
    Guide,
    GuideMove,
    Jog,
    JogMove,
    Measure,
    PointCorners,
    SetupQuestion,
)
from frida_painter.errors import Interrupted
from frida_painter.planning.forecast import SimilarityForecast
from frida_painter.planning.optimize import Step
from frida_painter.session import events
from frida_painter.session.fold import PaintingState
from frida_painter.session.time_left import PlanTime, duration, share_of_plan
from frida_painter.system import images
from frida_painter.system.operating_system import forget_keys

# Progress with a forecast of the time left, from measured durations of each kind of work.


class Line(Progress):
    """Line on the terminal for one long task, within a `with` block: the current work, a bar, and the time left."""

    def __init__(self, console: Console) -> None:
        super().__init__(TextColumn("{task.description}"), BarColumn(bar_width=36), _TimeLeft(), console=console)
        self.task = self.add_task("getting ready", total=1.0, left=math.inf)


class PaintingLine(Line):
    """Line on the terminal for a painting: the current work, its progress, and the time left.

    state: returns the state of the painting, which has heard an event before the line does.
    """

    def __init__(self, console: Console, state: Callable[[], PaintingState]) -> None:
        self._state, self._is_aside = state, False
        super().__init__(console)

    def hear(self, event: events.Event) -> None:
        """Shows an event; during a pause, the terminal is free for questions."""
        if isinstance(event, events.Paused):
            self.stop()
        elif not self._is_aside:
            self.start()
        if isinstance(event, events.Remark) and event.about != "last look":  # which is told at the end
            self.console.print(event.sentence, markup=False)
        state = self._state()
        passed, left = state.sittings.seconds, state.planning.time.remaining
        self.update(
            self.task,
            description=_words(event, state.progress.pace) or self.tasks[0].description,
            completed=passed / max(passed + left, 1e-9),
            left=left,
        )

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Hides the line within the `with` block, for a question."""
        shown, self._is_aside = self.live.is_started, True
        self.stop()
        try:
            yield
        finally:
            self._is_aside = False
            if shown:
                self.start()


class PlanningLine(Line):
    """Line on the terminal for a single plan.

    expected: its seconds if nothing else runs on the machine; None if unknown
    """

    def __init__(self, console: Console, expected: float | None = None) -> None:
        self._plan_time = PlanTime(expected)
        super().__init__(console)

    def hear(self, step: Step) -> None:
        """Shows a step; later steps, with all strokes placed, take longer than the first."""
        self.show(share_of_plan(step.iteration, step.of))

    def show(self, share: float) -> None:
        """Shows the share of the work that is done."""
        left = self._plan_time.find_remaining(share)
        self.update(self.task, description=f"planning {100 * share:3.0f} %", completed=share, left=left)


class _TimeLeft(ProgressColumn):
    """Column with the time left, in words."""

    def render(self, task: Task) -> Text:
        left = task.fields["left"]
        return Text(f"{duration(left)} left" if math.isfinite(left) else "")


def _words(event: events.Event, pace: float) -> str:
    match event:
        case events.PlanningStep("plan", iteration, of):
            return f"planning {100 * iteration // of:3d} %"
        case events.PlanningStep(_, iteration, of):
            return f"planning the rest again {100 * iteration // of:3d} %"
        case events.Planned(similarity=(expected, least, most)):
            return f"planned: {SimilarityForecast(expected, least, most)}"
        case events.Scheduled(0, seconds=float(seconds), drying=drying):
            return f"the robot will take {duration(seconds - (1 - min(pace, 1)) * drying)}"
        case events.PaintsWanted((color,), ground=True):
            return f"toning the canvas in {color}"
        case events.PaintsWanted(colors):
            return f"mixing {len(colors)} paints"
        case events.StrokePainted(done, of) | events.StrokeLeftOut(done, of):
            return f"stroke {done} of {of}"
        case events.Drying(left=left) if left * pace > 0:
            return f"letting the paint dry, {duration(left * pace)} more"
        case events.LayerBegun(layer=layer, brush=brush):
            return f"layer {layer}, with the {brush} brush"
        case events.Looked():
            return "looking at the canvas"
        case events.SessionResumed(done):
            return f"going on after stroke {done}"
        case events.Paused(cause="button"):
            return "paused by the machine's button"
        case events.Paused():
            return "paused"
        case events.Began("results"):
            return "finishing the film and the page"
        case _:
            return ""


_LEFT = "You left, or nobody is there to answer; what was done before is kept."

# Dialogues: questions are printed, and answers typed.

_STEPS = {"u": 0.001, "d": -0.001, "uu": 0.005, "dd": -0.005, "+": 0.0002, "-": -0.0002}


@dataclass(frozen=True)
class Terminal:
    """Leads a dialogue line by line; `answer` is the callback for `dialogue.lead`.

    ask: shows a prompt and returns the typed line; raises EOFError if there are no more lines.
    tell: shows a line.
    pictures: folder for pictures of questions.
    keys: answers a `Guide` by single keys; None if there is no keyboard to read them from.
    """

    ask: Callable[[str], str]
    tell: Callable[[str], None]
    pictures: Path
    keys: "GuidingKeys | None" = None

    def answer(self, question: SetupQuestion) -> Answer:
        """Returns the typed answer; asks again until it is valid. Raises Interrupted if the person leaves."""
        if question.text and not getattr(question, "again", False):
            self.tell(question.text)
        if remark := getattr(question, "remark", ""):
            self.tell(remark)
        if isinstance(question, Confirm | PointCorners | Jog):
            self._show(question.picture)
        if isinstance(question, Choose):
            for number, thing in enumerate(question.things, 1):
                note = f" ({question.notes[number - 1]})" if question.notes else ""
                self.tell(f"  {number:2d}  {thing}{note}")
        if isinstance(question, Guide) and self.keys is not None:
            return self.keys.answer(question, self.tell)
        prompt, understand, allowed = _in_words(question)
        if not getattr(question, "again", False):
            forget_keys(sys.stdin)
        while True:
            try:
                line = self.ask(prompt).strip()
            except (EOFError, KeyboardInterrupt) as end:
                raise Interrupted(_LEFT) from end
            understood = understand(line if isinstance(question, EnterAddress) else line.lower())
            if understood is not None:
                return understood
            self.tell(allowed)

    def _show(self, picture: Tensor | None) -> None:
        if picture is not None:
            path = self.pictures / "question.png"
            images.save(picture, path)
            self.tell(f"  Look at {path}")


def terminal_at(pictures: Path, console: Console | None = None, keys: "GuidingKeys | None" = None) -> Terminal:
    """Returns the dialogue at this terminal.

    pictures: folder for pictures of questions
    console: None for one on the error output, which stays readable when the output is sent to a file
    keys: as in `Terminal`
    """
    shown = console or Console(stderr=True, highlight=False)
    return Terminal(
        lambda prompt: shown.input(prompt, markup=False),
        lambda line: shown.print(line, markup=False, soft_wrap=True),
        pictures,
        keys,
    )


def _in_words(question: SetupQuestion) -> tuple[str, Callable[[str], Answer | None], str]:
    """Returns the prompt of a question, what a typed line means (None if it is not valid), and what may be typed."""
    match question:
        case Confirm(proposal=agrees):
            words = {"y": True, "yes": True, "n": False, "no": False}
            if question.moves:
                return "[y/n] ", words.get, "Type y, and it moves; or n."
            return "[Y/n] " if agrees else "[y/N] ", {"": agrees, **words}.get, "Type y or n."
        case PointCorners(proposal=points):
            shown = "  ".join(f"{column:.1f},{row:.1f}" for column, row in points or ())
            allowed = (
                "Type eight numbers, column and row of the top left, top right, bottom right and bottom left corner in "
                "pixels of the picture, like 120,80 1400,95 1420,1010 100,1000"
            )
            if points is None:
                return "Four corners: ", parse_corners, f"{allowed}."
            take = "; or only Enter to take those in brackets."
            return f"Four corners [{shown}]: ", lambda line: parse_corners(line) if line else points, allowed + take
        case Jog(height=height, lowest=lowest, highest=highest):
            allowed = (
                "Type u or d for 1 mm up or down, uu or dd for 5 mm, + or - for 0.2 mm, a number of millimetres, or ok "
                f"where it is right; the brush moves from {lowest * 1000:.1f} to {highest * 1000:.1f} mm."
            )
            return f"{height * 1000:.1f} mm> ", lambda line: _move(question, line), allowed
        case Measure(lowest=lowest, highest=highest, proposal=known):

            def measure(line: str) -> float | None:
                length = _length(line) if line else known
                return length if length is not None and lowest <= length <= highest else None

            prompt = "mm: " if known is None else f"mm [{known * 1000:g}]: "
            return prompt, measure, f"Type millimetres, from {lowest * 1000:g} to {highest * 1000:g}."
        case Guide(position=position):
            allowed = (
                f"Type a move in mm, like x+5 or y-2.5 z+1, at most {_FARTHEST_JOG * 1000:g} mm; or ok if it is there."
            )
            return f"{_millimetres(position)} mm> ", _guide_by_words, allowed
        case Choose(things=things, proposal=usual):
            count = len(things)

            def choose(line: str) -> int | None:
                chosen = int(line) - 1 if line.isdecimal() and len(line) < 4 else None if line else usual
                return chosen if chosen is not None and 0 <= chosen < count else None

            prompt = f"1 to {count}: " if usual is None else f"1 to {count} [{usual + 1}]: "
            return prompt, choose, f"Type a number from 1 to {count}."
        case EnterAddress():
            return "> ", lambda line: line if question.allows(line) else None, f"Type it like {question.example}."


def parse_corners(line: str) -> Corners | None:
    """Returns four corners from a line of eight numbers; None if it is not valid."""
    numbers = [float(word) for word in re.findall(r"-?\d+(?:\.\d+)?", line)]
    if len(numbers) != 8 or re.search(r"[a-z]", line):
        return None
    return tuple(zip(numbers[::2], numbers[1::2], strict=True))


def _move(question: Jog, line: str) -> JogMove | None:
    if line == "ok":
        return JogMove(settled=True)
    step = _STEPS[line] if line in _STEPS else _length(line)
    if step is None or not question.lowest <= question.height + step <= question.highest:
        return None
    return JogMove(step)


_WORD = re.compile(r"([xyz])\s*([+-]\s*\d+(?:\.\d+)?)")


def _guide_by_words(line: str) -> GuideMove | None:
    """Returns the move that "x+5 y-2.5" or "ok" means, in millimetres; None if it is not valid."""
    if line == "ok":
        return GuideMove(settled=True)
    steps = {axis: float(number.replace(" ", "")) / 1000 for axis, number in _WORD.findall(line)}
    if not steps or _WORD.sub("", line).strip(" ,") or not all(abs(step) <= _FARTHEST_JOG for step in steps.values()):
        return None
    return GuideMove((steps.get("x", 0.0), steps.get("y", 0.0), steps.get("z", 0.0)))


def _millimetres(position: tuple[float, float, float]) -> str:
    return " ".join(f"{axis} {metres * 1000:.1f}" for axis, metres in zip("xyz", position, strict=True))


_FARTHEST_JOG = 0.5  # metres
_FIRST_STEP = 1


class GuidingKeys:
    """Guiding by keys: arrows for x and y, page up and down for z; the step shrinks each time a direction reverses.

    read: waits for a key and returns it under the names of readchar.
    """

    def __init__(self, read: Callable[[], str]) -> None:
        from readchar import key

        self._read = read
        self._axes = {
            key.RIGHT: (0, 1), key.LEFT: (0, -1), key.UP: (1, 1), key.DOWN: (1, -1), key.PAGE_UP: (2, 1),
            key.PAGE_DOWN: (2, -1), "w": (2, 1), "s": (2, -1),
        }  # fmt: skip
        self._leaves = {key.CTRL_C, key.CTRL_D, key.ESC, "q"}
        self._step, self._last = _FIRST_STEP, dict[int, int]()

    @classmethod
    def of_this_terminal(cls) -> Self | None:
        """Returns the keys of this terminal; None if nobody sits at it."""
        if not sys.stdin.isatty():
            return None
        from readchar import readkey

        return cls(readkey)

    def answer(self, question: Guide, tell: Callable[[str], None]) -> GuideMove:
        """Returns the move of the next key that means one. Raises Interrupted if the person leaves."""
        if not question.again:
            self._step, self._last = _FIRST_STEP, {}
            tell(
                "  Arrows: left, right, away, near. Page up and down (or w, s): up, down. + and -: step. o: there (ok)."
            )
            forget_keys(sys.stdin)
        tell(f"  {_millimetres(question.position)} mm, step {JOG_STEPS[self._step] * 1000:g} mm")
        while True:
            try:
                pressed = self._read()
            except (EOFError, KeyboardInterrupt) as end:
                raise Interrupted(_LEFT) from end
            if pressed in self._leaves:
                raise Interrupted(_LEFT)
            if pressed == "o":  # no Enter, after which the tip would go on
                return GuideMove(settled=True)
            if pressed in self._axes:
                return self._move(*self._axes[pressed])
            if pressed in "+-":
                change = -1 if pressed == "+" else 1
                self._step = min(max(self._step + change, 0), len(JOG_STEPS) - 1)
                tell(f"  step {JOG_STEPS[self._step] * 1000:g} mm")

    def _move(self, axis: int, direction: int) -> GuideMove:
        if self._last.get(axis, direction) != direction:
            self._step = min(self._step + 1, len(JOG_STEPS) - 1)
        self._last[axis] = direction
        step = [0.0, 0.0, 0.0]
        step[axis] = direction * JOG_STEPS[self._step]
        return GuideMove((step[0], step[1], step[2]))


def _length(line: str) -> float | None:
    """Returns a length such as "31", "31mm" or "3.1 cm" in metres; None if it is not valid."""
    match = re.fullmatch(r"([+-]?\d+(?:\.\d+)?)\s*(mm|cm|m)?", line)
    if match is None:
        return None
    metres = float(match[1]) * {"mm": 0.001, "cm": 0.01, "m": 1.0}[match[2] or "mm"]
    return metres if math.isfinite(metres) else None
