"""Processes that tests fork, so that nothing is loaded again, and processes that die in a moment that tests choose."""

import contextlib
import gc
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NoReturn
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from frida_painter.errors import FridaError, ImageError, ProcessLost
from frida_painter.system import picture_file, python_process
from frida_painter.system.event_log import EventLog
from frida_painter.system.python_process import OwnProcess


def kill_when(journal: Path, moment: Callable[[dict[str, Any]], bool], work: Callable[[], None]) -> None:
    """Does the work in a process that is killed (SIGKILL) as soon as a record of the journal is the moment.

    The process kills itself, right after the record has been written to the disk: whoever watches from outside
    comes some strokes late where the machine is busy.
    """
    child = os.fork()
    if child == 0:
        try:
            _read_pictures_alone()
            _die_at(journal, moment)
            work()
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(1)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL, "the work ended before the moment came"


def began(stroke: int) -> Callable[[dict[str, Any]], bool]:
    """The moment in which a stroke is begun."""
    return lambda record: record["kind"] == "motion_began" and record.get("stroke") == stroke


def ended(stroke: int) -> Callable[[dict[str, Any]], bool]:
    """The moment in which a stroke is done."""
    return lambda record: record["kind"] == "stroke_painted" and record["done"] == stroke


def _die_at(journal: Path, moment: Callable[[dict[str, Any]], bool]) -> None:
    """Of this process, which is never used again."""
    append = EventLog.append

    def append_and_look(self: EventLog, record: Mapping[str, Any], **how: Any) -> None:
        append(self, record, **how)
        if self.path == journal and any(moment(one) for one in EventLog.read(journal)):
            os.kill(os.getpid(), signal.SIGKILL)

    EventLog.append = append_and_look  # type: ignore[method-assign]


def _read_pictures_alone() -> None:
    """Of a forked process: it would wait for ever for threads of libvips, which stay behind in the other one."""

    def decode(path: Path, *, most_pixels: int = 0, longest: int = picture_file.LONGEST) -> NDArray[np.uint8]:
        try:
            with Image.open(path) as picture:
                upright = ImageOps.exif_transpose(picture).convert("RGB")
        except (OSError, ValueError) as cause:
            raise ImageError(f"{path} is no picture: {cause}") from cause
        upright.thumbnail((longest, longest))
        return np.array(upright)  # one that may be written to

    picture_file.decode = decode  # type: ignore[assignment]


class ForkedProcess:
    """Stands in for `subprocess.Popen` of a Python program: the same, from the moment at which all is imported.

    PyTorch takes two seconds of a processor to load, which a program that tests start hundreds of times need not.
    work: what the process does; its exit status is that of SystemExit
    pass_fds, files: all files but these are closed in it
    """

    def __init__(
        self,
        work: Callable[[], object],
        *,
        pass_fds: Sequence[int] = (),
        files: Sequence[Any] = (),
        stdout: IO[Any] | None = None,
        stderr: IO[Any] | None = None,
        start_new_session: bool = False,
        cwd: Path | None = None,
        env: Mapping[str, str] | None = None,
    ) -> None:
        self.returncode: int | None = None
        sys.stdout.flush()
        sys.stderr.flush()
        self.pid = os.fork()
        if self.pid == 0:
            self._become(
                work, [*pass_fds, *(file.fileno() for file in files)], stdout, stderr, start_new_session, cwd, env
            )

    def poll(self) -> int | None:
        """The exit status, or minus the signal that ended it; None as long as it is there."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """The exit status. Raises TimeoutExpired where it does not end in so many seconds."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while (status := self.poll()) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired("a forked process", timeout or 0.0)
            time.sleep(0.005)
        return status

    def send_signal(self, number: int) -> None:
        """As Popen: nothing happens where it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    @staticmethod
    def _become(
        work: Callable[[], object],
        pass_fds: Sequence[int],
        stdout: IO[Any] | None,
        stderr: IO[Any] | None,
        start_new_session: bool,
        cwd: Path | None,
        env: Mapping[str, str] | None,
    ) -> NoReturn:
        """What a fresh process has: default signals, no files of others, its own folder and environment."""
        status = 1
        try:
            gc.disable()  # what belongs to the tests is never finalised here
            gc.freeze()
            signal.set_wakeup_fd(-1)
            for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGALRM):
                signal.signal(number, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            nothing = os.open(os.devnull, os.O_RDWR)
            for stream, file in ((0, None), (1, stdout), (2, stderr)):
                os.dup2(nothing if file is None else file.fileno(), stream)
            # Loggers that were made before still write to files of the tests: such a number must not become a socket's.
            there = {int(entry.name) for entry in Path("/dev/fd").iterdir()}
            for number in there - {0, 1, 2, nothing, *pass_fds}:
                with contextlib.suppress(OSError):  # that of the listing itself is closed again
                    os.fstat(number)
                    os.dup2(nothing, number, inheritable=False)
            sys.stdin = os.fdopen(0, "r", closefd=False)
            sys.stdout = os.fdopen(1, "w", closefd=False)
            sys.stderr = os.fdopen(2, "w", closefd=False)
            if start_new_session:
                os.setsid()
            if cwd is not None:
                os.chdir(cwd)
            if env is not None:
                os.environ.clear()
                os.environ.update(env)
            _read_pictures_alone()
            work()
            status = 0
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)


class ForkedCommand(ForkedProcess):
    """`frida-painter WORD ...` in a process that is forked; nobody types anything, and what it says is kept."""

    def __init__(self, folder: Path, *words: str, env: Mapping[str, str] | None = None) -> None:
        self._out = tempfile.TemporaryFile("w+")  # noqa: SIM115 (`close` closes both)
        self._err = tempfile.TemporaryFile("w+")  # noqa: SIM115

        def work() -> None:
            from frida_painter_cli import commands

            sys.argv = ["frida-painter", *words]
            commands.main()

        super().__init__(work, stdout=self._out, stderr=self._err, cwd=folder, env={**os.environ, **(env or {})})

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """What it said on standard output and standard error, once it has ended. Raises TimeoutExpired."""
        self.wait(timeout)
        said = []
        for file in (self._out, self._err):
            file.seek(0)
            said.append(file.read())
        return said[0], said[1]

    def close(self) -> None:
        """Ends it in any case."""
        self.kill()
        self.wait()
        self._out.close()
        self._err.close()


def call_here(self: OwnProcess[..., Any], *given: Any, **named: Any) -> Any:
    """Stands in for `OwnProcess.__call__`: the function runs in this process, which has loaded all libraries."""
    try:
        return self.function(*given, **named)
    except FridaError:
        raise
    except Exception as failure:
        raise ProcessLost(f"{type(failure).__name__}: {failure}") from failure


_START = python_process.start


def _start_forked(*words: Any, stdin: Any = None, stdout: Any = None, **options: Any) -> Any:
    """As `python_process.start`; an easel's process is forked from this one."""
    if words[2:3] != ("frida_painter.easel.host:serve_easel",):
        return _START(*words, stdin=stdin or subprocess.DEVNULL, stdout=stdout, **options)
    handed = [file.fileno() for file in options.pop("files", ())]
    return ForkedProcess(lambda: python_process.serve(*words[2:]), pass_fds=handed, **options)


@contextmanager
def forked_easels() -> Iterator[None]:
    """Easels' processes are forked from this one; all else about them stays."""
    with patch("frida_painter.system.python_process.start", _start_forked):
        yield


@contextmanager
def fresh_easels() -> Iterator[None]:
    """Within `forked_easels`: easels' processes are started as people have them."""
    with patch("frida_painter.system.python_process.start", _START):
        yield
