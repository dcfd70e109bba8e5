from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from frida_painter.runs.goal_item import GoalItem
from frida_painter.runs.spec import RunSpec
from frida_painter_studio.studio_folder import GoalRequest, PaintingRequest

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


def test_what_matters_most_in_a_picture_is_asked_for_as_on_the_command_line() -> None:
    assert request_of().focus == "faces" and request_of(focus="none").focus == "none"
    with pytest.raises(ValidationError, match="'faces' or 'none'"):
        request_of(focus="hands")


def test_how_free_colors_are_is_asked_for_as_on_the_command_line() -> None:
    assert request_of().freedom == RunSpec.model_fields["freedom"].default and request_of(freedom=1).freedom == 1
    for wrong in (-0.1, 1.1, float("nan")):
        with pytest.raises(ValidationError, match="freedom"):
            request_of(freedom=wrong)


def test_a_request_of_an_upright_brush_is_read_and_one_of_a_leaning_brush_refused() -> None:
    """Version 0.3 kept `tilt`, in degrees."""
    assert request_of(tilt=0.0) == request_of()
    with pytest.raises(ValidationError, match="tilt"):
        request_of(tilt=20.0)


def test_people_who_do_not_mix_say_so() -> None:
    assert request_of().paints == RunSpec.model_fields["paints"].default and request_of(paints="any").paints == "any"
    with pytest.raises(ValidationError, match="paints"):
        request_of(paints="/etc/passwd")


@given(st.text(max_size=300))
@settings(max_examples=40)
def test_all_words_arrive_as_they_were_said_or_are_refused(words: str) -> None:
    try:
        term = GoalRequest(kind="text", words=words)
    except ValidationError:
        assert not words.strip() or not words.isprintable()
    else:
        assert term.item(Path()).value == term.words and term.words in words


@pytest.mark.parametrize(
    ("record", "says"),
    [
        ({"terms": []}, "nothing to paint yet"),
        ({"terms": [{"kind": "image"}]}, "either words or a picture"),
        ({"terms": [{"kind": "text", "picture": PICTURE}]}, "either words or a picture"),
        ({"terms": [{"kind": "text", "words": "a", "picture": PICTURE}]}, "either words or a picture"),
        ({"terms": [{"kind": "text", "words": "   "}]}, "at least 1"),
        ({"terms": [{"kind": "text", "words": "a\x1b[2J"}]}, "cannot be printed"),
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
        ({"title": "a\nb"}, "cannot be printed"),
        ({"address": "http://evil"}, "Extra"),
    ],
)
def test_what_makes_no_sense_is_refused(record: dict[str, Any], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        request_of(**record)
