"""Time of a plan by a CLIP."""

from pathlib import Path

import torch

from frida_painter import images
from frida_painter.planning.planner import Planner
from frida_painter.runs.goals import open_goal
from frida_painter.runs.settle import open_planner
from frida_painter.runs.spec import RunSpec
from tiny_clip import write_clip


def test_the_time_of_a_plan_is_measured_before_it_begins_and_changes_nothing(tmp_path: Path) -> None:
    clip = write_clip(tmp_path)

    def planner(words: str) -> Planner:
        goal = [{"image": str(tmp_path / "ground.png")}, *([{"text": words}] if words else [])]
        spec = RunSpec.of(goal=goal, strokes=6, colors=2, canvas="12x9cm", render_height=64, effort=0.05,
                          clip=str(clip) if words else None)  # fmt: skip
        return open_planner(spec, open_goal(spec))

    images.save(torch.rand(3, 30, 40, generator=torch.Generator().manual_seed(0)), tmp_path / "ground.png")
    timed, other = planner("a fox"), planner("a fox")
    short, long = timed.measure_plan(6), timed.measure_plan(60)
    assert short is not None and long is not None and 0 < short < 60
    assert timed.plan(timed.bare, 6, 2).digest == other.plan(other.bare, 6, 2).digest
    assert planner("").measure_plan(6) is None, "no network reads anything"
