import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
import torch

from frida_painter.easel.kinds import GIVEN, LIVE
from frida_painter.errors import FrameRejected, StorageError
from frida_painter.hardware.easel import PersonStroke
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.runs.painting_folder import read_goal
from frida_painter.session import events, resuming
from frida_painter.session.controls import Controls
from frida_painter.session.events import Durable, Event, PauseCause, kind_of
from frida_painter.session.journal import Journal
from frida_painter.session.progress import PaintingProgress
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter_studio.at_page import StopPressed, StopWatch
from frida_painter_studio.picture_choosing import AllowedMakers
from frida_painter_together.commands import (
    END_MAKING,
    FINISH,
    FREE,
    GO_ON,
    LOOK,
    PAUSE,
    ChangeGoal,
    Command,
    GivePicture,
    GoalRequest,
    LeaveOut,
    Propose,
    Protect,
    TakeTurns,
)
from frida_painter_together.conductor import Conductor
from frida_painter_together.inbox import send
from killing import kill_when
from support.boat import BOAT
from support.planning import CANVAS, goal, picture, plain, small_table
from support.session import SessionSetup
from support.virtual_painting import RESTS_ON, STROKES, VirtualPainting

PICTURE, DRAWING = "a" * 32, "b" * 32
Told = TypeVar("Told")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "cup" / GIVEN).mkdir(parents=True)
    return tmp_path / "cup"


class Table:
    """A painting on the stub easel with a person who answers its pauses, one command after another."""

    def __init__(
        self,
        folder: Path,
        strokes: int,
        *,
        pause_after: int = 2,
        journal: Journal | None = None,
        began: float = 0.0,
    ) -> None:
        self.folder = folder
        self.stop = StopWatch(folder / "stop", folder.parent)
        self.controller = Conductor(folder, lambda event: self.setup._hear(event), lambda: self.stop.asked, began)
        self.setup = SessionSetup(
            strokes,
            replans=0,
            pause_at=self._pauses(pause_after),
            go_on=self._go_on,
            journal=journal or Journal(None),
        )
        self.setup.session.interruptions.pause_cause = self._pause_cause
        self.controller.opened = lambda: self.setup.session
        self.says: list[Command] = []
        deadline = threading.Timer(180, (folder / "stop").touch)  # a pause that nobody ends is not waited for
        deadline.daemon = True
        deadline.start()

    def told(self, kind: type[Told]) -> list[Told]:
        results = [event.result for event in self.setup.heard if isinstance(event, events.CommandDone)]
        return [each for each in (*self.setup.heard, *results) if isinstance(each, kind)]

    def _pauses(self, after: int) -> Any:
        def pause_at(event: Event) -> bool:
            self.controller.hear(event)
            return isinstance(event, events.StrokePainted) and event.done == after

        return pause_at

    def _pause_cause(self) -> PauseCause | None:
        return self.controller.pause_cause() or ("person" if self.setup.pausing else None)

    def _go_on(self, paused: events.Paused) -> bool:
        for command in self.says:
            send(self.folder, command)
        while len(self.controller._commands) < len(self.says) and not self.stop.asked:
            time.sleep(0.01)  # a command is good for seconds, and what the first one asks for may take longer
        return self.controller.go_on(paused)


def test_in_a_pause_strokes_are_left_out_and_the_painting_goes_on(folder: Path) -> None:
    table = Table(folder, 8)
    table.says = [LOOK, LeaveOut(3), PAUSE, GO_ON]
    assert table.setup.run().painted == 5
    (paused,) = table.told(events.Paused)
    assert "arm aside" in paused.reason and len(table.told(events.WentOn)) == 1


def test_turns_are_taken(folder: Path) -> None:
    table = Table(folder, 7)
    table.says = [TakeTurns(2), GO_ON]
    assert table.setup.run().painted == 7
    turns = [event for event in table.told(events.Paused) if event.cause == "turn"]
    assert len(turns) >= 2 and "your turn" in turns[0].reason


def test_what_cannot_be_done_is_told_and_nothing_goes_on(folder: Path) -> None:
    table = Table(folder, 4)
    table.setup.planner.size = CANVAS  # type: ignore[attr-defined]
    images.save(torch.zeros(3, 40, 50), folder / GIVEN / f"{DRAWING}.png")
    other = ChangeGoal((GoalRequest(kind="image", picture=PICTURE),))
    table.says = [Protect(DRAWING, only=False), Protect(PICTURE, only=False), other, GO_ON]
    assert table.setup.run().painted == 4
    sentences = [event.sentence for event in table.told(events.Remark)]
    assert "Nothing was drawn" in sentences[0] and len(sentences) == 3


def test_what_was_asked_after_a_pause_is_done_in_that_pause(folder: Path) -> None:
    controller = Table(folder, 4).controller
    for command in (TakeTurns(5), PAUSE, GO_ON):
        send(folder, command)
    while (cause := controller.pause_cause()) is None:
        time.sleep(0.01)
    assert cause == "person"
    assert controller.pause_cause() is None  # there is one pause, and nothing is lost: it goes on
    assert controller.go_on(events.Paused("You asked for a pause.", 3, "person"))


def test_a_region_and_another_goal_reach_the_planner(folder: Path) -> None:
    table = Table(folder, 4, journal=Journal.begin(folder, {}, {}))
    planner = Planner(goal(), *plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.02), seed=1))
    white = torch.ones(3, planner.fine.rows, planner.fine.columns)
    made = planner.plan(white, 4, 1, lambda step: None)
    table.setup.session.planner = planner
    drawn = torch.zeros(3, 60, 80)
    drawn[:, :, :30] = 1
    images.save(drawn, folder / GIVEN / f"{DRAWING}.png")
    images.save(picture(60, 80), folder / GIVEN / f"{PICTURE}.png")
    table.says = [Protect(DRAWING, only=False), NEW_GOAL, GO_ON]
    table.setup.session.run(4, 1, made)
    table.setup.session.journal.close()
    after = table.setup.session.planner
    assert after is not planner and after.region is not None and planner.region is None
    assert after.goal.terms[0].weight == 2
    (told,) = table.told(events.DrawnRegion)
    assert told.drawing is not None and (folder / "regions" / told.drawing).is_file() and told.only is False
    history = Journal.reopen(folder)[1]
    kept_region = resuming.region(folder, history)
    assert kept_region is not None and torch.equal(kept_region.forbidden, after.region.forbidden)
    assert read_goal(folder / history.wishes.goal)["goal"][0]["weight"] == 2
    assert table.told(events.NewGoal)[0].wish["terms"][0]["weight"] == 2
    assert sum(isinstance(event, events.Planned) for event in table.setup.heard) >= 3


def _planned(table: Table) -> Plan:
    """A plan of six strokes by a planner of this table's session."""
    planner = Planner(goal(), *plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.02), seed=1))
    table.setup.session.planner = planner
    return planner.plan(torch.ones(3, planner.fine.rows, planner.fine.columns), 6, 1, lambda step: None)


def _ask(*commands: Command) -> Callable[[Path], None]:
    """Asks for these in a pause of a new painting."""

    def ask(folder: Path) -> None:
        table = Table(folder, 6, journal=Journal.begin(folder, {}, {}))
        table.says = list(commands)
        table.setup.session.run(6, 1, _planned(table))

    return ask


WAVE = "sh -c 'cp $1 $2' sh {here}/wave.png {out} {canvas} {words}"
"""A maker that is quick."""


def order(folder: Path, command: str = WAVE, minutes: float = 1.0) -> Propose:
    """Has the studio allow a maker, and returns the command of a person who asks it."""
    images.save(picture(60, 80), folder / "wave.png")
    allowed = AllowedMakers({"boats": f"command:{command.format_map(Places(here=folder))}"}, minutes)
    allowed.order("add a boat", "boats").keep(folder)
    return Propose("add a boat", "boats")


class Places(dict[str, Any]):
    """Places in a command; those that it does not know stay."""

    def __missing__(self, name: str) -> str:
        return f"{{{name}}}"


def _ask_maker(*commands: Command) -> Callable[[Path], None]:
    return lambda folder: _ask(order(folder), *commands)(folder)


def _proposals(table: Table) -> list[dict[str, Any]]:
    return [one for made in table.told(events.MadePictures)[-1:] for one in made.pictures]


def test_pictures_begin_from_the_canvas_and_nobody_has_to_choose_one(folder: Path) -> None:
    (folder / "boat.py").write_text(BOAT)
    table = Table(folder, 6, journal=Journal.begin(folder, {}, {}))
    command = f"{sys.executable} {{here}}/boat.py {{seed}} {{canvas}} {{out}} {{words}}"
    table.says = [order(folder, command), GO_ON]
    assert table.setup.run().painted == 6
    table.setup.session.journal.close()
    (made,) = table.told(events.MadePictures)
    canvas = images.load(folder / "changes" / "1" / "canvas.png")
    for one in made.pictures:
        boat = images.load(folder / one["file"])
        assert boat.shape == canvas.shape and 0.01 < float(((boat - canvas).abs().mean(0) > 0.1).float().mean()) < 0.2
        assert (folder / LIVE / one["picture"]).is_file()
    assert len({one["seed"] for one in made.pictures}) == 4
    record = json.loads((folder / "changes" / "1" / "making.json").read_text())
    assert record["words"] == "add a boat" and str(folder) not in json.dumps(record["facts"])
    wishes = Journal.reopen(folder)[1].wishes
    assert wishes.goal == "" and wishes.request == {} and wishes.proposed is None, "it has painted on"


FAULTS = {
    "another size": ("sh -c 'cp {here}/square.png $1' sh {out} {canvas} {words}", "does not show the whole canvas"),
    "takes an hour": ("sh -c 'sleep 3600' sh {canvas} {words}", "was not finished after"),
    "no canvas": ("true {words}", "is not given the canvas here"),
}


@pytest.mark.parametrize(("command", "says"), FAULTS.values(), ids=FAULTS)
def test_a_maker_that_fails_is_one_sentence_and_the_painting_keeps_its_goal(
    folder: Path, command: str, says: str
) -> None:
    images.save(torch.rand(3, 30, 30), folder / "square.png")
    table = Table(folder, 4, journal=Journal.begin(folder, {}, {}))
    table.says = [order(folder, command, minutes=0.02 if "sleep" in command else 1.0), GO_ON]
    assert table.setup.run().painted == 4
    (remark,) = (event.sentence for event in table.told(events.Remark))
    assert says in remark and "\n" not in remark
    assert not table.told(events.MadePictures) and not table.told(events.NewGoal)
    assert not list((folder / "changes").glob("*/*"))


def test_the_person_ends_a_making_and_no_other_work(folder: Path) -> None:
    table = Table(folder, 4, journal=Journal.begin(folder, {}, {}))
    table.says = [order(folder, "sleep 3600 {canvas}"), END_MAKING, GO_ON]
    assert table.setup.run().painted == 4
    assert [event.sentence for event in table.told(events.Remark)] == ["You stopped the making of pictures."]
    assert len(table.told(events.WentOn)) == 1


NEW_GOAL = ChangeGoal((GoalRequest(kind="image", picture=PICTURE, weight=2),))
REGION = Protect(DRAWING, only=False)
Asked = tuple[Callable[[Path], None], str, int, Callable[[Table, list[Path]], bool]]
SAID_TO_BE_DONE: dict[str, Asked] = {
    "goal": (_ask(NEW_GOAL), "command_taken", 1, lambda table, seen: _weight(table) == 2),
    "protect, told": (_ask(REGION), "command_done", 1, lambda table, seen: not _touch(table)),
    "free": (_ask(REGION, FREE), "command_taken", 2, lambda table, seen: table.setup.session.planner.region is None),
    "turns": (_ask(TakeTurns(1)), "command_done", 1, lambda table, seen: table.controller._game == events.Turns(1)),
    "picture": (_ask(GivePicture(PICTURE)), "command_taken", 1, lambda table, seen: len(seen) == 1),
    "propose, while it makes": (_ask_maker(), "command_taken", 1, lambda table, seen: len(_proposals(table)) == 4),
    "propose, made": (_ask_maker(), "command_done", 1, lambda table, seen: _waits_for_a_choice(table)),
    "propose, chosen": (_ask_maker(NEW_GOAL), "command_done", 2, lambda table, seen: _weight(table) == 2),
}  # fmt: skip


def _waits_for_a_choice(table: Table) -> bool:
    return not table.told(events.MadePictures) and len(table.told(events.Paused)) == 1


def _weight(table: Table) -> float:
    return table.setup.session.planner.goal.terms[0].weight


def _touch(table: Table) -> bool:
    """True if a stroke after the second one was painted in the region that REGION protects."""
    plan = table.setup.session._progress.plan
    assert plan is not None
    return bool((plan.strokes.path(torch.linspace(0, 1, 9))[2:, :, 0] < 0.35 * CANVAS.width).any())


@pytest.mark.parametrize("asked", SAID_TO_BE_DONE.values(), ids=SAID_TO_BE_DONE)
def test_what_the_page_said_it_does_is_done_although_the_painter_was_killed_at_that_moment(
    folder: Path,
    asked: tuple[Callable[[Path], None], str, int, Callable[[Table, list[Path]], bool]],
) -> None:
    ask, moment, times, is_done = asked
    drawn = torch.zeros(3, 60, 80)
    drawn[:, :, :30] = 1
    images.save(drawn, folder / GIVEN / f"{DRAWING}.png")
    images.save(picture(60, 80), folder / GIVEN / f"{PICTURE}.png")
    count = 0

    def said(record: dict[str, Any]) -> bool:
        return record["kind"] == moment

    def is_said() -> None:
        tell = Journal.tell

        def tell_and_die(journal: Journal, event: Durable) -> None:
            nonlocal count
            tell(journal, event)
            count += kind_of(type(event)) == moment and event != events.CommandTaken({})
            if count == times:
                os.kill(os.getpid(), signal.SIGKILL)

        Journal.tell = tell_and_die  # type: ignore[method-assign]
        ask(folder)

    kill_when(folder / "nowhere", said, is_said)
    journal, history = Journal.reopen(folder)
    kept = resuming.load_kept_plan(folder, history)
    assert kept is not None and history.progress.painted == 2
    journal.record_resume(repaint=False)
    table, seen = Table(folder, 6, pause_after=0, journal=journal, began=time.time()), list[Path]()
    _planned(table)
    planner = table.setup.session.planner
    region = resuming.region(folder, history)
    table.setup.session.planner = planner.keeping_clear(region)
    table.controller.look_at = seen.append
    table.controller.owe(history.wishes.request, history.wishes.proposed)
    table.says = 6 * [GO_ON]
    now = table.setup.session.look()
    table.setup.session.resume(PaintingProgress.resume(kept.plan, 2, kept.planning.done, None, now))
    journal.close()
    done, table.controller.opened = is_done(table, seen), lambda: None  # its thread stays, and would keep the session
    assert done
    assert Journal.reopen(folder)[1].wishes.request == {}, "and it is done once"


def test_a_drawing_that_is_finished_is_finished_by_the_next_painter_too(folder: Path) -> None:
    kill_when(folder / "journal", lambda record: record["kind"] == "command_taken", lambda: _ask(FINISH)(folder))
    history = Journal.reopen(folder)[1]
    controller = Conductor(folder, lambda event: None, lambda: False, time.time() + 1)
    controller.owe(history.wishes.request, history.wishes.proposed)
    assert controller.pause_cause() == "person" and list(controller._commands) == [FINISH]


def test_what_can_only_be_done_in_a_pause_is_refused_aloud(folder: Path) -> None:
    table = Table(folder, 4)
    table.controller._commands.extend((LOOK, GO_ON, NEW_GOAL))
    assert table.controller.pause_cause() is None and len(table.told(events.Remark)) == 2


def test_turns_that_find_no_room_in_the_journal_end_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(event: Event) -> None:
        raise StorageError("The disk is full.")

    table = Table(folder, 4)
    monkeypatch.setattr(table.setup.session.journal, "tell", full)
    table.controller._commands.append(TakeTurns(2))
    assert table.controller.pause_cause() is None and table.controller._game == events.Turns(0)


@pytest.fixture
def stopped(folder: Path) -> Iterator[StopWatch]:
    stop = StopWatch(folder / "stop", folder.parent)
    stop.heed()
    (folder / "stop").touch()
    deadline = time.monotonic() + 20
    while not stop.asked and time.monotonic() < deadline:
        time.sleep(0.005)
    yield stop


def test_stop_ends_a_pause_and_whatever_heeds_it(folder: Path, stopped: StopWatch) -> None:
    with pytest.raises(StopPressed):
        stopped.heed()
    controller = Conductor(folder, lambda event: None, lambda: stopped.asked, 0.0)
    assert controller.go_on(events.Paused("You asked for a pause.", 3, "person")) is False


def test_a_person_s_picture_is_taken_in_the_pause_and_a_refusal_is_told(folder: Path) -> None:
    table, taken = Table(folder, 5), []

    def look_at(path: Path) -> None:
        taken.append(path)
        if len(taken) == 1:
            raise FrameRejected("The picture does not show this canvas.")

    table.controller.look_at = look_at
    table.says = [GivePicture(DRAWING), GivePicture(PICTURE), GO_ON]
    table.setup.run()
    assert taken == [folder / GIVEN / f"{name}.png" for name in (DRAWING, PICTURE)]
    assert [remark.sentence for remark in table.told(events.Remark)] == ["The picture does not show this canvas."]


def test_at_a_real_easel_paint_is_found_and_asked_about(folder: Path) -> None:
    world = VirtualPainting.made(seed=7)
    asked: list[Any] = []

    def answer(question: Any) -> bool:
        asked.append(question)
        return True

    def paint() -> None:
        planned = session.rest.strokes.path(torch.linspace(0, 1, 9)).numpy()
        place = planned[np.argmax(session.rest.strokes.length.numpy())]
        press = np.full(len(place), 0.5)
        studio.easel.operator.paint_stroke(PersonStroke(1, "fine", 0, place, press, 0 * press, 0 * press))  # type: ignore[attr-defined]

    told: list[Event] = []
    controller = Conductor(folder, told.append, lambda: False, 0.0, ask=answer)

    def go_on(paused: events.Paused) -> bool:
        photograph = session.person.await_paint

        def paint_after_it() -> None:  # only photographs show what a real brush paints
            photograph()
            paint()

        session.person.await_paint = paint_after_it  # type: ignore[method-assign]
        send(folder, GO_ON)
        return controller.go_on(paused)

    journal = Journal.begin(folder, {"strokes": STROKES}, RESTS_ON)
    due = iter([True])
    session, studio = world.session(
        folder,
        journal,
        controls=Controls(
            pause_cause=lambda: "person" if session._progress.painted == 4 and next(due, False) else None,
            go_on=go_on,
        ),
        notify=told.append,
    )
    session.hand.easel = replace(session.hand.easel, person_brushes=())
    controller.opened = lambda: session
    assert session.run(STROKES, 3).painted == STROKES
    (shown,) = [event for event in told if isinstance(event, events.ResultFound)]
    assert shown.what == "found" and (folder / LIVE / shown.name).is_file()
    regions = [event for event in told if isinstance(event, events.CommandDone)]
    (remark,) = [event.sentence for event in told if isinstance(event, events.Remark)]
    (question,) = asked
    assert "outlined" in question.text and question.picture.shape[0] == 3 and "still planned" in question.text
    assert len(regions) == 1 and "paints around it" in remark and session.planner.region is not None
    studio.close()


def test_what_was_agreed_on_about_turns_is_known_after_the_painter_was_killed(folder: Path) -> None:
    journal = Journal.begin(folder, {}, {})
    journal.tell(events.CommandDone(events.Turns(7, 0.0, "continue", "protect")))
    journal.close()
    table = Table(folder, 4, journal=Journal.reopen(folder)[0])
    assert table.controller._game == events.Turns(7, 0.0, "continue", "protect")
