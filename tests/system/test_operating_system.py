"""What only some systems have is used nowhere without its counterpart: the painter paints as on Windows."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import frida_painter
from frida_painter.system.event_log import EventLog
from frida_painter.system.operating_system import why_unfit
from frida_painter.system.storage import PART
from test_house import SOURCES, place_of

TESTS = Path(__file__).parents[1]
PHOTO = TESTS.parent / "examples" / "photographs" / "coffee.jpg"


@pytest.mark.skipif(sys.platform != "linux", reason="Windows itself is another job")
def test_a_painting_is_planned_painted_stopped_and_resumed_as_on_windows(tmp_path: Path) -> None:
    folder = tmp_path / "ein Bild ä"
    paths = (TESTS / "support" / "windows", Path(frida_painter.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths)), "COLUMNS": "200"}

    def begin(*words: object) -> "subprocess.Popen[str]":
        command = (sys.executable, "-P", "-m", "frida_painter", *map(str, words))
        return subprocess.Popen(command, env=environment, stdout=-1, stderr=-2, text=True, cwd=tmp_path)

    small = (
        "--strokes",
        8,
        "--colors",
        2,
        "--camera",
        "none",
        "--canvas",
        "6x4cm",
        "--render-height",
        64,
        "--effort",
        0.05,
    )
    painter = begin("paint", PHOTO, *small, "--pace", 1, "--no-film", "--out", folder)
    while not (folder / "plan.json").exists():
        assert painter.poll() is None, painter.communicate()
        time.sleep(0.05)
    painter.send_signal(signal.SIGINT)
    said, _ = painter.communicate()
    assert painter.returncode == 130 and "Traceback" not in said, said
    assert json.loads((folder / "result.json").read_text())["stopped"] is True, said
    resumed = begin("resume", folder, "--pace", 0, "--yes")
    said, _ = resumed.communicate()
    assert resumed.returncode == 0 and "Traceback" not in said, said
    painted = [record for record in EventLog.read(folder / "journal") if record["kind"] == "stroke_painted"]
    assert len(painted) == 8 and (folder / "painting.png").exists()
    assert not [path for path in folder.rglob("*") if path.name.startswith(PART)], "nothing was left, or could not go"


# Names that one system lacks are asked of the module that knows what stands in for them.
OF_ONE_SYSTEM = re.compile(
    r"\bimport (fcntl|grp|pwd|pty|resource|select|termios|tty|msvcrt)\b"
    r"|signal\.(SIGHUP|SIGKILL|SIGPIPE|SIGUSR\d|SIGALRM|SIGBREAK)\b|\b(pass_fds|preexec_fn|start_new_session|AF_UNIX)\b"
    r"|os\.(fork|setsid|killpg|get[eu]+id|getgid|O_(NOFOLLOW|CLOEXEC|NONBLOCK|DIRECTORY|BINARY)|pread|pwrite|statvfs"
    r"|fchmod|posix_fallocate|nice|tcgetpgrp|sysconf)\b|select\.(poll|epoll)\b|%-[a-zA-Z]\b"
)
KNOWING = {
    "system/operating_system.py",
    "system/locks.py",
    "easel/watchdog.py",  # sockets among them, and /proc, without which it counts otherwise
    "frida_painter_drivers/serial_line.py",  # asks for both where they are
}


def test_what_only_one_system_has_is_named_in_few_places() -> None:
    found = {place_of(path) for path in SOURCES if OF_ONE_SYSTEM.search(path.read_text(encoding="utf-8"))}
    assert found <= KNOWING, found - KNOWING


@pytest.mark.parametrize(
    ("system", "machine", "largest", "told"),
    [
        ("linux", "aarch64", 2**63 - 1, ""),
        ("win32", "AMD64", 2**63 - 1, ""),
        ("darwin", "arm64", 2**63 - 1, ""),
        ("darwin", "x86_64", 2**63 - 1, "Intel"),
        ("win32", "ARM64", 2**63 - 1, "x64"),
        ("linux", "armv7l", 2**31 - 1, "64-bit"),
        ("win32", "x86", 2**31 - 1, "64-bit"),
    ],
)
def test_a_computer_without_the_libraries_is_refused_with_what_to_do(
    system: str, machine: str, largest: int, told: str
) -> None:
    said = why_unfit(system, machine, largest)
    assert told in said and bool(said) == bool(told)
