import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from frida_painter.errors import ConfigError
from frida_painter.web.server import hosts, listen


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    program = [sys.executable, "-m", "frida_painter", "studio", "--folder", str(tmp_path), "--port", "0"]
    process = subprocess.Popen(
        [*program, "--no-browser"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, env={**os.environ},
    )  # fmt: skip
    assert process.stdout is not None
    yield process
    process.kill()
    process.wait(10)
    process.stdout.close()


def test_the_studio_closes_in_peace_while_somebody_watches(studio: subprocess.Popen[str]) -> None:
    assert studio.stdout is not None
    match = re.search(r"http://(\S+):(\d+)/\?token=(\S+)", studio.stdout.readline())
    assert match is not None
    host, port, token = match.groups()
    head = f"GET /api/calibration/events HTTP/1.1\r\nHost: {host}:{port}\r\nAuthorization: Bearer {token}\r\n\r\n"
    with socket.create_connection((host, int(port)), timeout=60) as watching:
        watching.sendall(head.encode())
        assert b"200 OK" in watching.recv(1000)
        studio.send_signal(signal.SIGINT)
        with contextlib.suppress(ConnectionResetError):
            while watching.recv(1 << 16):
                pass
        studio.wait(60)
    said = studio.stdout.read()
    assert "Traceback" not in said and "ERROR" not in said, said


def test_names_and_addresses() -> None:
    assert hosts("127.0.0.1", 80, ("easel.local",)) == {"127.0.0.1:80", "localhost:80", "easel.local:80"}
    assert "[::1]:80" in hosts("::1", 80)
    with listen("127.0.0.1", 0) as taken, pytest.raises(ConfigError, match="port 0"):
        listen("127.0.0.1", taken.getsockname()[1])
