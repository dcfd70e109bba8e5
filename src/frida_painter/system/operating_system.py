"""Differences between Windows and other systems: one function for each, used everywhere.

Nothing here loads more than the standard library, so that `why_unfit` can speak before anything heavy is imported.
"""

import os
import platform
import signal
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import IO, TYPE_CHECKING, Any

IS_WINDOWS = sys.platform == "win32"
_msvcrt: Any = import_module("msvcrt") if IS_WINDOWS else None
if not IS_WINDOWS:
    import resource
    import select
    import termios

if TYPE_CHECKING:
    import subprocess

_GLANCE = 0.02  # seconds


def why_unfit(system: str = sys.platform, machine: str = platform.machine(), largest: int = sys.maxsize) -> str:
    """Returns why this Python cannot run the painter and what to do, as a sentence; "" if it can.

    largest: greatest length of a list, by which a 32-bit Python is known
    """
    if largest < 2**32:
        return "This is a 32-bit Python, for which there is no PyTorch; install a 64-bit system and a 64-bit Python."
    if system == "darwin" and machine == "x86_64":
        return (
            "There is no PyTorch for Macs with an Intel processor; use another computer. If this Mac has an Apple "
            "processor, its Python was made for Intel: install one for arm64."
        )
    if system == "win32" and machine.lower() == "arm64":
        return "There is no numba for Windows on ARM; install the Python for x64, which Windows translates."
    return ""


# Files.

NOT_LINKS = getattr(os, "O_NOFOLLOW", 0)
_OF_BYTES = sum(getattr(os, name, 0) for name in ("O_CLOEXEC", "O_NONBLOCK", "O_BINARY", "O_NOINHERIT"))


def open_file(path: Path, flags: int, mode: int = 0o644) -> int:
    """Returns the descriptor of a file of bytes. It is not inherited, and a pipe does not block. Raises OSError."""
    return os.open(path, flags | _OF_BYTES, mode)


def read_at(descriptor: int, count: int, offset: int) -> bytes:
    """Returns at most `count` bytes of a file. Raises OSError."""
    if hasattr(os, "pread"):
        return os.pread(descriptor, count, offset)
    os.lseek(descriptor, offset, os.SEEK_SET)
    return os.read(descriptor, count)


def write_at(descriptor: int, content: bytes, offset: int) -> int:
    """Writes bytes into a file, and returns how many. Raises OSError."""
    if hasattr(os, "pwrite"):
        return os.pwrite(descriptor, content, offset)
    os.lseek(descriptor, offset, os.SEEK_SET)
    return os.write(descriptor, content)


def allocate(descriptor: int, size: int) -> None:
    """Lengthens a file to `size` bytes, with zeros, and takes that room from the disk now. Raises OSError."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
    else:
        end = os.fstat(descriptor).st_size
        write_at(descriptor, bytes(size - end), end)


def flush(path: Path) -> None:
    """Flushes a file or a folder to the disk; Windows flushes only files. Raises OSError."""
    if IS_WINDOWS and path.is_dir():
        return
    descriptor = open_file(path, os.O_RDWR if IS_WINDOWS else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


_REPLACING = 5.0  # seconds


def replace(new: Path, old: Path) -> None:
    """Moves a file to the place of another. Raises OSError.

    Windows refuses that while a program reads the old file, so it is tried for 5 s there.
    """
    until = time.monotonic() + _REPLACING
    while True:
        try:
            new.replace(old)
            return
        except PermissionError:
            if not IS_WINDOWS or time.monotonic() > until:
                raise
            time.sleep(_GLANCE)


def user() -> int:
    """Returns the number of the user as files tell it; 0 on Windows."""
    return getattr(os, "geteuid", int)()


# Processes.

HANGUP = getattr(signal, "SIGHUP", None)
SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
"""Signals by which a person or the system ends a program. SIGBREAK: Ctrl-Break, or a closed console of Windows."""
APART: Mapping[str, Any] = MappingProxyType(
    # 0x200 | 0x08000000: CREATE_NEW_PROCESS_GROUP and CREATE_NO_WINDOW of `subprocess`
    {"creationflags": 0x08000200} if IS_WINDOWS else {"start_new_session": True}
)
"""Options of `subprocess.Popen` for a process that neither Ctrl-C nor a closed terminal reaches."""


def end_group(process: "subprocess.Popen[bytes]") -> None:
    """Kills a process that was started `APART`, with those that it started; does not wait for its end."""
    if not IS_WINDOWS:
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
    elif process.poll() is None:
        import subprocess

        subprocess.run(("taskkill", "/T", "/F", "/PID", str(process.pid)), capture_output=True, check=False)
        process.kill()


def socket_pair() -> tuple[socket.socket, socket.socket]:
    """Returns two connected sockets, which send at once. Raises OSError."""
    pair = socket.socketpair()
    for each in pair:
        if each.family == socket.AF_INET:  # on Windows
            each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return pair


def python() -> tuple[str, dict[str, str]]:
    """Returns the program that is Python, and the environment that it needs.

    Windows starts the Python of an environment through another process, which could not hand sockets on.
    """
    base = getattr(sys, "_base_executable", sys.executable)
    if not IS_WINDOWS or base == sys.executable:
        return sys.executable, {}
    return base, {"__PYVENV_LAUNCHER__": sys.executable}


def inheriting(files: Sequence[Any]) -> dict[str, Any]:
    """Returns the options of `subprocess.Popen` for a process that inherits these files and sockets (`inherited`)."""
    sockets = [file for file in files if isinstance(file, socket.socket)]
    if not IS_WINDOWS:
        return {"pass_fds": [file.fileno() for file in files]}
    subprocess, here = import_module("subprocess"), import_module("os")
    handles = [_msvcrt.get_osfhandle(file.fileno()) for file in files if file not in sockets]
    for handle in handles:
        here.set_handle_inheritable(handle, True)
    startup = subprocess.STARTUPINFO(lpAttributeList={"handle_list": handles} if handles else None)
    return {"startupinfo": startup, **({"stdin": subprocess.PIPE} if sockets else {})}


def number_of(file: Any) -> int:
    """Returns the number by which a process finds a file that it inherits."""
    own: int = file.fileno()
    return _msvcrt.get_osfhandle(own) if IS_WINDOWS and not isinstance(file, socket.socket) else own


def hand_sockets(process: "subprocess.Popen[bytes]", files: Sequence[Any]) -> None:
    """Completes what `inheriting` began, right after the start of the process. Raises OSError if it is gone."""
    if IS_WINDOWS and process.stdin is not None:
        with process.stdin as pipe:
            for file in files:
                if hasattr(file, "share"):  # it is a socket
                    share: bytes = file.share(process.pid)
                    pipe.write(len(share).to_bytes(4, "little") + share)


def inherited_socket(number: int) -> socket.socket:
    """Returns an inherited socket. Call it for the sockets in the order in which the parent named them."""
    if not IS_WINDOWS:
        return socket.socket(fileno=number)
    pipe = sys.stdin.buffer
    shared: socket.socket = import_module("socket").fromshare(pipe.read(int.from_bytes(pipe.read(4), "little")))
    return shared


def inherited_file(number: int) -> int:
    """Returns the descriptor of an inherited file that is no socket."""
    return _msvcrt.open_osfhandle(number, os.O_RDONLY | _OF_BYTES) if IS_WINDOWS else number


def limit_process(memory: int, processor: int, written: int, niceness: int) -> None:
    """Limits this process for good, as python_process.ProcessLimits says; Windows has no such limits."""
    if IS_WINDOWS:
        return
    kinds = resource.RLIMIT_AS, resource.RLIMIT_CPU, resource.RLIMIT_FSIZE
    for kind, most in zip(kinds, (memory, processor, written), strict=True):
        if most:
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            with suppress(ValueError):  # the system has no such limit, or a lower one
                resource.setrlimit(kind, (most, most))
    os.nice(niceness)


def forbid_files() -> bool:
    """Forbids this process for good to open a file or a socket; returns False on Windows, which cannot."""
    if IS_WINDOWS:
        return False
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, 0))
    return True


def allow_files(most: int) -> int:
    """Returns how many files this process may have open, at most `most`; raises its limit as far as it may."""
    if IS_WINDOWS:
        return most
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return most if files == resource.RLIM_INFINITY else min(most, files)


def memory_here() -> int:
    """Returns the bytes of memory of this computer."""
    if not IS_WINDOWS:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    ctypes: Any = import_module("ctypes")
    kilobytes = ctypes.c_ulonglong()
    ctypes.windll.kernel32.GetPhysicallyInstalledSystemMemory(ctypes.byref(kilobytes))
    return int(kilobytes.value) * 1024


# Terminals.


def is_typed(file: int, seconds: float) -> bool:
    """Returns True if something was typed at a terminal, or will be within `seconds`. Raises OSError, ValueError."""
    if not IS_WINDOWS:
        return bool(select.select([file], [], [], seconds)[0])
    until = time.monotonic() + seconds
    while not _msvcrt.kbhit():
        if time.monotonic() >= until:
            return False
        time.sleep(_GLANCE)
    return True


def forget_keys(terminal: IO[str]) -> None:
    """Forgets what was typed before a question, which it does not answer; nothing if this is no terminal."""
    if terminal.isatty() and not IS_WINDOWS:
        termios.tcflush(terminal, termios.TCIFLUSH)
    while terminal.isatty() and IS_WINDOWS and _msvcrt.kbhit():
        _msvcrt.getwch()


def is_in_background(terminal: int) -> bool:
    """Returns True if what is typed at a terminal is for another program."""
    return hasattr(os, "tcgetpgrp") and os.isatty(terminal) and os.tcgetpgrp(terminal) != os.getpgrp()
