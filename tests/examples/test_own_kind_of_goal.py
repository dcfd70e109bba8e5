"""The kind of goal that the example package brings works as it stands."""

import runpy
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType

import pytest
import torch

from frida_painter import registry
from frida_painter.errors import ConfigError
from frida_painter.objectives.objective import goal_kinds
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.registry import OBJECTIVES
from frida_painter.runs.goal_item import GoalItem, read_goal_file
from frida_painter.runs.goals import open_goal, picture_of
from frida_painter.runs.spec import RunSpec
from frida_painter_cli import commands
from support.planning import CANVAS, plain, small_table

ROOT = Path(__file__).parents[2]
EXAMPLE = runpy.run_path(str(ROOT / "examples" / "own_parts" / "own_parts" / "mirror.py"))


@pytest.fixture
def mirror(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The example's kind of goal, as if a package that brings it were installed."""
    module = ModuleType("example_of_mirrors")
    module.KIND = EXAMPLE["KIND"]  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    point = EntryPoint("mirror", f"{module.__name__}:KIND", OBJECTIVES)
    monkeypatch.setattr(registry, "_points_of_others", lambda path: [("unknown", point)])
    goal_kinds.cache_clear()
    yield
    monkeypatch.undo()
    goal_kinds.cache_clear()


def test_it_is_planned_for_alone_from_a_goal_file(mirror: None, tmp_path: Path) -> None:
    path = tmp_path / "goal.toml"
    path.write_text('[[goal]]\nmirror = "left-right"\nweight = 2\n')
    wanted = RunSpec.of(**read_goal_file(path))
    goal = open_goal(wanted)
    assert wanted.goal == (GoalItem(kind="mirror", value="left-right", weight=2.0),) and picture_of(goal) is None
    assert wanted.goal_facts == (("Mirror image", "“Left-right” (weight 2)"),)
    by = Planner(goal, *plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.1), seed=0))
    bare = torch.ones(3, 64, 85)
    bare[:, :, :40] = 0.4
    plan = by.plan(bare, 12, 3, lambda step: None)
    assert len(plan) == 12
    assert by.validation_loss(by.expected(plan, bare)) < 0.8 * by.validation_loss(bare)
    rest, half = plan.part(slice(6, None)), by.expected(plan.part(slice(6)), bare)
    again = by.replan(rest, half, lambda step: None)
    assert len(again) == 6
    assert by.validation_loss(by.expected(again, half)) <= by.validation_loss(by.expected(rest, half))
    with pytest.raises(ConfigError, match=r"--mirror diagonal: .*one of left-right, top-bottom"):
        open_goal(RunSpec.of(goal=[{"mirror": "diagonal"}]))


def test_the_command_line_paints_it(
    mirror: None,
    in_small_world: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["plan", "--mirror", "top-bottom", "--mirror-weight", "0.5", "--strokes", "5", "--colors", "2"]
    words += ["--effort", "0.05", "--render-height", "64", "--out", str(tmp_path / "out")]
    monkeypatch.setattr("sys.argv", ["frida-painter", *words])
    with pytest.raises(SystemExit) as end:
        commands.main()
    assert not end.value.code, capsys.readouterr().err
    assert (tmp_path / "out" / "plan.json").exists() and (tmp_path / "out" / "plan.png").exists()
