"""Whatever is wrong with what a person gives is said in one sentence, and nothing is made or changed."""

import os
import shutil
import signal
import sys
import time
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from frida_painter.__main__ import main as command
from frida_painter.errors import ConfigError, RobotStopped
from frida_painter.hardware.workcell import example
from frida_painter.runs.run import PaintingRun
from frida_painter.strokes.plan import Plan
from frida_painter.system import python_process
from frida_painter_cli import commands
from frida_painter_cli.stop_signal import stop_on_signals
from support.commandline import run_command
from support.plans import made_up_plan

MAX_WIDE = 40_000


def contents(folder: Path) -> dict[str, bytes]:
    """What lies there, without what is read for ever."""
    return {str(path): path.read_bytes() if path.is_file() else b"" for path in sorted(folder.rglob("*"))}


@pytest.fixture
def refuse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """refuse(word, ...): the one sentence that the command answers with; fails if anything was made or changed."""
    monkeypatch.chdir(tmp_path)

    def refused(*words: str) -> str:
        before = contents(tmp_path)
        status = run_command(*words)
        told = capsys.readouterr()
        assert status == 2, (told.out, told.err)
        assert told.out == ""
        assert told.err.startswith("frida-painter: ") and told.err.endswith("\n")
        message = told.err.removeprefix("frida-painter: ").rstrip("\n")
        assert message and "\n" not in message and "Traceback" not in message and len(message) < 450
        assert contents(tmp_path) == before
        return message

    return refused


@pytest.fixture
def photo(tmp_path: Path) -> str:
    path = tmp_path / "photo.png"
    shade = np.linspace(0, 255, 40 * 30, dtype=np.uint8).reshape(30, 40)
    Image.fromarray(shade).convert("RGB").save(path)
    return str(path)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--strokes", "0"), ("--strokes was given 0", "from 1 to 20000")),
        (("--strokes", "many"), ("'--strokes'", "'many' is not a whole number")),
        (("--strokes",), ("--strokes", "requires an argument")),
        (("--canvas", "14x11"), ("'14x11'", "unit")),
        (("--effort", "much"), ("'much' is not a number",)),
        (("--brush", "hairy"), ("hairy",)),
        (("--brush", "photo.png"), ("photo.png",)),
        (("--brush", "pickle.pt"), ("pickle.pt", "not safetensors")),
        (("--settings", "nowhere.toml"), ("nowhere.toml does not exist",)),
        (("--settings", "nan.toml"), ("--effort was given nan",)),
        (("--out", "photo.png"), ("photo.png",)),
        (("--out", "photo.png/inside"), ("cannot be written", "--out")),
        (("--out", "/proc/painting"), ("/proc/painting",)),
        (("--out", "full"), ("full is not empty", "nothing there is overwritten")),
        (("--out", "x" * 300), ("cannot be written",)),
        (("--colour", "3"), ("--colour",)),
        (("--palette", "nowhere.json"), ("nowhere.json does not exist",)),
        (("--palette", "."), ("is a folder; give the path of a palette",)),
        (("--palette", "odd.toml"), ("line 1: 'stroks = 300' is not a colour", "palette of GIMP (.gpl)")),
        (("--palette", "odd.json"), ("paint 2: 'red' is not a colour",)),
        (("--palette", "two.json", "--colors", "3"), ("two.json has 2 paints, and 3 are wanted",)),
        (("--brush", "zero.safetensors"), ("zero.safetensors is not a plain file",)),
        (("--settings", "own.JSON"), ("own.JSON", "it has no checksum", "your own are TOML: write lines")),
        (("--page", "nowhere"), ("--page was given nowhere", "no such folder", "the studio's folder of this painting")),
        (("--settings", "pipe"), ("pipe is not a plain file (but a pipe)",)),
        (("--goal", "pipe"), ("pipe is not a plain file",)),
        (("--goal", "heavy.toml"), ("heavy.toml is not TOML", "400 digits")),
        (("--image", "/dev/zero"), ("/dev/zero is not a plain file (but a device)",)),
        (("--clip", "nowhere"), ("nothing of this goal is seen through a CLIP",)),
        (("--pictures", "."), ("nothing of this goal is made of pictures of things",)),
        (("--palette", "photo.png", "--colors", "2"), ("40 x 30 pixels is too small", "photograph it from nearer")),
    ],
)  # fmt: skip
def test_wishes_that_cannot_be_fulfilled(
    words: tuple[str, ...], says: tuple[str, ...], refuse: Callable[..., str], photo: str, tmp_path: Path
) -> None:
    (tmp_path / "odd.toml").write_text("stroks = 300")
    (tmp_path / "odd.json").write_text('{"paints": ["#112233", "red"]}')
    (tmp_path / "two.json").write_text('{"paints": ["#112233", "#445566"]}')
    (tmp_path / "own.JSON").write_text('{"strokes": 300}')
    (tmp_path / "nan.toml").write_text("effort = nan")
    torch.save({"weights": torch.zeros(3)}, tmp_path / "pickle.pt")
    (tmp_path / "heavy.toml").write_text(f'[[goal]]\nimage = "photo.png"\nweight = {"9" * 400}')
    (tmp_path / "zero.safetensors").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("dear")
    message = refuse("paint", photo, *words)
    assert all(part in message for part in says), message


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--on-canvas",), "the canvas of the virtual studio is bare; leave it out, or give a picture"),
        (("--robot", "human", "--studio-canvas", "photo.png"), "--studio-canvas is for simulated robots"),
        (("--minutes", "soon"), "--minutes"),
        (("--camera", "folder:/nowhere"), "--camera is for real robots, and --robot virtual is a simulated one"),
        (("--camera", "opencv:0", "--workspace", "w.toml"), "--camera and --workspace are for real robots"),
        (("--calibration", "."), "is a folder; give the path of a calibration record"),
        (("--robot", "human", "--pace", "2"), "--pace is for simulated robots, and --robot human is a real one"),
    ],
)
def test_what_is_said_of_another_kind_of_robot(
    words: tuple[str, ...], says: str, refuse: Callable[..., str], photo: str, tmp_path: Path
) -> None:
    (tmp_path / "w.toml").write_text(example())
    assert says in refuse("paint", photo, *words)


def test_photographs_that_are_none(refuse: Callable[..., str], tmp_path: Path, photo: str) -> None:
    whole = tmp_path / "whole.jpg"
    Image.effect_noise((200, 150), 80).convert("RGB").save(whole)
    (tmp_path / "cut.jpg").write_bytes(whole.read_bytes()[:2000])
    (tmp_path / "text.jpg").write_text("This is a letter and no photograph.\n")
    Image.new("1", (MAX_WIDE, 16)).save(tmp_path / "wide.png")
    (tmp_path / "empty.png").write_bytes(b"")
    says = {
        "nowhere.jpg": "does not exist",
        "text.jpg": "is a text, not a picture",
        "cut.jpg": "is a damaged JPEG picture (VipsJpeg: premature end of JPEG image)",
        "wide.png": f"is {MAX_WIDE} x 16 pixels; a picture has at most 30000",
        "empty.png": "is empty",
        ".": "is a folder",
    }
    for name, part in says.items():
        assert part in refuse("paint", name), name
    assert "PHOTO" in refuse("plan")


@pytest.mark.parametrize("command", ["paint", "plan"])
def test_a_full_disk_is_told_before_anything_is_made(
    command: str, refuse: Callable[..., str], photo: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fault F6: the disk is nearly full."""
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(2**40, 2**40 - 2**20, 2**20))
    message = refuse(command, photo, "--out", "new", "--strokes", "5")
    assert "1 MB free" in message and "needs" in message and "--out" in message


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    made_up_plan(12, 3).save(tmp_path / "kept" / "plan.json")
    return tmp_path / "kept" / "plan.json"


@pytest.mark.usefixtures("in_small_world")
@pytest.mark.parametrize(
    "other", [("--canvas", "150x100mm"), ("--strokes", "11"), ("--brush", "fine")], ids=lambda other: other[0]
)
def test_a_plan_for_another_painting_is_refused_before_the_easel_opens(
    other: tuple[str, str], refuse: Callable[..., str], photo: str, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PaintingRun, "open_easel", lambda *_, **__: pytest.fail("the easel was opened"))
    size = Plan.load(plan).canvas
    Image.new("RGB", (90, 60), "tan").save(photo)
    asked = {"--canvas": f"{size.width}x{size.height}m", "--strokes": "12", "--brush": "medium"} | dict([other])
    words = (word for one in asked.items() for word in one)
    said = refuse("paint", photo, "--fit", "crop", "--plan", str(plan), *words)
    of = f"on a canvas of {1000 * size.width:.1f} x {1000 * size.height:.1f} mm"
    assert f"The plan is for 12 strokes by medium {of}, and this painting has" in said and "--plan" in said
    assert {"--canvas": "150.0 x 100.0", "--strokes": "11 strokes", "--brush": "by fine"}[other[0]] in said


@pytest.mark.parametrize("command", ["render", "export"])
def test_plans_that_are_damaged_or_not_there(command: str, refuse: Callable[..., str], plan: Path) -> None:
    """tests/strokes/test_plan.py has each way to be damaged."""
    whole = plan.read_bytes()
    for content, says in ((whole[:-100], "cut off or not JSON"), (whole.replace(b'"strokes": 12', b'"strokes": 13'),
                          "was changed after it was written"), (b"{}", "it has no checksum")):  # fmt: skip
        plan.write_bytes(content)
        assert says in refuse(command, "kept")
    plan.unlink()
    assert "does not exist" in refuse(command, "kept")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("render", "kept", "--height", "0"), "0 is not from 16 to 10000"),
        (("render", "kept", "--height", "20000"), "from 16 to 10000"),
        (("render", "kept", "--height", "nan"), "'nan' is not a whole number"),
        (("render", "kept", "--out", "picture"), "'picture' was given; the picture ends in .png or .jpg"),
        (("render", "kept", "--out", "picture.gif"), "ends in .png or .jpg"),
        (("render", "kept", "--height", "32", "--out", "kept/plan.json/p.png"), "cannot be written"),
        (("render", "kept", "--height", "32", "--out", "/proc/p.png"), "cannot be written"),
        (("export", "kept", "--to", "pdf"), "no exporter called 'pdf'; there are svg, gcode, csv, png"),
        (("export", "kept", "--to", "gcode", "--press", "-1"), "press of -1 mm"),
        (("export", "kept", "--to", "gcode", "--lift", "nan"), "lift of nan mm"),
        (("export", "kept", "--to", "gcode", "--flavour", "fanuc"), "'fanuc'; it is one of grbl, marlin"),
        (("export", "kept", "--to", "gcode", "--calibration", "none.json"), "without --workspace"),
        (("export", "kept", "--to", "gcode", "--workspace", "none.toml"), "none.toml does not exist"),
        (("export", "kept", "--to", "gcode", "--workspace", "none.toml", "--press", "1"), "leave them out"),
        (("export", "kept", "--to", "svg", "--lift", "3"), "--lift was given with --to svg"),
        (("export", "kept", "--refill", "300"), "with --dips only"),
        (("export", "kept", "--to", "csv", "--dips"), "--dips was given with --to csv"),
        (("export", "kept", "--out", "strokes"), "with --to svg the file ends in .svg"),
        (("export", "kept", "--to", "csv", "--out", "strokes.svg"), "the file ends in .csv"),
        (("export", "kept", "--out", "kept/plan.json/s.svg"), "cannot be written"),
        (("render", "kept", "--out", "pipe.png"), "pipe.png cannot be written (it is there and is not a plain file)"),
        (("mix", "/dev/zero"), "/dev/zero is not a plain file"),
        (("resume", "x" * 5000), "is not the folder of a painting"),
        (("experiments", "sim2real", "--out", "/dev/null"), "(it is there and is not a folder)"),
        (("render",), "PLAN"),
        (("nothing",), "No such command 'nothing'"),
        (("strokes", "nothing"), "No such command 'nothing'"),
        (("strokes", "paint", "--count", "0"), "0 is not from 1 to 10000"),
        (("strokes", "paint", "--count", "some"), "'some' is not a whole number"),
        (("strokes", "paint", "--brush", "hairy"), "brushes are fine, medium, broad"),
        (("strokes", "paint", "--seed", "-1"), "-1 is not from 0 to 2147483647"),
        (("strokes", "train", "kept/plan.json"), "plan.json"),
        (("strokes", "train", "kept/plan.json", "--out", "weights"), "ends in .safetensors"),
    ],
)  # fmt: skip
def test_other_commands(words: tuple[str, ...], says: str, refuse: Callable[..., str], plan: Path) -> None:
    os.mkfifo(plan.parent.parent / "pipe.png")
    message = refuse(*words)
    assert says in message, message


def test_control_characters_in_names_do_not_reach_the_terminal(refuse: Callable[..., str]) -> None:
    assert "\x1b" not in refuse("paint", "bad\x1b[31mname.jpg")
    assert "[red]name.jpg" in refuse("paint", "[red]name.jpg")


def test_what_is_said_in_several_lines_arrives_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(**given: object) -> None:
        raise ConfigError("Something was changed:\n  seed: it was 1\x1b, and is 2\nChange it back.")

    monkeypatch.setattr(commands, "build", lambda: refused)
    assert run_command("resume") == 2
    told = capsys.readouterr().err
    assert told.splitlines()[1:] == ["  seed: it was 1\N{REPLACEMENT CHARACTER}, and is 2", "Change it back."]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_at_any_moment_ends_it_in_a_sentence(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def loading(**given: object) -> None:
        try:
            os.kill(os.getpid(), number)
            time.sleep(5)
        except KeyboardInterrupt:  # as Typer does
            sys.exit(130)

    monkeypatch.setattr(commands, "build", lambda: loading)
    monkeypatch.setattr(python_process, "isolate", lambda: None)
    known = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {each: signal.getsignal(each) for each in known}
    try:
        with pytest.raises(SystemExit) as end:
            command()
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
    told = capsys.readouterr().err
    assert end.value.code == 128 + number
    assert told == f"\nfrida-painter: it was ended ({number.name}); nothing more is done.\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_that_was_ignored_from_the_beginning_stays_so(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As of a painting under nohup, or one that a script has in the background while something else is in front."""

    def working(**given: object) -> None:
        with stop_on_signals() as stop:
            os.kill(os.getpid(), number)
            time.sleep(0.05)
            print("asked to stop" if stop.asked else "not asked")

    monkeypatch.setattr(commands, "build", lambda: working)
    monkeypatch.setattr(python_process, "isolate", lambda: None)
    known = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {each: signal.getsignal(each) for each in known}
    signal.signal(number, signal.SIG_IGN)
    try:
        with pytest.raises(SystemExit) as end:
            command()
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
    assert capsys.readouterr().out == "not asked\n" and not end.value.code


@pytest.mark.parametrize(("asked", "status"), [(True, 130), (False, 2)])
def test_a_stop_that_was_asked_for_ends_as_one_and_any_other_is_a_fault(
    asked: bool, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(**given: object) -> None:
        raise RobotStopped("dip: nothing moves, the arm was stopped (the stop file stop appeared); arm it", asked=asked)

    monkeypatch.setattr(commands, "build", lambda: stopped)
    assert run_command("resume") == status
    assert capsys.readouterr().err.count("nothing moves, the arm was stopped") == 1
