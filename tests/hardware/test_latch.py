import os
from pathlib import Path
from typing import Any

import pytest

from frida_painter import storage
from frida_painter.errors import StorageError
from frida_painter.hardware.latch import Latch, latch_path, latches


def test_it_holds_until_it_is_released_and_keeps_the_first_reason(tmp_path: Path) -> None:
    latch = Latch(latch_path(tmp_path, "virtual studio 0"), "virtual studio 0")
    assert latch.read() is None and latches(tmp_path) == []
    latch.engage("a child ran by")
    latch.engage("the cable broke")
    again = Latch(latch.path, "virtual studio 0").read()
    assert again is not None and again.reason == "a child ran by" and "virtual studio 0 was stopped on" in str(again)
    latch.release()
    assert latch.read() is None
    latch.release()


def test_every_easel_has_its_own(tmp_path: Path) -> None:
    names = ["xarm 10.0.0.3", "virtual studio 1", "ros/left ../arm"]
    for name in names:
        Latch(latch_path(tmp_path, name), name).engage("because")
    assert [stop.easel for latch in latches(tmp_path) if (stop := latch.read())] == names
    assert all(path.parent == tmp_path / "stopped" for path in (latch.path for latch in latches(tmp_path)))


@pytest.mark.parametrize("content", [b"", b"{", b"{}", b"\x00" * 100])
def test_a_damaged_record_still_holds(tmp_path: Path, content: bytes) -> None:
    latch = Latch(latch_path(tmp_path, "arm"), "arm")
    latch.path.parent.mkdir(parents=True)
    latch.path.write_bytes(content)
    stopped = latch.read()
    assert stopped is not None and "damaged" in stopped.reason


def test_a_stop_that_is_still_being_stored_is_neither_read_nor_released(tmp_path: Path) -> None:
    """What is read of it would be damaged, and whoever released it would take the stop away from the disk."""
    path, other = latch_path(tmp_path, "arm"), Latch(latch_path(tmp_path, "other"), "other", {"10.0.0.4"})
    with storage.replacing(path) as temporary:
        temporary.write_text("{")
        assert latches(tmp_path) == [] and other.read() is None
        Latch(tmp_path / "whole.json", "arm").engage("because")
        temporary.write_bytes((tmp_path / "whole.json").read_bytes())
    assert [latch.path for latch in latches(tmp_path)] == [path]


def test_a_stop_that_is_released_while_it_is_read_does_not_hold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    latch, read = Latch(latch_path(tmp_path, "arm"), "arm"), storage.read_json
    latch.engage("because")

    def read_late(*what: Any) -> Any:
        latch.release()
        return read(*what)

    monkeypatch.setattr(storage, "read_json", read_late)
    assert latch.read() is None


def test_a_stop_that_is_stored_while_it_is_looked_for_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    latch = Latch(latch_path(tmp_path, "xarm"), "xarm")
    latch.engage("the first")
    read = storage.read_json

    def read_between(path: Path, what: str) -> Any:
        monkeypatch.setattr(storage, "read_json", read)
        latch.release()
        try:
            return read(path, what)  # is not there
        finally:
            latch.engage("it fell silent")

    monkeypatch.setattr(storage, "read_json", read_between)
    stop = latch.read()
    assert stop is not None and not stop.damaged and stop.reason == "it fell silent"


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


def test_two_machines_at_easels_of_one_name_are_both_held(tmp_path: Path) -> None:
    for address in ("10.0.0.3", "10.0.0.4"):
        Latch(latch_path(tmp_path, "easel"), "easel", {address}).engage(f"{address} failed")
    for address in ("10.0.0.3", "10.0.0.4"):
        held = Latch(latch_path(tmp_path, "other"), "other", {address}).read()
        assert held is not None and held.reason == "10.0.0.3 failed"


def test_a_damaged_record_holds_every_machine(tmp_path: Path) -> None:
    path = latch_path(tmp_path, "arm")
    path.parent.mkdir(parents=True)
    path.write_bytes(b"{")
    stopped = Latch(latch_path(tmp_path, "other"), "other", {"10.0.0.4"}).read()
    assert stopped is not None and stopped.easel == "arm" and "damaged" in stopped.reason
