"""Conductor of a painting: does what people command, between two strokes or in a pause, whoever began the painting."""

import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from torch import Tensor

from frida_painter.calibration import Corners
from frida_painter.easel.dialogue import Answer, Confirm, PointCorners, SetupQuestion
from frida_painter.easel.kinds import GIVEN, LIVE
from frida_painter.errors import CalibrationError, FridaError, StorageError
from frida_painter.perception.markers import find_marks
from frida_painter.perception.snapshot import find_corners
from frida_painter.runs.look_folder import GivenPicture
from frida_painter.runs.spec import RunSpec
from frida_painter.session import events
from frida_painter.session.events import Event, Notify, PauseCause
from frida_painter.session.loop import PaintingSession
from frida_painter.strokes.palette import to_hex
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter_together import commands
from frida_painter_together.asking import Asker
from frida_painter_together.commands import Command, command_of, goal_items, to_plain
from frida_painter_together.inbox import Inbox, MakingOrder, make_live_path
from frida_painter_together.plan_pictures import PlanPictures
from frida_painter_together.policies import TurnTaken, answer_turn, find_turn_policy
from frida_painter_together.proposing import (
    choose,
    forbid,
    mark,
    propose,
    pursue,
    record_making,
    require_goal,
    resize_mask,
    show_pictures,
    union_of,
    without_folders,
)
from frida_painter_together.turns import FoundPaint, PenStroke
from frida_painter_words.picture_makers.making import require_canvas_maker

if TYPE_CHECKING:
    from frida_painter.runs.run import PaintingRun

_BETWEEN_GLANCES = 0.04
_YOURS_STAYS = (
    "What you painted stays in all of them. To allow paint over it, press Remove the protection, then ask again."
)
_MAX_WAITING = 200  # commands that wait to be done


@dataclass
class Conductor:
    """Hears the commands in the inbox of a painting, and does them.

    folder: of the painting.
    report: shows an event in the journal.
    stop_asked: returns True if a person stops everything.
    since: commands from then on count, seconds since 1970.
    opened: returns the session, None before it is open.
    look_at: takes the picture in a file for a look, on an easel without a camera.
    ask: asks a question on the page and returns the answer.
    elsewhere: asked in a pause; returns True if a person lets the painting go on in another way than by the inbox,
    False if a person ends it, else None.
    asks_here: True if `ask` asks the person who gives the commands of `do`.

    A command is in the journal before the page hears that it is being done, or its result is.
    """

    folder: Path
    report: Notify
    stop_asked: Callable[[], bool]
    since: float
    opened: Callable[[], PaintingSession | None] = lambda: None
    look_at: Callable[[Path], None] = lambda picture: None
    ask: Callable[[SetupQuestion], Answer] = lambda question: False
    elsewhere: Callable[[events.Paused], bool | None] = lambda paused: None
    asks_here: bool = False
    _own: Command | None = field(default=None, init=False)  # last one of `do` or `owe`
    _commands: deque[Command] = field(default_factory=deque, init=False)
    _since_time: float = field(default=0.0, init=False)  # of the robot's current turn, monotonic seconds
    _answer: str = field(default="", init=False)  # sentence about the answer to the person's turn
    _conferring: bool = field(default=False, init=False)
    _owes: bool = field(default=False, init=False)  # True until a request of before the painting broke off is done
    _since: int = field(default=0, init=False)  # strokes of the robot's current turn

    def __post_init__(self) -> None:
        inbox = Inbox(self.folder, self.since)

        def listen() -> None:
            while True:
                with suppress(FridaError, OSError):  # the next look may succeed
                    for each in inbox.listen():
                        if each.command is not None and len(self._commands) < _MAX_WAITING:
                            self._commands.append(each.command)
                time.sleep(_BETWEEN_GLANCES)

        threading.Thread(target=listen, daemon=True, name="commands").start()

    @classmethod
    def lead(
        cls,
        run: "PaintingRun",
        stop_asked: Callable[[], bool],
        heed: Callable[[], None],
        since: float,
        elsewhere: Callable[[events.Paused], bool | None] = lambda paused: None,
    ) -> Self:
        """Has people lead a run with an open easel by its inbox, and returns their conductor.

        stop_asked, since, elsewhere: as in the class.
        heed: called while a question waits for its answer; raises if a person stops everything.
        From now on, the plans are drawn for the page.
        """

        def look_at(picture: Path) -> None:
            given = GivenPicture(picture)
            photograph = given.load()
            found: Corners | None = None
            with suppress(CalibrationError):
                found = find_corners(photograph, planner.size)
                if find_marks(photograph):  # printed pieces tell which corner is which
                    run.look_at_picture(replace(given, corners=found))
                    return
            question = "Where are the canvas's corners in this picture? Go round it, from any of them."
            corners = asker.answer(PointCorners(question, images.from_uint8(photograph), found))
            assert isinstance(corners, tuple)
            run.look_at_picture(replace(given, corners=corners))

        planner = run.planner
        shown = planner.bare, planner.models, planner.size
        run.keepers.append(PlanPictures(run.folder / LIVE, *shown, in_turns=run.spec.together).hear)
        asker = Asker(run.folder, run.report, heed)
        conductor = cls(
            run.folder, run.report, stop_asked, since, lambda: run.session, look_at, asker.answer, elsewhere
        )
        if run.history is not None:
            if run.history.people.question is not None:
                run.report(events.Asked(None))  # nobody waits for an answer to it any more
            conductor.owe(run.history.wishes.request, run.history.wishes.proposed)
        run.listeners.append(conductor.hear)
        return conductor

    def paint_on(self, difference: str, photograph: Tensor) -> bool:
        """Asks whether a canvas that is not as it should be is painted on."""
        question = f"{difference.split(' Look at ')[0]} Shall it be painted on as it is?"
        return self.ask(Confirm(question, photograph, proposal=False)) is True

    def repaint(self, number: int, picture: Tensor) -> bool:
        """Asks whether a stroke in doubt is painted again."""
        question = f"Stroke {number} was begun, and nothing tells whether it was painted. Paint it again?"
        return self.ask(Confirm(question, picture, proposal=False)) is True

    def do(self, command: Command) -> None:
        """Takes a command of somebody who needs no inbox."""
        self._own = command
        self._commands.append(command)

    def owe(self, request: dict[str, Any], proposed: events.MadePictures | None) -> None:
        """Takes over what a person asked for before the painting broke off: it is done before the next stroke.

        If pictures were proposed, or are to be, the painting then waits until the person chooses one or goes on.
        """
        command = command_of(request)
        if isinstance(command, commands.ChoosePicture) and proposed is None:
            command = commands.LOOK  # the goal is there already, and only its plan is not
        if command is not None:
            self.do(command)
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
        return self._session.journal.state.wishes.turns

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
        while not self.stop_asked():
            if not self._commands:
                session = self.opened()
                ended = True if session is not None and session.is_button_pressed() else self.elsewhere(paused)
                if ended is None:
                    time.sleep(_BETWEEN_GLANCES)
                    continue
                if not ended:
                    return False
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
        self._session.note(events.CommandTaken({} if command is None else to_plain(command)))

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
            shown = make_live_path(self.folder, "found", ".jpg")
            images.save(found.outlined, shown)
            self.report(events.ResultFound("found", shown.name))

    def _welcome_or_protect(self, session: PaintingSession, found: FoundPaint) -> None:
        """Asks what becomes of found paint if it matters, and replans the rest for the canvas with it."""
        share = f"{max(1, round(100 * found.share))} % of the canvas"
        covers = " Strokes that are still planned would cover some of it." if found.covered >= 0.01 else ""
        question = f"You painted what is outlined here, about {share}.{covers} Shall it stay as it is?"
        if found.matters and self.ask(Confirm(question, found.outlined, proposal=True)) is True:
            forbid(session, self.folder, union_of(session.planner.region, found.painted))
            self._answer = "What you painted stays as it is: the robot paints around it."
        else:
            self._answer = "The robot has seen what you painted, and goes on from it."
        session.look_again()

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
            forbid(session, self.folder, answer.forbidden)
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
                self.look_at(self.folder / GIVEN / f"{picture}.png")
            case commands.LeaveOut(count):
                rest = session.rest
                session.paint_instead(rest.part(slice(max(0, len(rest) - count))))
            case commands.Protect(picture, only):
                drawing = images.load(self.folder / GIVEN / f"{picture}.png")
                mark(session, self.folder, drawing, only=only)
                session.look_again()
            case commands.FREE:
                session.person.release()
                session.planner = session.planner.keeping_clear(None)
                session.note(events.CommandDone(events.DrawnRegion(None)))
                session.look_again()
            case commands.ChangeGoal(terms, initial):
                wanted = RunSpec.of(**goal_items(self.folder / GIVEN, terms, initial))
                plain = to_plain(command)
                pursue(session, self.folder, wanted, {name: plain[name] for name in ("terms", "initial")})
            case commands.Propose():
                self._propose(command)
            case commands.ChoosePicture(file):
                choose(session, self.folder, file)
            case commands.TakeTurns():
                self._take_turns(command)
            case _:
                pass  # the painting has paused already, or no picture is being made

    @property
    def _session(self) -> PaintingSession:
        session = self.opened()
        assert session is not None, "there is no pause before the session is open"
        return session

    def _propose(self, command: commands.Propose) -> None:
        """Has pictures made that begin from the canvas, and shows them; what the person painted is protected first."""
        session, order = self._session, MakingOrder.load(self.folder)
        require_goal(session)
        require_canvas_maker(order.maker)
        own, asks = session.person.find_own_paint(), self.asks_here and command is self._own
        if own is not None and asks:
            share = f"{max(1, round(100 * own.mean()))} % of the canvas"
            own = own if self.ask(Confirm(f"You painted about {share}. Shall it stay as it is?")) is True else None
        if own is not None:
            forbid(session, self.folder, union_of(session.planner.region, own))
        making = propose(
            session, self.folder, command.words, order.maker, minutes=order.minutes,
            stop_asked=lambda: self.stop_asked() or commands.END_MAKING in list(self._commands),
            tell=lambda sentence: self.report(events.Advanced(sentence)),
        )  # fmt: skip
        shown = show_pictures(making, self.folder / LIVE, secrets.token_hex(12))
        made = record_making(without_folders(making), order.label, self.folder, shown)
        session.note(events.CommandDone(made))
        if own is not None and not asks:
            self._remark(_YOURS_STAYS)

    def _take_turns(self, command: commands.TakeTurns) -> None:
        self._since, self._since_time = 0, time.monotonic()
        turns = events.Turns(command.count, command.minutes, command.policy, command.keep)
        self._session.note(events.CommandDone(turns))
