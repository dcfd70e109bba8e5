"""Setup of a machine from the command line, over a simulated controller: first hour, leaving, continuing."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from frida_painter.calibration import Calibration
from frida_painter.hardware.workcell import WorkcellConfig
from machines.grbl import router as controller
from machines.simulated_time import Living
from support.commandline import Command

Run = Callable[..., tuple[int, str]]
READY = ["y", "y", "", "y", "", "y"]  # the preset's two sentences; it homes, and moves, but not by Enter
CANVAS = ["x-20 y+10", "ok", "ok"]  # two corners
HEIGHTS = ["n", "-13", "-1.5", "ok", "d", "d", "ok", "n"]  # and the canvas is flat
HIGHER = ["n", "-14", "ok", "d", "ok", "n"]
PAINT = ["3", "z-12", "ok", "z-12", "ok", "z-13", "ok", "z-12", "ok"]
TRACE = ["y"]
STROKES = ["y", "y"]
ALL = [*READY, *CANVAS, *HEIGHTS, *PAINT, *TRACE, *STROKES]


@pytest.fixture
def run(call: Command) -> Run:
    """run(word, ..., typing=[...]): exit status, and what was said, on one line."""
    return lambda *words, typing: call("setup", *words, typing=typing).briefly


@pytest.fixture
def router() -> Iterator[Living]:
    with Living(controller(), pace=60) as machine:
        yield machine


def on(machine: Living, folder: str = "easel") -> tuple[object, ...]:
    return ("--preset", "grbl-router", "--port", machine.name, "--canvas", "120x90mm", "--folder", folder)


def test_a_newcomer_sets_a_router_up_and_finds_all_that_painting_needs(
    run: Run, router: Living, tmp_path: Path
) -> None:
    status, told = run(*on(router), typing=ALL)
    assert status == 0, told
    folder = tmp_path / "easel"
    workcell = WorkcellConfig.load(folder / "workspace.toml")
    record = Calibration.load(folder / "calibration.json")
    assert record.touch_height == workcell.touch_height == pytest.approx(0.0005)
    assert record.press_height == workcell.press_height == pytest.approx(-0.0015)
    assert workcell.workspace.canvas_origin[:2] == pytest.approx((0.145, 0.05))
    wells = np.array(workcell.workspace.wells)
    assert len(wells) == 3 and np.allclose(np.diff(wells, axis=0, n=2), 0, atol=2e-5)
    with Image.open(folder / "setup.png") as picture:
        assert picture.size[0] > 600
    assert "--camera none" in told and str(folder / "workspace.toml") in told
    lows = np.array(router.controller.moved)[:, 2]
    assert lows.min() == pytest.approx(-1.5, abs=0.01), "the hardest of the test strokes, and nothing lower"


def test_a_setup_that_was_left_goes_on_where_it_was(run: Run, router: Living, tmp_path: Path) -> None:
    status, told = run(*on(router), typing=[*READY, *CANVAS, *HEIGHTS, "3", "z-12"])
    assert status == 130 or status == 2, told
    assert "continues at the step paint" in told
    for option, other in (("--canvas", "200x90mm"), ("--brush", "broad"), ("--name", "it"), ("--preset", "idraw")):
        status, told = run("--folder", "easel", option, other, typing=[])
        assert status == 2 and "was begun with" in told and "--anew" in told, "nothing that was said is dropped"
    kept = json.loads((tmp_path / "easel" / "setup.json").read_text())
    assert kept["done"] == ["canvas", "touch", "surface"]
    assert not (tmp_path / "easel" / "workspace.toml").exists()
    status, told = run("--folder", "easel", typing=["y", *PAINT, *TRACE, *STROKES])
    assert status == 0 and "Done: canvas, touch, surface" in told, told
    status, told = run("--folder", "easel", "--step", "touch", typing=["y", *HIGHER, *TRACE, *STROKES])
    assert status == 0, told
    record = Calibration.load(tmp_path / "easel" / "calibration.json")
    assert record.touch_height - record.press_height == pytest.approx(0.001)


def test_what_cannot_be_true_is_told_and_asked_again(run: Run, router: Living, tmp_path: Path) -> None:
    crooked = ["x-20 y+10", "ok", "x+9", "ok", "y"]  # 9 mm longer than the canvas was said to be
    beyond = ["x+400", "x-20 y+10", "ok", "ok"]  # outside of the machine
    upside_down = ["n", "ok", "ok", "y"]
    status, told = run(*on(router), typing=[*READY, *crooked, *beyond, *upside_down, *HEIGHTS, *PAINT, "n", "n", "n"])
    assert status == 2
    assert "was marked 129.0 mm long, and the canvas was said to have 120 mm" in told
    assert "Not moved" in told and "the workspace reaches from" in told
    assert "The hardest press was marked 0.0 mm below the lightest touch" in told
    assert "The outline was not right" in told
    assert np.abs(np.array(router.controller.moved)[:, 0]).max() < 300


@pytest.mark.parametrize(("damage", "said"), [('{"format": 1}', "no checksum"), ("nonsense", "cut off or not JSON")])
def test_a_damaged_state_is_refused(run: Run, tmp_path: Path, damage: str, said: str) -> None:
    (tmp_path / "easel").mkdir()
    (tmp_path / "easel" / "setup.json").write_text(damage)
    status, told = run("--folder", "easel", typing=[])
    assert status == 2 and said in told


def test_a_machine_that_feels_finds_the_touch_and_the_height_map_by_itself(
    run: Run, router: Living, tmp_path: Path
) -> None:
    router.controller.surface = 1.25
    status, told = run(*on(router), typing=[*READY, *CANVAS, "y", "y", "y", *PAINT, *TRACE, *STROKES])
    assert status == 0, told
    record = Calibration.load(tmp_path / "easel" / "calibration.json")
    assert record.touch_height == pytest.approx(0.00125) and record.press_height == pytest.approx(-0.00175)
    assert record.surface is not None and abs(record.surface.highest) < 1e-6 > abs(record.surface.lowest)
    assert sum(line.startswith("G38.3") for line in router.controller.received) == 10


@pytest.mark.parametrize("limited", [0, 1])
def test_a_homed_machine_that_stands_outside_the_presets_box_is_no_dead_end(
    run: Run, router: Living, tmp_path: Path, limited: int
) -> None:
    """M25: 1 mm off its switches, which are where this machine has them and not where the preset guessed."""
    machine = router.controller
    machine.settings["20"] = limited
    machine.switches[:], machine.stored[:] = (296, 174, 39), (-297, -175, -40)
    back = [] if limited else ["", "y"]  # its own limits tell its box; else the tip goes back, not by Enter
    _, told = run(*on(router), typing=[*READY[:4], *back, "", "y", "ok"])
    assert ("stands outside the workspace. Shall it go back slowly (x -6.2 mm, y -4.2 mm)" in told) != bool(limited)
    assert "bottom-right corner" in told and "continues at the step canvas" in told, told
    assert machine.state == "Idle" and machine.alarms == []


def test_a_machine_without_switches_is_asked_and_goes_on_without(run: Run, router: Living, tmp_path: Path) -> None:
    """M28."""
    router.controller.settings["22"], router.controller.state = 0, "Idle"
    _, told = run(*on(router), typing=["y", "y", "y", "y", "y", "ok"])
    assert "go on without limit switches?" in told and "front left corner of its travel" in told
    assert "bottom-right corner" in told and "$H" not in router.controller.received, told
