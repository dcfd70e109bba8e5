"""One robot, one process."""

import errno
import fcntl
import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from frida_painter.easel.open import hold_machines
from frida_painter.errors import RobotBusy, StorageError

HOLD = """
import sys, pathlib, contextlib
from frida_painter.easel.open import hold_machines
with contextlib.ExitStack() as stack:
    hold_machines(stack, pathlib.Path(sys.argv[1]), {"the arm"})
    print("held", flush=True)
    sys.stdin.read()
"""


def try_to_hold(state: Path) -> None:
    with ExitStack() as stack:
        hold_machines(stack, state, ["the arm"])


def test_one_at_a_time_and_who_loses_leaves_the_holder_s_number_alone(tmp_path: Path) -> None:
    with ExitStack() as stack:
        hold_machines(stack, tmp_path, ["the arm", "serial number 7"])
        (lock, _) = sorted((tmp_path / "locks").iterdir(), key=lambda path: path.read_text())
        for _ in range(2):
            with pytest.raises(RobotBusy, match=f"the arm is in use by process {os.getpid()}") as busy:
                try_to_hold(tmp_path)
            assert busy.value.pid == os.getpid() and lock.read_text() == str(os.getpid())
        for each in (tmp_path / "locks").iterdir():
            each.write_text("")  # the number is not there yet
        with pytest.raises(RobotBusy, match="another process") as busy:
            try_to_hold(tmp_path)
        assert busy.value.pid is None
    lock.write_text("a longer text than any number of a process")
    try_to_hold(tmp_path)


def test_a_lock_of_a_dead_process_is_free(tmp_path: Path) -> None:
    """Fault F32: two painters, one robot."""
    other = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        with pytest.raises(RobotBusy) as busy:
            try_to_hold(tmp_path)
        assert busy.value.pid == other.pid
        other.kill()
    (lock,) = (tmp_path / "locks").iterdir()
    assert lock.read_text() == str(other.pid), "its number stays behind, the lock does not"
    try_to_hold(tmp_path)


def test_a_place_without_files_or_a_disk_without_locks_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A marker file in place of a lock would stay when its process dies."""
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError):
        try_to_hold(tmp_path / "file")

    def unknown(file: int, operation: int) -> None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))

    monkeypatch.setattr(fcntl, "flock", unknown)
    with pytest.raises(StorageError, match="cannot be written"):
        try_to_hold(tmp_path)
