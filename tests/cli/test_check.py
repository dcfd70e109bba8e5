import re
from pathlib import Path

import pytest

from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter.system import images
from frida_painter_calibration.commands.controller import examine
from machines import grbl, marlin
from machines.bench import tell_zero
from machines.simulated_time import SimulatedTime, simulated_time
from support.commandline import run_command
from support.plans import made_up_plan

__all__ = ["simulated_time"]  # a fixture


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "plan.json"
    made_up_plan(30, 4).save(path)
    return path


def workspace(*changes: tuple[str, str]) -> Path:
    text = example().replace("width = 0.3556", "width = 0.3").replace("height = 0.2794", "height = 0.2")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = Path("my.toml")
    path.write_text(text)
    return path


def test_the_virtual_studio_takes_every_plan(plan, capsys) -> None:
    assert run_command("check", plan) == 0
    told = capsys.readouterr().out
    assert "30 strokes in 4 paints: all of it can be painted." in told
    assert re.search(r"The robot takes \d+ min \d\d s without looks and planning: strokes .*, travel .*\.", told)
    assert not Path("check.png").exists()


@pytest.mark.parametrize("robot", ["human", "gcode:/dev/ttyUSB0"])
def test_a_plan_is_checked_for_a_robot_by_name(plan, capsys, robot) -> None:
    words = () if robot == "human" else ("--workspace", workspace())
    assert run_command("check", plan, "--robot", robot, *words) == 0
    assert "all of it can be painted" in capsys.readouterr().out


def test_strokes_out_of_reach_are_named_and_drawn_in_red(plan, capsys) -> None:
    short = workspace(("farthest = 0.78", "farthest = 0.5"))
    assert run_command("check", plan, "--workspace", short, "--out", "red.png") == 1
    told = capsys.readouterr().err
    concerned = re.search(r"(\d+) of 30 strokes are concerned", told)
    assert concerned and 0 < int(concerned[1]) < 30
    assert re.search(r"stroke \d+: the arm does not reach \(", told) and "What to do: move" in told
    red, green, blue = images.load(Path("red.png"))[:, :900]
    alarming = (red > 0.7) & (green < 0.2) & (blue < 0.25)
    width = alarming.shape[1]
    assert alarming[:, width // 2 :].sum() > 500, "those far from the arm, at the right"
    assert alarming[:, : width // 4].sum() < 50


def test_another_canvas_and_missing_wells_are_told_together(plan, capsys) -> None:
    wells = re.search(r"wells = \[.*?\n\]", example(), re.DOTALL)
    assert wells
    other = workspace((wells[0], "wells = [[0.22, 0.0, 0.118]]"), ("width = 0.3\n", "width = 0.25\n"))
    assert run_command("check", plan, "--workspace", other) == 1
    told = capsys.readouterr().err
    assert "the plan is for a canvas of 300 x 200 mm, and the easel's is 250 x 200 mm" in told
    assert "the plan has 4 paints, and the workspace 1 wells" in told


@pytest.mark.parametrize("camera", ["none", "opencv:0"])
@pytest.mark.parametrize(
    ("words", "refused"),
    [
        (("check", "plan.json"), ""),
        (("check", "plan.json", "--camera", "none"), ""),
        (("check", "plan.json", "--camera", "opencv:0"), "none"),
        (("export", "plan.json", "--to", "gcode"), ""),
    ],
)
def test_a_record_is_taken_whether_or_not_a_camera_measured_it(monkeypatch, plan, words, refused, camera) -> None:
    known = WorkcellConfig.load(workspace()).calibration("medium", camera=camera)  # `setup` writes "none"
    if camera != "none":
        known = known.with_canvas(known.corners, known.photograph, camera=camera, canvas=known.canvas, residual=0.1)
    known.save(Path("record.json"))
    status = run_command(*words, "--workspace", "my.toml", "--calibration", "record.json")
    assert status == (2 if camera == refused else 0)
    blind = WorkcellConfig.load(Path("my.toml")).calibration("medium", camera="none")
    assert examine(Path("record.json"), blind, named=True), (
        "`doctor --camera none` says what `paint --camera none` does"
    )


def test_a_record_of_another_brush_is_refused(plan, capsys, tmp_path) -> None:
    WorkcellConfig.load(workspace()).calibration("fine").save(tmp_path / "record.json")
    assert run_command("check", plan, "--workspace", "my.toml", "--calibration", "record.json") == 2
    assert "fine" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("check",), "PLAN"),
        (("check", "nowhere.json"), "nowhere.json does not exist"),
        (("check", "plan.json", "--workspace", "nowhere.toml"), "nowhere.toml does not exist"),
        (("check", "plan.json", "--workspace", "bad.toml"), "canvas.width is nan"),
        (("check", "plan.json", "--workspace", "plan.json"), "is not TOML"),
        (("check", "plan.json", "--calibration", "nowhere.json"), "nowhere.json"),
        (("check", "plan.json", "--robot", "kuka"), "There is no robot 'kuka'"),
        (("check", "plan.json", "--robot", "gcode:/dev/x"), "say it with --workspace"),
        (("check", "plan.json", "--robot", "gcode:/dev/x,speed=9", "--workspace", "good.toml"), "does not know speed"),
        (("check", "plan.json", "--out", "check.svg"), "ends in .png or .jpg"),
        (("workspace", "draw", "bad.toml"), "canvas.width is nan"),
        (("workspace", "draw", "nowhere.toml"), "nowhere.toml does not exist"),
    ],
)
def test_what_cannot_be_checked_is_refused_in_a_sentence(plan, capsys, words, says) -> None:
    Path("bad.toml").write_text(example().replace("width = 0.3556", "width = nan"))
    Path("good.toml").write_text(example())
    assert run_command(*words) == 2
    told = capsys.readouterr().err
    assert says in told and told.count("\n") == 1


def test_the_example_can_be_redirected_and_drawn(monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command("workspace", "example") == 0
    Path("mine.toml").write_text(capsys.readouterr().out)
    assert run_command("workspace", "draw", "mine.toml") == 0
    assert "my easel: 12 wells, canvas of 356 x 279 mm" in capsys.readouterr().out
    drawing = images.load(Path("workspace.png"))
    assert drawing.shape[2] > 1000 and float(drawing.std()) > 0.03


def test_a_controller_that_does_not_answer_is_told(plan, capsys) -> None:
    assert run_command("check", plan, "--robot", "gcode:/dev/nobody", "--workspace", workspace()) == 0
    told = capsys.readouterr().out
    assert "Its controller could not be asked, so its own limits are not checked: " in told
    assert "all of it can be painted" in told


def _seconds(told: str) -> int:
    found = re.search(r"The robot takes (?:(\d+) h )?(\d+) min (?:(\d+) s)?", told)
    assert found is not None, told
    hours, minutes, seconds = (int(part or 0) for part in found.groups())
    return 3600 * hours + 60 * minutes + seconds


def test_a_slow_controller_is_asked_for_its_speeds(simulated_time: SimulatedTime, plan, capsys) -> None:
    machine = grbl.GrblController(grbl.GRBL)  # 500 mm/min and 10 mm/s2, as it comes
    cable = simulated_time.attach(machine)
    assert run_command("check", plan, "--robot", f"gcode:{cable.name}", "--workspace", workspace()) == 0
    slow = capsys.readouterr().out
    assert "Warning: The machine cannot do the painting speed of 60 mm/s: its controller allows 8.33 mm/s" in slow
    assert run_command("check", plan, "--workspace", "my.toml") == 0
    assert _seconds(slow) > 3 * _seconds(capsys.readouterr().out)
    assert not machine.moved


def test_what_is_beyond_a_machines_own_limits_is_told(simulated_time: SimulatedTime, plan, capsys) -> None:
    build = marlin.Build(lowest=(-1000, -1000, -135), highest=(1000, 1000, 400))
    machine = marlin.MarlinController(build)
    cable = simulated_time.attach(machine)
    place = workspace()
    words = ("check", plan, "--robot", f"marlin:{cable.name}", "--workspace", place)
    assert run_command(*words) == 0, "its zero is not known: only its travel counts"
    tell_zero(Gcode("marlin"), cable.name, (0.0, 0.0, 0.25))  # it ends 135 mm below; the hardest press is at 108 mm
    capsys.readouterr()
    assert run_command(*words) == 1
    told = capsys.readouterr().err
    assert re.search(r"stroke \d+: z = 0\.1\d* m at waypoint \d+; the machine's own limits are 115\.0 to", told), told
    assert "What to do: move the canvas into its travel, or change its limits if they are wrong" in told
    assert Path("check.png").exists() and not machine.moved


def test_a_machine_with_too_little_travel_is_told_before_its_zero_is_found(
    simulated_time: SimulatedTime, plan, capsys
) -> None:
    small = {**grbl.QUICK, "20": 1, "130": 200.0, "131": 900.0, "132": 300.0}
    machine = grbl.GrblController(grbl.GRBL, small)
    cable = simulated_time.attach(machine)
    assert run_command("check", plan, "--robot", f"gcode:{cable.name}", "--workspace", workspace()) == 1
    told = capsys.readouterr().err
    assert re.search(r"needs \d+\.\d mm along x, and the machine's own limits leave 200\.0 mm of travel", told), told
    assert not machine.moved
