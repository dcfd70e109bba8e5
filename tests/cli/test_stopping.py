"""Stopping a painting from outside, in every state: processes of their own, and real signals."""

import json
import signal
import time
from pathlib import Path

from PIL import Image

from frida_painter.easel.kinds import STOP_FILE
from frida_painter.hardware.latch import latches
from killing import ForkedCommand
from session.easel_errands import moves, until
from support import data

SMALL = (
    "--canvas",
    "120x90mm",
    "--fit",
    "crop",
    "--render-height",
    "64",
    "--effort",
    "0.05",
    "--brush",
    "fine",
    "--no-film",
)


class Painter:
    """`frida-painter` in a process of its own, in a folder with a photograph."""

    def __init__(self, place: Path, *words: str) -> None:
        self.folder, self.state = place / "painted", place / "state"
        photo = place / "cup.png"
        if not photo.exists():
            Image.fromarray(data.coffee()).resize((300, 200)).save(photo)
        self.process = ForkedCommand(place, *words, env={"XDG_STATE_HOME": str(self.state)})

    def wait_for(self, name: str, strokes: int = 0) -> None:
        """Until it has written that file, and has begun that many motions at its pace."""
        until(lambda: self.process.poll() is not None or (self.folder / name).exists(), 600)
        until(lambda: self.process.poll() is not None or len(moves(self.folder)) >= strokes, 300)
        assert self.process.poll() is None, self.process.communicate()

    def end(self, within: float = 300) -> tuple[int, str, str]:
        try:
            out, err = self.process.communicate(timeout=within)
        finally:
            self.process.close()
        assert self.process.returncode is not None
        return self.process.returncode, out, err


def paint(place: Path, *words: str) -> Painter:
    return Painter(place, "paint", "cup.png", "--strokes", "24", "--replans", "1", *SMALL, "--out", "painted", *words)


def held(painter: Painter) -> list[str]:
    """Why robots are latched: no simulated one ever is."""
    found = [latch.read() for latch in latches(painter.state / "frida-painter")]
    return [stop.reason for stop in found if stop is not None]


def result(painter: Painter) -> dict:
    assert (painter.folder / "index.html").exists() and (painter.folder / "painting.png").exists()
    return json.loads((painter.folder / "result.json").read_text())


def test_ctrl_c_twice_stops_the_robot_and_writes_the_page(tmp_path: Path) -> None:
    """Faults F8: a stop is pressed; F34: a signal ends the program at any moment."""
    painter = paint(tmp_path, "--pace", "1")
    painter.wait_for("plan.json", strokes=4)
    painter.process.send_signal(signal.SIGINT)
    time.sleep(0.3)
    asked = time.monotonic()
    painter.process.send_signal(signal.SIGINT)
    status, out, err = painter.end()
    assert status == 130, err
    assert time.monotonic() - asked < 60 and "Traceback" not in err
    told = result(painter)
    assert told["stopped"] and told["strokes_painted"] < 24 and "Stopped after" in out
    count = len(moves(painter.folder))
    assert not held(painter)

    (painter.folder / STOP_FILE).touch()  # too late for that sitting, and none of the next one
    resumed = Painter(tmp_path, "resume", "painted", "--yes")
    until(lambda: resumed.process.poll() is not None or len(moves(painter.folder)) > count, 300)
    assert resumed.process.poll() is None, "a simulated robot needs nobody who arms it"
    resumed.process.send_signal(signal.SIGTERM)
    resumed.end()


def test_a_closed_terminal_ends_it_within_a_stroke(tmp_path: Path) -> None:
    """Fault F34: a signal ends the program at any moment."""
    painter = paint(tmp_path, "--pace", "0.3")
    painter.wait_for("plan.json", strokes=3)
    painter.process.send_signal(signal.SIGHUP)
    ended, _, err = painter.end()
    assert ended == 129 and "Traceback" not in err, err
    assert not held(painter)
    told = result(painter)
    assert told["stopped"] and 0 <= told["strokes_painted"] < 24


def test_whoever_ends_it_while_planning_leaves_nothing_half_done(tmp_path: Path) -> None:
    """Faults F34: a signal ends the program at any moment; B12: a very busy machine and a simulated robot."""
    painter = paint(tmp_path, "--effort", "5")
    painter.wait_for("studio.diary")
    painter.process.send_signal(signal.SIGTERM)
    asked = time.monotonic()
    ended, _, err = painter.end()
    assert ended == 143 and "Traceback" not in err, err
    assert time.monotonic() - asked < 60 and not held(painter)
    assert not (painter.folder / "plan.json").exists()


def test_the_stop_file_stops_a_painting_that_is_planning(tmp_path: Path) -> None:
    """Fault F8: a stop is pressed."""
    painter = paint(tmp_path, "--effort", "20")
    painter.wait_for("studio.diary", strokes=1)
    until(lambda: painter.process.poll() is not None or (painter.folder / "journal").exists(), 300)
    (painter.folder / STOP_FILE).touch()
    status, out, err = painter.end()
    require_stopped(painter, status, out, err)
    assert len(moves(painter.folder)) == 1, "the first look, and nothing since"
    assert not (painter.folder / "plan.json").exists(), "nobody plans on for a robot that stands still"


def test_the_stop_file_stops_a_painting_in_the_middle_of_a_motion_and_keeps_the_work(tmp_path: Path) -> None:
    """Fault F8: a stop is pressed."""
    painter = paint(tmp_path, "--pace", "4")
    painter.wait_for("plan.json", strokes=3)  # dips of many seconds, and strokes
    (painter.folder / STOP_FILE).touch()
    status, out, err = painter.end()
    require_stopped(painter, status, out, err)
    told = result(painter)
    assert told["stopped"] and told["strokes_painted"] < 24 and "Stopped after" in out
    count = len(moves(painter.folder))
    time.sleep(1)
    assert len(moves(painter.folder)) == count


def require_stopped(painter: Painter, status: int, out: str, err: str) -> None:
    """It ended as a painting that a person stopped, and said so in a sentence; the file is gone again."""
    assert status == 130 and "Traceback" not in err, (status, out, err)
    assert err.count("was stopped (the stop file stop appeared)") == 1, err
    assert not held(painter) and not (painter.folder / STOP_FILE).exists()
