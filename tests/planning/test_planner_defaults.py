"""What a notebook leaves out is what a person who says nothing gets on the command line, and makes the same plan."""

import sys
from dataclasses import fields
from pathlib import Path

import pytest
import torch

from frida_painter.brush.kinds import StrokeModel
from frida_painter.brush.table import StrokeTable
from frida_painter.errors import ConfigError
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.style import StyleTerm
from frida_painter.planning.effort import Effort
from frida_painter.planning.materials import Materials
from frida_painter.planning.planner import Planner
from frida_painter.planning.settings import PlannerSettings
from frida_painter.runs.goals import make_goal
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.settle import make_planner
from frida_painter.runs.spec import RunSpec
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter_cli import commands
from frida_painter_words.text import TextTerm
from marks import coarse_table
from support.networks import QuickEncoders
from support.planning import goal, picture, plain, small_table

QUICK = {"render_height": 64, "effort": 0.05}


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """Tall, of odd proportions and larger than the canvas is planned: it is to be fitted."""
    images.save(picture(307, 211), tmp_path / "photo.png")
    return tmp_path / "photo.png"


@pytest.fixture
def coarse_brushes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coarsely tabulated brushes, which are there sooner."""
    made: dict[str, StrokeTable] = {}

    def table(model: StrokeModel) -> StrokeTable:
        return made.setdefault(model.brush, made.get(model.brush) or coarse_table(model))

    monkeypatch.setattr("frida_painter.planning.materials.cached_table", table)


def told(planner: Planner) -> dict[str, object]:
    """All that a planner was told, but for the goal."""
    settings = {name: getattr(planner.settings, name) for name in PlannerSettings.model_fields}
    materials = {field.name: getattr(planner.materials, field.name) for field in fields(Materials)}
    return settings | materials | {"models": planner.kinds, "paints": planner.materials.paints is None}


def small(**settings: object) -> Planner:
    return Planner(goal(), *plain("12x9cm", small_table(), rows=64, effort=Effort().scale(0.02), **settings))


@pytest.mark.parametrize("strokes", [20, 120, 300])
@pytest.mark.parametrize("more", [{}, {"canvas": "A4", "fit": "crop", "seed": 4, "focus": "none", "new_paints": False}])
def test_a_notebook_and_the_command_line_tell_a_planner_the_same(
    photo: Path, strokes: int, more: dict[str, object], coarse_brushes: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("frida_painter.runs.settle.proposed_ground", lambda planner: (0.12, 0.12, 0.5))
    with PaintingRun(RunSpec.of(goal=[{"image": str(photo)}], strokes=strokes, **QUICK, **more)) as run:
        theirs = run.planner
    for asked in (str(photo), make_goal(photo), make_goal(images.load(photo))):
        mine = make_planner(asked, strokes=strokes, **QUICK, **more)
        assert told(mine) == told(theirs)
        assert mine.size == theirs.size and mine.fine == theirs.fine and mine.effort == theirs.effort
        for one, other in zip(mine.goal.terms, theirs.goal.terms, strict=True):
            assert isinstance(one, ImageTerm) and isinstance(other, ImageTerm) and torch.equal(one.image, other.image)
    assert (theirs.ground == (0.12, 0.12, 0.5)) == (strokes >= 100)


@pytest.mark.parametrize("words", [(), ("--brushes", "fine", "--canvas", "A5"), ("--seed", "3", "--no-new-paints")])
def test_a_notebook_and_the_command_line_make_the_same_plan_to_the_last_bit(
    photo: Path, tmp_path: Path, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    told = ("--strokes", "104", "--render-height", "64", "--effort", "0.05", "--colors", "4")
    monkeypatch.setattr(
        sys, "argv", ["frida-painter", "plan", str(photo), *told, *words, "--out", str(tmp_path / "out")]
    )
    with pytest.raises(SystemExit) as end:
        commands.main()
    assert not end.value.code
    theirs = Plan.load(tmp_path / "out")
    named = dict(zip([word[2:] for word in words[::2]], words[1::2], strict=False))
    more = {"new_paints": False, "seed": 3} if "--no-new-paints" in words else named
    mine = make_planner(photo, strokes=104, colors=4, **QUICK, **more).plan()
    assert mine.digest == theirs.digest and mine.ground == theirs.ground and mine.layers == theirs.layers
    for name, part in mine.strokes.arrays().items():
        assert part.numpy().tobytes() == theirs.strokes.arrays()[name].numpy().tobytes(), name


def test_what_is_usual_depends_on_the_kinds_of_a_goal_that_has_no_description(coarse_brushes: None) -> None:
    pictured, shown = Goal((ImageTerm(picture()),)), picture()
    assert make_planner(pictured, strokes=99, **QUICK).brushes == ("broad",)
    styled = Goal((StyleTerm(shown),))
    planner = make_planner(styled, strokes=110, encoders=QuickEncoders(), **QUICK)
    assert planner.brushes == ("broad", "medium") and planner.ground != (1, 1, 1)
    words = Goal((TextTerm("a lemon"),))
    said = RunSpec.of(goal=[{"text": "a lemon"}], strokes=110)
    planner = make_planner(words, strokes=110, encoders=QuickEncoders(), **QUICK)
    assert planner.brushes == said.brush_names == ("broad", "fine") and said.wanted_ground == "scene"
    own = Goal((make_goal(objective=lambda seen: seen.mean()).terms[0],))
    assert str(make_planner(own, strokes=10, **QUICK).plan().canvas) == str(RunSpec().canvas)


def test_stroke_models_of_one_s_own_take_the_place_of_the_brushes(coarse_brushes: None) -> None:
    settled = make_planner(goal(), strokes=120, ground="white", model=small_table(), **QUICK)
    assert settled.brushes == (small_table().brush,) and len(settled.layer_sizes(120)) == 2
    told = Materials.of(RunSpec.of(goal=[{"image": "x.png"}], strokes=120, **QUICK), small_table())
    assert told.shares is None and told.models == (small_table(),)
    named = RunSpec.of(goal=[{"image": "x.png"}], strokes=20, brushes="broad,medium", **QUICK)
    assert Materials.of(named, small_table()).layers is None


def test_nothing_of_a_planner_changes_when_another_ground_is_asked_for() -> None:
    by = small()
    toned = by.on_ground((0.5, 0.25, 0.125))
    assert by.ground == (1, 1, 1) and toned.ground == (0.5, 0.25, 0.125) == tuple(toned.bare[:, 0, 0].tolist())
    assert toned.goal is by.goal and toned.problems is by.problems and toned.towards(goal()).ground == toned.ground
    for name in ("ground", "region", "seed"):
        with pytest.raises(AttributeError):
            setattr(by, name, None)
    with pytest.raises(AttributeError):
        by.materials.ground = (0.0, 0.0, 0.0)  # type: ignore[misc]


def test_a_bare_canvas_is_planned_on_and_nobody_has_to_listen() -> None:
    by = small()
    told, silent = by.plan(by.bare, 6, 3, lambda step: None), small(strokes=6, colors=3).plan()
    assert torch.equal(told.strokes.position, silent.strokes.position)
    assert len(small(colors=12).plan(strokes=2)) == 2, "few strokes have a paint each"
    assert torch.equal(by.expected(silent), by.expected(silent, torch.ones_like(by.bare)))
    assert small(seed=5).plan(strokes=6, colors=3).digest != silent.digest
    bound = by.bind_to_palette(silent, by.bare, silent.palette)
    assert torch.equal(bound.palette.color, silent.palette.color)
    assert len(by.replan(silent.part(slice(3, None)), by.expected(silent.part(slice(3))))) == 3


@pytest.mark.parametrize(("strokes", "colors"), [(0, 3), (-1, 3), (6, 0)])
def test_there_is_no_plan_of_nothing(strokes: int, colors: int) -> None:
    with pytest.raises(ConfigError, match="at least 1 of each"):
        small().plan(strokes=strokes, colors=colors)
