"""Closed loop of a painting: plan, paint some strokes, look, replan the rest (paper, Algorithm 1, `paint`).

Start reading here. This file holds only the order of the steps; these modules perform them:

    look at the bare canvas, have it toned if a ground is wanted, and plan
    while strokes are left:
        paint a batch of strokes                         act      executor.py, hand.py
        let a finished layer dry, get brush and paints of the next one
        look at the canvas and compare it with the plan  observe  observer.py, plan_keeper.py
        replan the rest if replan_policy.py wants that   plan     plan_keeper.py, planning/planner.py
                                                         tell     events.py, journal.py

Without a camera, `open_loop.py` observes: the canvas is taken to be what the painted strokes make of it.

`PaintingSession._paint` is these lines. `progress.py` holds the progress. `executor.py` handles interruptions: a
person who stops or pauses, a disk or a camera that fails. Entries that must be on the disk before the robot moves
are written to the journal by direct calls. If such a call fails, nothing moves. All other events go to the
listeners.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Final

import torch
from torch import Tensor

from frida_painter.calibration import WetPaint
from frida_painter.errors import FridaError, Interrupted, PaintingPaused, RobotStopped
from frida_painter.planning.planner import Planner
from frida_painter.registry import Later
from frida_painter.session.controls import Controls
from frida_painter.session.events import (
    Durable,
    Event,
    Finished,
    LayerBegun,
    Notify,
    Stopped,
)
from frida_painter.session.executor import BatchExecutor, Desk, Interruptions, StopAsked
from frida_painter.session.hand import Hand
from frida_painter.session.journal import Journal
from frida_painter.session.observer import CanvasObserver, FrameDeveloper, Timelapse, has_ground
from frida_painter.session.open_loop import ExpectedFrames, OpenLoopMonitor
from frida_painter.session.plan_keeper import ExecutionMonitor, PlanKeeper
from frida_painter.session.progress import Painting, PaintingProgress
from frida_painter.session.replan_policy import ReplanPolicy
from frida_painter.strokes.palette import to_hex
from frida_painter.strokes.plan import WHITE, Plan


@dataclass(frozen=True)
class Extent:
    """Extent of a painting.

    seconds: of the robot's clock for the whole painting; the strokes that matter least are left out to keep it. None:
    as many as it takes.
    most: greatest number of strokes of a painting without a goal: a person begins, and each of their turns is answered
    with strokes, until this number is reached or a person ends it. None: there is a goal.
    frames: largest number of frames of its film.
    """

    seconds: float | None = None
    most: int | None = None
    frames: int = 0


_open_turns = Later("frida_painter_together.turns:PersonTurns")


class PaintingSession:
    """One painting, from a bare canvas or from the point where it broke off, to the last stroke.

    notify: receives the events.
    Raises PaintingPaused if `go_on` returns False, and RobotError, PlanError and their subclasses. The painting
    stays on the canvas and in the journal.
    """

    def __init__(
        self,
        planner: Planner,
        hand: Hand,
        observer: CanvasObserver,
        policy: ReplanPolicy,
        *,
        notify: Notify,
        journal: Journal | None = None,
        controls: Controls | None = None,
        extent: Extent | None = None,
    ) -> None:
        self.hand: Final = hand
        self.observer: Final = observer
        self.policy: Final = policy
        self.journal: Final = journal or Journal(None)
        self._controls, extent = controls or Controls(), extent or Extent()
        self._progress = PaintingProgress(most=extent.most)
        self.interruptions: Final = Interruptions(
            hand, self.tell, self._controls, painted=lambda: self._progress.painted, between=self._take_given
        )
        frames = Timelapse(extent.frames)
        desk = Desk(self.journal, self.interruptions, self._progress, self.tell)
        self._plans = PlanKeeper(planner, hand, policy, frames, desk, extent.seconds)
        sees = hand.easel.has_camera
        expected = partial(ExpectedFrames, observer, self._plans, self._progress)
        film = partial(partial(FrameDeveloper, observer) if sees else expected, self.tell)
        self._executor = BatchExecutor(hand, film, frames, desk)
        self._monitor: ExecutionMonitor | OpenLoopMonitor = (
            ExecutionMonitor(self._plans, self._executor, hand, observer, desk)
            if sees
            else OpenLoopMonitor(self._plans, self._executor, hand, desk)
        )
        self._notify = notify
        self._desk = desk
        self._began_at = 0.0  # seconds of the robot's clock

    @cached_property
    def person(self) -> Any:
        """Turns of a person (together.turns.PersonTurns), which are loaded if a person takes part."""
        return _open_turns(self.hand, self.observer, self._monitor, self._plans, self._desk)

    def run(self, strokes: int, colors: int, plan: Plan | None = None) -> Painting:
        """Paints a bare canvas with `strokes` strokes, or as many as the budget allows, in `colors` paints.

        A person may stop it.
        plan: plan with this number of strokes, painted instead of a new one.
        """
        return self._to_the_end(lambda: self._begin(strokes, colors, plan))

    def resume(self, where: PaintingProgress) -> Painting:
        """Paints the rest of a painting, with a clean brush and newly filled wells."""
        return self._to_the_end(lambda: self._begin_again(where))

    def _paint(self) -> None:
        """Paints a batch, looks, and replans the rest, until no stroke is left.

        Also looks at the start of each layer.
        """
        progress = self._progress
        if progress.most is not None:
            self.person.alternate(progress.most, self._equip, self._executor.paint_until, self._controls.adapt)
            return
        looks = not self.hand.easel.has_camera or self.policy.next_look(0, progress.strokes) < progress.strokes
        while progress.planned_at < progress.strokes:
            end = self.policy.next_look(progress.planned_at, progress.strokes)
            while (
                progress.painted < min(end, progress.strokes) or progress.must_dry
            ):  # a plan set in a pause may have fewer strokes
                if progress.must_dry:
                    self._executor.let_dry()
                if looks and progress.begins_layer and progress.planned_at < progress.painted:
                    break
                self._equip()
                self._executor.paint_until(min(end, progress.layer_end))
            seen = self._monitor.observe()
            if seen.left and not progress.answers and self.policy.wants_replan(seen):
                self._plans.replan()
            else:
                self._plans.keep()

    def expect(self, strokes: int) -> None:
        """Reports the work of a painting of that many strokes, 0 if nobody knows how many, before it is planned."""
        self._plans.expect(strokes)

    def tell(self, event: Event) -> None:
        """Reports an event to the listeners; the engine shows it in the journal."""
        self._notify(event)

    def note(self, event: Durable) -> None:
        """Notes in the journal what a person does in a pause, then tells it. Raises StorageError."""
        self.journal.tell(event)
        self.tell(event)

    @property
    def in_turns(self) -> bool:
        """True if there is no goal: the robot only answers what a person paints."""
        return self._progress.most is not None

    def look(self) -> Tensor:
        """Returns the current canvas, seen without the arm, from a photograph newer than the last motion."""
        return self._monitor.look()

    def look_again(self, rounds: int = 1) -> None:
        """Looks at the canvas after a person may have painted on it, and replans the rest; for use in a pause.

        rounds: rounds of the replan; more than one is useful if the goal has changed.
        """
        if self._monitor.observe().left:
            self._plans.replan(rounds)
        else:
            self._plans.keep()

    def learn_wet_paint(self) -> WetPaint | None:
        """Returns how wet paint mixed in this painting; None if no camera saw it, or if it hardly shows."""
        return self._monitor.learn_wet_paint() if isinstance(self._monitor, ExecutionMonitor) else None

    @property
    def open_loop(self) -> OpenLoopMonitor | None:
        """Monitor of a canvas that nobody watches, for pictures of a person; None with a camera."""
        return self._monitor if isinstance(self._monitor, OpenLoopMonitor) else None

    def paint_instead(self, rest: Plan) -> None:
        """Replaces the unpainted rest of the plan, with the same palette and canvas; also in a pause."""
        self._plans.replace(rest)

    @property
    def planner(self) -> Planner:
        """Planner of the session; it may be replaced in a pause."""
        return self._plans.planner

    @planner.setter
    def planner(self, planner: Planner) -> None:
        self._plans.planner = planner

    def is_button_pressed(self) -> bool:
        """Returns True, once, if the machine's pause button was pressed; for a pause, which it ends."""
        return self.interruptions.is_button_pressed()

    @property
    def rest(self) -> Plan:
        """Strokes that are not painted yet. Raises PlanError before the first plan."""
        return self._progress.rest

    @property
    def so_far(self) -> Painting | None:
        """Result so far, as last seen; None if the canvas was never seen."""
        seen = self._progress.canvas.before
        return None if seen is None else self._progress.as_painting(seen)

    def _begin(self, strokes: int, colors: int, plan: Plan | None) -> None:
        canvas, ground = self.look(), self.planner.ground
        if ground != WHITE and not (self.hand.easel.has_camera and has_ground(canvas, ground)):
            canvas = self._tone(ground)
        self._progress.canvas.saw(canvas, 0)
        self._began_at = self.hand.last_motion
        self._plans.begin(strokes, colors, plan)
        self._equip()

    def _equip(self) -> None:
        """Gets brush and paints of the next stroke's layer, and binds the strokes to the really mixed paints."""
        progress, rest = self._progress, self.rest
        if not len(rest) and not self.in_turns:
            return
        number = int(rest.layer[0]) if len(rest) else 0
        layer = rest.layers[number]
        changes = self._executor.change_brush(layer.brush)
        palette = rest.wells(layer)
        if progress.wells is None or not torch.equal(palette.color, progress.wells.color):
            self._executor.fill_wells(palette)
            progress.wells, changes = palette, True
            mixed = None if self._controls.mixed is None else self._controls.mixed(palette)
            if mixed is not None:
                self._plans.bind_to_palette(mixed)
                self.hand.easel.operator.fill_wells(mixed)
                progress.wells = mixed
        if len(rest.layers) > 1 and (changes or progress.begins_layer):
            self._desk.note(LayerBegun(number + 1, layer.brush, layer.paints[0]))

    def _tone(self, ground: tuple[float, float, float]) -> Tensor:
        """Has the canvas toned and returns it, [3, H, W]; pauses once if its colour differs from the ground."""
        self._executor.tone(ground)
        canvas = self.look()
        if not has_ground(canvas, ground):
            seen = to_hex(canvas.flatten(1).median(1).values)
            self.interruptions.pause(
                f"The ground is to be {to_hex(torch.tensor(ground))}, and the canvas shows {seen} in the middle of all "
                "places. Tone it, or go on with what is there."
            )
            canvas = self.look()
        return canvas

    def _begin_again(self, where: PaintingProgress) -> None:
        self._progress.go_on_from(where)
        self._began_at = self.hand.last_motion
        self._plans.schedule()
        if self.hand.has_rack:
            if self.hand.held:
                self._executor.clean()
        else:
            self._executor.clean()
            self.hand.held = None
        if where.person_unseen:
            self.person.answer_if_possible(self._controls.adapt)
        self.interruptions.check()  # what a person asked for before it broke off is done before a stroke is painted

    def _take_given(self) -> None:
        if self.open_loop is not None:
            self.open_loop.look_at_next()

    def _to_the_end(self, begin: Callable[[], None]) -> Painting:
        stopped = False
        progress = self._progress
        try:
            self.hand.require_rack()
            begin()
            self._paint()
        except StopAsked:
            self.tell(Stopped())
            stopped = True
        except FridaError as trouble:
            gave_up = isinstance(trouble, RobotStopped | PaintingPaused | Interrupted)
            self.tell(Stopped("" if gave_up else str(trouble)))
            raise
        took = self.hand.last_motion - self._began_at
        self._executor.put_brush_back()
        photograph = self.look()
        if not stopped:
            self._desk.note(Finished(progress.painted, round(took, 3)))
        return progress.as_painting(photograph, took)
