"""doctor --robot: what a controller tells, over a line on which a simulated one lives."""

import contextlib
from pathlib import Path

import pytest

from frida_painter.easel.kinds import is_machine
from frida_painter.errors import ConfigError, RobotDisconnected
from frida_painter.hardware.workcell import example
from frida_painter_calibration.commands.controller import examine_machine
from killing import ForkedCommand
from machines.grbl import CLONE, GRBL, GrblController
from machines.marlin import PLAIN, MarlinController
from machines.simulated_time import Living

Out = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def own_state_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("frida_painter.easel.connecting.state_folder", lambda: tmp_path / "state")


def test_a_grbl_as_it_comes_is_explained_and_nothing_moves(capsys: Out, tmp_path: Path) -> None:
    (tmp_path / "easel.toml").write_text(example())
    machine = GrblController(GRBL)
    with Living(machine) as line:
        assert examine_machine(f"gcode:{line.name}", tmp_path / "easel.toml")
    said = capsys.readouterr().out
    assert "It is GRBL 1.1h" in said and "It can paint." in said
    for warning in (
        "GRBL's default limits",
        "$1=25",
        "zero is to be found before it paints",
        "cannot do the painting speed",
    ):
        assert warning in said
    assert machine.moved == [] and not any(line.startswith(("G", "M")) for line in machine.received)


def test_what_cannot_work_is_refused(capsys: Out) -> None:
    with Living(GrblController(CLONE)) as line:
        assert not examine_machine(f"gcode:{line.name},sinks=yes", None)
    said = capsys.readouterr().out
    assert "x It releases its motors" in said and "It cannot paint like this." in said
    with Living(MarlinController(PLAIN)) as line:
        assert not examine_machine(f"marlin:{line.name},servo=-0.003/10/0.05/90", None)
    assert "M280 is an unknown command" in capsys.readouterr().out


def test_nobody_there_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RobotDisconnected, match="cannot be opened"):
        examine_machine(f"gcode:{tmp_path / 'ttyNOPE'}", None)
    with pytest.raises(ConfigError):
        is_machine("toaster:1")
    assert not is_machine("virtual") and is_machine("gcode:/dev/ttyUSB0")


def test_doctor_prints_it_and_its_status_says_if_it_can_paint(tmp_path: Path) -> None:
    with Living(GrblController(GRBL)) as line:
        for options, status in (("", 0), (",sinks=yes", 1)):
            words = ("doctor", "--robot", f"gcode:{line.name}{options}")
            with contextlib.closing(ForkedCommand(tmp_path, *words)) as doctor:
                out, err = doctor.communicate(timeout=120)
            assert doctor.returncode == status, err
            assert "It is GRBL 1.1h" in out
