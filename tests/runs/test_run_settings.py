"""Settings as keywords: an editor, a type checker and the program know the same ones."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import pytest

import frida_painter as fp
from frida_painter.errors import ConfigError
from frida_painter.runs.run_settings import RunSettings

SRC = Path(fp.__file__).parents[1]
RIGHT = """
import frida_painter as fp
spec = fp.RunSpec.of(strokes=5, canvas="A4", ground=(1.0, 0.5, 0.5), brushes=["broad", "fine"], palette="p.json")
planner = fp.make_planner("a.jpg", strokes=5, model="broad", seed=1)
outcome = fp.paint("a.jpg", strokes=5)
known: str = fp.__version__
length: int = len(fp.Strokes.empty()[0]) + sum(len(one) for one in fp.Strokes.empty())
event = fp.events.StrokePainted(1)
"""
TYPOS = {
    'fp.Plannr("x")': "Plannr",
    'fp.paint("a.jpg", strkes=5)': "strkes",
    'fp.make_planner("a.jpg", sed=1)': "sed",
    "fp.RunSpec.of(stroks=5)": "stroks",
    'fp.RunSpec.of(strokes="many")': "strokes",
    'fp.make_goal("a.jpg", txt="a lemon")': "txt",
    'fp.render_batch("broad", fp.Strokes.empty(), cnvas="A4")': "cnvas",
    "fp.events.StrokePaintd": "StrokePaintd",
}


def test_the_keywords_are_the_settings() -> None:
    assert set(RunSettings.__annotations__) == {*fp.RunSpec.model_fields, "brush"}


def test_a_choice_has_the_same_words_in_both() -> None:
    hints = get_type_hints(RunSettings, localns={"AnyColor": Any, "GoalItem": Any})
    choices = {name: words_of(field.annotation) for name, field in fp.RunSpec.model_fields.items()}
    assert {name: words_of(hints[name]) for name in choices if words_of(hints[name])} == {
        name: words for name, words in choices.items() if words and name in hints and words_of(hints[name])
    }
    assert {"beginning", "fit", "focus"} <= {name for name in choices if words_of(hints[name])}


def words_of(annotation: object) -> set[object]:
    """Returns the words of the choice in a type, with its unions."""
    if get_origin(annotation) is Literal:
        return set(get_args(annotation))
    return set().union(*(words_of(part) for part in get_args(annotation)))


@pytest.mark.parametrize("typo", ["strkes", "sed", "Strokes"])
def test_a_typo_is_an_error_when_it_runs(typo: str) -> None:
    for called in (lambda: fp.paint("a.jpg", **{typo: 5}), lambda: fp.RunSpec.of(**{typo: 5})):  # type: ignore[arg-type]
        with pytest.raises(ConfigError, match=f"'{typo}' is not a setting"):
            called()
    with pytest.raises(AttributeError, match=r"did you mean Planner\?"):
        fp.Plannr  # type: ignore[attr-defined]  # noqa: B018
    with pytest.raises(TypeError, match="txt"):
        fp.make_goal("a.jpg", txt="a lemon")  # type: ignore[call-arg]


@pytest.mark.slow
def test_a_typo_is_an_error_for_a_type_checker(tmp_path: Path) -> None:
    lines = [*RIGHT.strip().splitlines(), *TYPOS]
    (tmp_path / "user.py").write_text("\n".join(lines) + "\n")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--cache-dir", str(tmp_path / "cache"),
         "--config-file", str(SRC.parent / "pyproject.toml"), "-m", "user"],
        cwd=tmp_path, capture_output=True, text=True, env={**os.environ, "MYPYPATH": f"{SRC}{os.pathsep}{tmp_path}"},
    )  # fmt: skip
    said = [line for line in done.stdout.splitlines() if line.startswith("user.py:")]
    wrong = {int(line.split(":")[1]) for line in said}
    first = len(lines) - len(TYPOS) + 1
    assert wrong == set(range(first, len(lines) + 1)), done.stdout + done.stderr
    for number, word in enumerate(TYPOS.values(), first):
        assert any(line.startswith(f"user.py:{number}:") and word in line for line in said)
