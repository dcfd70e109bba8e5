import json
import math
import re
from pathlib import Path

import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.runs.spec import RunSpec, millimetres_and_degrees, upgrade_record


def fault(**values: object) -> str:
    with pytest.raises(ConfigError) as refused:
        RunSpec.of(**values)
    return str(refused.value)


def test_without_a_wish_everything_has_its_default() -> None:
    chosen = RunSpec.of()
    assert (chosen.strokes, chosen.colors, chosen.replans, chosen.brushes) == (300, 12, 4, None)
    assert str(chosen.canvas) == "356 x 279 mm"


def test_a_brush_gets_a_stroke_or_is_refused_and_paint_may_dry_at_once() -> None:
    assert RunSpec.of(brushes="broad:90%,fine:10%", strokes=6).shares == (0.9, 0.1)
    assert RunSpec.of(strokes=1).drying == 20 and RunSpec.of(drying=0.0).drying == 0


def test_few_strokes_bring_their_own_colors_and_replans() -> None:
    assert RunSpec.of(strokes=3).colors == 3
    assert [RunSpec.of(strokes=count).replans for count in (1, 2, 5, 300)] == [0, 1, 4, 4]
    assert RunSpec.of(strokes=3, colors=2, replans=1).colors == 2


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"strokes": 0}, "--strokes was given 0; it is a whole number from 1 to 20000"),
        ({"strokes": 10_000_000}, "from 1 to 20000"),
        ({"strokes": 3.5}, "--strokes was given 3.5; it is a whole number"),
        ({"strokes": "many"}, "--strokes was given 'many'"),
        ({"colors": 0}, "--colors was given 0; it is a whole number from 1 to 24"),
        ({"replans": -1}, "--replans was given -1; it is a whole number of at least 0"),
        ({"seed": -1}, "--seed was given -1; it is a whole number from 0 to 2147483647"),
        ({"effort": float("nan")}, "--effort was given nan; it is a number from 0.05 to 20"),
        ({"effort": float("inf")}, "--effort was given inf"),
        ({"render_height": 0}, "--render-height was given 0; it is a whole number from 64 to 2048"),
        ({"canvas": "0x0mm"}, "--canvas: A canvas 0 mm wide was given; each side is from 30 to 3000 mm"),
        ({"canvas": "100x100m"}, "100000 mm wide"),
        ({"canvas": "nanxnanmm"}, "'nanxnanmm' is not understood; give width x height with a unit"),
        ({"canvas": float("nan")}, "'nan' is not understood"),
        ({"brush": ""}, "--brushes was given ''; it is a name or a path"),
        ({"brushes": "broad,,fine"}, "names no brush at one place; write broad or broad:60%,medium:40%"),
        ({"brushes": "broad:60%,fine"}, "some have none; give shares to all of them or to none"),
        ({"brushes": "broad:60%,fine:30%"}, "the shares make 90 %; together they make 100 %"),
        ({"brushes": "broad:100%,fine:0%"}, "above 0 % and at most 100 %; leave brushes out that paint nothing"),
        ({"brushes": "broad:nan%,fine:40%"}, "a share is above 0 %"),
        ({"brushes": "broad:inf,fine:40%"}, "'broad:inf' is no share; write it in percent, as broad:60%,medium:40%"),
        ({"brushes": "broad:0.6,fine:0.4"}, "'broad:0.6' is no share; write it in percent"),
        ({"brushes": "broad:x%,fine:40%"}, "the share 'x%' of 'broad' is not a number"),
        ({"brushes": ",".join(["fine"] * 9)}, "9 brushes were given; there are at most 8 layers"),
        ({"brushes": 3}, "--brushes was given 3; it is a name or a path"),
        ({"brushes": "broad,fine", "layers": 3}, "3 layers and 2 brushes; leave out --layers"),
        ({"brushes": "broad,fine", "strokes": 1}, "2 layers for 1 stroke; give at most as many brushes"),
        ({"brushes": "broad", "brush": "fine"}, "give --brushes alone"),
        ({"colour": 3}, "'colour' is not a setting; near it is colors"),
        ({"qqq": 3}, "'qqq' is not a setting; there are avoid, beginning, brushes, calibration, camera"),
        ({"strokes": 5, "layers": 6}, "6 layers for 5 strokes; give at most as many layers as strokes"),
        ({"layers": 0}, "--layers was given 0; it is a whole number from 1 to 8"),
        (
            {"brushes": "broad:99%,fine:1%", "strokes": 6},
            "fine gets 1 % of 6 strokes, which is not one stroke; give it",
        ),
        ({"goal": [{"image": "x.png"}], "avoid": "text"}, "--avoid is for words, and the goal has none; leave it out"),
        ({"drying": -5.0}, "--drying was given -5.0; it is a number from 0 to 1440"),
        ({"drying": float("nan")}, "--drying was given nan; it is a number from 0 to 1440"),
        ({"ground": "blurple"}, "--ground: 'blurple' is not a ground; give auto, white, or a colour such as #c8a878"),
        ({"ground": "#12345"}, "'#12345' is not a ground"),
        ({"focus": "cats"}, "--focus: 'cats' is not a focus; give faces, none, or a place"),
        ({"paints": ""}, "--paints was given ''"),
        ({"darkest": "black"}, "--darkest: 'black' is not a colour; give one such as #202020"),
        ({"darkest": "#30303"}, "--darkest: '#30303' is not a colour"),
        ({"darkest": "#802020"}, "--darkest: #802020 is light, .* at most 102 of 255 in each band"),
        ({"ground": "auto", "on_canvas": True}, "--on-canvas paints on what is there, and --ground auto tones"),
        ({"minutes": 0.0}, "--minutes was given 0.0; it is a number from 1 to 10000"),
        ({"minutes": -20.0}, "--minutes was given -20.0; it is a number from 1 to 10000"),
        ({"minutes": float("nan")}, "--minutes was given nan; it is a number from 1 to 10000"),
        ({"minutes": 20.0, "robot": "human"}, "--minutes is the robot's time, and with --robot human a person paints"),
        (
            {"minutes": 30.0, "brushes": "broad,medium,fine"},
            "--minutes is 30, and between 3 layers paint dries for 40 min",
        ),
        ({"minutes": 20.0, "layers": 2}, "--minutes is 20, and between 2 layers paint dries for 20 minutes; give more"),
        ({"minutes": float("inf")}, "--minutes was given inf; it is a number from 1 to 10000"),
        ({"strokes": 5, "colors": 6}, "6 colors for 5 strokes; give at most as many colors as strokes"),
        ({"strokes": 5, "colors": 5, "replans": 5}, "5 replans for 5 strokes; .* at most 4"),
        ({"strokes": "x" * 10_000}, r"--strokes was given 'x{36}\.\.\.; it is"),
    ],
)
def test_what_is_not_allowed_is_named_with_what_is(values: dict[str, object], says: str) -> None:
    message = fault(**values)
    assert re.search(says, message), message
    assert message.endswith(".") and len(message) < 500 and "\n" not in message


def test_all_faults_are_named_at_once() -> None:
    message = fault(strokes=0, colors=99, effort=-1.0)
    assert all(name in message for name in ("--strokes", "--colors", "--effort"))


def toml(tmp_path: Path, content: str | bytes) -> Path:
    path = tmp_path / "settings.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_a_settings_file_may_name_a_former_setting_at_its_fixed_value(tmp_path: Path) -> None:
    assert RunSpec.from_toml(toml(tmp_path, "strokes = 9\nsharpness = 0.3\n")).strokes == 9
    with pytest.raises(ConfigError, match="sharpness"):
        RunSpec.from_toml(toml(tmp_path, "sharpness = 0.5\n"))


def test_a_file_is_read_and_the_command_line_goes_before_it(tmp_path: Path) -> None:
    path = toml(tmp_path, 'strokes = 50\ncolors = 5\ncanvas = "30x20cm"\neffort = 0.5\n')
    chosen = RunSpec.from_toml(path, colors=7)
    assert (chosen.strokes, chosen.colors, chosen.effort) == (50, 7, 0.5)
    assert chosen.canvas == CanvasSize.parse("300x200mm")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("strokes = ", "is not TOML"),
        ("strokes = 5\nstrokes = 6", "is not TOML"),
        (b"strokes = \xff", "is not TOML"),
        ("strokes = nan", "--strokes was given nan"),
        ("effort = nan", "--effort was given nan"),
        ("minutes = 0.5", "--minutes was given 0.5; it is a number from 1 to 10000"),
        ("stroks = 5", "'stroks' is not a setting"),
        ("[strokes]\nmany = 1", "--strokes was given"),
        ("strokes = true\ncolors = 5", "--strokes was given True"),
        ("x = " + "[" * 10_000, "is not TOML"),
    ],
)
def test_a_file_with_faults_is_refused_in_a_sentence(tmp_path: Path, content: str | bytes, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        RunSpec.from_toml(toml(tmp_path, content))


def test_a_file_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="does not exist"):
        RunSpec.from_toml(tmp_path / "settings.toml")
    with pytest.raises(ConfigError, match="is a folder"):
        RunSpec.from_toml(tmp_path)
    with pytest.raises(ConfigError, match="at most"):
        RunSpec.from_toml(toml(tmp_path, "#" * (2**20 + 1)))


def test_settings_become_plain_values_and_come_back() -> None:
    chosen = RunSpec.of(canvas="297x210mm", strokes=20)
    plain = json.loads(json.dumps(chosen.record()))
    assert plain["canvas"] == "297x210mm" and plain["version"] == 1
    assert RunSpec.of(**plain).record() == plain


def test_settings_are_read_from_their_folder_and_those_of_another_version_refused(tmp_path: Path) -> None:
    plain = RunSpec.of(strokes=10, canvas="120x90mm").record()
    file = tmp_path / "settings.json"
    file.write_text(json.dumps(plain))
    assert RunSpec.read(file).record() == plain
    for version in (0, 2, "1", True, 1.0, None):
        file.write_text(json.dumps({**plain, "version": version}))
        with pytest.raises(ConfigError, match=f"version {version!r}"):
            RunSpec.read(file)
    for damaged in ("[]", "{", json.dumps({"version": 1, "strokes": 10})):
        file.write_text(damaged)
        with pytest.raises(ConfigError, match="bring it back"):
            RunSpec.read(file)


@pytest.mark.parametrize(
    ("name", "usual", "other"),
    [("tilt", 0.0, 30.0), ("sharpness", 0.3, 0.5), ("timelapse_frames", 120, 60), ("initialiser", "growth", "uniform")],
)
def test_a_former_setting_is_read_if_it_was_the_usual_one(name: str, usual: object, other: object) -> None:
    record = RunSpec.of(strokes=20).record()
    assert RunSpec.of(**upgrade_record({**record, name: usual})).record() == record
    with pytest.raises(ConfigError, match=f"say {name} = {other}, and it is always"):
        upgrade_record({**record, name: other})


def test_what_is_painted_is_said_as_in_a_goal_file() -> None:
    spec = RunSpec.of(goal=[{"image": "me.jpg"}, {"text": "a lemon", "weight": 2}])
    assert [(item.kind, item.value, item.weight) for item in spec.goal] == [
        ("image", "me.jpg", 1),
        ("text", "a lemon", 2),
    ]
    for wrong, says in (
        ([{"text": "a", "style": "b"}], "--goal"),
        ([3], "--goal"),
        ([{"text": "a", "weight": -1}], "A weight of -1.0 was given to text 'a'; weights are above 0"),
        ([{"text": " "}], "--text was given no words"),
        ([{"smell": "roses"}], "There is no kind of goal called 'smell'"),
    ):
        with pytest.raises(ConfigError, match=says):
            RunSpec.of(goal=wrong)


def test_a_picture_in_the_studio_has_three_brushes_and_elsewhere_nobody_has_to_change_one() -> None:
    chosen = RunSpec.of()
    assert chosen.brush_names == ("broad", "medium", "fine") and chosen.shares == (0.3, 0.35, 0.35)
    for fewer in ({"strokes": 199}, {"minutes": 119}, {"minutes": 29, "drying": 5}):
        assert RunSpec.of(**fewer).brush_names == ("broad", "medium") and RunSpec.of(**fewer).shares == (0.5, 0.5)
    assert RunSpec.of(minutes=120).brush_names == chosen.brush_names
    assert RunSpec.of(layers=3).brush_names == RunSpec.of(robot="human", camera="x").brush_names == ("broad",)
    assert RunSpec.of(brush="fine").brush_names == RunSpec.of(brushes="fine").brush_names == ("fine",)
    assert RunSpec.of(brush="fine").with_values(brush="medium").brushes == "medium"
    several = RunSpec.of(brushes=["broad:50%", "medium:30%", "fine:20%"])
    assert several.brush_names == ("broad", "medium", "fine") and several.shares == (0.5, 0.3, 0.2)
    assert RunSpec.of(**several.record()).brushes == several.brushes == "broad:50%,medium:30%,fine:20%"
    assert RunSpec.of(brushes="my/brush.safetensors").brush_names == ("my/brush.safetensors",)


def test_words_alone_are_painted_with_a_finer_brush_over_the_broad_one() -> None:
    assert RunSpec.of(goal=[{"text": "a lemon"}]).brush_names == ("broad", "fine")
    assert RunSpec.of(goal=[{"image": "cat.jpg"}, {"text": "a lemon"}]).brush_names == ("broad", "medium", "fine")
    assert RunSpec.of(goal=[{"text": "a lemon"}], initial=[{"image": "cat.jpg"}]).brush_names == (
        "broad",
        "medium",
        "fine",
    )
    assert RunSpec.of(goal=[{"text": "a lemon"}], layers=2).brush_names == ("broad",)


@pytest.mark.parametrize(
    ("given", "brushes", "shares"),
    [
        ({"brushes": "fine", "strokes_of": "comma:40%"}, ("fine", "fine+comma"), (0.6, 0.4)),
        ({"brushes": "fine", "strokes_of": "comma:100%"}, ("fine+comma",), None),
        ({"strokes": 40, "strokes_of": "comma,zigzag"}, ("broad", "broad+comma", "broad+zigzag"), (0.6, 0.2, 0.2)),
        ({"brushes": "broad:50%,fine:50%", "strokes_of": "own.safetensors:20%"},
         ("broad", "fine", "fine+own.safetensors"), (0.4, 0.4, 0.2)),
        ({"brushes": "fine:70%,fine+comma:30%"}, ("fine", "fine+comma"), (0.7, 0.3)),
    ],
)  # fmt: skip
def test_a_family_is_a_layer_of_the_last_brush(given, brushes, shares):
    spec = RunSpec.of(**{"goal": [{"text": "a lemon"}], **given})
    assert spec.brush_names == brushes
    assert spec.shares == (None if shares is None else pytest.approx(shares))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"strokes_of": "comma:110%"}, "at most 100 %"),
        ({"strokes_of": "comma:20%,zigzag"}, "no family with a share"),
        ({"strokes_of": "fine+comma:20%"}, "no family with a share"),
        ({"strokes_of": "comma", "layers": 2}, "leave out --layers"),
    ],
)
def test_families_that_make_no_sense_are_refused(given, words):
    with pytest.raises(ConfigError, match=words):
        RunSpec.of(**{"goal": [{"text": "a lemon"}], **given})


@pytest.mark.parametrize(
    ("text", "shift", "degrees"),
    [
        ("4mm,2deg", (0.004, 0.0), 2.0),
        ("3mm,-2mm,-1.5deg", (0.003, -0.002), -1.5),
        (" .5mm , 0mm , 0deg ", (0.0005, 0.0), 0.0),
        ("4MM,2DEG", (0.004, 0.0), 2.0),
    ],
)
def test_what_is_understood(text: str, shift: tuple[float, float], degrees: float) -> None:
    error = millimetres_and_degrees(text)
    assert error is not None
    assert error[:2] == pytest.approx(shift) and error[2] == pytest.approx(math.radians(degrees))


def test_nothing_given_is_left_to_the_seed() -> None:
    assert millimetres_and_degrees(None) is None


@pytest.mark.parametrize("text", ["", "4,2", "4mm", "2deg", "4mm,2mm", "nanmm,2deg", "4cm,2deg", "1mm,1mm,1mm,1deg"])
def test_what_is_not_understood_is_told_what_would_be(text: str) -> None:
    with pytest.raises(ConfigError, match="4mm,2deg"):
        millimetres_and_degrees(text)


@pytest.mark.parametrize("text", ["60mm,0deg", "1mm,20deg", "40mm,40mm,0deg"])
def test_what_cannot_be_corrected_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="at most 50 mm and 15 degrees"):
        millimetres_and_degrees(text)
