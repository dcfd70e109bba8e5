"""Every edge can be taken away: a painting of a photograph has the same bytes without them, and loads few files."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from test_house import ROOT

PHOTO = ROOT.parents[1] / "examples" / "photographs" / "coffee.jpg"
MAX_LOADED = 160  # source files, of all processes of a painting; may only fall, and 100 are aimed at
SETTINGS = {"canvas": "12x9cm", "strokes": 6, "colors": 3, "render_height": 64, "effort": 0.05, "replans": 0}
# Python runs this before anything else in each process that has its folder on PYTHONPATH.
NOTING = """
import os, sys

class Noting:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0].startswith("frida_painter"):
            with open(os.environ["NOTED"], "a") as noted:
                noted.write(name + "\\n")
        # An edge, in the folder that this installation names.
        if name.startswith("frida_painter_") and not name.startswith("frida_painter_cli"):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Noting())
"""


def without_edges(folder: Path) -> Path:
    """A copy of the package without the edges, with the loops that numba compiled."""
    tree = folder / "src"
    for package in ROOT, ROOT.with_name("frida_painter_cli"):  # the packages beside these are edges
        shutil.copytree(package, tree / package.name)
    return tree


@pytest.mark.slow
def test_a_photograph_is_painted_the_same_without_any_edge(tmp_path: Path) -> None:
    with PaintingRun(RunSpec.of(goal=[{"image": str(PHOTO)}], film=False, **SETTINGS), tmp_path / "whole") as run:
        run.start()
    tree, noted = without_edges(tmp_path), tmp_path / "noted"
    (tmp_path / "sitecustomize.py").write_text(NOTING)
    options = [word for name, value in SETTINGS.items() for word in (f"--{name.replace('_', '-')}", str(value))]
    subprocess.run(
        [sys.executable, "-m", "frida_painter", "paint", PHOTO, *options, "--no-film", "--out", tmp_path / "bare"],
        env={
            **os.environ,
            "PYTHONPATH": f"{tmp_path}{os.pathsep}{tree}",
            "NOTED": str(noted),
            "XDG_CACHE_HOME": str(noted),  # no folder: nobody compiles loops that were copied with the tree
        },
        check=True,
        capture_output=True,
    )
    for name in ("painting.png", "plan.png", "strokes.csv"):
        assert (tmp_path / "bare" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), name
    loaded = set(noted.read_text().split())
    assert len(loaded) <= MAX_LOADED, " ".join(sorted(loaded))
