"""A part of another package that fails while it works is told in one sentence, with its package and place."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from frida_painter import registry
from frida_painter.objectives.objective import goal_kinds
from plugins import install
from support.commandline import run_command

PHOTO = str(Path(__file__).parents[2] / "examples" / "photographs" / "cat.jpg")
CHEAP = ("--effort", "0.05", "--canvas", "120x90mm", "--render-height", "64", "--focus", "none", "--no-film")
FAILS = {
    "a goal": (registry.OBJECTIVES, ["--sad", "abc"], """
        from frida_painter.plugins import Gives, GoalKind
        def work(value, weight):
            return float(value)
        KIND = GoalKind("sad", Gives.WORDS, "Sad.", "Sad", work)""", "could not convert string to float: 'abc'"),
    "a planner": (registry.PLANNERS, ["--planner", "sad"], """
        from frida_painter.plugins import PlannerKind
        def work(task):
            return task.strokes / 0
        KIND = PlannerKind("sad", "Sad.", work)""", "division by zero"),
}  # fmt: skip


@pytest.fixture(autouse=True)
def known_kinds() -> Iterator[None]:
    """Kinds of goals are listed once in a process: they are listed anew here, and for the tests that follow."""
    goal_kinds.cache_clear()
    yield
    goal_kinds.cache_clear()


@pytest.mark.parametrize("what", FAILS)
def test_its_package_is_named(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    group, options, module, why = FAILS[what]
    name = f"sad_{group.rpartition('.')[2]}"
    text = "\n".join(line.removeprefix(8 * " ") for line in module.splitlines())
    install(tmp_path, monkeypatch, "sad-parts", {group: {"sad": f"{name}:KIND"}}, {name: text})
    monkeypatch.delitem(sys.modules, name, raising=False)
    order = ["paint", PHOTO, "--strokes", "4", *CHEAP, "--out", str(tmp_path / "painting")]
    assert run_command(*order, *options) == 2
    said = capsys.readouterr().err.strip()
    assert said.splitlines()[-1].startswith("frida-painter: The package sad-parts failed ("), said
    assert why in said and f"{name}.py, line " in said and "`frida-painter parts sad-parts`" in said


def test_a_failure_of_our_own_blames_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch, "sad-parts", {registry.PLANNERS: {"sad": "sad_planners:KIND"}})
    with pytest.raises(ZeroDivisionError) as failure:
        1 / 0  # noqa: B018
    assert registry.blame(failure.value) is None
