from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from frida_painter.easel.kinds import OpenEasel
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.virtual_easel import assemble_easel
from frida_painter.errors import ConfigError
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import PaintSet
from frida_painter.mixing.shopping import DROP, TUBES, Mixture, Supply, paints_by_brush, supplies, use_of_paint
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter.virtual.studio import FREE, VirtualStudio
from support.plans import made_up_plan

WHITE = usual_paints()[0]


def recipes_of(plan: Plan) -> list:
    return PaintSet(usual_paints()).mix(plan.palette.color)


def test_the_studio_draws_what_the_list_says(tmp_path: Path) -> None:
    """The studio's bristles know nothing of the list; what they drew is counted at its wells."""
    studios: list[VirtualStudio] = []

    def open_studio(order: EaselOrder) -> OpenEasel:
        studio, easel = assemble_easel(order, FREE)
        studios.append(studio)
        return OpenEasel(easel, studio.close)

    images.save(torch.full((3, 20, 30), 0.5), tmp_path / "gray.png")
    plan = made_up_plan(24, 6)
    goal = [{"image": str(tmp_path / "gray.png")}]
    settings: Any = {"canvas": "300x200mm", "brushes": "medium", "replans": 0, "render_height": 64, "ground": "white"}
    spec = RunSpec.of(goal=goal, strokes=24, colors=6, layers=1, **settings)
    with PaintingRun(spec) as run:
        run.simulate(plan, open_studio)
    assert float(use_of_paint(plan).sum()) == pytest.approx(studios[0].balance().drawn / 1000, rel=0.25)


@pytest.mark.parametrize(
    ("mixed", "tubes"),
    [
        (0.5, "1 x 20 ml"),
        (20.0, "1 x 20 ml"),
        (20.1, "1 x 60 ml"),
        (250.0, "1 x 250 ml"),
        (251.0, "1 x 250 ml + 1 x 20 ml"),
        (700.0, "3 x 250 ml"),
    ],
)
def test_tubes_hold_what_is_mixed(mixed: float, tubes: str) -> None:
    supply = Supply(WHITE, 0.1, mixed)
    assert supply.in_tubes == tubes and sum(supply.tubes) >= mixed and set(supply.tubes) <= set(TUBES)


def test_every_part_is_whole_drops_and_there_is_enough() -> None:
    plan = made_up_plan(400, 9)
    mixtures = [mixture for brush in paints_by_brush(plan, recipes_of(plan)) for mixture in brush.mixtures]
    for mixture in mixtures:
        assert mixture.volume is not None and mixture.drawn is not None
        assert mixture.volume >= max(3.0, 2 * mixture.drawn) - 1e-9
        drops = [amount / DROP for amount in mixture.amounts.values()]
        assert all(count == pytest.approx(round(count)) and round(count) >= 1 for count in drops)
    bought = supplies(paints_by_brush(plan, recipes_of(plan)))
    assert sum(one.mixed for one in bought) == pytest.approx(sum(one.volume or 0 for one in mixtures))
    assert sum(one.drawn for one in bought) == pytest.approx(float(use_of_paint(plan).sum()))


def test_one_paint_in_two_layers_is_one_row() -> None:
    plan = made_up_plan(20, 3)
    both = plan.under(made_up_plan(20, 3, seed=5)).under(plan)
    first, second, third = paints_by_brush(both, recipes_of(both))
    assert [mixture.wells for mixture in first.mixtures] == [((1, 1), (3, 1)), ((1, 2), (3, 2)), ((1, 3), (3, 3))]
    assert len(second.mixtures) == 3 and second.kept == "" and third.mixtures == ()
    assert third.kept == "Mixed before: well 1 (layer 1, well 1), 2 (layer 1, well 2), 3 (layer 1, well 3)"
    alone = paints_by_brush(plan, recipes_of(plan))[0].mixtures
    assert [one.drawn for one in first.mixtures] == pytest.approx([2 * (one.drawn or 0) for one in alone])


def test_layers_from_the_same_wells_are_one_table() -> None:
    plan = made_up_plan(20, 3)
    (only,) = paints_by_brush(plan.under(plan), recipes_of(plan))
    assert only.title == "Layers 1 to 2: medium brush, 40 strokes" and len(only.mixtures) == 3


def test_a_plan_of_one_stroke_and_one_of_none() -> None:
    for strokes, title in ((1, "Layer 1: medium brush, 1 stroke"), (0, "Layer 1: medium brush")):
        plan = made_up_plan(1, 1).part(slice(strokes))
        (brush,) = paints_by_brush(plan, recipes_of(plan))
        assert brush.title == title and len(brush.mixtures) == 1


def test_without_a_plan_nobody_knows_how_much() -> None:
    (recipe,) = PaintSet(usual_paints()).mix(torch.tensor([[0.5, 0.4, 0.3]]))
    assert Mixture(recipe, ((1, 1),)).volume is None


def test_a_brush_that_nobody_knows_is_told() -> None:
    plan = made_up_plan(2, 1)
    with pytest.raises(ConfigError, match="is not known"):
        use_of_paint(replace(plan, layers=(replace(plan.layers[0], brush="broom"),)))
