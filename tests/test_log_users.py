"""Every file that is kept as a log, torn at every byte, and with a byte changed."""

import multiprocessing
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from frida_painter.errors import StorageError
from frida_painter.system.event_log import FEED, JOURNAL, EventLog, LogPolicy, LogReader
from frida_painter.virtual import simulation_log
from frida_painter.virtual.simulation_log import SimulationLog
from frida_painter_together.commands import TakeTurns
from frida_painter_together.inbox import Reply, send

Record = dict[str, Any]
BEGUN = {"kind": "painting_begun"}
STUDIO = {"seed": 4}
COUNT = 5


def add_entries(folder: Path, count: int) -> None:
    log = SimulationLog(folder / "log", STUDIO)
    for number in range(count):
        log.note({"did": "move", "number": number}, flush=number % 2 == 0)


def add_records(folder: Path, count: int) -> None:
    log = EventLog(folder / "log") if (folder / "log").exists() else EventLog.begin(folder / "log", BEGUN)
    for number in range(count):
        log.append({"kind": "motion_began", "number": number})
    log.close()


def add_lines(folder: Path, count: int) -> None:
    for number in range(count):  # each by a writer of its own, as the page adds them
        EventLog(folder / "log", FEED).append({"kind": "remark", "number": number})


def add_messages(folder: Path, count: int) -> None:
    for number in range(count):
        given = Reply(question="0" * 16, length=number / 10)
        send(folder, given if number % 2 else TakeTurns(number))
    (folder / "log").unlink(missing_ok=True)
    (folder / "log").symlink_to(folder / "inbox.jsonl")


@dataclass(frozen=True)
class User:
    add: Callable[[Path, int], None]
    policy: LogPolicy
    first: int = 0  # records that are there before the first one is added


USERS = {
    "journal": User(add_records, JOURNAL, 1),
    "studio": User(add_entries, simulation_log._POLICY, 1),
    "feed": User(add_lines, FEED),
    "inbox": User(add_messages, FEED),
}


@pytest.fixture(params=USERS)
def user(request: pytest.FixtureRequest) -> User:
    return USERS[request.param]


def ends(content: bytes) -> list[int]:
    return [number for number, byte in enumerate(content, 1) if byte == ord("\n")]


def test_torn_at_every_byte_all_that_was_whole_is_there_and_it_goes_on(tmp_path: Path, user: User) -> None:
    user.add(tmp_path, COUNT)
    path = (tmp_path / "log").resolve()
    content, records = path.read_bytes(), EventLog.read(path, user.policy)
    assert len(records) == user.first + COUNT
    for length in range(ends(content)[0], len(content)):
        path.write_bytes(content[:length])
        whole = sum(end <= length for end in ends(content))
        assert EventLog.read(path, user.policy) == records[:whole]
        user.add(tmp_path, 1)
        after = EventLog.read(path, user.policy)
        assert after[:whole] == records[:whole] and len(after) == whole + 1


def test_a_changed_byte_is_never_taken_for_what_was_written(tmp_path: Path, user: User) -> None:
    user.add(tmp_path, COUNT)
    path = (tmp_path / "log").resolve()
    content, records = path.read_bytes(), EventLog.read(path, user.policy)
    for place in range(0, len(content), 3):
        changed = bytearray(content)
        changed[place] ^= 0x11
        path.write_bytes(changed)
        try:
            left = EventLog.read(path, user.policy)
        except StorageError:
            assert not user.policy.forgiving
        else:
            assert all(record in records for record in left) and len(left) < len(records)
            assert len(left) >= len(records) - 3 if user.policy.forgiving else left == records[:-1]


def _add_for_ever(add: Callable[[Path, int], None], folder: Path) -> None:
    while True:
        add(folder, 20)


def test_killed_while_it_writes_what_was_read_before_stays_and_it_goes_on(tmp_path: Path, user: User) -> None:
    context = multiprocessing.get_context("fork")
    for _ in range(3):
        before = EventLog.read(tmp_path / "log", user.policy) if (tmp_path / "log").exists() else []
        writer = context.Process(target=_add_for_ever, args=(user.add, tmp_path))
        writer.start()
        while not (tmp_path / "log").exists() or len(EventLog.read(tmp_path / "log", user.policy)) < len(before) + 10:
            pass
        assert writer.pid is not None
        os.kill(writer.pid, signal.SIGKILL)
        writer.join()
        left = EventLog.read(tmp_path / "log", user.policy)
        assert left[: len(before)] == before and len(left) >= len(before) + 10


def test_several_writers_take_turns_and_a_reader_hears_each_record_once(tmp_path: Path) -> None:
    reader, heard = LogReader(tmp_path / "feed"), list[Record]()
    assert reader.read() == []
    logs = [EventLog(tmp_path / "feed", FEED) for _ in range(3)]
    for number in range(12):
        logs[number % 3].append({"number": number})
        heard += reader.read()
    assert [record["number"] for record in heard] == list(range(12))


def test_half_a_record_is_waited_for_and_what_a_killed_process_left_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "feed"
    reader, log = LogReader(path), EventLog(tmp_path / "feed", FEED)
    log.append({"a": 1})
    with path.open("ab") as file:
        file.write(b"0123456789abcdef 12 {")
    assert reader.read() == [{"a": 1}] and reader.read() == []
    log.append({"b": "ü\n"})
    assert reader.read() == [{"b": "ü\n"}]


@pytest.mark.parametrize("damaged", [b"nonsense", b"[1]", b'"text"', b"\xff\xfe", b"{" * 100_000, b""])
def test_damaged_lines_of_a_feed_are_left_out(tmp_path: Path, damaged: bytes) -> None:
    EventLog(tmp_path / "feed", FEED).append({"a": 1})
    whole = (tmp_path / "feed").read_bytes()
    (tmp_path / "feed").write_bytes(whole + damaged + b"\n")
    assert LogReader(tmp_path / "feed").read() == [{"a": 1}]
    log = EventLog(tmp_path / "feed", FEED)
    log.append({"b": 2})
    assert LogReader(tmp_path / "feed").read() == [{"a": 1}, {"b": 2}]


def test_a_folder_that_is_gone_is_told(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="make room"):
        EventLog(tmp_path / "nowhere" / "feed", FEED)
