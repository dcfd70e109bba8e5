from pathlib import Path
from typing import Any

import pytest

from frida_painter import registry
from frida_painter.runs.spec import RunSpec
from frida_painter_studio.form import SETTINGS, describe_form, name_settings
from frida_painter_studio.studio_folder import PaintingRequest
from frida_painter_studio.web_app_easel import WebAppEasel
from plugins import install

RECORD = Path("record.json")
REAL = WebAppEasel(RECORD, robot="xarm:10.0.0.2", camera="opencv:0", workspace=Path("workspace.toml"))
EASELS = {
    "virtual": WebAppEasel(RECORD),
    "real": REAL,
    "unseen": WebAppEasel(RECORD, robot="xarm:10.0.0.2", camera="none", workspace=Path("workspace.toml")),
    "by hand": WebAppEasel(RECORD, robot="human", camera="opencv:0"),
}
GOAL = [{"kind": "image", "picture": "0" * 32}]


def shown(easel: WebAppEasel) -> dict[str, dict[str, Any]]:
    return {control["name"]: control for control in describe_form(easel, ["comma"])["controls"]}


@pytest.mark.parametrize("easel", EASELS.values(), ids=EASELS)
def test_every_choice_of_the_form_can_be_painted(easel: WebAppEasel, tmp_path: Path) -> None:
    usual = describe_form(easel, [])["usual"]
    offered = [{}, {"seed": 1}]
    for name, control in shown(easel).items():
        offered += [option["sets"] for option in control["options"]]
        offered += [{name: step} for step, _ in control.get("steps", ())]
    for sets in offered:
        asked = PaintingRequest.model_validate({"terms": GOAL, **usual, **sets})
        assert {name: getattr(asked, name) for name in usual} == usual | sets
        spec = asked.spec(easel, tmp_path, tmp_path)
        assert isinstance(spec, RunSpec) and spec.robot == easel.robot


def test_a_setting_is_asked_for_where_it_does_something() -> None:
    names = {easel: shown(EASELS[easel]).keys() for easel in EASELS}
    assert names["real"] - names["virtual"] == {"drying"}
    assert names["real"] - names["unseen"] == {"replans"}
    assert names["real"] - names["by hand"] == {"minutes"}
    told = {name: control["level"] for name, control in shown(REAL).items()}
    assert [name for name, level in told.items() if level == "first"] == ["detail"]
    assert [name for name, level in told.items() if level == "semantic"] == ["freedom"]
    assert set(told) - {"detail", "canvas", "initial"} <= set(SETTINGS)


def test_values_are_said_in_words() -> None:
    told = shown(REAL)
    assert told["replans"]["steps"][:2] == [(0, "none"), (1, "once it looks and replans")]
    assert told["minutes"]["steps"][:2] == [(None, "as long as it takes"), (10, "at most 10 minutes")]
    assert [words for _, words in told["freedom"]["steps"]] == ["faithful"] * 4 + ["bold"] * 3 + ["wild"] * 4
    assert told["seed"]["range"] == {"ge": 0, "le": 2**31 - 1} and "same painting" in told["seed"]["help"]


def test_brushes_of_other_packages_can_be_chosen_on_a_real_easel(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    install(tmp_path / "mops", monkeypatch, "mops", {registry.STROKE_MODELS: {"mop": "mops:MOP"}})
    mop = {"label": "mop", "title": "", "picture": "medium", "sets": {"brushes": "mop"}}
    assert mop in shown(REAL)["brushes"]["options"] and mop not in shown(EASELS["virtual"])["brushes"]["options"]


def test_the_canvas_at_the_start_is_one_of_those_that_the_easel_can_see() -> None:
    grounds = {easel: [each["label"] for each in shown(EASELS[easel])["ground"]["options"]] for easel in EASELS}
    assert grounds["virtual"] == ["usual", "white", "toned"] and grounds["unseen"] == ["white", "toned"]
    assert grounds["real"] == grounds["by hand"] == ["white", "toned", "as it is"]


def test_sentences_name_settings_as_the_form_does() -> None:
    said = name_settings("--minutes is 10; give fewer brushes or --layers, or --on-canvas, not --strokes-of.")
    assert said == "“Robot's time” is 10; give fewer brushes or layers, or on canvas, not “Shape of the marks”."
