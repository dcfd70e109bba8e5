"""What a notebook leaves out of a planner is what a person would have said."""

import inspect

import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize
from frida_painter.goal import Goal
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.style import StyleTerm
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.runs.spec import RunSpec
from marks import coarse_table
from networks import QuickEncoders
from scenes import goal, picture, small_table

SHAPES = ((120, 160), (160, 120))


def small(**settings: object) -> Planner:
    return Planner(goal(), "12x9cm", small_table(), rows=64, effort=0.02, **settings)  # type: ignore[arg-type]


def test_the_usual_canvas_has_the_proportions_of_the_picture() -> None:
    usual = RunSpec().canvas
    lying, upright = (Planner(Goal((ImageTerm(picture(*shape)),)), model=small_table(), rows=64) for shape in SHAPES)
    assert lying.size == usual.shaped_like(*SHAPES[0])
    assert upright.size == CanvasSize(lying.size.height, lying.size.width)
    styled = Goal((StyleTerm(picture(*SHAPES[1])),))
    assert Planner(styled, model=small_table(), rows=64, encoders=QuickEncoders()).size == upright.size


def test_what_is_left_out_is_what_the_command_line_takes() -> None:
    settings = RunSpec()
    planner = inspect.signature(Planner).parameters
    plan = inspect.signature(Planner.plan).parameters
    assert planner["rows"].default == settings.render_height
    assert planner["seed"].default == settings.seed
    assert planner["effort"].default == settings.effort
    assert planner["model"].default == settings.brush_names[0]
    assert (plan["strokes"].default, plan["colors"].default) == (settings.strokes, settings.colors)


def test_a_brush_is_known_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("frida_painter.planning.layers.cached_table", coarse_table)
    assert Planner(goal(), "12x9cm", "fine", rows=64).brushes == ("fine",)


@pytest.mark.slow
def test_a_bare_canvas_is_planned_on_and_nobody_has_to_listen() -> None:
    by = small()
    told, silent = by.plan(by.bare, 6, 3, lambda step: None), small().plan(strokes=6, colors=3)
    assert torch.equal(told.strokes.position, silent.strokes.position)
    assert torch.equal(by.expected(silent), by.expected(silent, torch.ones_like(by.bare)))
    assert small(seed=5).plan(strokes=6, colors=3).digest != silent.digest
    bound = by.bind_to_palette(silent, by.bare, silent.palette)
    assert torch.equal(bound.palette.color, silent.palette.color)
    assert len(by.replan(silent.part(slice(3, None)), by.expected(silent.part(slice(3))))) == 3


def test_effort_is_a_factor_or_told_one_by_one() -> None:
    assert small().effort == Effort().scaled(0.02)
    exactly = Effort(polishing=3)
    assert Planner(goal(), "12x9cm", small_table(), rows=64, effort=exactly).effort is exactly


@pytest.mark.parametrize(("strokes", "colors"), [(0, 3), (-1, 3), (6, 0)])
def test_there_is_no_plan_of_nothing(strokes: int, colors: int) -> None:
    with pytest.raises(ConfigError, match="at least 1 of each"):
        small().plan(strokes=strokes, colors=colors)
