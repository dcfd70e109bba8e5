"""The maker `command`: a program of the person's, in every way that it can go wrong."""

import json
import re
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from frida_painter.errors import ConfigError, Interrupted, MakingFailed
from frida_painter_words.picture_makers import command as program
from frida_painter_words.picture_makers.command import COMMAND, CommandMaker
from picture_makers.test_service import ask

PRINTS = """
import sys
from PIL import Image
Image.new("RGB", (40, 30), (200, 10, 10)).save(sys.stdout.buffer, "PNG")
"""


@pytest.fixture
def command(tmp_path: Path) -> Callable[..., str]:
    """command(source, *arguments): the command line of a Python program."""

    def write(source: str, *arguments: str) -> str:
        (tmp_path / "maker.py").write_text(source)
        return " ".join([sys.executable, str(tmp_path / "maker.py"), *arguments])

    return write


def test_a_program_prints_a_picture_or_writes_one(tmp_path: Path, command: Callable[..., str]) -> None:
    maker = CommandMaker.parse(command(PRINTS))
    (made,) = maker.make(ask(tmp_path))
    assert isinstance(made, Path)
    with Image.open(made) as picture:
        assert picture.size == (40, 30)
    assert maker.facts["command"].endswith("maker.py '{words}'") and len(maker.facts["sha256"].split()) == 2


def test_words_are_one_argument_and_no_shell_reads_them(tmp_path: Path, command: Callable[..., str]) -> None:
    source = "import sys, json, pathlib; pathlib.Path(sys.argv[-1]).write_text(json.dumps(sys.argv[1:]))"
    words = "a $(touch here) 'lemon'; {out} | {seed}"
    maker = CommandMaker.parse(command(source, "--w={words}", "{seed}x{width}x{height}", "{out}"))
    files = maker.make(replace(ask(tmp_path, seeds=(7, 8)), words=words))
    heard = [json.loads(file.read_text()) for file in files if isinstance(file, Path)]
    assert [one[:2] for one in heard] == [[f"--w={words}", "7x128x64"], [f"--w={words}", "8x128x64"]]
    assert not list(tmp_path.rglob("here")) and heard[0][2] != heard[1][2]


@pytest.mark.parametrize(
    ("source", "arguments", "says"),
    [
        ("import sys; sys.exit('out of\\x1b[31m paint')", (), r"status 1 and .*: out of \[31m paint; try .*\.$"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", (), "was ended by SIGSEGV and made no picture"),
        ("", (), "ended well and printed nothing"),
        ("", ("{out}",), "ended well and wrote no file {out}"),
        ("while True: print('x' * 4096)", (), "wrote more than 1 MB and was ended"),
        ("import sys\nwhile True: sys.stderr.write('x' * 4096)", (), "wrote more than 1 MB and was ended"),
        ("import sys\nf = open(sys.argv[1], 'wb')\nwhile True: f.write(b'x' * 4096)", ("{out}",), "more than 1 MB"),
    ],
)  # fmt: skip
def test_each_fault_is_one_sentence(
    tmp_path: Path, command: Callable[..., str], monkeypatch: pytest.MonkeyPatch, source: str,
    arguments: tuple[str, ...], says: str,
) -> None:  # fmt: skip
    monkeypatch.setattr(program, "MAX_BYTES", 10**6)
    monkeypatch.setattr(program, "_MAX_SAID", 10**6)
    (fault,) = CommandMaker.parse(command(source, *arguments)).make(ask(tmp_path))
    assert isinstance(fault, MakingFailed) and re.search(says, str(fault))
    assert "\n" not in str(fault) and "\x1b" not in str(fault)


def test_a_fault_of_one_picture_and_the_end_of_the_time_leave_the_others(
    tmp_path: Path, command: Callable[..., str]
) -> None:
    source = f"if sys.argv[1] == '8': sys.exit('no luck')\nif sys.argv[1] == '9': time.sleep(60)\n{PRINTS}"
    maker = CommandMaker.parse(command(f"import sys, time\n{source}", "{seed}"))
    first, second, third, fourth = maker.make(ask(tmp_path, seeds=(7, 8, 9, 10), seconds=4.0))
    assert isinstance(first, Path) and first.stat().st_size
    assert "it said: no luck" in str(second) and "was not finished after" in str(third)
    assert "was not finished after 4 s; give it more time" in str(fourth)


HANGS = """
import subprocess, sys, time, pathlib
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
pathlib.Path(sys.argv[1]).write_text(str(child.pid))
time.sleep(600)
"""


def is_running(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


def test_a_program_that_hangs_is_ended_with_its_children(tmp_path: Path, command: Callable[..., str]) -> None:
    began = time.monotonic()
    (fault,) = CommandMaker.parse(command(HANGS, str(tmp_path / "child"))).make(ask(tmp_path, seconds=3.0))
    assert "was not finished after 3 s; give it more time" in str(fault)
    child = int((tmp_path / "child").read_text())
    while is_running(child) and time.monotonic() - began < 20:
        time.sleep(0.05)
    assert not is_running(child) and time.monotonic() - began < 20


def test_a_stop_ends_it_at_once(tmp_path: Path, command: Callable[..., str]) -> None:
    began = time.monotonic()
    with pytest.raises(Interrupted, match="You stopped the making"):
        CommandMaker.parse(command(HANGS, str(tmp_path / "child"))).make(
            ask(tmp_path, stop=lambda: time.monotonic() - began > 1)
        )
    assert time.monotonic() - began < 20


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "was given no program; write 'command:my-maker"),
        ("   ", "was given no program"),
        ("'half", "cannot be split into arguments"),
        ("sh -c 'my-maker {words}'", "could read them as commands; let them be an argument of their own"),
        ("sh -c \"echo '{words}'\"", "could read them as commands"),
        ("no-such-program-at-all {words}", "The program 'no-such-program-at-all' is not here"),
    ],
)
def test_commands_that_cannot_be_are_refused_before_anything(text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        CommandMaker.parse(text)


def test_a_program_begins_from_the_canvas_and_before_a_painting_it_is_told_that_there_is_none(
    tmp_path: Path, command: Callable[..., str]
) -> None:
    source = "import sys, json, pathlib; pathlib.Path(sys.argv[1]).write_text(json.dumps(sys.argv[2:4]))"
    text = command(source, "{out}", "--begin={canvas}", "{free}")
    assert COMMAND.begins_from_canvas(text) and not COMMAND.begins_from_canvas(command(source, "{out}"))
    request = ask(tmp_path)
    (alone,) = CommandMaker.parse(text).make(request)
    (begun,) = CommandMaker.parse(text).make(
        replace(request, folder=tmp_path, canvas=tmp_path / "c.png", free=tmp_path / "f.png")
    )
    assert json.loads(Path(str(alone)).read_text()) == ["--begin=", ""]
    assert json.loads(Path(str(begun)).read_text()) == [f"--begin={tmp_path / 'c.png'}", str(tmp_path / "f.png")]
