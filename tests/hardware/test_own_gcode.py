"""G-code of one's own: fields, length, motion that leaves the workspace, and where the lines stand in a program."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import ConfigError
from frida_painter.hardware.gcode import MAX_LINE, Gcode, OwnGcode, Servo, read_own
from frida_painter.hardware.robot import Waypoints
from support.easel import WORKSPACE  # x and y from -300 to 500 mm, z from 50 to 400 mm

SOLENOID = """
start = ["G28", "M106 S255"]
end = ["M107", "M18"]
lift = ["M5", "G4 P0.2"]
lower = ["M3 S{z}", "G4 P0.2"]
down_below = 0.102
dip = ["M62 P{well}"]
change = ["T1 (take {brush})"]
"""


def written(folder: Path, text: str) -> Path:
    (folder / "own.toml").write_text(text)
    return folder / "own.toml"


def stroke(*heights: float) -> Waypoints:
    path = np.array([(0.01 * number, 0.02, z) for number, z in enumerate(heights)])
    return Waypoints("stroke 1", path, 0.05)


def test_the_lines_stand_for_axis_and_servo(tmp_path: Path) -> None:
    language = Gcode(own=read_own(written(tmp_path, SOLENOID), WORKSPACE))
    lines = [line for _, line in language.lines(stroke(0.13, 0.1, 0.098, 0.13, 0.14))]
    assert lines == [
        "M5", "G4 P0.2", "G1 X0.000 Y20.000 F6000",
        "G1 X10.000 Y20.000 F3000", "M3 S100.000", "G4 P0.2", "G1 X20.000 Y20.000 F3000",
        "M5", "G4 P0.2", "G1 X30.000 Y20.000 F3000", "G1 X40.000 Y20.000 F3000",
    ]  # fmt: skip
    assert not any("Z" in line for line in lines) and not language.tells_height
    assert list(language.rise(0.2, (0.1, 0.05))) == ["M5", "G4 P0.2"]
    assert list(language.rise(0.09, (0.1, 0.05))) == list(language.own.at("lower", x=0.1, y=0.05, z=0.09, feed=0.1))


def test_lines_that_raise_the_brush_know_the_place_of_the_tip() -> None:
    own = OwnGcode(lift=("G0 X{x} Y{y} Z5",), lower=("G0 X{x} Y{y} Z0",), down_below=0.02)
    assert list(Gcode(own=own).rise(0.05, (0.1, 0.2))) == ["G0 X100.000 Y200.000 Z5"]
    assert list(Gcode(own=own).rise(0.01, (0.1, 0.2))) == ["G0 X100.000 Y200.000 Z0"]


def test_a_dip_and_a_change_have_their_lines_first(tmp_path: Path) -> None:
    language = Gcode(own=read_own(written(tmp_path, SOLENOID), WORKSPACE))
    dip = Waypoints("dip into well 3", np.zeros((1, 3)) + 0.1, 0.1, ("dip", "3"))
    assert next(language.lines(dip)) == (0, "M62 P3")
    change = Waypoints("take", np.zeros((1, 3)) + 0.1, 0.1, ("change", "my (broad) one; ~"))
    assert next(language.lines(change)) == (0, "T1 (take my__broad__one___)")
    assert "M62" not in " ".join(line for _, line in language.lines(stroke(0.1)))


@pytest.mark.parametrize(
    ("low", "high", "speed"),
    [
        ((0.1, 1), (0.1, 2), 0.05),
        ((0.0, float("nan")), (0.1, 2), 0.05),
        ((0.0, -1), (0.1, 2), 0.05),
        ((0.0, 1), (0.1, -2), 0.05),
        ((0.0, 1), (0.1, 2), 0.0),
    ],
)
def test_a_servo_that_cannot_be_is_refused(low: tuple[float, float], high: tuple[float, float], speed: float) -> None:
    with pytest.raises(ConfigError):
        Servo(low, high, speed)


def test_a_brush_is_raised_in_one_way_only(tmp_path: Path) -> None:
    own = read_own(written(tmp_path, SOLENOID), WORKSPACE)
    with pytest.raises(ConfigError, match="by a servo and by G-code of one's own"):
        Gcode(servo=Servo((0.0, 1), (0.1, 2)), own=own)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('lift = ["M5"]', "give all three or none"),
        ("down_below = 0.1", "give all three or none"),
        ('dip = ["M62 {colour}"]', r"unknown field {colour}; the fields there are {well}"),
        ('start = ["G1 X{x}"]', r"unknown field {x}; the fields there are none"),
        ('dip = ["M62 {}"]', "unknown field {}"),
        ('dip = ["M62 {well:03d}"]', r"has a field with a format; write {well} alone"),
        ('dip = ["M62 {well!r}"]', "has a field with a format"),
        ('dip = ["M62 {well.__class__}"]', "unknown field {well.__class__}"),
        ('dip = ["M62 {well"]', "cannot be read"),
        ('end = ["M117 done!"]', "printable ASCII without"),
        ('end = ["M117 fürs Erste"]', "printable ASCII without"),
        ('end = ["M5\\nM18"]', "printable ASCII without"),
        ('end = [""]', "is empty"),
        (f'end = ["M117 {"x" * 70}"]', "may become 75 characters long; at most 70 fit"),
        ('change = ["M117 take the brush that is called {brush}, and be quick about it"]', "may become 78"),
        ('end = "M5"', "end is not as it must be"),
        ("end = [5]", "end.0 is not as it must be"),
        ('finish = ["M5"]', "finish is not as it must be"),
        ("down_below = nan", "down_below is not as it must be"),
        ('start = ["G1 X900 Y0"]', r"goes to X 900.0 mm; the workspace reaches from -300.0 to 500.0 mm"),
        ('start = ["G1 X0 Y0 Z10"]', "goes to Z 10.0 mm"),
        ('start = ["G20", "G1 X30", "G21"]', "has G20, which changes the unit"),
        ('start = ["g1x900"]', "goes to X 900.0 mm"),
        ('start = ["G1 F100", "X900"]', "goes to X 900.0 mm"),
        ('start = ["G1 (X0) X900 ; X0"]', "goes to X 900.0 mm"),
        ('start = ["G91", "G1 X5", "G90"]', "from a place that cannot be known"),
        ('start = ["G1 X490", "G91", "G1 X20", "G90"]', "goes to X 510.0 mm"),
        ('start = ["G91"]', "end in relative coordinates"),
        ('start = ["G1 X450 Y0", "G2 X450 Y0 I30 J0"]', "has G2, which is an arc"),
        ('end = ["G28"]', "has G28, which drives to the machine's own home"),
        ('start = ["G92 X0"]', "has G92, which moves the zero"),
        ('start = ["G10 L2 P1 X0"]', "has G10, which moves the zero"),
        ('start = ["G53 G1 X0"]', "has G53, which leaves the work zero"),
        ('start = ["G55"]', "has G55, which is not known here"),
        ('start = ["G5 X0 Y0 P1 Q1"]', "cannot be read|is not known here"),
        ('start = ["M3 S1 G1 X900"]', "has an M code beside other codes"),
        ('start = ["M3 X900"]', "has an M code beside other codes or a place"),
        ('start = ["M5 G91"]', "has an M code beside other codes"),
        ('start = ["$X"]', "a command to the controller itself"),
        ('start = ["$110=9999"]', "a command to the controller itself"),
        ('start = ["G1 X#1"]', "cannot be read"),
    ],
)  # fmt: skip
def test_lines_that_cannot_be_trusted_are_refused_in_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as told:
        read_own(written(tmp_path, text), WORKSPACE)
    assert "\n" not in str(told.value) and "own.toml" in str(told.value)


@pytest.mark.parametrize(
    "text",
    [
        'start = ["$H"]', 'start = ["G28 X Y"]', 'end = ["M18", "; all is done"]', 'start = ["G1 X490 Y490 Z390 F500"]',
        'start = ["G1 X10 Y10", "G91", "G1 X20", "G90"]', 'start = ["M92 X80 Y80", "M3 S100"]',
        'lift = ["G91", "G1 Z0", "G90"]\nlower = ["G1 X{x} Y{y} Z{z} F{feed}"]\ndown_below = 0.1', "",
    ],
)  # fmt: skip
def test_lines_within_the_workspace_pass(tmp_path: Path, text: str) -> None:
    own = read_own(written(tmp_path, text), WORKSPACE)
    assert own is not None


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(-9, 9), st.floats(0.0001, 1), st.text(max_size=60))
def test_no_line_ever_becomes_longer_than_a_machine_reads(x: float, y: float, z: float, feed: float, name: str) -> None:
    lift = ("G1 X{x} Y{y} Z{z} F{feed} ; back to the top of it",)
    own = OwnGcode(lift=lift, lower=("M3",), change=("T1 ({brush})",), down_below=0.0)
    lines = [*own.at("lift", x=x, y=y, z=z, feed=feed), *own.at("change", brush=name)]
    assert all(len(line) <= MAX_LINE and line.isascii() and line.isprintable() for line in lines)
    assert ")" not in lines[1][:-1] and "(" not in lines[1][4:]
