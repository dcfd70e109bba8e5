"""The simulated Sawyer from the command line, whole."""

import json
from pathlib import Path

import pytest

from frida_painter.system import images
from support import data
from support.commandline import run_command

pytest.importorskip("mink")
SMALL = ("--render-height", "64", "--effort", "0.05", "--strokes", "4", "--colors", "1", "--robot", "sawyer-sim")


@pytest.fixture
def painting(tmp_path, monkeypatch):
    """painting(word, ...): the command's exit status, after painting a small photograph into `painted`."""
    monkeypatch.chdir(tmp_path)
    images.save(images.from_uint8(data.coffee()[::4, ::4].copy()), tmp_path / "photo.png")

    def painting(*words):
        return run_command("paint", "photo.png", *SMALL, *words, "--out", "painted")

    return painting


def test_it_paints_looks_and_paints_the_rest(painting):
    assert painting("--canvas", "200x150mm", "--replans", "1", "--no-film") == 0
    folder = Path("painted")
    assert json.loads((folder / "result.json").read_text())["strokes_painted"] == 4
    assert json.loads((folder / "settings.json").read_text())["robot"] == "sawyer-sim"
    page = (folder / "index.html").read_text()
    assert "Rethink Sawyer, simulated" in page
    assert "The arm at work" not in page
