"""The command `teach` with an arm that is guided by hand: a terminal, an arm, a file of marks."""

import os
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from frida_painter.easel import connecting
from frida_painter.errors import ConfigError, MotionFailed
from frida_painter.hardware.latch import latches
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter_calibration.commands.teach import ArmOptions, FamilyOptions, guide, teach
from frida_painter_calibration.teaching.marks import read_marks
from machines.xarm_box import COLLISION, STANDBY, TEACHING, XarmBox, use_ports

pytest.importorskip("xarm", reason="the extra `xarm` is not installed")

ARM = "xarm:127.0.0.1,brush_length=0.1"


@pytest.fixture
def box(monkeypatch: pytest.MonkeyPatch) -> Iterator[XarmBox]:
    with XarmBox() as box:
        use_ports(box, monkeypatch)
        box.pose[2] = 400.0
        yield box


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A terminal: what is written to this file is typed by the person."""
    person, program = os.openpty()
    with os.fdopen(program) as screen:
        monkeypatch.setattr(sys, "stdin", screen)
        yield person
    os.close(person)


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(connecting, "state_folder", lambda: tmp_path / "state")
    monkeypatch.setattr("frida_painter_calibration.calibrating.default_record", lambda easel: tmp_path / "record.json")
    path = tmp_path / "studio.toml"
    path.write_text(example())
    return path


def lead(box: XarmBox, workspace: Path, keyboard: int, marks: int, collides: bool = False) -> threading.Thread:
    """A person who leads the arm along straight marks of 20 mm on the canvas, and then presses Enter."""
    cell = WorkcellConfig.load(workspace)

    def work() -> None:
        while box.mode != TEACHING or box.state != STANDBY:
            time.sleep(0.005)
        time.sleep(0.2)
        for number in range(marks):
            place = np.c_[0.1 + np.linspace(0, 0.02, 30), np.full(30, 0.1 + 0.01 * number)]
            height = (
                cell.touch_height + np.r_[np.linspace(0.01, -0.004, 6), [-0.004] * 18, np.linspace(-0.004, 0.01, 6)]
            )
            tip = cell.workspace.to_robot(place, height)
            box.guide(np.c_[1000 * (tip + np.array([0, 0, 0.1])), np.tile((np.pi, 0, 0), (30, 1))], 0.6)
        if collides:
            box._fail(COLLISION)
        else:
            os.write(keyboard, b"\n")

    thread = threading.Thread(target=work)
    thread.start()
    return thread


def test_marks_of_the_arm_go_to_a_file_and_the_arm_stays_stopped(
    box: XarmBox, workspace: Path, keyboard: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hand = lead(box, workspace, keyboard, marks=3)
    guide(ARM, workspace, "fine", tmp_path / "marks.json")
    hand.join()
    told = capsys.readouterr().out
    assert "The arm is released now: hold it" in told and "3 marks" in told and "frida-painter arm" in told
    taught = read_marks(tmp_path / "marks.json")
    assert len(taught) == 3
    for number, mark in enumerate(taught):
        assert mark.place[:, 1] == pytest.approx(0.1 + 0.01 * number, abs=1e-4)
        assert 0.01 < mark.size < 0.02 and mark.pressure.max() == pytest.approx(4 / 12, abs=0.01)
    assert box.mode == 0 and latches(tmp_path / "state")
    with pytest.raises(ConfigError, match=r"go into a new .json file, and not into .*marks.json"):
        guide(ARM, workspace, "fine", tmp_path / "marks.json")


def test_marks_that_were_drawn_before_a_fault_are_kept(
    box: XarmBox, workspace: Path, keyboard: int, tmp_path: Path
) -> None:
    hand = lead(box, workspace, keyboard, marks=2, collides=True)
    with pytest.raises(MotionFailed, match="error 31"):
        guide(ARM, workspace, "fine", tmp_path / "marks.json")
    hand.join()
    assert len(read_marks(tmp_path / "marks.json")) == 2


def test_what_is_missing_is_told_before_an_arm_is_released(
    workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ConfigError, match="say it with --workspace FILE"):
        guide(ARM, None, "fine", tmp_path / "marks.json")
    with pytest.raises(ConfigError, match=r"a new .json file"):
        guide(ARM, workspace, "fine", tmp_path / "marks.csv")
    with pytest.raises(ConfigError, match="--workspace was given without --robot"):
        teach(marks=tmp_path / "marks.json", of=FamilyOptions("hook"), arm=ArmOptions(workspace=workspace))
    with pytest.raises(ConfigError, match="No marks were given"):
        teach(of=FamilyOptions("hook"), arm=ArmOptions())
    with (tmp_path / "nobody").open("w+") as nobody:
        monkeypatch.setattr(sys, "stdin", nobody)
        with pytest.raises(ConfigError, match="run this in a terminal beside the arm"):
            guide(ARM, workspace, "fine", tmp_path / "marks.json")
    assert not latches(tmp_path / "state")
