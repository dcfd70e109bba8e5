import json
from pathlib import Path
from typing import Any

import pytest

from frida_painter.event_log import FEED, EventLog
from frida_painter.web import commands
from frida_painter.web.commands import LEAD_GOOD_FOR, Command, CommandReader, Pause, TakeTurns, tell_painter
from frida_painter.web.studio_folder import PaintingFolder


def test_each_command_is_heard_once(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path)
    listener = CommandReader(folder, 0.0)
    tell_painter(folder, "pause", "browser")
    tell_painter(folder, "turns", "browser", count=5)
    assert listener.listen() == [Pause(), TakeTurns(5)]
    assert listener.listen() == []
    with EventLog(folder.commands, FEED) as log:
        for record in log.found:
            log.append(record)
    assert listener.listen() == [], "said again, and known already"


def test_what_was_asked_while_nobody_could_hear_is_not_done_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = PaintingFolder(tmp_path)
    tell_painter(folder, "go on", "browser")
    now = commands.time.time()
    monkeypatch.setattr(commands.time, "time", lambda: now + LEAD_GOOD_FOR + 1)
    assert CommandReader(folder, 0.0).listen() == []
    monkeypatch.setattr(commands.time, "time", lambda: now - 3600)
    assert CommandReader(folder, 0.0).listen() == [], "the clock was set back"


def test_what_was_said_to_a_painter_is_not_done_again_by_the_next_one(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path)
    first = CommandReader(folder, commands.time.time())
    tell_painter(folder, "pause", "browser")
    tell_painter(folder, "go on", "browser")
    assert len(first.listen()) == 2
    following = CommandReader(folder, commands.time.time())
    assert following.listen() == []
    tell_painter(folder, "pause", "browser")
    assert following.listen() == [Pause()]


@pytest.mark.parametrize(
    "changes",
    [
        {"kind": "home"}, {"kind": None}, {"nonce": "short"}, {"nonce": 5}, {"until": float("1e999")}, {"until": "1"},
        {"count": -1}, {"count": 1.5}, {"count": True}, {"record": "../x"}, {"speed": 3},
    ],
)  # fmt: skip
def test_what_is_no_command_is_left_out(tmp_path: Path, changes: dict[str, Any]) -> None:
    folder = PaintingFolder(tmp_path)
    tell_painter(folder, "look", "browser")
    (record,) = EventLog.read(folder.commands, FEED)
    assert isinstance(Command.model_validate(record), Command)
    folder.commands.write_text(json.dumps({**record, **changes}) + "\n")
    assert CommandReader(folder, 0.0).listen() == []
