"""Paints a batch stroke by stroke, with each stroke in the journal.

Each stroke is noted before the robot gets it, and again when it is done. After a crash, at most one stroke is
therefore in doubt. If the disk is full, nothing moves until there is room.
"""

import itertools
import math
import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeVar

import torch

from frida_painter.errors import CameraError, FridaError, PaintingPaused, StorageError
from frida_painter.hardware.robot import PausableRobot
from frida_painter.session import events
from frida_painter.session.choreography import Action
from frida_painter.session.controls import Controls
from frida_painter.session.hand import Hand
from frida_painter.session.journal import Journal
from frida_painter.session.observer import FrameDeveloper, Timelapse
from frida_painter.session.progress import PaintingProgress
from frida_painter.strokes.palette import Palette, to_hex

# Interruptions of a painting: a stop or a pause by a person, a full disk, a camera that fails.

_T = TypeVar("_T")
_BETWEEN_PRESSES = 0.2  # seconds between two questions about the machine's pause button
_REASONS: dict[events.PauseCause, str] = {
    "person": "You asked for a pause: the brush is clean, the arm aside. You may paint on the canvas.",
    "button": "Somebody pressed the pause button of the machine; press it again to go on.",
    "turn": "It is your turn: paint what you like, then let the robot go on.",
    "trouble": "Something is wrong.",
}


class Interruptions:
    """Checks after every stroke and every planning step for a stop or a pause, and performs the pause.

    painted: returns the number of painted strokes.
    between: called at each check, after a pause; it may move the arm and adopt another plan.
    touched: True if a person may have painted on the canvas since the last look.
    """

    def __init__(
        self,
        hand: Hand,
        notify: events.Notify,
        controls: Controls,
        painted: Callable[[], int],
        between: Callable[[], None] = lambda: None,
    ) -> None:
        self._between = between
        self.touched = False
        self.pause_cause = controls.pause_cause
        self._hand, self._notify = hand, notify
        self._stop_asked, self._go_on, self._painted = controls.stop_asked, controls.go_on, painted
        self._stopping, self._ask_button_at = False, 0.0

    def check(self, before_pause: Callable[[], None] = lambda: None) -> None:
        """Raises StopAsked, once, if a person wants to stop; pauses, after `before_pause`, if a pause is due.

        Raises PaintingPaused if the person does not want to go on.
        """
        if not self._stopping and self._stop_asked():
            self._stopping = True
            raise StopAsked
        cause = self.pause_cause() or ("button" if self.is_button_pressed() else None)
        if cause is not None:
            before_pause()
            self.pause(_REASONS[cause], cause)
        self._between()

    def is_button_pressed(self) -> bool:
        """Returns True, once, if the machine's pause button was pressed; asks the machine at most every 0.2 s.

        Raises RobotError.
        """
        robot, now = self._hand.easel.robot, time.monotonic()
        if not isinstance(robot, PausableRobot) or now < self._ask_button_at:
            return False
        self._ask_button_at = now + _BETWEEN_PRESSES
        return robot.wants_pause()

    def retry(self, work: Callable[[], _T]) -> _T:
        """Calls `work`, which needs the disk or the camera; if either fails, pauses and then tries again.

        Raises PaintingPaused if the person does not want to go on.
        """
        while True:
            try:
                return work()
            except (StorageError, CameraError) as trouble:
                self.pause(str(trouble), trouble=trouble)

    def pause(self, reason: str, cause: events.PauseCause = "trouble", *, trouble: FridaError | None = None) -> None:
        """Cleans the brush, moves the arm to its home position and waits until a person lets the painting go on.

        trouble: error that caused the pause, None if there is none.
        Raises PaintingPaused if the person does not want to go on.
        """
        if self._hand.load.paint is not None:
            self._hand.clean()
        self._hand.step_aside()
        self.touched = True  # the person may paint on the canvas, before or after the answer
        paused = events.Paused(reason, self._painted(), cause)
        self._notify(paused)
        if not self._go_on(paused):
            raise PaintingPaused(f"{reason} The painting has paused after {paused.done} strokes.") from trouble
        self.touched = True


class Desk(NamedTuple):
    """Everything that the parts of a session share.

    tell: reports an event to the journal and the listeners.
    """

    journal: Journal
    interruptions: Interruptions
    progress: PaintingProgress
    tell: events.Notify

    def note(self, event: events.Durable) -> None:
        """Writes an event that resuming needs, again after a pause if the disk fails, and then reports it."""
        self.interruptions.retry(partial(self.journal.tell, event))
        self.tell(event)


class StopAsked(Exception):
    """Signal that a person wants to stop; the session then ends the painting in order."""


_STEP = 10.0  # seconds of drying that a simulated easel simulates at a time
_GLANCE = 0.1  # seconds between two checks for a stop or a pause
_BETWEEN_WORDS = 60.0


class BatchExecutor:
    """Paints the next strokes of the plan in `progress` with the robot, and counts them there.

    A person may stop or pause after every stroke. Frames of the `timelapse` film are taken between strokes.
    film: returns what makes these frames during a batch.
    """

    def __init__(self, hand: Hand, film: Callable[[], FrameDeveloper], timelapse: Timelapse, desk: Desk) -> None:
        self._hand, self._open_film, self._timelapse = hand, film, timelapse
        self._journal, self._interruptions, self._progress, self._tell = desk
        self._note = desk.note
        self._told: str | None = None  # brush in the hand, as last reported to listeners
        self._filmed: int | None = None  # frames that were due at the last frame; None before painting

    def paint_until(self, end: int) -> None:
        """Paints until `end` strokes are done; after a pause the brush is clean, and the batch is prepared anew.

        Raises RobotError or a subclass of it, WorkspaceViolation before anything moves, PaintingPaused, StopAsked.
        """
        progress = self._progress
        if self._filmed is None:
            self._filmed = self._timelapse.due(progress.painted, progress.most or progress.strokes)
        with self._open_film() as frames:
            while progress.plan is not None and progress.painted < min(end, progress.strokes):
                left = progress.plan.part(slice(progress.painted, end))
                actions = self._hand.prepare(left, progress.painted, progress.strokes)
                for action, following in itertools.zip_longest(actions, actions[1:]):
                    leaves = following is None or isinstance(following.done, events.Dipped)
                    done = self._perform(action, frames, leaves=leaves)
                    if not done or self._hand.load is not action.load:
                        break

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Reports the wanted ground (sRGB), and waits until the canvas has it."""
        self._tell(events.PaintsWanted((to_hex(torch.tensor(ground)),), ground=True))
        self._hand.easel.operator.tone(ground)
        self._interruptions.touched = True

    def fill_wells(self, palette: Palette) -> None:
        """Reports the wanted paints, and waits until their wells are filled."""
        self._tell(events.PaintsWanted(tuple(map(to_hex, palette.color))))
        self._hand.easel.operator.fill_wells(palette)

    def change_brush(self, brush: str) -> bool:
        """Puts the brush of a layer into the holder; returns True if the brush had to be changed.

        A robot with a rack changes the brush itself, otherwise a person does. Raises Interrupted if nobody does.
        """
        hand = self._hand
        changes = hand.held != brush and (hand.has_rack or bool(hand.others))
        if changes:
            if hand.load.paint is not None:
                self.clean()
            if hand.has_rack:
                self._change_in_rack(brush)
            else:
                self._interruptions.retry(self.step_aside)
                self._note(events.BrushInHand(None))
                hand.change_brush(brush)
        if self._told != brush:
            self._told = brush
            (self._tell if hand.has_rack else self._note)(events.BrushInHand(brush))
        return changes

    def put_brush_back(self) -> None:
        """Cleans the brush, and puts it back if the robot has a rack."""
        if self._hand.load.paint is not None:
            self.clean()
        if self._hand.has_rack:
            self._change_in_rack("", stoppable=False)
            self._tell(events.BrushInHand(""))

    def _change_in_rack(self, brush: str, *, stoppable: bool = True) -> None:
        """Changes the brush; each motion is noted before the robot gets it, and the held brush after it."""
        for motion, held in self._hand.changing(brush):
            for noted in (events.BrushInHand(None), events.MotionBegan((motion.label,))):
                self._interruptions.retry(partial(self._journal.tell, noted))
            self._hand.move_brush(motion, held)
            self._interruptions.retry(partial(self._journal.tell, events.BrushInHand(held)))
            if stoppable:
                self._interruptions.check()

    def let_dry(self) -> None:
        """Cleans the brush, moves the arm to its home position and waits until the paint is dry.

        A person may stop or pause meanwhile; real paint dries in a pause too. The journal holds the remaining time,
        so that a resumed painting waits only for the rest.
        """
        if self._hand.load.paint is not None:
            self.clean()
        self._interruptions.retry(self.step_aside)
        easel, progress = self._hand.easel, self._progress
        left = progress.wet_for(self._hand.drying)
        dry_at, told = time.monotonic() + left, math.inf
        while True:
            if left == 0 or told - left >= _BETWEEN_WORDS:
                told = left
                self._note(events.Drying(progress.painted, round(left, 1)))
            progress.wet = left
            self._interruptions.check()
            if left == 0:
                break
            step = min(left, _STEP)
            self._wait(step * easel.pace)
            easel.operator.let_dry(step)
            left -= step
            if not easel.simulated:
                left = max(0.0, min(left, dry_at - time.monotonic()))
        progress.dried_at, progress.wet = progress.painted, None

    def _wait(self, seconds: float) -> None:
        """Waits; checks for a stop or a pause every 0.1 s."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            time.sleep(min(left, _GLANCE))
            self._interruptions.check()

    def clean(self) -> None:
        """Notes the cleaning in the journal, then rinses and wipes the brush."""
        what = tuple(motion.label for motion in self._hand.cleaning())
        self._interruptions.retry(partial(self._journal.tell, events.MotionBegan(what)))
        self._hand.clean()

    def step_aside(self) -> None:
        """Moves the arm out of the camera's view. Raises StorageError if the journal cannot note it."""
        self._journal.tell(events.MotionBegan(("home",)))
        self._hand.step_aside()

    def _perform(self, action: Action, frames: FrameDeveloper, *, leaves: bool) -> bool:
        """Notes and performs an action; returns False if it could not be noted, and the painting has paused.

        leaves: True if the hand leaves the canvas afterwards anyway.
        """
        try:
            self._journal.begins(action)
        except StorageError as trouble:
            self._interruptions.pause(str(trouble), trouble=trouble)
            return False
        done = self._hand.perform(action)
        self._interruptions.retry(partial(self._journal.tell, done))
        self._tell(done)
        if isinstance(done, events.StrokeLeftOut):
            self._progress.canvas.left_out.add(done.done - 1)
        if not isinstance(done, events.Dipped):
            self._progress.painted = done.done
            if isinstance(done, events.StrokePainted):
                self._film(done, frames, leaves=leaves)
            self._interruptions.check(before_pause=frames.wait)  # a pause shows the current canvas
        return True

    def _film(self, painted: events.StrokePainted, frames: FrameDeveloper, *, leaves: bool) -> None:
        """Takes the film's next frame if it is due; a camera sees the canvas only with the arm at home."""
        done, has_camera = painted.done, self._hand.easel.has_camera
        of = self._progress.most or painted.of
        if self._timelapse.wants_frame(done, of, self._filmed or 0, leaves=leaves or not has_camera):
            self._filmed = self._timelapse.due(done, of)
            if has_camera:
                self._interruptions.retry(self.step_aside)
            frames.take(painted, self._hand.last_motion)
