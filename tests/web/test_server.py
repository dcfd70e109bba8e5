"""The studio as it is opened by its command: addresses, links, certificate and end."""

import contextlib
import datetime
import ipaddress
import json
import os
import re
import signal
import socket
import ssl
import subprocess
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPSConnection
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from frida_painter.errors import ConfigError
from frida_painter_cli import commands
from frida_painter_studio import server
from frida_painter_studio.network import Certificate
from frida_painter_studio.server import hosts, listen
from frida_painter_together.commands import Role
from served import end_listener, open_studio


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
from frida_painter_cli import commands as cli
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


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Where the studio would have been served, without a socket."""
    places: list[tuple[str, int]] = []

    def listen(address: str, port: int) -> socket.socket:
        places.append((address, port))
        return socket.socket()

    def serve(store: Any, easel: Any, listening: socket.socket, names: Any, tell: Any, *more: Any) -> None:
        listening.close()
        tell(server.Links({role: f"http://here/?token={role.name}" for role in Role}, "http://here/?token=once"))

    monkeypatch.setattr(server, "listen", listen)
    monkeypatch.setattr(server, "serve", serve)
    return places


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["frida-painter", "studio", "--no-browser", *words])
    with pytest.raises(SystemExit) as end:
        commands.main()
    return int(end.value.code or 0)


def test_only_this_machine_reaches_it_unless_another_address_is_given(
    served: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run(monkeypatch, "--folder", str(tmp_path)) == 0
    said = capsys.readouterr().out
    assert served == [("127.0.0.1", 8350)] and "tunnel" not in said and "token=operate" in said
    assert run(monkeypatch, "--folder", str(tmp_path), "--address", "192.0.2.7", "--port", "0") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert served[1:] == [("192.0.2.7", 0)]
    assert "whoever has one of these links can use it" in said and "no encryption" in said and "SSH tunnel" in said


def test_the_browser_is_given_an_address_that_is_good_once_and_root_is_warned(
    served: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    for user, warned in ((0, True), (1000, False)):
        monkeypatch.setattr(os, "geteuid", lambda user=user: user)
        assert run(monkeypatch, "--folder", str(tmp_path), "--browser") == 0
        assert ("runs as root" in capsys.readouterr().out) == warned
    assert opened == ["http://here/?token=once"] * 2


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--address", "0.0.0.0"), "would listen on all networks"),
        (("--address", "::"), "would listen on all networks"),
        (("--address", "::ffff:0.0.0.0"), "would listen on all networks"),
        (("--address", "::ffff:0:0"), "would listen on all networks"),
        (("--certificate", "nowhere.pem"), "belong together"),
        (("--certificate", "nowhere.pem", "--key", "nowhere.key"), "is no file"),
        (("--address", "easel.local"), "an IP address"),
        (("--robot", "toaster"), "There is no robot 'toaster'"),
        (("--port", "99999"), "not from 0 to 65535"),
    ],
)
def test_what_cannot_be_served_is_refused(
    served: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    words: tuple[str, ...], says: str,
) -> None:  # fmt: skip
    assert run(monkeypatch, "--folder", str(tmp_path), *words) == 2
    assert says in " ".join(capsys.readouterr().err.split()) and served == []


def make(folder: Path, name: str) -> Certificate:
    """A certificate that vouches for itself, with its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    who = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "the studio")])
    now = datetime.datetime.now(datetime.UTC)
    address = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    builder = x509.CertificateBuilder().subject_name(who).issuer_name(who).public_key(key.public_key())
    builder = builder.serial_number(1).not_valid_before(now - datetime.timedelta(hours=1))
    signed = builder.not_valid_after(now + datetime.timedelta(days=1)).add_extension(address, False)
    made = signed.sign(key, hashes.SHA256())
    found = Certificate(folder / f"{name}.pem", folder / f"{name}.key")
    found.certificate.write_bytes(made.public_bytes(serialization.Encoding.PEM))
    kind = serialization.PrivateFormat.PKCS8
    found.key.write_bytes(key.private_bytes(serialization.Encoding.PEM, kind, serialization.NoEncryption()))
    return found


def test_both_ports_are_encrypted_with_it(tmp_path: Path) -> None:
    made = make(tmp_path, "studio")
    words = ("--certificate", str(made.certificate), "--key", str(made.key))
    served = open_studio(tmp_path / "paintings", *words)
    trust = ssl.create_default_context(cafile=str(made.certificate))
    try:
        bearer = {"Authorization": f"Bearer {served.tokens['operate']}"}
        with closing(HTTPSConnection(served.host, served.port, timeout=30, context=trust)) as page:
            page.request("GET", "/api/studio", headers=bearer)
            answer = page.getresponse()
            way = json.loads(answer.read())["stop"]
            allowed = answer.headers["content-security-policy"]
        assert f"connect-src 'self' https://{served.host}:{way['port']} " in allowed
        with closing(HTTPSConnection(served.host, way["port"], timeout=30, context=trust)) as stop:
            stop.request("POST", "/stop", way["secret"], {"Origin": f"https://{served.host}:{served.port}"})
            assert json.loads(stop.getresponse().read()) == {"stopped": 0, "heard": 0}
        with closing(HTTPSConnection(served.host, served.port, timeout=30, context=trust)) as page:
            page.request("GET", f"/?token={served.tokens['watch']}")
            assert "secure" in page.getresponse().headers["set-cookie"].lower()
    finally:
        served.kill()
        end_listener(served.folder)


def test_files_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    first, second = make(tmp_path, "first"), make(tmp_path, "second")
    assert Certificate.from_files(None, None) is None
    assert Certificate.from_files(first.certificate, first.key) is not None
    for certificate, key in ((first.certificate, second.key), (first.key, first.certificate)):
        with pytest.raises(ConfigError, match="its own key"):
            Certificate.from_files(certificate, key)
