"""Presets of machines: each opens its driver, and a wrong one is refused in a sentence that names the entry."""

import math
import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware import preset as presets_module
from frida_painter.hardware.kinds import MachineName, RobotKind
from frida_painter.hardware.preset import Layout, Preset, find_preset, presets, read_preset
from frida_painter.hardware.robot import Reach

FOLDER = Path(str(resources.files("frida_painter.hardware") / "presets"))
OURS = presets()
MACHINES = [name for name, preset in OURS.items() if preset.is_machine]


def values(name="axidraw"):
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def changed(where, value):
    read = values()
    *sections, last = where.split(".")
    place = read
    for section in sections:
        place = place[section]
    place[last] = value
    return read


@pytest.mark.parametrize("name", MACHINES)
def test_a_preset_opens_its_driver_in_the_workspace_that_it_proposes(name):
    preset = OURS[name]
    kind = registry.parts(registry.ROBOTS)[preset.robot].load(RobotKind)
    workspace = Layout.propose(preset).workcell().workspace
    assert OURS["axidraw"].robot_name("P") == "axidraw:P,servo=-0.002/9855/0.01/27831"  # RB1, a standard servo
    assert OURS["nextdraw"].robot_name("P").endswith("servo=-0.002/5400/0.01/12600")  # RB2, in a narrow band
    name = preset.robot_name("10.0.0.9" if preset.connection == "network" else "/dev/x")
    robot = kind.open(MachineName.of(name), workspace)
    assert robot.resting == workspace.home


@pytest.mark.parametrize(("name", "package"), [("so101", "mink"), ("franka", "franky")])
def test_an_arm_reaches_the_places_that_its_preset_proposes(name, package):
    pytest.importorskip(package, reason=f"the extra `{name}` is not installed")
    preset = OURS[name]
    kind = registry.parts(registry.ROBOTS)[preset.robot].load(RobotKind)
    workcell = Layout.propose(preset).workcell()
    place = workcell.workspace
    robot = kind.open(MachineName.of(preset.robot_name("10.0.0.9")), place)
    assert isinstance(robot, Reach)
    corners = np.array([(x, y) for x in (0.0, workcell.canvas.width) for y in (0.0, workcell.canvas.height)])
    heights = workcell.press_height, place.top + place.hover
    canvas = [place.to_robot(corners, np.full(4, height)) for height in heights]
    tips = np.concatenate([*canvas, place.wells, [place.water, place.rag, place.home]])
    assert robot.reachable(tips).all(), tips[~robot.reachable(tips)]


@pytest.mark.parametrize(
    ("where", "value", "said"),
    [
        ("lift.hight", 1.0, "lift.hight is not known; there are by"),
        ("speed", 1.0, "speed is not known; there are title"),
        ("area.upper", [300, 0, 10], "metres"),
        ("motion.travel_speed", 150.0, "m/s"),
        ("lift.touch", math.nan, "lift.touch is nan"),
        ("area.lower", [math.inf, 0.0, 0.0], "area.lower[0] is inf"),
        ("lift.low", {"height": 0.012, "value": 9855}, "exchange them with their values"),
        ("lift.low", {"height": -0.002, "value": 27831}, "would not move"),
        ("lift.press", 0.002, "below lift.touch"),
        ("probe.corner", [0.0, 0.0, 1.0], "outside the area"),
        ("probe.zero", "robot", "belongs to probe.zero"),
        ("lift.by", "axis", "belong to lift.by = 'servo'"),
        ("lift", {"by": "servo", "low": {"height": -0.002, "value": 9855}}, "belong to lift.by = 'servo'"),
        ("area.lower", [0.0, 0.3, -0.002], "not below area.upper in y"),
        ("area.lower", [0.0, -0.01, -0.002], "at least 50 mm"),
        ("motion.painting_speed", 0.5, "is above motion.travel_speed"),
        ("motion.hover", 0.02, "above the area"),
        ("options", {"baud": "9600,homing=yes"}, "no comma or ="),
        ("title", "", "title is ''"),
    ],
)
def test_a_wrong_entry_is_named(where, value, said):
    with pytest.raises(ConfigError, match=r"^[^\n]*$") as told:
        Preset.of(changed(where, value), "mine")
    assert said in str(told.value)


def test_a_persons_own_preset_replaces_ours_and_stands_beside_them(tmp_path, monkeypatch):
    monkeypatch.setattr(presets_module, "user_folder", lambda: tmp_path)
    text = (FOLDER / "idraw.toml").read_text(encoding="utf-8")
    (tmp_path / "idraw.toml").write_text(text.replace("iDraw 1 A4", "mine"), encoding="utf-8")
    (tmp_path / "attic.toml").write_text(text, encoding="utf-8")
    found = presets()
    assert found["idraw"].title.startswith("mine")
    assert set(found) == {*OURS, "attic"}
    assert find_preset(str(tmp_path / "attic.toml")).name == "attic"
    with pytest.raises(ConfigError, match=r"no preset 'nobody'; take one of .*attic"):
        find_preset("nobody")


def test_a_preset_without_its_driver_says_which_there_are():
    stranger = values() | {"robot": "etch-a-sketch"}
    with pytest.raises(ConfigError, match="'etch-a-sketch', which is not installed here; there are xarm"):
        Preset.of(stranger, "mine").needed  # noqa: B018


def test_only_a_preset_of_the_project_is_printed():
    assert tomllib.loads(read_preset("idraw"))["title"].startswith("iDraw")
    for name in ("../presets/idraw", "nobody", "", "idraw.toml"):
        with pytest.raises(ConfigError, match="no preset"):
            read_preset(name)


def test_a_file_of_own_lines_is_found_beside_its_preset(tmp_path, monkeypatch):
    text = (FOLDER / "grbl-plotter.toml").read_text().replace("baud = 115200", 'baud = 115200, own = "own.toml"')
    (tmp_path / "mine.toml").write_text(text)
    monkeypatch.chdir("/")
    assert f"own={tmp_path / 'own.toml'}" in find_preset(str(tmp_path / "mine.toml")).robot_name("/dev/ttyUSB0")


def test_a_canvas_is_marked_by_three_corners_or_by_two_if_its_size_is_known():
    layout = Layout.propose(OURS["idraw"])
    left, right, _, top = layout.corners().values()
    size = layout.canvas
    for found in (layout.with_canvas(left, right, top), layout.with_canvas(left, right, None, size)):
        assert (found.canvas.width, found.canvas.height) == pytest.approx((size.width, size.height))
        assert found.workspace.canvas_angle == pytest.approx(0) and found.workspace.canvas_origin == left
    leaning = (top[0] + 0.02 * size.height + 0.01, top[1], top[2])
    for corners, known, says in (
        ((left, left, top), None, "lower corners are 0.0 mm apart"),
        ((left, right, leaning), None, "a canvas has right angles"),
        ((left, right, None), CanvasSize(size.width + 0.0031, size.height), "The lower edge was marked"),
        ((left, right, top), CanvasSize(size.width, size.height - 0.0031), "The left edge was marked"),
    ):
        with pytest.raises(ConfigError, match=says):
            layout.with_canvas(*corners, known)
