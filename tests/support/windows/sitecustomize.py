"""Makes the painter's own modules see Windows: with this folder in PYTHONPATH, in a process and all that it starts.

Only modules named frida_painter see it; the libraries stay as they are. What Windows has not is missing, what it has
in place of it stands here, and no file that a process of this tree has open can be replaced, moved or deleted.
"""

import builtins
import fcntl
import os
import pathlib
import secrets
import select
import shutil
import signal
import socket
import stat
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from types import ModuleType
from typing import Any

FIRST = int(os.environ.setdefault("LIKE_WINDOWS_SINCE", str(os.getpid())))
BYTES, ALONE = 1 << 29, 1 << 30  # O_BINARY, O_NOINHERIT
ABSENT_MODULES = {"fcntl", "grp", "posix", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty"}
ABSENT = {
    "os": {
        "O_ACCMODE", "O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "chown", "fchmod", "fchown", "fdatasync",
        "fork", "forkpty", "getegid", "geteuid", "getgid", "getgrouplist", "getloadavg", "getpgid", "getpgrp",
        "getuid", "killpg", "lchown", "mkfifo", "nice", "posix_fallocate", "pread", "preadv", "pwrite", "pwritev",
        "register_at_fork", "sched_getaffinity", "sched_setaffinity", "sendfile", "set_blocking", "setpgid",
        "setpriority", "setsid", "statvfs", "sync", "sysconf", "tcgetpgrp", "tcsetpgrp", "uname",
    },
    "signal": {
        "SIGALRM", "SIGCHLD", "SIGCONT", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGQUIT", "SIGSTOP", "SIGTSTP", "SIGUSR1",
        "SIGUSR2", "alarm", "pause", "pthread_kill", "pthread_sigmask", "setitimer", "sigwait",
    },
    "socket": {"AF_UNIX", "SCM_RIGHTS", "recv_fds", "send_fds"},
    "select": {"epoll", "poll"},
    "selectors": {"DevpollSelector", "EpollSelector", "KqueueSelector", "PollSelector"},
    "asyncio": {"open_unix_connection", "start_unix_server"},
}  # fmt: skip


def users_of(path: object) -> list[str]:
    """The processes of this tree that have a file open."""
    named, found = os.path.realpath(str(path)), []
    for process in filter(str.isdigit, os.listdir("/proc")):  # noqa: PTH208 (Path is changed below)
        try:
            files = os.scandir(f"/proc/{process}/fd") if int(process) >= FIRST else ()
            found += [process for file in files if os.readlink(file.path) == named]  # noqa: PTH115
        except OSError:
            continue  # it has ended, or the file was closed
    return found


def refusing(act: Callable[..., Any], *places: int) -> Callable[..., Any]:
    def refuse(*given: Any, **named: Any) -> Any:
        for path in (given[place] for place in places):
            if os.path.isfile(path) and users_of(path):  # noqa: PTH113
                raise PermissionError(13, "The process cannot access the file because it is being used", str(path))
        return act(*given, **named)

    return refuse


for name, places in (("replace", (0, 1)), ("rename", (0, 1)), ("unlink", (0,))):
    setattr(pathlib.Path, name, refusing(getattr(pathlib.Path, name), *places))
remove_tree = shutil.rmtree


def rmtree(path: Any, ignore_errors: bool = False, **named: Any) -> None:
    if not ignore_errors and (used := [each for each in pathlib.Path(path).rglob("*") if users_of(each)]):
        raise PermissionError(13, "The process cannot access the file because it is being used", str(used[0]))
    remove_tree(path, ignore_errors, **named)


# Files.

held: dict[int, list[tuple[int, int]]] = {}  # descriptor: its locks, each as where it begins and a file of its own


def open_file(path: Any, flags: int, mode: int = 0o777) -> int:
    assert flags & BYTES, f"{path} would be opened as text"
    if os.path.isdir(path):  # noqa: PTH112
        raise PermissionError(13, "Permission denied", str(path))
    return os.open(path, flags & ~(BYTES | ALONE), mode)


def close(descriptor: int) -> None:
    for _, lock in held.pop(descriptor, ()):
        os.close(lock)
    os.close(descriptor)


def locking(descriptor: int, mode: int, count: int) -> None:
    start = os.lseek(descriptor, 0, os.SEEK_CUR)
    if mode == msvcrt.LK_UNLCK:
        (lock,) = (file for begin, file in held[descriptor] if begin == start)
        held[descriptor].remove((start, lock))
        os.close(lock)
        return
    lock = os.open(f"/proc/self/fd/{descriptor}", os.O_RDWR | os.O_CLOEXEC)
    try:
        wanted = struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, start, count, 0)
        fcntl.fcntl(lock, fcntl.F_OFD_SETLK, wanted)
    except OSError:
        os.close(lock)
        raise PermissionError(13, "Permission denied") from None
    held.setdefault(descriptor, []).append((start, lock))


msvcrt: Any = ModuleType("msvcrt")
vars(msvcrt).update(
    LK_NBLCK=2, LK_UNLCK=0, locking=locking, get_osfhandle=lambda descriptor: descriptor,
    open_osfhandle=lambda handle, flags: handle, kbhit=lambda: bool(select.select([sys.stdin], [], [], 0)[0]),
)  # fmt: skip


# Processes.


class StartupInfo:
    def __init__(self, lpAttributeList: dict[str, list[int]] | None = None) -> None:
        self.handles = (lpAttributeList or {}).get("handle_list", [])


def translated(creationflags: int = 0, startupinfo: StartupInfo | None = None, **named: Any) -> dict[str, Any]:
    assert not named.keys() & {"pass_fds", "preexec_fn", "start_new_session", "process_group"}, named.keys()
    return {
        **named, "start_new_session": bool(creationflags), "pass_fds": startupinfo.handles if startupinfo else ()
    }  # fmt: skip


class Popen(subprocess.Popen[Any]):
    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **translated(**named))


def run(*given: Any, **named: Any) -> Any:
    if given[0][0] == "taskkill":
        return os.kill(int(given[0][-1]), signal.SIGKILL)
    return subprocess.run(*given, **translated(**named))


def share(self: socket.socket, process: int) -> bytes:
    address, copy = f"\0{secrets.token_hex(8)}", self.dup()
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(address)
    listening.listen(1)

    def give() -> None:
        with listening, copy, listening.accept()[0] as line:
            socket.send_fds(line, [b"!"], [copy.fileno()])

    threading.Thread(target=give, daemon=True).start()
    return address.encode()


def from_share(shared: bytes) -> socket.socket:
    with socket.socket(socket.AF_UNIX) as line:
        line.connect(shared.decode())
        return socket.socket(fileno=socket.recv_fds(line, 1, 1)[1][0])


def socket_pair() -> tuple[socket.socket, socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        one = socket.create_connection(listening.getsockname())
        return one, listening.accept()[0]


def select_sockets(*given: Any) -> Any:
    files = [file if isinstance(file, int) else file.fileno() for each in given[:3] for file in each]
    assert all(stat.S_ISSOCK(os.fstat(file).st_mode) for file in files), files
    return select.select(*given)


socket.socket.share = share  # type: ignore[attr-defined]


# What the painter's modules import.


class View(ModuleType):
    """A module of Python as it is on Windows."""

    def __init__(self, real: ModuleType, **own: Any) -> None:
        super().__init__(real.__name__)
        vars(self).update(own, _real=real)

    def __getattr__(self, name: str) -> Any:
        if name in ABSENT.get(self.__name__, ()):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r} on Windows")
        return getattr(vars(self)["_real"], name)


def import_module(name: str, package: str | None = None) -> Any:
    if name in ABSENT_MODULES:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return importing(name, {"__name__": "frida_painter"}, None, ("import_module",), 0)


OWN: dict[str, dict[str, Any]] = {
    "os": {
        "O_BINARY": BYTES, "O_NOINHERIT": ALONE, "open": open_file, "close": close, "name": "nt",
        "set_handle_inheritable": os.set_inheritable,
    },
    "sys": {"platform": "win32"},
    "signal": {"SIGBREAK": signal.SIGTTIN},  # both are 21
    "socket": {"socketpair": socket_pair, "fromshare": from_share},
    "select": {"select": select_sockets},
    "subprocess": {"Popen": Popen, "run": run, "STARTUPINFO": StartupInfo},
    "shutil": {"rmtree": rmtree},
    "importlib": {"import_module": import_module},
}  # fmt: skip
views: dict[str, ModuleType] = {"msvcrt": msvcrt}
real_import = builtins.__import__


def importing(name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0) -> Any:
    if level or not str((globals or {}).get("__name__", "")).startswith(("frida_painter", "__main__")):
        return real_import(name, globals, locals, fromlist, level)
    if name in ABSENT_MODULES:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    if name not in views and name in OWN.keys() | ABSENT.keys():
        views[name] = View(real_import(name), **OWN.get(name, {}))
    return views.get(name) or real_import(name, globals, locals, fromlist, level)


builtins.__import__ = importing
