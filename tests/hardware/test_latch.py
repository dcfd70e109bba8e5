import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from frida_painter.errors import StorageError
from frida_painter.hardware.latch import SHARED, Latch, latch_of, latch_path, latches, shared_folder, why_private
from frida_painter.system import storage


def test_it_holds_until_it_is_released_and_keeps_the_first_reason(tmp_path: Path) -> None:
    latch = Latch(latch_path(tmp_path, "virtual studio 0"), "virtual studio 0")
    assert latch.read() is None and latches(tmp_path) == []
    latch.engage("a child ran by")
    latch.engage("the cable broke")
    again = Latch(latch.path, "virtual studio 0").read()
    assert again is not None and again.reason == "a child ran by" and "virtual studio 0 was stopped on" in str(again)
    for name in ("xarm 10.0.0.3", "ros/left ../arm"):
        Latch(latch_path(tmp_path, name), name).engage("because")
    found = [stop.easel for latch in latches(tmp_path) if (stop := latch.read())]
    assert found == ["virtual studio 0", "xarm 10.0.0.3", "ros/left ../arm"]
    assert all(latch.path.parent == tmp_path / "stopped" for latch in latches(tmp_path))
    latch.release()
    assert latch.read() is None
    latch.release()


def record(**values: object) -> bytes:
    """A record with a right checksum, whatever it says."""
    body = {"easel": "arm", "reason": "because", "at": 1.7e9, "machines": ["10.0.0.3"], **values}
    return json.dumps({**body, "sha256": storage._checksum(body)}).encode()


def nested(depth: int) -> object:
    value: object = 1
    for _ in range(depth):
        value = [value]
    return value


DAMAGED = {
    "empty": b"",
    "cut off": b"{",
    "no record": b"{}",
    "zeros": b"\x00" * 100,
    "a list": b"[]",
    "very deep": b"[" * 100_000,
    "deep": record(machines=nested(480)),
    "not a number": b'{"at": NaN}',
    "a time beyond all calendars": record(at=1e300),
    "a whole number beyond all": record(at=10**30),
    "a time in words": record(at="yesterday"),
    "no time": record(at=None),
    "machines that are no list": record(machines="10.0.0.3"),
    "a number as machines": record(machines=3),
}
WRITES = record(reason="\x1b[2J\nNo robot is stopped.")  # of another user, to the terminal


@pytest.mark.parametrize("content", DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_record_holds_every_robot_until_it_is_armed(tmp_path: Path, content: bytes) -> None:
    latch = Latch(latch_path(tmp_path, "arm"), "arm")
    latch.path.parent.mkdir(parents=True)
    latch.path.write_bytes(content)
    stopped = latch.read()
    assert stopped is not None and stopped.damaged and str(stopped)
    assert Latch(latch_path(tmp_path, "other"), "other", {"10.0.0.4"}).read() is not None
    (found,) = latches(tmp_path)
    found.release()
    assert latch.read() is None and latches(tmp_path) == []
    latch.path.write_bytes(WRITES)
    assert str(latch.read()).isprintable()


def test_what_is_no_file_holds_too_and_is_set_aside_not_deleted(tmp_path: Path) -> None:
    folder, link = latch_path(tmp_path, "folder"), latch_path(tmp_path, "link")
    folder.mkdir(parents=True)
    (folder / "letter").write_text("of a person")
    link.symlink_to(tmp_path / "nowhere")
    assert Latch(latch_path(tmp_path, "other"), "other", {"10.0.0.4"}).read() is not None
    for found in latches(tmp_path):
        found.release()
    assert latches(tmp_path) == []
    (kept,) = folder.parent.glob("*/letter")
    assert kept.read_text() == "of a person"


def test_a_stop_that_is_still_being_stored_is_neither_read_nor_released(tmp_path: Path) -> None:
    """What is read of it would be damaged, and whoever released it would take the stop away from the disk."""
    path, other = latch_path(tmp_path, "arm"), Latch(latch_path(tmp_path, "other"), "other", {"10.0.0.4"})
    with storage.replacing(path) as temporary:
        temporary.write_text("{")
        assert latches(tmp_path) == [] and other.read() is None
        Latch(tmp_path / "whole.json", "arm").engage("because")
        temporary.write_bytes((tmp_path / "whole.json").read_bytes())
    assert [latch.path for latch in latches(tmp_path)] == [path]


@pytest.mark.parametrize("again", [False, True])
def test_a_stop_that_changes_while_it_is_read_counts_as_it_is_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, again: bool
) -> None:
    """It is released in that moment, and perhaps another one is stored."""
    latch, read = Latch(latch_path(tmp_path, "arm"), "arm"), storage.read_json
    latch.engage("the first")

    def read_between(path: Path, what: str) -> Any:
        monkeypatch.setattr(storage, "read_json", read)
        latch.release()
        try:
            return read(path, what)  # is not there
        finally:
            if again:
                latch.engage("it fell silent")

    monkeypatch.setattr(storage, "read_json", read_between)
    stop = latch.read()
    assert (stop is not None) == again
    assert stop is None or (not stop.damaged and stop.reason == "it fell silent")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_disk_that_cannot_be_written_is_told_of(tmp_path: Path) -> None:
    (tmp_path / "stopped").mkdir(mode=0o500)
    with pytest.raises(StorageError):
        Latch(latch_path(tmp_path, "arm"), "arm").engage("because")


def test_it_holds_the_machine_under_every_name_of_easel_and_robot(tmp_path: Path) -> None:
    """B1: a stop belongs to the machine, not to a name in a file."""
    Latch(latch_path(tmp_path, "left"), "left", {"10.0.0.3", "serial number 7"}).engage("a child ran by")
    renamed = Latch(latch_path(tmp_path, "second name"), "second name", {"10.0.0.4", "serial number 7"})
    stopped = renamed.read()
    assert stopped is not None and stopped.easel == "left" and stopped.reason == "a child ran by"
    other = Latch(latch_path(tmp_path, "second name"), "second name", {"10.0.0.4"})
    assert other.read() is None
    assert Latch(latch_path(tmp_path, "left"), "left", {"10.0.0.4"}).read(), "and under the easel's name as before"
    latches(tmp_path)[0].release()
    assert renamed.read() is None
    for address in ("10.0.0.3", "10.0.0.4"):  # two machines at easels of one name
        Latch(latch_path(tmp_path, "easel"), "easel", {address}).engage(f"{address} failed")
    for address in ("10.0.0.3", "10.0.0.4"):
        held = Latch(latch_path(tmp_path, "other"), "other", {address}).read()
        assert held is not None and held.reason == "10.0.0.3 failed"


# The folder of the computer.

NOBODY, SOMEBODY = 65534, 12345
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")


@pytest.fixture
def shared(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of the computer, which every user can reach."""
    with tempfile.TemporaryDirectory() as place:
        Path(place).chmod(0o755)
        monkeypatch.setenv(SHARED, f"{place}/of all/stopped")
        yield Path(place, "of all", "stopped")


@contextmanager
def user(number: int) -> Iterator[None]:
    """Acts as another user of the computer."""
    os.seteuid(number)
    try:
        yield
    finally:
        os.seteuid(0)


def test_a_stop_holds_for_every_home_of_the_computer(tmp_path: Path, shared: Path) -> None:
    latch_of(tmp_path / "one", "arm", {"10.0.0.3"}).engage("a child ran by")
    assert list(shared.glob("*.json")) and not (tmp_path / "one").exists()
    held = latch_of(tmp_path / "two", "another name", {"10.0.0.3"})
    stopped = held.read()
    assert stopped is not None and stopped.reason == "a child ran by"
    assert latch_of(tmp_path / "two", "another name", {"10.0.0.4"}).read() is None
    (found,) = latches(tmp_path / "two")
    found.release()
    assert held.read() is None


def test_stops_of_before_in_a_users_own_folder_still_count_and_are_armed(tmp_path: Path, shared: Path) -> None:
    Latch(latch_path(tmp_path, "left"), "left", {"10.0.0.3"}).engage("from an older version")
    latch_of(tmp_path, "right", {"10.0.0.4"}).engage("of today")
    assert latch_of(tmp_path, "other", {"10.0.0.3"}).read() is not None
    for latch in latches(tmp_path):
        latch.release()
    assert latches(tmp_path) == [] and latch_of(tmp_path, "other", {"10.0.0.3"}).read() is None


def test_without_a_folder_of_the_computer_stops_are_the_users_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    for told in (str(tmp_path / "file" / "stopped"), ""):
        monkeypatch.setenv(SHARED, told)
        latch_of(tmp_path / told[-1:], "arm", {"10.0.0.3"}).engage("because")
        assert latch_path(tmp_path / told[-1:], "arm").exists()
    monkeypatch.setenv(SHARED, str(tmp_path / "file" / "stopped"))
    folder = shared_folder()
    assert folder is not None and why_private(folder)
    anybodys = tmp_path / "anybody may delete here"
    anybodys.mkdir()
    anybodys.chmod(0o777)
    monkeypatch.setenv(SHARED, str(anybodys))
    assert why_private(anybodys)
    latch_of(tmp_path / "mine", "arm", {"10.0.0.3"}).engage("because")
    assert latch_path(tmp_path / "mine", "arm").exists() and not list(anybodys.iterdir())


@as_root
def test_the_stop_of_one_user_holds_another_who_cannot_take_it_away(tmp_path: Path, shared: Path) -> None:
    latch_of(tmp_path, "arm", {"10.0.0.1"}).engage("the folder is made by root")
    home = shared.parents[1] / "home"
    with user(NOBODY):
        latch_of(home, "arm", {"10.0.0.3"}).engage("a child ran by")
    with user(SOMEBODY):
        for machine in ("10.0.0.1", "10.0.0.3"):
            assert latch_of(home, "other", {machine}).read() is not None
        for latch in latches(home):
            with pytest.raises(StorageError):
                latch.release()
        (shared / "left.0.json").touch()  # in the place of a stop of root's, to be taken away later
    latch_of(tmp_path, "left", {"10.0.0.9"}).engage("because")
    with user(SOMEBODY):
        (shared / "left.0.json").unlink()
    assert latch_of(tmp_path, "other", {"10.0.0.9"}).read() is not None


@as_root
def test_what_another_user_hides_counts_as_a_stop(tmp_path: Path, shared: Path) -> None:
    latch_of(tmp_path / "root", "arm", {"10.0.0.1"}).engage("because")
    (hidden,) = shared.glob("*.json")
    for place in (hidden, shared):
        place.chmod(0o700)
        with user(SOMEBODY):
            stopped = latch_of(shared.parents[1] / "home", "other", {"10.0.0.4"}).read()
        assert stopped is not None and stopped.damaged
        place.chmod(0o755)
