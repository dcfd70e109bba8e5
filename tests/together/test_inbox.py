"""Commands and answers of a person, from the page to the worker."""

import math
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
import torch
from pydantic import TypeAdapter, ValidationError

from frida_painter.easel.dialogue import Answer, Confirm, Jog, JogMove, Measure, PointCorners, Question
from frida_painter.easel.kinds import INBOX
from frida_painter.errors import ConfigError, Interrupted
from frida_painter.session.events import Asked, Event
from frida_painter.system.event_log import FEED, EventLog, LogReader
from frida_painter_studio.at_page import Feed, StopPressed, StopWatch
from frida_painter_studio.studio_folder import PaintingFolder, read_events
from frida_painter_studio.web_studio import Followed
from frida_painter_together import asking, inbox
from frida_painter_together.asking import MAX_ABSENCE, Asker, describe_question
from frida_painter_together.commands import (
    END_MAKING,
    FINISH,
    FREE,
    GO_ON,
    LOOK,
    MAX_POINTS,
    PAUSE,
    ChangeGoal,
    GivePicture,
    GoalRequest,
    LeaveOut,
    PageCommand,
    PaintStroke,
    Propose,
    Protect,
    TakeTurns,
)
from frida_painter_together.inbox import FOLLOWED, LEAD_GOOD_FOR, Inbox, Message, Reply, send


def heard(inbox: Inbox) -> list[PageCommand | None]:
    return [each.command for each in inbox.listen()]


def test_each_command_is_heard_once(tmp_path: Path) -> None:
    folder = tmp_path
    listener = Inbox(folder, 0.0)
    send(folder, PAUSE)
    send(folder, TakeTurns(5))
    assert heard(listener) == [PAUSE, TakeTurns(5)]
    assert heard(listener) == []
    with EventLog(folder / INBOX, FEED) as log:
        for record in log.found:
            log.append(record)
    assert heard(listener) == [], "said again, and known already"
    assert heard(Inbox(folder, 0.0)) == [PAUSE, TakeTurns(5)], "both times at once"


def test_what_was_asked_while_nobody_could_hear_is_not_done_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path
    send(folder, GO_ON)
    now = inbox.time.time()
    monkeypatch.setattr(inbox.time, "time", lambda: now + LEAD_GOOD_FOR + 1)
    assert heard(Inbox(folder, 0.0)) == []
    monkeypatch.setattr(inbox.time, "time", lambda: now - 3600)
    assert heard(Inbox(folder, 0.0)) == [], "the clock was set back"


def test_what_was_said_to_a_painter_is_not_done_again_by_the_next_one(tmp_path: Path) -> None:
    folder = tmp_path
    first = Inbox(folder, inbox.time.time())
    send(folder, PAUSE)
    send(folder, GO_ON)
    assert len(first.listen()) == 2
    following = Inbox(folder, inbox.time.time())
    assert heard(following) == []
    send(folder, PAUSE)
    assert heard(following) == [PAUSE]


POINT = (0.5, 0.5, 1.0, 0.0, 0.0, 0.0)
TERMS = [{"kind": "image", "picture": "a" * 32}, {"kind": "text", "words": "sea"}]
EACH: dict[str, tuple[dict[str, Any], PageCommand]] = {
    "pause": ({}, PAUSE),
    "go on": ({}, GO_ON),
    "finish": ({}, FINISH),
    "look": ({}, LOOK),
    "leave out": ({"count": 3}, LeaveOut(3)),
    "turns": ({"count": 0}, TakeTurns(0)),
    "protect": ({"picture": "b" * 32, "only": True}, Protect("b" * 32, only=True)),
    "picture": ({"picture": "c" * 32}, GivePicture("c" * 32)),
    "free": ({}, FREE),
    "paint": ({"brush": "fine", "paint": 1, "points": [[0.5, 0.5, 1, 0, 0, 0]]}, PaintStroke("fine", 1, (POINT,))),
    "propose": ({"words": "a stormy sea", "maker": "mine"}, Propose("a stormy sea", "mine")),
    "end making": ({}, END_MAKING),
    "goal": ({"terms": TERMS}, ChangeGoal(tuple(GoalRequest.model_validate(each) for each in TERMS))),
}


@pytest.mark.parametrize("kind", EACH)
def test_a_command_is_the_same_at_the_page_in_the_file_and_at_the_painter(tmp_path: Path, kind: str) -> None:
    more, means = EACH[kind]
    command: PageCommand = TypeAdapter(PageCommand).validate_python({"kind": kind, **more})
    assert command == means
    send(tmp_path, command)
    assert heard(Inbox(tmp_path, 0.0)) == [means]


def test_every_kind_of_command_is_tested() -> None:
    kinds = [get_type_hints(each)["kind"] for each in get_args(get_args(PageCommand)[0])]
    assert {name for kind in kinds for name in get_args(kind)} == set(EACH)


@pytest.mark.parametrize(
    "changes",
    [
        {"command": {"kind": "home"}}, {"command": {"kind": None}}, {"command": None}, {"command": {"count": 3}},
        {"nonce": "short"}, {"nonce": 5}, {"until": 1e300}, {"until": "1"}, {"by": 3}, {"speed": 3},
        *({"command": {"kind": "turns", "count": count}} for count in (-1, 1.5, True, "3", None, 20_001)),
        {"command": {"kind": "turns"}}, {"command": {"kind": "pause", "count": 3}},
        {"command": {"kind": "protect", "picture": "../x", "only": True}},
        {"command": {"kind": "protect", "picture": "a" * 32, "only": 1}},
        {"command": {"kind": "goal", "terms": []}},
        {"command": {"kind": "choose", "file": "changes/1/canvas.png"}},
    ],
)  # fmt: skip
def test_what_is_no_command_is_left_out(tmp_path: Path, changes: dict[str, Any]) -> None:
    folder = tmp_path
    send(folder, LOOK)
    (record,) = EventLog.read(folder / INBOX, FEED)
    assert Message.model_validate(record).command == LOOK
    (folder / INBOX).unlink()
    with EventLog(folder / INBOX, FEED) as log:
        log.append({**record, **changes})
    assert heard(Inbox(folder, 0.0)) == []


FLOODS: dict[str, Callable[[bytes], bytes]] = {
    "half a command": lambda line: line[: len(line) // 2],
    "a line without an end": lambda line: b"0" * 5000,
    "a line that is too long": lambda line: b"0" * 5000 + b"\n",
    "lines that are none": lambda line: b"\n" * 5000,
    "the same again and again": lambda line: 40 * line,
    "a foreign kind": lambda line: line.replace(b"look", b"home"),
}


@pytest.mark.parametrize("flood", FLOODS.values(), ids=FLOODS)
def test_an_inbox_that_holds_anything_is_read_in_bounded_parts_and_the_next_command_is_heard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flood: Callable[[bytes], bytes]
) -> None:
    monkeypatch.setattr(inbox, "_MAX_READ", 1000)
    listener = Inbox(tmp_path, 0.0)
    send(tmp_path, LOOK)
    assert heard(listener) == [LOOK]
    content = (tmp_path / INBOX).read_bytes()
    (tmp_path / INBOX).write_bytes(content + flood(content))
    assert [command for _ in range(10) for command in heard(listener)] == []
    send(tmp_path, PAUSE)
    send(tmp_path, GO_ON)
    assert [command for _ in range(60) for command in heard(listener)] == [PAUSE, GO_ON]


@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        ([], "0 points, and a stroke has 1 to"),
        ([list(POINT)] * (MAX_POINTS + 1), f"{MAX_POINTS + 1} points"),
        ([[0.5, 0.5, math.nan, 0, 0, 0]], "Point 1 of the stroke has a press of nan"),
        ([list(POINT), [0.5, 0.5, 1.5, 0, 0, 0]], "Point 2 of the stroke has a press of 1.5"),
        ([[0.5, math.inf, 1, 0, 0, 0]], "place from the top of inf"),
        ([[0.5, 0.5, 1, 2, 0, 0]], "tilt of 2"),
        ([[0.5, 0.5, 1, 0, 0]], "not made of 6 numbers"),
        ([[0.5, 0.5, True, 0, 0, 0]], "not made of 6 numbers"),
        ("scribble", "0 points"),
    ],
)
def test_a_stroke_that_cannot_be_painted_is_refused_with_one_sentence(points: Any, sentence: str) -> None:
    with pytest.raises(ValidationError) as refused:
        TypeAdapter(PageCommand).validate_python({"kind": "paint", "brush": "fine", "paint": 0, "points": points})
    (fault,) = refused.value.errors()
    assert fault["type"] == "value_error" and sentence in fault["msg"]
    assert fault["msg"].count("\n") == 0


PICTURE = torch.zeros(3, 20, 30)
CORNERS = ((1.25, 1.0), (25.0, 1.0), (25.0, 15.0), (1.0, 15.0))
QUESTIONS: list[tuple[Question, dict[str, Any], Answer]] = [
    (Confirm("Is it so?", PICTURE), {"yes": False}, False),
    (PointCorners("Where?", PICTURE, CORNERS), {"corners": [list(each) for each in CORNERS]}, CORNERS),
    (Jog("Up?", 0.1, 0.0, 0.2, proposal=None), {"step": 0.005}, JogMove(0.005)),
    (Jog("Up?", 0.1, 0.0, 0.2, proposal=None), {"settled": True}, JogMove(settled=True)),
    (Measure("How long?", 0.0, 0.5), {"length": 0.25}, 0.25),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path


def asker(folder: Path, **more: Any) -> Asker:
    """Who asks in a job of this folder."""
    return Asker(folder, Feed(folder).tell, StopWatch(folder / "stop", folder.parent).heed, **more)


def told(folder: Path) -> list[Event]:
    """The events in the feed of this folder."""
    return [event for event, _ in read_events(LogReader(PaintingFolder(folder).feed))]


def asked(folder: Path) -> dict[str, Any]:
    """The question that stands in the feed, once it does."""
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        for event in told(folder):
            if isinstance(event, Asked):
                return event.question
        time.sleep(0.01)
    raise AssertionError("nothing is asked")


@pytest.mark.parametrize(("question", "says", "means"), QUESTIONS)
def test_a_question_waits_for_its_answer_and_no_other(
    folder: Path, question: Question, says: dict[str, Any], means: Answer
) -> None:
    asks, found = asker(folder), list[Answer]()
    waiting = threading.Thread(target=lambda: found.append(asks.answer(question)), daemon=True)
    waiting.start()
    shown = asked(folder)
    assert ("picture" in shown) == (getattr(question, "picture", None) is not None)
    send(folder, Reply.model_validate({"question": "0" * 16, **says}))
    send(folder, Reply.model_validate({"question": shown["id"]}))
    waiting.join(0.2)
    assert waiting.is_alive(), "these were answers to something else, or none"
    send(folder, Reply.model_validate({"question": shown["id"], **says}))
    waiting.join(20)
    assert found == [means]
    assert told(folder)[-1] == Asked(None)


def test_an_answer_that_comes_too_late_is_none(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    send(folder, Reply(question="0" * 16, yes=True))
    assert len(Inbox(folder, 0.0).listen()) == 1
    now = time.time()
    monkeypatch.setattr(inbox.time, "time", lambda: now + LEAD_GOOD_FOR + 1)
    assert Inbox(folder, 0.0).listen() == []


def test_stop_ends_a_question(folder: Path) -> None:
    asks, caught = asker(folder), list[BaseException]()

    def wait() -> None:
        try:
            asks.answer(Confirm("Is it so?"))
        except StopPressed as stop:
            caught.append(stop)

    waiting = threading.Thread(target=wait, daemon=True)
    waiting.start()
    asked(folder)
    (folder / "stop").touch()
    waiting.join(20)
    assert len(caught) == 1


class FollowedClock:
    """Time that passes while a question waits; a page follows it until `until`."""

    def __init__(self, path: Path, until: float) -> None:
        self.now, self.until, self.sign = 0.0, until, Followed(path)

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += 20.0
        if self.now <= self.until:
            self.sign._renewed = -1e9
            self.sign.renew()


@pytest.mark.parametrize("followed", [0.0, 2000.0])
def test_a_dialogue_that_no_page_follows_is_left_so_that_the_machine_is_free(
    folder: Path, monkeypatch: pytest.MonkeyPatch, followed: float
) -> None:
    clock = FollowedClock(folder / FOLLOWED, followed)
    monkeypatch.setattr(asking, "time", clock)
    asks = asker(folder, may_leave=True)
    with pytest.raises(Interrupted, match=r"No page was open for 10 minutes; what was done before is kept"):
        asks.answer(Confirm("Is it so?"))
    assert followed + MAX_ABSENCE <= clock.now <= followed + MAX_ABSENCE + 60
    assert told(folder)[-1] == Asked(None), "nothing is asked any more"


def test_a_question_of_a_painting_waits_for_days(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = FollowedClock(folder / FOLLOWED, 0.0)
    monkeypatch.setattr(asking, "time", clock)
    monkeypatch.setattr(clock, "sleep", lambda seconds: (folder / "stop").touch() if clock.now > 1e5 else advance())

    def advance() -> None:
        clock.now += 1e4

    with pytest.raises(StopPressed):
        asker(folder).answer(Confirm("Are the wells filled?"))


@pytest.mark.parametrize(
    ("question", "says", "complaint"),
    [
        (Confirm("?"), {"length": 0.1}, "no answer"),
        (Jog("?", 0.1, 0.09, 0.11), {"step": 0.05}, "cannot go further"),
        (Measure("?", 0.0, 0.5), {"length": 0.6}, "0.0 to 500.0 mm"),
        (PointCorners("?", PICTURE, None), {"corners": [[0, 0], [31, 0], [9, 9], [0, 9]]}, "outside the photograph"),
    ],
)
def test_what_is_no_answer_is_refused(question: Question, says: dict[str, Any], complaint: str) -> None:
    shown = {**describe_question(question), "rows": 20, "columns": 30}
    with pytest.raises(ConfigError, match=complaint):
        Reply.model_validate({"question": "0" * 16, **says}).answering(shown["kind"], shown)
