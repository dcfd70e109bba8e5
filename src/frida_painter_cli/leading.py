"""Control of a painting from the terminal: progress, pauses, questions and the final report."""

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rich.console import Console
from torch import Tensor

from frida_painter.easel.dialogue import Answer, Question
from frida_painter.easel.kinds import ARM_FILM, INBOX, JOURNAL, PAUSE_FILE, easel_kind
from frida_painter.errors import Interrupted, RobotStopped
from frida_painter.registry import Later
from frida_painter.runs.painting_folder import NOW
from frida_painter.runs.run import PaintingRun, RunOutcome
from frida_painter.runs.spec import RunSpec
from frida_painter.session.controls import answer_usually
from frida_painter.session.events import Event, PauseCause, Paused, Stopped, WentOn
from frida_painter.session.fold import ENDS, PaintingState, require_journal
from frida_painter.session.time_left import duration
from frida_painter.system import locks, storage
from frida_painter.system.event_log import LogReader
from frida_painter.system.operating_system import forget_keys, is_typed
from frida_painter.system.storage import count_of
from frida_painter_cli.options import Wells, ask_at_terminal
from frida_painter_cli.stop_signal import StopSignal
from frida_painter_cli.terminal import PaintingLine, terminal_at

PLAN_ROOM = 20 * 2**20  # bytes needed before a plan begins
_GLANCE = 0.2  # seconds between two looks at pause file, inbox and terminal

_lead_from_pages = Later("frida_painter_together.conductor:Conductor.lead")
_add_results = Later("frida_painter_together.plan_pictures:add_results")
_open_proposer = Later("frida_painter_together.proposing:Proposer")


class Leader:
    """Leads a run with an open easel, in a `with` block, then reports the result.

    As soon as a page writes into the inbox of the painting, its commands are done too. If people at a page lead it,
    they answer the questions, too.

    asked: True if a person answers questions.
    asks_for_paints: True if the person may enter the mixed paints.
    repaint: decision about a stroke in doubt. None: the person is asked.
    propose: picture maker for changes by words. None: none is wanted.
    started: start time of the command, monotonic seconds.
    led: lead of the people at a page (frida_painter_studio.at_page.PageLead). None: nobody is there.
    """

    def __init__(
        self,
        run: PaintingRun,
        stop: StopSignal,
        *,
        asked: bool,
        started: float,
        asks_for_paints: bool = False,
        repaint: bool | None = None,
        propose: str | None = None,
        led: Any = None,
    ) -> None:
        ask = partial(ask_at_terminal, stop_asked=self._is_stopped)
        self._proposer = None if propose is None else _open_proposer(run, propose, ask)
        self._conductor: Any = None  # of the people at a page, once there is one
        self._held = False  # in a pause: by the pause file
        self._asks = False  # in a pause: the person at the terminal
        self._run, self._stop, self._started = run, stop, started
        self._asked, self._repaint, self._led = asked, repaint, led
        self._console = Console(stderr=True, highlight=False)
        self._bar = PaintingLine(self._console, lambda: run.painting)
        self._over = threading.Event()
        wells = Wells(run.mixed, input if asks_for_paints else None, run.folder, poured=not run.easel.simulated)
        run.listeners.append(self._bar.hear)
        run.controls = replace(
            run.controls,
            stop_asked=lambda: stop.asked,
            pause_cause=self._pause_cause,
            go_on=self._go_on,
            mixed=wells.fill if asks_for_paints else run.controls.mixed,
            answer=self._answer if asked else None,
            paint_on=self._paint_on,
            repaint=self._repaints,
            adapt=lambda turn: (self._conductor.adapt_alone if self._conductor else answer_usually)(turn),
        )
        if led is not None or self._proposer is not None:
            leads: Any = self._lead_from_page(time.time() if led is None else led.began)
            if led is None:
                leads.ask, leads.asks_here = self._answer, sys.stdin.isatty()
            else:
                run.controls = replace(run.controls, answer=leads.ask, paint_on=leads.paint_on, repaint=leads.repaint)
            if self._proposer is not None:
                run.listeners.append(self._proposer.hear)
            return
        hearing = threading.Thread(target=self._await_page, args=(time.time(),), daemon=True, name="inbox")
        hearing.start()
        hearing.join(None if storage.exists(run.folder / INBOX) else 0.0)  # what is owed is done before a stroke

    def __enter__(self) -> Self:
        if self._run.history is None:
            self._bar.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._bar.__exit__(kind, error, trace)

    def conclude(self, outcome: RunOutcome) -> None:
        """Reports the result; then exits with the stop's exit status, or raises the error that ended the run."""
        spec = self._run.spec
        tell(outcome, spec.strokes, time.monotonic() - self._started, watched=spec.has_camera)
        if self._led is not None and outcome.page is None:  # no journal tells that it was stopped before the first plan
            self._led.feed.tell(Stopped())
        if self._stop.asked and (outcome.trouble is None or isinstance(outcome.trouble, RobotStopped)):
            sys.exit(self._stop.exit_status)
        if outcome.trouble is not None:
            raise outcome.trouble

    def _await_page(self, since: float) -> None:
        """Loads who does the commands of a page, once there is an inbox; a command is good for seconds only."""
        while not storage.exists(self._run.folder / INBOX):
            if self._over.wait(_GLANCE):
                return
        self._lead_from_page(since)

    def _lead_from_page(self, since: float) -> Any:
        self._conductor = _lead_from_pages(self._run, self._is_stopped, self._heed, since, self._is_let_go_on)
        return self._conductor

    def _is_stopped(self) -> bool:
        return self._stop.asked or self._run.is_stopped

    def _heed(self) -> None:
        if self._is_stopped():
            raise Interrupted("You stopped; what was painted is kept.")

    @property
    def _pause_file(self) -> Path:
        return self._run.folder / PAUSE_FILE

    def _pause_cause(self) -> PauseCause | None:
        if self._run.painting.wishes.paused:  # what is done in a pause asks for no other one
            return None
        self._held = self._pause_file.exists()
        if self._held or (self._proposer is not None and self._proposer.wants_pause()):
            return "person"
        cause: PauseCause | None = None if self._conductor is None else self._conductor.pause_cause()
        return cause

    def _go_on(self, paused: Paused) -> bool:
        """Waits until somebody lets the painting go on, here or at a page; returns False if somebody ends it."""
        self._held = self._held or self._pause_file.exists()
        at_page = self._conductor is not None and self._proposer is None
        self._asks = not self._held and (at_page or paused.cause != "person") and sys.stdin.isatty()
        how = f"To go on, remove {self._pause_file}" if self._held else paused.reason
        asked = " To go on, type go; to stop, Ctrl-C." if self._asks else ""
        forget_keys(sys.stdin)
        self._console.print(f"Paused after {paused.done} strokes. {how}{asked}", markup=False)
        while not self._is_stopped():
            if self._conductor is not None:
                went_on: bool = self._conductor.go_on(paused)
                if went_on and self._held:
                    self._pause_file.unlink(missing_ok=True)  # else the next stroke would pause again
                return went_on
            let = self._is_let_go_on(paused)
            if let is not None:
                if let:
                    self._run.report(WentOn())
                return let
            time.sleep(_GLANCE)
        return False

    def _is_let_go_on(self, paused: Paused) -> bool | None:
        """Returns True if somebody here lets the painting go on in a pause, False if they end it, else None."""
        session = self._run.session
        if self._held:
            return None if self._pause_file.exists() else True
        if session is not None and session.is_button_pressed():
            return True
        if self._asks:
            if not is_typed(sys.stdin.fileno(), 0):
                return None
            line = sys.stdin.readline()
            self._asks = bool(line)  # else the terminal was closed
            return line.strip().lower() == "go" or None
        if self._proposer is not None and self._proposer.has_word():
            with self._bar.aside():
                command = self._proposer.find_command()
            if command is None:
                return True
            self._conductor.do(command)
            return None
        if self._conductor is not None or paused.cause == "button":
            return None
        return paused.cause == "person"  # the pause file is gone already; else nobody is here, and it is resumed later

    def _answer(self, question: Question) -> Answer:
        with self._bar.aside():
            return terminal_at(self._run.folder, self._console).answer(question)

    def _paint_on(self, sentence: str, canvas: Tensor) -> bool:
        if not self._asked or not sys.stdin.isatty():
            return False
        with self._bar.aside():
            return confirm(
                f"{sentence}\nLook at {self._run.folder / NOW}. Shall it be painted on as it is?", default=False
            )

    def _repaints(self, number: int, picture: Tensor) -> bool:
        if self._repaint is not None or not self._asked:
            return bool(self._repaint)
        return confirm(f"Look at {self._run.folder / NOW}: paint stroke {number} again?", default=False)


def follow(folder: Path) -> None:
    """Shows a painting that another process makes, from its journal, until that process ends.

    folder: of the painting, or of the studio's entry that holds it.
    Raises StorageError if it is no painting's.
    """
    inside = not storage.exists(folder / JOURNAL) and storage.exists(folder / "painting")
    place = folder / "painting" if inside else folder
    require_journal(place)
    state, reader, at_work = PaintingState(), LogReader(place / JOURNAL), True
    news: Iterable[Event] = deque(state.hear_journal(reader.stream(), place), maxlen=1)  # of the past, the last event
    with suppress(KeyboardInterrupt), PaintingLine(Console(stderr=True, highlight=False), lambda: state) as line:
        while True:
            for event in news:
                line.hear(event)
            if not at_work:
                break
            time.sleep(_GLANCE)
            at_work = locks.is_held(place / JOURNAL)
            news = state.hear_journal(reader.stream(), place)
    ended = f"It {state.progress.doing}." if state.progress.doing in ENDS else "It is not at its end."
    done = f"{state.progress.painted} of {count_of(state.progress.of, 'stroke')} painted."
    say(" ".join(filter(None, (done, ended, state.end.trouble, state.sittings.unknown_sentence))))


def answer_early(run: PaintingRun) -> Callable[[Question], Answer]:
    """Returns a function that asks the person at the terminal before the painting begins."""
    return lambda question: terminal_at(run.folder).answer(question)


def ready_planner(run: PaintingRun, stop: StopSignal, out: Path | None = None, led: Any = None) -> float | None:
    """Opens the planner, and prints the choices, the networks in use and remarks; returns the time of a plan if known.

    out: folder to be made later, checked before any work.
    led: as in `Leader`; its page, too, is told of waits.
    Raises StorageError if the folder cannot be made, Interrupted after a stop.
    """
    if out is not None:
        storage.require_space(out, PLAN_ROOM, "this plan")
        storage.require_unused(out)

    def heed() -> None:
        if stop.asked:
            raise Interrupted("You stopped before there was a plan; nothing was painted.")

    attend(run, led)
    run.heed = heed
    if led is not None:
        led.stop.then(stop.stop_now)
    encoders = run.planner.encoders
    for choice in encoders.choices:
        better = f" (better: {choice.better})" if choice.better else ""
        print(f"Seeing {choice.purpose} through {choice.used}{better}.", file=sys.stderr)
    for remark in (*encoders.remarks, *run.remarks):
        print(remark, file=sys.stderr)
    seconds = run.planner.measure_plan(run.spec.strokes)
    if seconds is not None:
        took = count_of(max(1, round(seconds / 60)), "minute")
        print(f"A plan with this network takes about {took}, longer if this machine is busy.", file=sys.stderr)
    return seconds


def attend(run: PaintingRun, led: Any) -> None:
    """Has the run tell its waits here and at the page of who leads it, if any, and add the results of such a page."""

    def say_wait(sentence: str) -> None:
        print(sentence, file=sys.stderr)
        if led is not None:
            led.feed.say(sentence)

    run.tell = say_wait
    if led is not None:
        run.finish = partial(_add_results, run)


def say_films(spec: RunSpec) -> None:
    """Prints the reason if a wanted film cannot be made."""
    kind = easel_kind(spec.robot) if spec.films_arm else None
    why_not = None if kind is None or kind.why_no_film is None else kind.why_no_film()
    if why_not is not None:
        print(why_not, file=sys.stderr)


def say(*lines: str) -> None:
    """Prints lines for people to the standard output."""
    for line in lines:
        print(line)


def confirm(question: str, *, default: bool | None) -> bool:
    """Asks at the terminal until the answer is yes, no or empty. Raises Interrupted if nobody answers.

    default: of Enter; None if it is no answer, because a machine moves then
    """
    choice = "[y/n]" if default is None else "[Y/n]" if default else "[y/N]"
    forget_keys(sys.stdin)
    while True:
        try:
            answer = input(f"{question} {choice} ").strip().lower()
        except (EOFError, KeyboardInterrupt) as end:
            raise Interrupted("Nobody answered, and nothing was done; for scripts there is --yes.") from end
        if answer in ("y", "yes", "n", "no") or not (answer or default is None):
            return answer[:1] == "y" if answer else bool(default)
        print("Type y or n.")


def tell(outcome: RunOutcome, of: int, seconds: float, *, watched: bool = True) -> None:
    """Prints the result and the files of a run; without a camera it is not `watched`, and shows what is expected."""
    folder, painting = outcome.folder, outcome.painting
    if outcome.page is None or painting is None:
        say(f"Stopped before there was a plan; nothing was painted. ({folder})")
        return
    painted = painting.painted
    finished = painted == of or (outcome.trouble is None and painting.rest is not None and len(painting.rest) == 0)
    expected = "" if watched else ", as expected: nobody looked"
    fewer = finished and painted < of
    begun = f"{painted} strokes" if finished else f"Stopped after {painted} of {of} strokes; what was made is kept"
    say(
        f"{begun} in {duration(seconds)}.",
        *([f"  {of - painted} of {of} strokes were left out: those that would be missed least."] if fewer else []),
        f"  The painting  {folder / 'painting.png'}{expected}",
        *([f"  The film      {folder / 'film.mp4'}{expected}"] if (folder / "film.mp4").exists() else []),
        *([f"  The arm       {folder / ARM_FILM}"] if (folder / ARM_FILM).exists() else []),
        *([f"  The card      {folder / 'card.jpg'}"] if (folder / "card.jpg").exists() else []),
        f"  The page      {outcome.page}",
        *([f"  How near      {outcome.similarity}"] if outcome.similarity else []),
        *([f"  The easel     {outcome.calibration}, with what was learned of it"] if outcome.calibration else []),
        *([f"  Remark        {painting.remark}"] if painting.remark else []),
        *([f"  To go on      frida-painter resume {folder}"] if not finished else []),
    )
