import errno
import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

from frida_painter.easel.lock import RobotLock
from frida_painter.errors import RobotBusy, StorageError

HOLD = """
import sys, pathlib
from frida_painter.easel.lock import RobotLock
lock = RobotLock(pathlib.Path(sys.argv[1]), "the arm")
print("held", flush=True)
sys.stdin.read()
"""


def test_one_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "new" / "robot.lock"
    first = RobotLock(path, "the arm")
    with pytest.raises(RobotBusy, match=f"the arm is in use by process {os.getpid()}") as busy:
        RobotLock(path, "the arm")
    assert busy.value.pid == os.getpid()
    first.release()
    RobotLock(path, "the arm").release()


def test_a_lock_of_a_dead_process_is_free(tmp_path: Path) -> None:
    """Fault F32: two painters, one robot."""
    path = tmp_path / "robot.lock"
    other = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        with pytest.raises(RobotBusy) as busy:
            RobotLock(path, "the arm")
        assert busy.value.pid == other.pid
        other.kill()
    assert path.read_text() == str(other.pid), "its number stays behind, the lock does not"
    RobotLock(path, "the arm").release()


def test_a_lock_whose_number_is_not_there_yet_holds_as_well(tmp_path: Path) -> None:
    path = tmp_path / "robot.lock"
    held = RobotLock(path, "the arm")
    path.write_text("")
    with pytest.raises(RobotBusy, match="another process") as busy:
        RobotLock(path, "the arm")
    assert busy.value.pid is None
    held.release()


def test_a_place_where_no_file_can_be_is_a_storage_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError):
        RobotLock(tmp_path / "file" / "robot.lock", "the arm")


def test_a_disk_that_knows_no_locks_is_refused_rather_than_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A marker file in place of a lock would stay when its process dies."""

    def unknown(file: int, operation: int) -> None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))

    monkeypatch.setattr(fcntl, "flock", unknown)
    with pytest.raises(StorageError, match="cannot be written"):
        RobotLock(tmp_path / "robot.lock", "the arm")


def test_who_loses_leaves_the_holder_s_number_alone(tmp_path: Path) -> None:
    path = tmp_path / "robot.lock"
    path.write_text("a longer text than any number of a process")
    held = RobotLock(path, "the arm")
    for _ in range(2):
        with pytest.raises(RobotBusy):
            RobotLock(path, "the arm")
    assert path.read_text() == str(os.getpid())
    held.release()
