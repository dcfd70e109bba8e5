import pytest
import torch

from frida_painter.errors import ConfigError, WeightsError
from frida_painter.render import render
from frida_painter.render.painting import render_plan
from support.planning import small_table
from support.plans import made_up_plan


def test_a_plan_is_drawn_on_its_own_ground() -> None:
    plan = made_up_plan()
    drawn = render_plan(plan, 90, {"medium": small_table()})
    ground = torch.tensor(plan.ground)[:, None, None].expand_as(drawn).contiguous()
    assert drawn.shape[:2] == (3, 90)
    assert torch.equal(drawn, render(plan.strokes, small_table(), ground, plan.canvas))
    assert not torch.equal(drawn, ground)


@pytest.mark.parametrize("height", [0, 15, 10_001])
def test_sizes_that_nobody_can_use_are_refused(height: int) -> None:
    with pytest.raises(ConfigError, match="16 to 10000"):
        render_plan(made_up_plan(), height, {"medium": small_table()})


def test_the_brush_of_the_plan_has_to_be_known() -> None:
    from dataclasses import replace

    with pytest.raises(WeightsError):
        plan = made_up_plan()
        render_plan(replace(plan, layers=(replace(plan.layers[0], brush="nowhere"),)), 90)
