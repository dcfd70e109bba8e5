import pytest
import torch

from frida_painter.mixing.recipe import volumes
from frida_painter.plan import Plan
from support.plans import made_up_plan


def test_each_paint_is_wanted_by_the_area_that_it_paints_and_never_less_than_can_be_dipped_in() -> None:
    plan = made_up_plan(400, 4)
    lengths = plan.strokes.length.double() * (0.25 + 0.75 * plan.strokes.thickness.double()) * 0.017
    area = torch.zeros(4, dtype=torch.float64).index_add(0, plan.paint, lengths)
    assert volumes(plan).tolist() == pytest.approx((area * 300).clamp(min=3).tolist(), rel=1e-5)
    assert volumes(plan.part(slice(1))).tolist() == [3, 3, 3, 3]


def test_twice_the_painting_takes_twice_the_paint() -> None:
    plan = made_up_plan(4000, 2)
    assert isinstance(plan, Plan)
    assert volumes(plan).sum() == pytest.approx(2 * float(volumes(made_up_plan(2000, 2)).sum()), rel=0.1)
