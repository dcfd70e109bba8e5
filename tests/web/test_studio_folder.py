import subprocess
import sys
import threading
from pathlib import Path

from frida_painter_studio.studio_folder import PaintingFolder, WorkerLock, working


def test_a_painting_that_nobody_works_on_is_free(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path)
    assert not working(folder)
    lock, other = WorkerLock(folder), WorkerLock(folder)
    assert lock.take() and not other.take() and working(folder)
    lock.release()
    assert other.take()
    other.release()
    assert not working(folder)


def test_somebody_who_only_looks_whether_it_is_free_keeps_nobody_out(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path)
    looking, lock = WorkerLock(folder), WorkerLock(folder)
    assert looking.try_once()
    threading.Timer(0.2, looking.release).start()
    assert lock.take()
    lock.release()


def test_a_lock_that_was_handed_to_a_child_is_the_child_s_until_it_ends(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path)
    lock = WorkerLock(folder)
    assert lock.take()
    child = subprocess.Popen(
        [sys.executable, "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE, pass_fds=[lock.fileno()]
    )
    with child:
        lock.release()
        assert working(folder), "the page lets go, or dies, and the worker goes on"
        child.kill()
    assert not working(folder)
