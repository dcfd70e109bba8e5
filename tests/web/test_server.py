import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import webbrowser
from collections.abc import Iterator
from pathlib import Path

import pytest

from frida_painter.cli import commands
from frida_painter.errors import ConfigError
from frida_painter_studio.server import hosts, listen


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


def test_the_studio_closes_in_peace_while_somebody_watches_and_keeps_no_token(
    studio: subprocess.Popen[str], tmp_path: Path
) -> None:
    assert studio.stdout is not None
    match = re.search(r"http://(\S+):(\d+)/\?token=(\S+)", studio.stdout.readline())
    assert match is not None
    host, port, token = match.groups()
    head = f"GET /api/events?of=calibration HTTP/1.1\r\nHost: {host}:{port}\r\nAuthorization: Bearer {token}\r\n\r\n"
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
    assert token not in said
    assert not any(token.encode() in file.read_bytes() for file in tmp_path.rglob("*") if file.is_file())


def link_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["frida-painter", "studio", "--folder", str(folder), "--link"])
    with pytest.raises(SystemExit) as end:
        commands.main()
    return int(end.value.code or 0)


def test_the_link_of_an_open_studio_is_told_and_opened_again(
    studio: subprocess.Popen[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    assert studio.stdout is not None
    first = [studio.stdout.readline() for _ in range(3)]
    assert link_again(tmp_path, monkeypatch) == 0
    assert capsys.readouterr().out == "".join(first)
    link = first[0].split()[-1]
    page = Path(opened[0].removeprefix("file://"))
    assert f'url={link}"' in page.read_text() and link not in opened[0], "others can read a command line"
    for file in (page, tmp_path / ".links.json"):
        assert file.stat().st_mode & 0o777 == 0o600
    studio.kill()
    studio.wait(10)
    assert link_again(tmp_path, monkeypatch) == 2
    assert "No studio is open in" in capsys.readouterr().err and len(opened) == 1


# What the page's process does, but for the socket: opened, asked by a browser, given a picture.
PAGE = """
import io, sys
from pathlib import Path
from PIL import Image
import frida_painter_studio.server  # what the command opens the page with
from frida_painter.cli import commands as cli
from support.studio import Studio

cli.build()
visitor = Studio(Path(sys.argv[1])).visitor()
picture = io.BytesIO()
Image.new("RGB", (64, 48)).save(picture, "PNG")
for path in ("/", "/api/studio", "/api/paintings", "/api/calibration"):
    assert visitor.get(path).status_code == 200, path
assert visitor.post("/api/pictures", content=picture.getvalue()).status_code == 200
assert visitor.post("/api/stop").status_code == 200
print(*sys.modules)
"""


def test_the_process_of_the_page_holds_neither_robot_nor_accelerator(tmp_path: Path) -> None:
    """In a process of its own: what was loaded before by other tests does not count."""
    tests = str(Path(__file__).parents[1])
    path = os.pathsep.join(filter(None, (tests, os.environ.get("PYTHONPATH"))))
    said = subprocess.run(
        [sys.executable, "-c", PAGE, str(tmp_path / "store")],
        capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    loaded = set(said.stdout.split())
    assert "frida_painter_studio.server" in loaded
    heavy = {"torch", "safetensors", "numba", "cv2", "scipy", "h5py", "transformers", "mujoco"}
    assert not loaded & heavy
    drivers = {name for name in loaded if name.startswith(("frida_painter_drivers", "frida_painter.virtual"))}
    assert not drivers and "frida_painter.easel.open" not in loaded


def test_names_and_addresses() -> None:
    assert hosts("127.0.0.1", 80, ("easel.local",)) == {"127.0.0.1:80", "localhost:80", "easel.local:80"}
    assert "[::1]:80" in hosts("::1", 80)
    with listen("127.0.0.1", 0) as taken, pytest.raises(ConfigError, match="port 0"):
        listen("127.0.0.1", taken.getsockname()[1])
