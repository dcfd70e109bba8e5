import os
import socket
import sys
import webbrowser
from pathlib import Path
from typing import Any

import pytest

from frida_painter.cli import commands
from frida_painter_studio import server
from frida_painter_studio.commands import Role


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
