import errno
import os
from pathlib import Path

import pytest

from frida_painter.easel.kinds import state_folder
from frida_painter.hardware.latch import Latch, latch_path
from support.commandline import run_command


def stopped(name: str, reason: str = "Ctrl-C was pressed twice") -> Latch:
    latch = Latch(latch_path(state_folder(), name), name)
    latch.engage(reason)
    return latch


@pytest.fixture
def at_the_terminal(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the person answers, one after another; whoever has no more answers has left."""
    answers: list[str] = []

    def answer(prompt: str) -> str:
        print(prompt)
        if not answers:
            raise EOFError
        return answers.pop(0)

    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("builtins.input", answer)
    monkeypatch.setattr("frida_painter_cli.leading.forget_keys", lambda terminal: None)
    return answers


def test_nothing_is_stopped(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command("arm") == 0
    assert capsys.readouterr().out == "No robot is stopped.\n"


def test_each_robot_is_asked_about_by_itself(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], at_the_terminal: list[str]
) -> None:
    first, second = stopped("virtual studio 0"), stopped("xarm 10.0.0.3", "stroke 3: error 31")
    at_the_terminal += ["", "Y"]
    assert run_command("arm") == 0
    said = capsys.readouterr().out
    assert "virtual studio 0 stays stopped." in said and "xarm 10.0.0.3 may move again." in said
    assert "stroke 3: error 31" in said
    assert first.read() is not None and second.read() is None


def test_who_leaves_without_an_answer_arms_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], at_the_terminal: list[str]
) -> None:
    latch = stopped("virtual studio 0")
    assert run_command("arm") == 2
    assert "Nobody answered" in capsys.readouterr().err and latch.read() is not None


def test_a_script_has_to_say_that_somebody_looked(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    latch = stopped("virtual studio 0")
    assert run_command("arm") == 2
    assert "--yes" in capsys.readouterr().err and latch.read() is not None
    assert run_command("arm", "--yes") == 0 and latch.read() is None


def test_a_damaged_latch_can_be_released_as_well(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    latch = stopped("virtual studio 0")
    latch.path.write_bytes(b"\x00")
    assert run_command("arm", "--yes") == 0 and latch.read() is None


def test_a_stop_that_may_not_be_cleared_does_not_keep_others_from_being_armed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    others, own = stopped("of another user"), stopped("of this one")
    unlink = Path.unlink

    def refuse(path: Path, missing_ok: bool = False) -> None:
        if path == others.path:
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", refuse)
    assert run_command("arm", "--yes") == 2
    assert "sudo" in capsys.readouterr().err
    assert others.read() is not None and own.read() is None
