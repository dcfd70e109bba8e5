"""Programs that make pictures: run without a shell, with limits on time and size, and ended with all they started."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from frida_painter import python_process, storage
from frida_painter.errors import Interrupted, MakingFailed
from frida_painter.storage import megabytes
from frida_painter_words.picture_makers.making import MAX_BYTES

_GLANCE = 0.05  # seconds between two looks at a program
_MAX_SAID = 20 * 2**20  # bytes that a program may say to its standard error
_SAID = "the words of a program"
MORE_TIME = "give it more time with --imagine-minutes, or name a quicker one"
"""Advice if the time is over."""
_TOLD = 200  # characters of a program's last line in messages


def run_program(
    arguments: Sequence[str],
    name: str,
    *,
    printed: Path,
    said: Path,
    made: Path | None,
    until: float,
    stop_asked: Callable[[], bool],
    hear: Callable[[str], None] | None = None,
    environment: Mapping[str, str] | None = None,
) -> None:
    """Runs a program to its end.

    arguments: the program and its arguments; no shell reads them
    name: name of the maker in messages
    printed, said: files for the standard output and the standard error
    made: another file that the program writes, whose size is limited too
    until: time of the monotonic clock at which the program is ended
    hear: receives each whole line of the standard error, while the program runs
    environment: environment of the program; None: that of this process, as the person gave it
    Raises MakingFailed if it cannot be started, fails, or takes too long or too much room, and Interrupted after a
    stop. The program is then ended, with all processes of its group.
    """
    began = time.monotonic()
    if not began < until:
        raise MakingFailed(f"{name} was not asked any more, because the time was over; {MORE_TIME}.")
    with printed.open("wb") as output, said.open("wb") as complaints:
        try:
            process = subprocess.Popen(
                list(arguments), stdin=subprocess.PIPE, stdout=output, stderr=complaints, start_new_session=True,
                env=environment or python_process.environment_of_others(),
            )  # fmt: skip
        except (OSError, ValueError) as cause:
            why = getattr(cause, "strerror", None) or str(cause)
            raise MakingFailed(f"{name} cannot start {arguments[0][:80]!r} ({why}); give one that runs.") from cause
        heard = 0
        try:
            while process.poll() is None:
                if stop_asked():
                    raise Interrupted("You stopped the making of pictures.")
                if not time.monotonic() < until:
                    raise MakingFailed(
                        f"{name} was not finished after {time.monotonic() - began:.0f} s and was ended; {MORE_TIME}."
                    )
                for file, most in ((printed, MAX_BYTES), (said, _MAX_SAID), (made, MAX_BYTES)):
                    if file is not None and _size(file) > most:
                        raise MakingFailed(
                            f"{name} wrote more than {megabytes(most)} and was ended; a picture file is smaller."
                        )
                heard = _pass_on(said, heard, hear)
                time.sleep(_GLANCE)
        finally:
            _end(process)
    _pass_on(said, heard, hear)
    if process.returncode != 0:
        how = (
            f"ended with status {process.returncode}"
            if process.returncode > 0
            else f"was ended by {_signal(-process.returncode)}"
        )
        raise MakingFailed(f"{name} {how} and made no picture{_last_line(said)}; try it by itself, or name another.")


def _end(process: "subprocess.Popen[bytes]") -> None:
    """Ends a program and all processes of its group, and waits for it."""
    with suppress(OSError):
        os.killpg(process.pid, signal.SIGKILL)
    if process.stdin is not None:
        with suppress(OSError):
            process.stdin.close()
    process.wait()


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0


def _pass_on(said: Path, heard: int, hear: Callable[[str], None] | None) -> int:
    """Passes whole new lines on, and returns the number of bytes that were heard so far."""
    if hear is None:
        return heard
    with storage.open_checked(said, _SAID, MAX_BYTES, MakingFailed) as file:
        file.seek(heard)
        whole, end, _ = file.read(_MAX_SAID).rpartition(b"\n")
    for line in whole.decode("utf-8", "replace").splitlines():
        hear(line)
    return heard + len(whole) + len(end)


def _last_line(said: Path) -> str:
    """Returns the last line that a program said, as the end of a sentence; "" if it said nothing."""
    with storage.open_checked(said, _SAID, MAX_BYTES, MakingFailed) as file:
        file.seek(max(0, _size(said) - 4096))
        lines = file.read().decode("utf-8", "replace").split("\n")
    plain = [" ".join("".join(mark if mark.isprintable() else " " for mark in line).split()) for line in lines]
    last = next((line for line in reversed(plain) if line), "")
    return f"; it said: {last[:_TOLD].rstrip('.')}" if last else ""


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
