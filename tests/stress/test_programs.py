"""The programs that stress the painter still run, and find nothing in little time."""

import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from support.programs import load_program
from support.virtual_painting import VirtualPainting

PROGRAMS = Path(__file__).parent


def program(name: str) -> ModuleType:
    return load_program(PROGRAMS / f"{name}.py")


@pytest.mark.slow
def test_a_few_hostile_command_lines_are_refused_in_order() -> None:
    # In a process of its own, for it forks: what it forks would wait for ever for libvips' threads of a test process.
    command = [sys.executable, str(PROGRAMS / "hostile_commands.py"), "--lines", "8", "--seed", "1", "--seconds", "60"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert re.search(r"^8 lines: 0 wrong, \d went to work; exit status .*\b2: [1-8]", done.stdout, re.MULTILINE)


@pytest.mark.slow
def test_every_command_but_two_is_tried_with_all_that_it_takes():
    known = {one.path: one for one in program("hostile_commands").commands()}
    assert {("paint",), ("resume",), ("strokes", "train"), ("experiments", "replanning")} <= set(known)
    takes = {one.name: one.takes for one in known["paint",].parameters}
    assert takes["--brushes"] is str and takes["--settings"] is Path and takes["--strokes"] is int and takes[""] is Path


@pytest.mark.slow
def test_a_franka_paints_in_the_closed_loop(tmp_path: Path) -> None:
    pytest.importorskip("franky_sim")
    painting = program("franka").closed_loop(tmp_path, 2, 1, colors=1)
    assert painting.strokes == 2 and painting.looks == 2 and painting.rms < 3e-4
    assert float(painting.canvas.min()) < 0.9, "there is paint on the canvas"


@pytest.mark.slow
def test_an_so101_paints_in_the_closed_loop_as_exactly_as_it_was_told() -> None:
    pytest.importorskip("mink")
    pytest.importorskip("scservo_sdk")
    so101 = program("so101")
    one = so101.judged(VirtualPainting.made(), 2, 1, so101.PLAY, colors=1)
    assert one.painting.strokes == 2 and one.painting.looks == 2
    assert one.told / 4 < one.painting.rms < one.told
    assert float(one.painting.canvas.min()) < 0.9, "there is paint on the canvas"


@pytest.mark.slow
def test_a_painting_that_is_killed_while_it_finishes_is_resumed_whole(tmp_path):
    (kill,) = program("kills").killed(tmp_path, 4, [0.85])
    assert (kill.wrong, kill.painted) == ("", 4)
