"""Control of a painting from the page: questions to the person, and commands in pauses."""

import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from torch import Tensor

from frida_painter import images
from frida_painter.easel.dialogue import Answer, Confirm, Jog, Measure, PointCorners, Question
from frida_painter.errors import FridaError
from frida_painter.event_log import LogReader
from frida_painter.frames import PixelGrid
from frida_painter.planning.problem import region_of
from frida_painter.runs.goal_item import read_goal_file
from frida_painter.runs.painting_folder import keep_goal
from frida_painter.runs.settle import open_goal
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import (
    Answered,
    Asked,
    Considering,
    Event,
    GoalChanged,
    Paused,
    RegionProtected,
    Remark,
    StrokePainted,
    Turns,
    WentOn,
)
from frida_painter.session.loop import PaintingSession
from frida_painter.session.observer import PHOTOGRAPH_ROWS
from frida_painter.web.commands import (
    ChangeGoal,
    CommandReader,
    Free,
    GoOn,
    LeaveOut,
    LookAgain,
    PaintingCommand,
    Pause,
    Protect,
    TakeTurns,
    parse_answer,
)
from frida_painter.web.stop import StopWatch
from frida_painter.web.studio_folder import Feed, PaintingFolder

# Questions from a worker to the person at the page: calibration, paints to fill, strokes in doubt.

_BETWEEN_GLANCES = 0.04


@dataclass
class Asker:
    """Shows questions on the page; `answer` is the callback for dialogues and operators."""

    folder: PaintingFolder
    feed: Feed
    stop: StopWatch
    _shown: deque[str] = field(default_factory=deque, init=False)

    def answer(self, question: Question) -> Answer:
        """Waits for the person's answer and returns it. Raises StopPressed if the person stops everything."""
        number = secrets.token_hex(8)
        asked = describe_question(question)
        picture = None if isinstance(question, Measure) else question.picture
        if picture is not None:
            asked |= {"picture": self._show(picture), "rows": picture.shape[1], "columns": picture.shape[2]}
        reader = LogReader(self.folder.replies)
        reader.read()  # earlier answers do not count
        self.feed.tell(Asked({"id": number, **asked}))
        while True:
            self.stop.heed()
            for line in reader.read():
                answer = parse_answer(line, number, asked)
                if answer is not None:
                    self.feed.tell(Answered())
                    return answer
            time.sleep(_BETWEEN_GLANCES)

    def _show(self, picture: Tensor) -> str:
        # The name is random, because everybody who knows it may see the picture.
        name = f"question-{secrets.token_hex(12)}.jpg"
        images.save(picture, self.folder.live / name)
        self._shown.append(name)
        while len(self._shown) > 2:
            (self.folder.live / self._shown.popleft()).unlink(missing_ok=True)
        return name


def describe_question(question: Question) -> dict[str, Any]:
    """Returns a question as plain values, without its picture."""
    match question:
        case Confirm(text=text, proposal=proposal):
            return {"kind": "confirm", "text": text, "proposal": proposal}
        case PointCorners(text=text, proposal=proposal):
            corners = None if proposal is None else [[float(x), float(y)] for x, y in proposal]
            return {"kind": "corners", "text": text, "proposal": corners}
        case Jog():
            step = None if question.proposal is None else question.proposal.step
            told = {"kind": "jog", "text": question.text, "height": question.height, "proposal": step}
            return told | {"lowest": question.lowest, "highest": question.highest}
        case Measure():
            told = {"kind": "measure", "text": question.text, "proposal": question.proposal}
            return told | {"lowest": question.lowest, "highest": question.highest}


_ROUNDS = 3  # rounds of a replan after a change of the goal
_YOUR_TURN = "It is your turn. Paint what you like, let it look, then let it go on."
_PAUSED = "It has paused: the brush is clean, the arm aside. You may paint on the canvas, then let it look."


@dataclass
class PauseController:
    """Handles the pauses of a session.

    began: start of the painter, seconds since 1970.
    opened: returns the session, None before it is open.
    """

    folder: PaintingFolder
    feed: Feed
    stop: StopWatch
    began: float
    opened: Callable[[], PaintingSession | None] = lambda: None
    _commands: deque[PaintingCommand] = field(default_factory=deque, init=False)
    _turns: int = field(default=0, init=False)
    _conferring: bool = field(default=False, init=False)
    _since: int = field(default=0, init=False)  # strokes of the robot's current turn

    def __post_init__(self) -> None:
        listener = CommandReader(self.folder, self.began)

        def listen() -> None:
            while True:
                self._commands.extend(listener.listen())
                time.sleep(_BETWEEN_GLANCES)

        threading.Thread(target=listen, daemon=True, name="commands").start()

    def hear(self, event: Event) -> None:
        """Counts strokes, for turns."""
        if isinstance(event, StrokePainted):
            self._since += 1

    def pause_asked(self) -> bool:
        """Returns True if a person wants a pause, or if it is their turn.

        Drops what can be done in a pause only. Keeps what was asked after a pause: it is done in that pause.
        """
        if self._conferring:
            return False
        while self._commands:
            match self._commands.popleft():
                case Pause():
                    self._conferring = True  # until go_on
                    return True
                case TakeTurns() as turns:
                    self._take_turns(turns)
        return 0 < self._turns <= self._since

    def go_on(self, paused: Paused) -> bool:
        """Performs commands until the person lets the painting go on; returns False if the person stops it."""
        self._conferring = True
        try:
            return self._confer(paused)
        finally:
            self._conferring = False

    def _confer(self, paused: Paused) -> bool:
        mine = 0 < self._turns <= self._since
        reason = _YOUR_TURN if mine else _PAUSED if paused.asked else self._without_paths(paused.reason)
        told = replace(paused, reason=reason, turn=mine)
        self.feed.tell(told)
        while not self.stop.asked:
            if not self._commands:
                time.sleep(_BETWEEN_GLANCES)
                continue
            command = self._commands.popleft()
            if isinstance(command, GoOn):
                self._since = 0
                self.feed.tell(WentOn())
                return True
            self.feed.tell(Considering())
            try:
                self._do(command)
            except FridaError as trouble:
                self.feed.tell(Remark(self._without_paths(str(trouble))))
            self.feed.tell(told)
        return False

    def _without_paths(self, sentence: str) -> str:
        """Returns a sentence without the folder's path, for everybody at the page."""
        return sentence.replace(str(self.folder.path), "its folder")

    def _do(self, command: PaintingCommand) -> None:
        session = self._session
        match command:
            case LookAgain():
                session.look_again()
            case LeaveOut(count):
                rest = session.rest
                session.paint_instead(rest.part(slice(max(0, len(rest) - count))))
            case Protect(number, only):
                drawn = self.folder.region(number)
                drawing = images.load(drawn)
                session.planner = session.planner.keeping_clear(region_of(drawing, only_inside=only))
                self._tell_region(RegionProtected(self._keep_region(drawing, number), only, drawn.name))
            case Free():
                session.planner = session.planner.keeping_clear(None)
                self._tell_region(RegionProtected(None))
            case ChangeGoal():
                self._pursue(command)
            case TakeTurns():
                self._take_turns(command)
            case _:
                pass  # the painting has paused already

    @property
    def _session(self) -> PaintingSession:
        session = self.opened()
        assert session is not None, "there is no pause before the session is open"
        return session

    def _tell_region(self, region: RegionProtected) -> None:
        """Notes and reports a changed region, and replans the rest around it."""
        session = self._session
        session.journal.tell(region)
        self.feed.tell(region)
        session.look_again()

    def _keep_region(self, drawing: Tensor, number: int) -> str:
        """Saves the drawing of a region into the painting's results; returns its file name."""
        name = f"regions/{number}.png"
        images.save(drawing, self.folder.painting / name)
        return name

    def _pursue(self, command: ChangeGoal) -> None:
        """Changes the goal; the paints stay, because they are mixed already."""
        session = self._session
        place = self.folder.change(command.record)
        grid = PixelGrid.of_height(session.planner.size, PHOTOGRAPH_ROWS)
        wanted = RunSpec.of(**read_goal_file(place.goal))
        keep_goal(wanted, self.folder.painting / f"changes/{command.record}")
        goal = open_goal(wanted).fit_to(grid.rows, grid.columns)
        changed = GoalChanged(f"changes/{command.record}", place.request().model_dump(mode="json"))
        session.journal.tell(changed)
        session.planner = session.planner.towards(goal)
        self.feed.tell(changed)
        session.look_again(_ROUNDS)

    def _take_turns(self, command: TakeTurns) -> None:
        self._turns, self._since = command.count, 0
        self.feed.tell(Turns(command.count))
