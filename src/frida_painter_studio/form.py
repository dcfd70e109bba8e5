"""Form of the page: every setting that it asks for, as `RunSpec` describes it, for the easel of this studio."""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from frida_painter.easel.kinds import HUMAN
from frida_painter.planning.fields import AUTO, FAMILY_SHARE, limits_of
from frida_painter.planning.form_control import Control
from frida_painter.planning.settings import about, help_of, usual_of
from frida_painter.registry import STROKE_MODELS, parts
from frida_painter.runs.spec import OF_PAINTINGS, RunSpec
from frida_painter_studio.web_app_easel import WebAppEasel

_PRESETS: Mapping[str, Mapping[str, float]] = {
    "Quick study": {"strokes": 80, "colors": 6, "replans": 2, "effort": 0.5},
    "Normal": {"strokes": 300, "colors": 12, "replans": 4, "effort": 1.0},
    "Detailed": {"strokes": 800, "colors": 16, "replans": 8, "effort": 1.5},
}
_BRUSHES = (None, "broad", "medium", "fine", "broad,medium", "broad,medium,fine")
CONTROLS: dict[str, Control] = {
    name: about(field)["form"] for name, field in RunSpec.model_fields.items() if about(field)["form"] is not None
}
"""Controls of all settings that a form asks for."""
SETTINGS = tuple(name for name, control in CONTROLS.items() if control.widget not in ("canvas", "goals"))
"""Settings that a request carries under their own names; it has goals with pictures, and the sides of the canvas."""
USUAL_VALUES: dict[str, list[Any]] = {
    name: [RunSpec.model_fields[name].default, *(sets[name] for sets in _PRESETS.values() if name in sets)]
    for name in SETTINGS
}
"""Values of each setting that a person has not chosen one by one: the usual one, and those of the presets."""


def describe_form(easel: WebAppEasel, families: Iterable[str]) -> dict[str, Any]:
    """Returns the form for an easel as plain values: `form` of `House` in tools/page/state.d.ts.

    families: names of the stroke families that can be painted with.
    """
    has = {"": True, "camera": easel.has_camera, "real paint": not easel.simulated, "robot": easel.robot != HUMAN}
    presets = [_option(label, sets, picture=label) for label, sets in _PRESETS.items()]
    shown: list[dict[str, Any]] = [
        {"name": "detail", "label": "Detail", "kind": "choices", "level": "first", "options": presets}
    ]
    for section, name in ((each, name) for each in OF_PAINTINGS for name in each.model_fields):
        control, field = CONTROLS.get(name, Control()), RunSpec.model_fields[name]
        if control.label and has[control.needs]:
            shown.append({
                "name": name, "label": control.label, "kind": control.kind, "help": help_of(field),
                "group": section.panel, "level": control.beside or "more", "range": limits_of(field),
                "steps": [(step, control.in_words(step)) for step in control.steps],
                "options": list(_options(name, control, easel, families)),
            })  # fmt: skip
    usual = {name: RunSpec.model_fields[name].default for name in SETTINGS}
    return {"usual": usual | ({} if easel.simulated else {"ground": "white"}), "controls": shown}


def _option(label: str, sets: Mapping[str, Any], title: str = "", picture: str | None = None) -> dict[str, Any]:
    return {"label": label, "title": title, "picture": picture, "sets": sets}


def _options(name: str, control: Control, easel: WebAppEasel, families: Iterable[str]) -> Iterator[dict[str, Any]]:
    """Yields what can be chosen for a setting."""
    for value, (label, title) in control.options.items():
        yield _option(label, {name: value}, title, value)
    if control.widget == "brushes":
        others = () if easel.simulated else parts(STROKE_MODELS)  # the virtual studio has no brushes of other packages
        for brush in dict.fromkeys((*_BRUSHES, *others)):
            picture = (brush or "usual brushes") if brush in _BRUSHES else "medium"
            yield _option((brush or "usual").replace(",", ", "), {name: brush}, picture=picture)
    elif control.widget == "families":
        yield _option("the brush's own", {name: None})
        for family in families:
            yield _option(f'with {100 * FAMILY_SHARE:g} % of the stroke "{family}"', {name: family})
    elif control.widget == "ground":
        if easel.simulated:
            title = usual_of(RunSpec.model_fields[name])
            yield _option("usual", {name: None, "on_canvas": False}, title, "usual ground")
        title = "A colour that suits the picture" + ("" if easel.simulated else "; you tone the canvas, by a recipe")
        yield _option("white", {name: "white", "on_canvas": False}, picture="white")
        yield _option("toned", {name: AUTO, "on_canvas": False}, title, "toned")
        if easel.has_camera and not easel.simulated:
            title = "Paint on what is there: a toned ground, an old painting, or what you painted"
            yield _option("as it is", {name: "white", "on_canvas": True}, title, "as it is")


def name_settings(sentence: str) -> str:
    """Returns a sentence of `RunSpec` with the labels of the form in place of options of the command line."""

    def label(option: re.Match[str]) -> str:
        control = CONTROLS.get(option[1].replace("-", "_"), Control())
        return f"“{control.label}”" if control.label else option[1].replace("-", " ")

    return re.sub(r"--([a-z][a-z-]*)", label, sentence)
