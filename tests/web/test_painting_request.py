import unicodedata
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from frida_painter.errors import ConfigError
from frida_painter.runs.goal_item import GoalItem
from frida_painter.runs.spec import RunSpec
from frida_painter.runs.variant_settings import VARIANTS, variant_of
from frida_painter_studio.form import SETTINGS
from frida_painter_studio.studio_folder import GoalRequest, PaintingRequest
from frida_painter_studio.web_app_easel import WebAppEasel

PICTURE = "0" * 32


def request_of(**more: Any) -> PaintingRequest:
    return PaintingRequest.model_validate({"terms": [{"kind": "image", "picture": PICTURE}], **more})


def test_the_goals_of_a_request_are_goal_items_with_the_files_of_their_pictures() -> None:
    asked = request_of(
        strokes=5, colors=12, replans=9, width=297, height=210, initial=[{"kind": "text", "words": 'a "sea"'}]
    )
    assert asked.goals(Path("here")) == {
        "goal": (GoalItem(kind="image", value=f"here/{PICTURE}.png", weight=1.0),),
        "initial": (GoalItem(kind="text", value='a "sea"', weight=1.0),),
    }
    assert asked.pictures == {PICTURE}
    cropped = request_of(terms=[{"kind": "image", "picture": PICTURE, "crop": [0, 0.25, 1, 0.5]}])
    assert PaintingRequest.model_validate_json(cropped.model_dump_json()) == cropped, "as the studio keeps it"
    assert cropped.goals(Path("here"))["goal"][0].crop == (0, 0.25, 1, 0.5)


def test_settings_are_those_of_the_description_and_a_blank_field_is_not_given() -> None:
    usual = {name: RunSpec.model_fields[name].default for name in SETTINGS}
    for asked in (request_of(), request_of(**dict.fromkeys(SETTINGS, ""))):
        assert {name: getattr(asked, name) for name in SETTINGS} == usual
    assert request_of(ground=" #C8A878 ").ground == "#c8a878", "as on the command line"


def test_the_description_of_a_request_is_for_the_studios_easel(tmp_path: Path) -> None:
    easel = WebAppEasel(tmp_path / "record.json", pace=0.5)
    (tmp_path / "hook.safetensors").write_bytes(b"")
    asked = request_of(strokes=5, colors=12, replans=9, width=297, height=210, strokes_of="hook,comma", title="Tea")
    spec = asked.spec(easel, tmp_path, tmp_path)
    assert (spec.colors, spec.replans, spec.pace, spec.title, spec.fit) == (5, 4, 0.5, "Tea", "crop")
    assert str(spec.canvas) == "297 x 210 mm" and spec.strokes_of == f"{tmp_path}/hook.safetensors:20%,comma:20%"
    for other in ("crook", "/etc/passwd", f"comma,{tmp_path}/hook.safetensors"):
        with pytest.raises(ConfigError, match="no stroke family"):
            request_of(strokes_of=other).spec(easel, tmp_path, tmp_path)
    unseen = replace(easel, robot="human", camera="none").validate()
    assert request_of(replans=9).spec(unseen, tmp_path, tmp_path).replans == 0


@pytest.mark.parametrize(
    ("asked", "strokes", "colors", "loose_brushes"),
    [
        ({}, {"loose": 110}, {"graphic": 5}, "broad:80%,medium:20%"),
        ({"strokes": 800, "colors": 16, "effort": 1.5}, {"loose": 110}, {"graphic": 5}, "broad:80%,medium:20%"),
        ({"strokes": 80, "colors": 6}, {}, {"graphic": 5}, None),
        ({"strokes": 400, "colors": 9, "brushes": "fine"}, {}, {}, "fine"),
        ({"strokes": 3, "colors": 2}, {}, {}, None),
    ],
    ids=["usual", "Detailed", "Quick study", "chosen one by one", "few"],
)
def test_what_a_person_chose_one_by_one_holds_in_all_variants_and_a_preset_does_not(
    asked: dict[str, Any], strokes: dict[str, int], colors: dict[str, int], loose_brushes: str | None, tmp_path: Path
) -> None:
    wanted, easel = request_of(**asked), WebAppEasel(tmp_path / "record.json")
    one = wanted.spec(easel, tmp_path, tmp_path)
    specs = {each.variant: each.spec(easel, tmp_path, tmp_path) for each in wanted.variants()}
    assert list(specs) == list(VARIANTS) and specs["faithful"] == one
    assert {name: spec.strokes for name, spec in specs.items()} == dict.fromkeys(VARIANTS, one.strokes) | strokes
    assert {name: spec.colors for name, spec in specs.items()} == dict.fromkeys(VARIANTS, one.colors) | colors
    assert specs["loose"].brushes == loose_brushes
    assert all(variant_of(spec, name) == spec for name, spec in specs.items()), "as `paint` fits it to the plan"


def test_a_request_of_an_upright_brush_is_read_and_one_of_a_leaning_brush_refused() -> None:
    """Version 0.3 kept `tilt`, in degrees."""
    assert request_of(tilt=0.0) == request_of()
    with pytest.raises(ValidationError, match="tilt"):
        request_of(tilt=20.0)


@given(st.text(max_size=300))
@settings(max_examples=40)
def test_all_words_arrive_as_they_were_said_but_for_what_nobody_sees(words: str) -> None:
    try:
        said = GoalRequest(kind="text", words=words).item(Path()).value
    except ValidationError:
        assert not request_of(title=words[:80]).title.strip()
    else:
        shown = "".join(mark for mark in unicodedata.normalize("NFC", words) if mark.isprintable() and mark != " ")
        assert "".join(mark for mark in said if mark.isprintable() and mark != " ") == shown
        assert said == " ".join(said.split()) and GoalRequest(kind="text", words=said).words == said


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("Screenshot 2026-11-29 at 3.45.12\u202fPM", "Screenshot 2026-11-29 at 3.45.12 PM"),  # macOS
        ("portrait \U0001f469\u200d\U0001f3a8", "portrait \U0001f469\u200d\U0001f3a8"),
        ("\u0645\u06cc\u200c\u062e\u0648\u0627\u0647\u0645", "\u0645\u06cc\u200c\u062e\u0648\u0627\u0647\u0645"),
        ("Cafe\u0301", "Caf\u00e9"),
        ("two\u00ad\u202eparts\ufeff", "twoparts"),
        ("a\nb\x1b[2J\x00 ", "a b [2J"),
        ("half a sign \ud83d", "half a sign"),
        ("\u200b\u00a0", ""),
    ],
)
def test_no_title_that_a_file_gives_is_refused(given: str, kept: str) -> None:
    assert request_of(title=given).title == kept


@pytest.mark.parametrize(
    ("record", "says"),
    [
        ({"terms": []}, "nothing to paint yet"),
        ({"terms": [{"kind": "image"}]}, "either words or a picture"),
        ({"terms": [{"kind": "text", "picture": PICTURE}]}, "either words or a picture"),
        ({"terms": [{"kind": "text", "words": "a", "picture": PICTURE}]}, "either words or a picture"),
        ({"terms": [{"kind": "text", "words": "   "}]}, "at least 1"),
        ({"terms": [{"kind": "text", "words": "\x1b\u200b"}]}, "at least 1"),
        ({"terms": [{"kind": "image", "picture": "../../etc/passwd"}]}, "match"),
        ({"terms": [{"kind": "pickle", "picture": PICTURE}]}, "image"),
        ({"terms": [{"kind": "image", "picture": PICTURE, "weight": float("nan")}]}, "finite"),
        ({"terms": [{"kind": "image", "picture": PICTURE, "weight": 0}]}, "greater"),
        ({"terms": [{"kind": "image", "picture": PICTURE}] * 9}, "at most 8"),
        *(
            ({"terms": [{"kind": "image", "picture": PICTURE, "crop": crop}]}, says)
            for crop, says in (
                ([float("nan"), 0, 0.5, 0.5], "finite"),
                ([0, 0, float("inf"), 0.5], "finite"),
                ([-0.1, 0, 0.5, 0.5], "inside"),
                ([0.6, 0, 0.5, 0.5], "inside"),
                ([0, 0.2, 1, 0.9], "inside"),
                ([0, 0, 0, 0.5], "at least 0.01"),
                ([0, 0, 1], "missing|4 items|required"),
            )
        ),
        ({"terms": [{"kind": "text", "words": "a", "crop": [0, 0, 1, 1]}]}, "cannot be cropped"),
        ({"strokes": 0}, "greater"),
        ({"strokes": 20_001}, "less"),
        ({"width": float("inf")}, "finite"),
        ({"minutes": 0}, "greater"),
        ({"minutes": float("nan")}, "finite"),
        ({"width": 1900, "height": 70}, "too narrow"),
        ({"brushes": "/dev/sda"}, "fine"),
        ({"brushes": "broad:10%"}, "together they make 100 %"),
        ({"paints": "/etc/passwd"}, "'acrylics' or 'any'"),
        ({"focus": "hands"}, "not a focus"),
        *(({"freedom": wrong}, "freedom") for wrong in (-0.1, 1.1, float("nan"))),
        ({"ground": "blue"}, "not a ground"),
        ({"variant": "wild"}, "no variant 'wild'"),
        *(({name: "x"}, "Extra") for name in ("palette", "calibration", "robot", "pictures")),
        ({"title": "a" * 81}, "at most 80"),
        ({"address": "http://evil"}, "Extra"),
    ],
)
def test_what_makes_no_sense_is_refused(record: dict[str, Any], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        request_of(**record)
