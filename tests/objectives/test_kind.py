"""Kinds of goals are found by name, ours and those of others, and what is broken there breaks nothing here."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from pydantic import ValidationError

from frida_painter import registry
from frida_painter.errors import ConfigError
from frida_painter.objectives.objective import Gives, GoalKind, KnownKinds, goal_kinds
from frida_painter.registry import OBJECTIVES
from frida_painter.runs.goal_item import GoalItem
from frida_painter_cli.options import goal_options, tell_left_out
from frida_painter_studio.studio_folder import GoalRequest
from frida_painter_studio.web_studio import abilities
from frida_painter_words.text import TextTerm

OURS = ["image", "semantic", "sketch", "text", "style"]
Install = Callable[..., KnownKinds]


def kind(name: str = "mood", **more: Any) -> GoalKind:
    return GoalKind(name, Gives.WORDS, "A mood.", "Mood", TextTerm, **more)


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """install(name=object, ...): the kinds there are once a package is installed that names these entry points."""
    module = ModuleType("of_somebody")
    monkeypatch.setitem(sys.modules, "of_somebody", module)

    def installed(**named: Any) -> KnownKinds:
        vars(module).update(named)
        points = [("somebody", EntryPoint(name, f"of_somebody:{name}", OBJECTIVES)) for name in (*named, "absent")]
        monkeypatch.setattr(registry, "_points_of_others", lambda path: points)
        goal_kinds.cache_clear()
        return goal_kinds()

    yield installed
    goal_kinds.cache_clear()


def test_ours_are_there_whatever_was_installed_and_are_entry_points_too(install: Install) -> None:
    assert list(install().by_name) == OURS
    named = registry.OUR_PARTS[OBJECTIVES]
    assert list(named) == OURS
    for name, value in named.items():
        assert EntryPoint(name, value, OBJECTIVES).load() is goal_kinds()[name]
        assert goal_kinds()[name].name == name


def test_they_are_known_without_loading_what_plans() -> None:
    program = (
        "import sys; from frida_painter.objectives.objective import goal_kinds; assert len(goal_kinds().by_name) >= 5; "
        "print(sorted({'torch', 'cv2', 'numba', 'transformers'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_what_cannot_be_used_is_left_out_with_a_sentence_and_the_rest_stays(install: Install) -> None:
    known = install(mood=kind(), text=kind("text"), other="no kind at all")
    assert list(known.by_name) == [*OURS, "mood"] and known["text"].label == "Words"
    absent, other = known.complaints
    assert "'absent'" in absent and "AttributeError" in absent
    assert "'other'" in other and "is a str and should be a GoalKind" in other
    with pytest.raises(ConfigError, match=r"no kind of goal called 'sound'; there are image, .*mood"):
        known["sound"]


@pytest.mark.parametrize("name", ["", "Mood", "my-mood", "weight", "goal", "init_mood", "mood_weight", "a" * 31])
def test_names_that_no_kind_can_have(name: str) -> None:
    with pytest.raises(ConfigError, match="A kind of goal was called"):
        kind(name)


def test_every_kind_has_its_options_and_a_name_that_is_taken_has_none(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install(my_mood=kind("my_mood", initial_help="A first mood."), out=kind("out"))
    names = [option.name for option in goal_options()]
    assert names[: 2 * len(OURS)] == [name for one in OURS for name in (one, f"{one}_weight")]
    assert {"my_mood", "my_mood_weight", "init_my_mood", "init_text"} < set(names) and "init_sketch" not in names
    assert names[-1] == "goal"
    tell_left_out({"out"})
    said = capsys.readouterr().err
    assert "--out is another option already" in said and said.count("left out: 'absent'") == 1


def test_the_page_knows_them_too(install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FRIDA_PAINTER_MODELS", str(tmp_path))
    with pytest.raises(ValidationError, match="no such kind of goal; there are image"):
        GoalRequest(kind="mood", words="calm")
    install(mood=kind(networks=(("large-net", "small-net"),)))
    assert GoalRequest(kind="mood", words="calm").item(tmp_path) == GoalItem(kind="mood", value="calm")
    with pytest.raises(ValidationError, match="either words or a picture"):
        GoalRequest(kind="mood", picture="0" * 32)
    assert abilities()["mood"]["missing"] == ["small-net"] and abilities()["image"]["ready"]
