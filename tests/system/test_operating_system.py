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

    small = ("--strokes", 8, "--colors", 2, "--replans", 1, "--render-height", 64, "--effort", 0.05)
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
    painted = [record["stroke"] for record in EventLog.read(folder / "journal") if record["kind"] == "stroke_painted"]
    assert len(painted) == 8 and not list(folder.glob(".*-part-*"))
    assert list(environment) and (folder / "painting.png").exists()
