import math
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
from pydantic import TypeAdapter, ValidationError

from frida_painter.event_log import FEED, EventLog
from frida_painter_studio import commands
from frida_painter_studio.commands import (
    END_MAKING,
    FINISH,
    FREE,
    GO_ON,
    LEAD_GOOD_FOR,
    LOOK,
    MAX_POINTS,
    PAUSE,
    ChangeGoal,
    Command,
    GivePicture,
    Inbox,
    LeaveOut,
    Message,
    PaintStroke,
    Propose,
    Protect,
    TakeTurns,
    tell_worker,
)
from frida_painter_studio.studio_folder import PaintingFolder, PaintingRequest


def heard(inbox: Inbox) -> list[Command | None]:
    return [each.command for each in inbox.listen()]


def test_each_command_is_heard_once(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path)
    listener = Inbox(folder, 0.0)
    tell_worker(folder, PAUSE, "browser")
    tell_worker(folder, TakeTurns(5), "browser")
    assert heard(listener) == [PAUSE, TakeTurns(5)]
    assert heard(listener) == []
    with EventLog(folder.inbox, FEED) as log:
        for record in log.found:
            log.append(record)
    assert heard(listener) == [], "said again, and known already"
    assert heard(Inbox(folder, 0.0)) == [PAUSE, TakeTurns(5)], "both times at once"


def test_what_was_asked_while_nobody_could_hear_is_not_done_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = PaintingFolder(tmp_path)
    tell_worker(folder, GO_ON, "browser")
    now = commands.time.time()
    monkeypatch.setattr(commands.time, "time", lambda: now + LEAD_GOOD_FOR + 1)
    assert heard(Inbox(folder, 0.0)) == []
    monkeypatch.setattr(commands.time, "time", lambda: now - 3600)
    assert heard(Inbox(folder, 0.0)) == [], "the clock was set back"


def test_what_was_said_to_a_painter_is_not_done_again_by_the_next_one(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path)
    first = Inbox(folder, commands.time.time())
    tell_worker(folder, PAUSE, "browser")
    tell_worker(folder, GO_ON, "browser")
    assert len(first.listen()) == 2
    following = Inbox(folder, commands.time.time())
    assert heard(following) == []
    tell_worker(folder, PAUSE, "browser")
    assert heard(following) == [PAUSE]


POINT = (0.5, 0.5, 1.0, 0.0, 0.0, 0.0)
REQUEST = {"terms": [{"kind": "image", "picture": "a" * 32}, {"kind": "text", "words": "sea"}], "strokes": 7}
EACH: dict[str, tuple[dict[str, Any], Command]] = {
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
    "goal": ({"request": REQUEST}, ChangeGoal(PaintingRequest.model_validate(REQUEST))),
}


@pytest.mark.parametrize("kind", EACH)
def test_a_command_is_the_same_at_the_page_in_the_file_and_at_the_painter(tmp_path: Path, kind: str) -> None:
    more, means = EACH[kind]
    command: Command = TypeAdapter(Command).validate_python({"kind": kind, **more})
    assert command == means
    tell_worker(PaintingFolder(tmp_path), command, "browser")
    assert heard(Inbox(PaintingFolder(tmp_path), 0.0)) == [means]


def test_every_kind_of_command_is_tested() -> None:
    kinds = [get_type_hints(each)["kind"] for each in get_args(get_args(Command)[0])]
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
        {"command": {"kind": "goal", "request": {"terms": []}}},
    ],
)  # fmt: skip
def test_what_is_no_command_is_left_out(tmp_path: Path, changes: dict[str, Any]) -> None:
    folder = PaintingFolder(tmp_path)
    tell_worker(folder, LOOK, "browser")
    (record,) = EventLog.read(folder.inbox, FEED)
    assert Message.model_validate(record).command == LOOK
    folder.inbox.unlink()
    with EventLog(folder.inbox, FEED) as log:
        log.append({**record, **changes})
    assert heard(Inbox(folder, 0.0)) == []


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
        ("scribble", "no points"),
    ],
)
def test_a_stroke_that_cannot_be_painted_is_refused_with_one_sentence(points: Any, sentence: str) -> None:
    with pytest.raises(ValidationError) as refused:
        TypeAdapter(Command).validate_python({"kind": "paint", "brush": "fine", "paint": 0, "points": points})
    (fault,) = refused.value.errors()
    assert fault["type"] == "value_error" and sentence in fault["msg"]
    assert fault["msg"].count("\n") == 0
