"""Locks that another process holds for ever: each wait ends with a sentence."""

import errno
import fcntl
import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from frida_painter.errors import FridaError, StorageError
from frida_painter.system import event_log, locks
from frida_painter.system.event_log import FEED, JOURNAL, EventLog
from frida_painter_lab import runs
from frida_painter_lab.runs import RunFolder
from frida_painter_lab.sweeps.sweep_spec import SweepFolder
from frida_painter_studio import network
from frida_painter_studio.network import share_lock
from frida_painter_studio.studio_folder import PaintingFolder, WorkerLock
from test_house import SOURCES, place_of


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Holds the lock of a file as a reader can: on a descriptor that may only read."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(0o644)
    descriptor = os.open(path, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    yield
    os.close(descriptor)


def enter(what: "RunFolder | SweepFolder") -> None:
    with what.lock():
        pass


def begin_feed(folder: Path) -> None:
    EventLog(folder / "feed", FEED)


def begin_journal(folder: Path) -> None:
    EventLog(folder / "journal", JOURNAL)


@pytest.mark.parametrize(
    ("name", "use"),
    [
        ("feed", begin_feed),
        ("journal", begin_journal),
        (".studio", share_lock),
        ("runs/key/.lock", lambda folder: enter(RunFolder(folder, "key"))),
        (".lock", lambda folder: enter(SweepFolder(folder))),
    ],
)
def test_a_lock_that_is_never_given_back_is_a_sentence(
    name: str, use: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, limit in ((event_log, "_PATIENCE"), (network, "_ENDS_WITHIN"), (runs, "_PATIENCE")):
        monkeypatch.setattr(module, limit, 0.03)
    with held(tmp_path / name), pytest.raises(FridaError, match=re.escape(str((tmp_path / name).parent))):
        use(tmp_path)
    if name not in ("journal", ".lock"):
        use(tmp_path)


def test_a_reader_that_locks_a_feed_slows_no_painting_down(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []
    monkeypatch.setattr(locks.time, "monotonic", lambda: sum(waits))
    mine, rest = threading.get_ident(), time.sleep  # other tests may have left threads that sleep
    monkeypatch.setattr(locks.time, "sleep", lambda s: waits.append(s) if threading.get_ident() == mine else rest(s))
    with EventLog(tmp_path / "feed", FEED) as feed:
        with held(tmp_path / "feed"):
            for _ in range(50):
                with pytest.raises(StorageError):
                    feed.append({"event": 1})
        assert 1 < sum(waits) < 3
        feed.append({"event": 2})
    assert EventLog.read(tmp_path / "feed", FEED) == [{"event": 2}]


def test_a_worker_s_lock_is_refused_after_a_moment(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path / "studio" / "1")
    folder.path.mkdir(parents=True)
    lock = WorkerLock(folder)
    with held(next(path for path in folder.path.parent.rglob("1") if path.is_file())):
        assert not lock.try_once(0.03)
    assert lock.take()
    lock.release()


@pytest.mark.parametrize("code", ["ENOLCK", "EOPNOTSUPP", "EINVAL", "ENOSYS", "EIO", "EACCES"])
def test_on_a_drive_without_locks_nothing_is_painted_and_nobody_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str
) -> None:
    def refuse(descriptor: int, operation: int) -> None:
        number = getattr(errno, code)
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", refuse)
    for limit in ("_PATIENCE", "_A_MOMENT"):
        monkeypatch.setattr(event_log, limit, 0.03)
    monkeypatch.setattr(network, "_ENDS_WITHIN", 0.03)
    held = code == "EACCES"  # as some drives say that another process has the lock
    for use in (begin_feed, begin_journal, share_lock, lambda folder: EventLog.begin(folder / "new", {})):
        (tmp_path / "journal").touch()
        with pytest.raises(StorageError, match="another process" if held else "disk of this machine"):
            use(tmp_path)
    assert locks.is_held(tmp_path / "journal") is held


def test_nobody_else_can_open_a_lock_file(tmp_path: Path) -> None:
    (tmp_path / "old").touch(0o666)
    (tmp_path / "link").symlink_to(tmp_path / "old")
    for name in ("old", "new"):
        os.close(locks.open_lock(tmp_path / name))
        assert (tmp_path / name).stat().st_mode & 0o777 == 0o600
    with pytest.raises(OSError, match="symbolic"):
        locks.open_lock(tmp_path / "link")


def test_no_lock_is_taken_in_another_way() -> None:
    """Else there would be a wait without an end."""
    texts = {place_of(path): path.read_text() for path in SOURCES}
    assert {name for name, text in texts.items() if re.search(r"\bfcntl\b|\blockf\b|\block_descriptor\b", text)} == {
        "system/locks.py"
    }
    taken = [call for text in texts.values() if "FileLock" in text for call in re.findall(r"\.acquire\((.*?)\)", text)]
    assert taken and all(re.match(r"timeout=|blocking=False", call) for call in taken), taken
