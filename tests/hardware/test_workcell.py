import math
import tomllib
from pathlib import Path

import pytest

from frida_painter.errors import ConfigError
from frida_painter.hardware.workcell import WorkcellConfig, example


def workcell(*changes: tuple[str, str], before: str = "") -> WorkcellConfig:
    text = example()
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return WorkcellConfig.of(tomllib.loads(before + text), "my.toml")


def fault(*changes: tuple[str, str], before: str = "") -> str:
    with pytest.raises(ConfigError) as refused:
        workcell(*changes, before=before)
    message = str(refused.value)
    assert message.startswith("my.toml is no workspace: ") and "workspace example" in message
    assert "\n" not in message
    return message


def test_the_example_is_a_whole_workspace() -> None:
    made = workcell()
    assert made.easel == "my easel" and len(made.workspace.wells) == 12
    assert str(made.canvas) == "356 x 279 mm"
    assert made.workspace.canvas_origin == (0.3, -0.1, 0.12) and made.workspace.home == (0.1, -0.25, 0.25)
    assert made.reach is not None and made.reach.farthest == 0.78


RACK = """
[rack]
places = { fine = [0.12, 0.26, 0.118], medium = [0.20, 0.26, 0.118], broad = [0.28, 0.26, 0.118] }
slide = [0.0, -0.05]
lift = 0.04
"""


def test_the_example_tells_how_a_rack_is_written() -> None:
    lines = example().replace("\n#[rack]", "\n[rack]").replace("\n#places", "\nplaces").replace("\n#slide", "\nslide")
    made = WorkcellConfig.of(tomllib.loads(lines.replace("\n#lift", "\nlift")), "my.toml").workspace
    assert made == WorkcellConfig.of(tomllib.loads(example() + RACK), "my.toml").workspace
    assert made.rack is not None and list(made.rack.places) == ["fine", "medium", "broad"]
    assert made.rack.front("fine") == pytest.approx((0.12, 0.21, 0.118))
    assert made.top == pytest.approx(0.158) and workcell().workspace.rack is None


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("lift = 0.04", "", "rack.lift is missing"),
        ("lift = 0.04", "lift = 0.9", "rack.lift is 0.9; it must be less than or equal to 0.5 (lengths are metres"),
        ("lift = 0.04", "lift = 0.16", "above the highest thing is at 0.308 m, above the upper bound (0.3 m)"),
        ("slide = [0.0, -0.05]", "slide = [0.0]", "rack.slide[1] is missing"),
        ("slide = [0.0, -0.05]", "slide = [0.0, 1, 2]", "rack.slide is [0.0, 1, 2]; Tuple should have at most 2 items"),
        ("slide = [0.0, -0.05]", "slide = [0.0, -0.01]", "rack.slide is 10 mm long; a brush is clear of its"),
        ("slide = [0.0, -0.05]", "slide = [0.0, 0.05]", "drawn out of its fork, is outside the bounds in y (0.31 m"),
        ("slide = [0.0, -0.05]", "slide = [0.08, 0.0]", "the fine brush is drawn out of its fork against the medium"),
        ("[0.12, 0.26, 0.118]", "[0.12, 0.29, 0.118]", "the fine brush in the rack is outside the bounds in y (0.29 m"),
        ("[0.12, 0.26, 0.118]", "[0.19, 0.26, 0.118]", "the fine and the medium brush stand in one place: they"),
        ("[0.12, 0.26, 0.118]", "[0.28, 0.00, 0.118]", "the fine brush in the rack stands where other brushes are"),
        ("[0.12, 0.26, 0.118]", "[0.12, 0.26]", "rack.places.fine[2] is missing"),
        ("{ fine = [0.12, 0.26, 0.118],", "{ fine = 3,", "rack.places.fine is 3"),
        (RACK[RACK.index("{") : RACK.index("}") + 1], "{ }", "rack.places is {}; Dictionary should have"),
        (RACK[RACK.index("{") : RACK.index("}") + 1], "[[0, 0, 0]]", "is [[0, 0, 0]]; it must be a valid dictionary"),
    ],
)  # fmt: skip
def test_a_rack_that_cannot_be_is_refused(old: str, new: str, says: str) -> None:
    assert old in RACK
    with pytest.raises(ConfigError) as refused:
        WorkcellConfig.of(tomllib.loads(example() + RACK.replace(old, new)), "my.toml")
    assert says in str(refused.value)


def test_the_turn_is_in_degrees_and_home_and_arm_may_be_left_out() -> None:
    text = example()
    made = workcell(
        ("turn = 0.0", "turn = 4"),
        ("home = [0.10, -0.25, 0.250]", ""),
        (text[text.index("[arm]") :], ""),
    )
    assert made.workspace.canvas_angle == pytest.approx(math.radians(4))
    assert made.workspace.home is None and made.reach is None


def test_its_first_record_has_the_heights_of_the_workspace() -> None:
    record = workcell().calibration("broad")
    assert (record.easel, record.brush) == ("my easel", "broad")
    assert (record.touch_height, record.press_height) == (0.12, 0.108)
    assert record.canvas == workcell().canvas and record.done == {}


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('easel = "my easel"', "", "easel is missing"),
        ('easel = "my easel"', 'easel = " "', "easel is ' '; it is a name of printable characters"),
        ('easel = "my easel"', 'easel = "my\\u001b[2J"', "it is a name of printable characters"),
        ('easel = "my easel"', "easel = 3", "easel is 3; it must be a valid string"),
        ('easel = "my easel"', 'esel = "my easel"', "esel is not known; there are easel, bounds"),
        ("[bounds]", "[bound]", "bounds is missing"),
        ("width = 0.3556", "", "canvas.width is missing"),
        (
            "width = 0.3556",
            "width = 355.6",
            "canvas.width is 355.6; it must be less than or equal to 3 (lengths are metres",
        ),
        ("width = 0.3556", "width = -0.3", "canvas.width is -0.3"),
        ("width = 0.3556", "width = nan", "canvas.width is nan"),
        ("width = 0.3556", 'width = "0.3556"', "canvas.width is '0.3556'; it must be a valid number"),
        ("width = 0.3556", "width = true", "canvas.width is True; it must be a valid number"),
        ("hover = 0.03", "hover = inf", "motion.hover is inf; it must be a finite number"),
        ("hover = 0.03", "hower = 0.03", "motion.hower is not known; there are hover"),
        ("painting_speed = 0.06", "painting_speed = 0", "motion.painting_speed is 0; it must be greater than 0"),
        ("rag_width = 0.08", "rag_width = -0.08", "paint.rag_width is -0.08"),
        ("water = [0.22, -0.20, 0.110]", "water = [0.22, -0.20]", "paint.water[2] is missing"),
        (
            "water = [0.22,",
            "water = [0.22, 0.1,",
            "paint.water is [0.22, 0.1, -0.2, 0.11]; Tuple should have at most 3 items",
        ),
        ("water = [0.22,", "water = [220,", "paint.water[0] is 220; it must be less than or equal to 10"),
        ("[0.22, 0.00, 0.118]", "[0.22, nan, 0.118]", "paint.wells[2][1] is nan"),
        ("farthest = 0.78", "farthest = 0.1", "arm.nearest (0.15 m) is not below arm.farthest (0.1 m)"),
        # Contradictions
        ("lower = [0.05,", "lower = [0.75,", "bounds.lower is not below bounds.upper in x (0.75 and 0.7 m)"),
        ("corner = [0.30,", "corner = [0.40,", "the canvas's bottom-right corner is outside the bounds in x (0.7556 m"),
        ("turn = 0.0", "turn = 20", "the canvas's top-right corner is outside the bounds in y"),
        ("[0.22, 0.15, 0.118]", "[0.22, 0.28, 0.118]", "well 6, with 8 mm around it, is outside the bounds in y"),
        ("water = [0.22, -0.20, 0.110]", "water = [0.22, -0.20, 0.09]", "the water, with 8 mm around it, is outside"),
        ("rag = [0.12,", "rag = [0.08,", "the rag, with 40 mm around it, is outside the bounds in x"),
        ("[0.22, 0.15, 0.118]", "[0.22, 0.115, 0.118]", "well 5 and well 6 overlap: they are 15 mm apart"),
        ("water = [0.22, -0.20,", "water = [0.22, -0.11,", "well 1 and the water overlap"),
        ("water = [0.22, -0.20,", "water = [0.14, -0.20,", "the water and the rag overlap"),
        ("[0.22, 0.15, 0.118]", "[0.40, 0.10, 0.118]", "well 6 overlaps the canvas"),
        ("hover = 0.03", "hover = 0.19", "motion.hover (0.19 m) above the highest thing is at 0.31 m"),
        ("home = [0.10, -0.25, 0.250]", "home = [0.10, -0.25, 0.14]", "motion.home is at 0.14 m, below the height"),
        ("home = [0.10, -0.25, 0.250]", "home = [0.10, -0.55, 0.250]", "motion.home is outside the bounds in y"),
        ("press_height = 0.108", "press_height = 0.121", "is -1 mm below brush.touch_height"),
        ("press_height = 0.108", "press_height = 0.05", "brush.press_height is outside the bounds in z (0.05 m"),
        ("press_height = 0.108", "press_height = 0.05", "is 70 mm below brush.touch_height"),
        ("touch_height = 0.120", "touch_height = 0.16", "more than 30 mm from the canvas"),
        ("travel_speed = 0.20", "travel_speed = 0.05", "motion.painting_speed (0.06 m/s) is above motion.travel_speed"),
    ],
)
def test_what_cannot_be_true_is_named_with_what_is_allowed(old: str, new: str, says: str) -> None:
    assert says in fault((old, new))


def test_all_faults_are_named_at_once_and_then_all_contradictions() -> None:
    message = fault(
        ('easel = "my easel"', ""),
        ("width = 0.3556", ""),
        ("hover = 0.03", "hover = nan"),
        ("rag_width = 0.08", "rag_width = 0.08\nrags = 2"),
        before="colour = 1\n",
    )
    for part in ("easel is missing", "colour is not", "canvas.width", "motion.hover", "paint.rags"):
        assert part in message
    message = fault(("press_height = 0.108", "press_height = 0.13"), ("travel_speed = 0.20", "travel_speed = 0.05"))
    assert "brush.press_height" in message and "motion.painting_speed" in message
    with pytest.raises(ConfigError) as refused:
        WorkcellConfig.of({"easel": "x", "bounds": 7, "canvas": [], "paint": {"wells": [], "water": 1}}, "my.toml")
    for part in ("bounds is 7; it must be a valid dictionary", "paint.wells is []; Tuple should have at least 1 item",
                 "paint.water is 1; it must be a valid tuple", "motion is missing"):  # fmt: skip
        assert part in str(refused.value)
    assert "arm" not in str(refused.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"[bounds", "is not TOML"),
        (b"easel = 1\neasel = 2", "is not TOML"),
        (b"easel = \xff", "is not TOML"),
        (b"x = " + b"[" * 10_000, "is not TOML"),
        (b"#" * 300_000, "at most"),
    ],
)
def test_files_that_are_none(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "my.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=says):
        WorkcellConfig.load(path)


def test_a_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text(example())
    assert WorkcellConfig.load(path) == workcell()
    with pytest.raises(ConfigError, match="does not exist"):
        WorkcellConfig.load(tmp_path / "other.toml")
