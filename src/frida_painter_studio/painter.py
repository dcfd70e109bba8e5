"""Control of a painting from the page: questions to the person, and commands in pauses."""

import contextlib
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import images
from frida_painter.easel.dialogue import (
    JOG_STEPS,
    Answer,
    Choose,
    Confirm,
    EnterAddress,
    Guide,
    Jog,
    Measure,
    PointCorners,
    SetupQuestion,
)
from frida_painter.errors import FridaError, Interrupted, StorageError
from frida_painter.palette import to_hex
from frida_painter.plan import Plan
from frida_painter.planning.problem import region_of
from frida_painter.runs.spec import RunSpec
from frida_painter.session import events
from frida_painter.session.events import Event, Notify, PauseCause
from frida_painter.session.loop import PaintingSession
from frida_painter_studio import commands
from frida_painter_studio.commands import Command, Inbox, accept_reply, command_of, to_plain
from frida_painter_studio.picture_choosing import MakingOrder
from frida_painter_studio.side_jobs import show_pictures, without_folders
from frida_painter_studio.stop import StopWatch
from frida_painter_studio.studio_folder import Feed, PaintingFolder
from frida_painter_together.policies import TurnTaken, answer_turn, find_turn_policy
from frida_painter_together.proposing import (
    forbid,
    keep_region,
    propose,
    pursue,
    record_making,
    require_goal,
    resize_mask,
    union_of,
)
from frida_painter_together.turns import FoundPaint, PenStroke
from frida_painter_words.picture_makers.making import require_canvas_maker

# Questions from a worker to the person at the page: calibration, paints to fill, strokes in doubt.

_BETWEEN_GLANCES = 0.04
MAX_ABSENCE = 600.0
"""Seconds without a page after which a dialogue that can be continued is left: phones sleep, and networks fail."""


@dataclass
class Asker:
    """Shows questions on the page; `answer` is the callback for dialogues and operators.

    may_leave: True if the person may leave the dialogue without a stop. It is then left, too, if no page has followed
        it for MAX_ABSENCE seconds while it waits for an answer, so that the machine is free for others.
    """

    folder: PaintingFolder
    feed: Feed
    stop: StopWatch
    may_leave: bool = False
    _shown: deque[Path] = field(default_factory=deque, init=False)

    def answer(self, question: SetupQuestion) -> Answer:
        """Waits for the person's answer and returns it.

        Raises StopPressed if the person stops everything, Interrupted if the person leaves or is gone.
        """
        number = secrets.token_hex(8)
        asked = describe_question(question) | ({"leave": True} if self.may_leave else {})
        picture = getattr(question, "picture", None)
        if picture is not None:
            asked |= {"picture": self._show(picture), "rows": picture.shape[1], "columns": picture.shape[2]}
        inbox = Inbox(self.folder, 0.0)
        inbox.listen()  # earlier answers do not count
        self.feed.tell(events.Asked({"id": number, **asked}))
        followed, since = self._followed(), time.monotonic()
        while True:
            self.stop.heed()
            if (now := self._followed()) not in (followed, None):
                followed, since = now, time.monotonic()
            elif self.may_leave and time.monotonic() - since > MAX_ABSENCE:
                self.feed.tell(events.Asked(None))
                raise Interrupted(
                    f"No page was open for {MAX_ABSENCE / 60:.0f} minutes; what was done before is kept, and the "
                    "machine is free."
                )
            for message in inbox.listen():
                answer = accept_reply(message.reply, number, asked)
                if answer is not None:
                    self.feed.tell(events.Asked(None))
                    return answer
            time.sleep(_BETWEEN_GLANCES)

    def _followed(self) -> int | None:
        """Returns a number that changes while a page follows; None if none ever did."""
        with suppress(OSError):
            return self.folder.followed.stat().st_mtime_ns
        return None

    def _show(self, picture: Tensor) -> str:
        self._shown.append(self.folder.make_live_path("question", ".jpg"))
        images.save(picture, self._shown[-1])
        while len(self._shown) > 2:
            self._shown.popleft().unlink(missing_ok=True)
        return self._shown[-1].name


_KINDS: dict[type, str] = {
    Confirm: "confirm",
    PointCorners: "corners",
    Jog: "jog",
    Measure: "measure",
    Guide: "guide",
    Choose: "choose",
    EnterAddress: "address",
}


def describe_question(question: SetupQuestion) -> dict[str, Any]:
    """Returns a question as plain values, without its picture."""
    told = {name: value for name, value in vars(question).items() if name != "picture"}
    match question:
        case PointCorners(proposal=tuple(corners)):
            told["proposal"] = [[float(x), float(y)] for x, y in corners]
        case Jog():
            told["proposal"] = None if question.proposal is None else question.proposal.step
        case Guide():
            told |= {"proposal": None, "steps": JOG_STEPS}
        case EnterAddress():
            told["example"] = question.example
        case _:
            pass
    return {"kind": _KINDS[type(question)], **told}


_YOURS_STAYS = (
    "What you painted stays as it is in all of them. If it may be painted over, press Remove the protection, then ask "
    "again."
)
_MAX_WAITING = 200  # commands that wait to be done


@dataclass
class PauseController:
    """Handles the pauses of a session.

    report: shows an event in the journal.
    began: start of the painter, seconds since 1970.
    opened: returns the session, None before it is open.
    look_at: takes the picture in a file for a look, on an easel without a camera.
    ask: asks a question on the page and returns the answer.

    A request is in the journal before the page hears that it is being done, or its result is.
    """

    folder: PaintingFolder
    report: Notify
    stop: StopWatch
    began: float
    opened: Callable[[], PaintingSession | None] = lambda: None
    look_at: Callable[[Path], None] = lambda picture: None
    ask: Callable[[SetupQuestion], Answer] = lambda question: False
    _commands: deque[Command] = field(default_factory=lambda: deque(maxlen=_MAX_WAITING), init=False)
    _since_time: float = field(default=0.0, init=False)  # of the robot's current turn, monotonic seconds
    _answer: str = field(default="", init=False)  # sentence about the answer to the person's turn
    _conferring: bool = field(default=False, init=False)
    _owes: bool = field(default=False, init=False)  # True until a request of before the painting broke off is done
    _since: int = field(default=0, init=False)  # strokes of the robot's current turn

    def __post_init__(self) -> None:
        inbox = Inbox(self.folder, self.began)

        def listen() -> None:
            while True:
                with contextlib.suppress(FridaError, OSError):  # the next look may succeed
                    self._commands.extend(each.command for each in inbox.listen() if each.command is not None)
                time.sleep(_BETWEEN_GLANCES)

        threading.Thread(target=listen, daemon=True, name="commands").start()

    def owe(self, request: dict[str, Any], proposed: events.PicturesMade | None) -> None:
        """Takes over what a person asked for before the painting broke off: it is done before the next stroke.

        If pictures were proposed, or are to be, the painting then waits until the person chooses one or goes on.
        """
        command = command_of(request)
        if command is not None:
            self._commands.append(command)
            if command != commands.FINISH and not isinstance(command, commands.Propose):
                self._commands.append(commands.GO_ON)
        self._owes = command is not None or proposed is not None

    def hear(self, event: Event) -> None:
        """Counts strokes, for turns."""
        if isinstance(event, events.StrokePainted):
            self._since += 1

    def pause_cause(self) -> PauseCause | None:
        """Returns the cause of a pause that is due: a person wants it, or it is their turn; else None.

        Refuses what can be done in a pause only. Keeps what was asked after a pause: it is done in that pause.
        """
        if self._conferring:
            return None
        if self._owes:
            self._owes, self._conferring = False, True
            return "person"
        while self._commands:
            match self._commands.popleft():
                case commands.PAUSE:
                    self._conferring = True  # until go_on
                    return "turn" if self._is_turn else "person"
                case commands.TakeTurns() as turns:
                    with suppress(StorageError):  # on a full disk the painting pauses by itself, and tells why
                        self._take_turns(turns)
                case commands.PaintStroke():  # the page refuses it too, but the painting may have gone on meanwhile
                    self._remark(commands.ROBOT_MOVES)
                case commands.GO_ON:
                    pass  # it went on already
                case _:
                    self._remark(commands.IN_A_PAUSE)
        return "turn" if self._is_turn else None

    @property
    def _game(self) -> events.Turns:
        """Turns that were agreed on."""
        return self._session.journal.state.turns

    @property
    def _is_turn(self) -> bool:
        """True if the robot has painted the strokes of its turn, or as long as its turn lasts."""
        session = self.opened()
        if session is None or session.in_turns:
            return False  # without a goal, every answer ends with the person's turn
        game = self._game
        over = 0 < game.minutes <= (time.monotonic() - self._since_time) / 60 and self._since > 0
        return over or 0 < game.strokes <= self._since

    def go_on(self, paused: events.Paused) -> bool:
        """Performs commands until the person lets the painting go on; returns False if the person stops it."""
        self._conferring = True
        try:
            return self._confer(paused)
        finally:
            self._conferring = False

    def _confer(self, paused: events.Paused) -> bool:
        session = self.opened()
        if session is not None:
            if paused.cause != "trouble":
                session.person.await_paint()
            if session.person.may_paint and session.person.wells is not None:
                wells = [to_hex(color) for color in session.person.wells.color]
                brushes = [asdict(brush) for brush in session.hand.easel.person_brushes]
                self.report(events.PersonMayPaint(brushes, wells))
        while not self.stop.asked:
            if not self._commands:
                session = self.opened()
                if session is None or not session.is_button_pressed():
                    time.sleep(_BETWEEN_GLANCES)
                    continue
                self._commands.append(commands.GO_ON)
            command = self._commands.popleft()
            if command in (commands.GO_ON, commands.FINISH):
                if command == commands.FINISH:
                    self._note(command)
                self._end_turn(command)
                self._since, self._since_time = 0, time.monotonic()
                self.report(events.WentOn())
                self._tell_answer()
                return True
            try:
                quick = isinstance(command, commands.LeaveOut | commands.TakeTurns | commands.PaintStroke)
                if command != commands.END_MAKING and not quick:
                    self._note(command)
                self._do(command)
            except FridaError as trouble:
                self._remark(str(trouble))
            with suppress(StorageError):
                self._note(None)
        return False

    def _remark(self, sentence: str) -> None:
        self.report(events.Remark(sentence))

    def _note(self, command: Command | None) -> None:
        """Notes in the journal that a request is being done, or that nothing is. Raises StorageError."""
        self._session.note(events.RequestTaken({} if command is None else to_plain(command)))

    def _tell_answer(self) -> None:
        """Says how the robot answers the person, once."""
        if self._answer:
            self._remark(self._answer)
        self._answer = ""

    def _end_turn(self, command: Command) -> None:
        """Answers a person who painted, or finishes a painting without a goal."""
        session = self.opened()
        if session is None:
            return
        try:
            if command == commands.GO_ON:
                self._answer_person(session)
            elif session.in_turns:
                session.person.end_here()
            else:
                self._answer = "This painting has a goal, and goes on towards it; to end it now, press Stop."
        except FridaError as trouble:
            self._answer = str(trouble)

    def _answer_person(self, session: PaintingSession) -> None:
        """Answers a person by the turn policy that they chose.

        At a real easel, what they painted is found by photographs. If nothing was agreed on, they are asked what
        becomes of it, but only if it matters.
        """
        person = session.person
        found = None if person.touched else person.find_paint()
        if person.touched or (found is not None and (session.in_turns or self._game != events.Turns(0))):
            person.answer(self.adapt)
        elif found is not None:
            self._welcome_or_protect(session, found)
        if found is not None:
            shown = self.folder.make_live_path("found", ".jpg")
            images.save(found.outlined, shown)
            self.report(events.ResultFound("found", shown.name))

    def _welcome_or_protect(self, session: PaintingSession, found: FoundPaint) -> None:
        """Asks what becomes of found paint if it matters, and replans the rest for the canvas with it."""
        share = f"{max(1, round(100 * found.share))} % of the canvas"
        covers = " Strokes that are still planned would cover some of it." if found.covered >= 0.01 else ""
        question = f"You painted what is outlined here, about {share}.{covers} Shall it stay as it is?"
        if found.matters and self.ask(Confirm(question, found.outlined, proposal=True)) is True:
            self._forbid(union_of(session.planner.region, found.painted))
            self._answer = "What you painted stays as it is: the robot paints around it."
        else:
            self._answer = "The robot has seen what you painted, and goes on from it."
        session.look_again()

    def _forbid(self, forbidden: NDArray[np.bool_]) -> None:
        """Forbids strokes on a part of the canvas [H, W], and notes that; nothing is replanned."""
        forbid(self._session, self.folder.painting, forbidden, self._show_region)

    def adapt_alone(self, turn: TurnTaken) -> Plan | None:
        """Answers a turn as `adapt`, outside of a pause, and says how."""
        rest = self.adapt(turn)
        self._tell_answer()
        return rest

    def adapt(self, turn: TurnTaken) -> Plan | None:
        """Answers a turn by the policy that was agreed on; tells why if there is no such answer, and returns None."""
        session, game = self._session, self._game
        count = min(turn.room, game.strokes or turn.count)
        policy, region = find_turn_policy(game.policy), session.planner.region
        protected = None if region is None else resize_mask(region.forbidden.numpy(), turn.painted.shape)
        try:
            size = session.planner.size.height
            answer = answer_turn(policy, game.keep, replace(turn, count=count), size, protected)
        except FridaError as trouble:
            self._answer = str(trouble)
            return None
        if answer.forbidden is not None:
            self._forbid(answer.forbidden)
        if game.policy != "alternate" or answer.forbidden is not None:
            self._answer = answer.sentence
        return answer.rest

    def _do(self, command: Command) -> None:
        session = self._session
        match command:
            case commands.LOOK:
                session.look_again()
            case commands.PaintStroke(brush, paint, points):
                session.person.paint(PenStroke(brush, paint, points))
            case commands.GivePicture(picture):
                self.look_at(self.folder.pictures / f"{picture}.png")
            case commands.LeaveOut(count):
                rest = session.rest
                session.paint_instead(rest.part(slice(max(0, len(rest) - count))))
            case commands.Protect(picture, only):
                drawing = images.load(self.folder.pictures / f"{picture}.png")
                session.planner = session.planner.keeping_clear(region_of(drawing, only_inside=only))
                kept = keep_region(self.folder.painting, drawing)
                session.note(events.RegionProtected(kept, only, self._show_region(drawing)))
                session.look_again()
            case commands.FREE:
                session.person.release()
                session.planner = session.planner.keeping_clear(None)
                session.note(events.RegionProtected(None))
                session.look_again()
            case commands.ChangeGoal(request):
                wanted = RunSpec.of(**request.goals(self.folder.pictures))
                pursue(session, self.folder.painting, wanted, request.model_dump(mode="json"))
            case commands.Propose():
                self._propose(command)
            case commands.TakeTurns():
                self._take_turns(command)
            case _:
                pass  # the painting has paused already, or no picture is being made

    @property
    def _session(self) -> PaintingSession:
        session = self.opened()
        assert session is not None, "there is no pause before the session is open"
        return session

    def _show_region(self, drawing: Tensor) -> str:
        """Writes the drawing of a region for the page, and returns its name."""
        shown = self.folder.make_live_path("region", ".png")
        images.save(drawing, shown)
        return shown.name

    def _propose(self, command: commands.Propose) -> None:
        """Has pictures made that begin from the canvas, and shows them; what the person painted is protected first."""
        session, order = self._session, MakingOrder.load(self.folder)
        require_goal(session)
        require_canvas_maker(order.maker)
        own = session.person.find_own_paint()
        if own is not None:
            self._forbid(union_of(session.planner.region, own))
        making = propose(
            session, self.folder.painting, command.words, order.maker, minutes=order.minutes,
            stop_asked=lambda: self.stop.asked or commands.END_MAKING in list(self._commands),
            tell=lambda sentence: self.report(events.Advanced(sentence)),
        )  # fmt: skip
        shown = show_pictures(making, self.folder.live, secrets.token_hex(12))
        session.note(record_making(without_folders(making), order.label, self.folder.painting, shown))
        if own is not None:
            self._remark(_YOURS_STAYS)

    def _take_turns(self, command: commands.TakeTurns) -> None:
        self._since, self._since_time = 0, time.monotonic()
        self._session.note(events.Turns(command.count, command.minutes, command.policy, command.keep))
