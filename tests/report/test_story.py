import math

import pytest
import torch

from frida_painter.report.story import compare, paints
from frida_painter.strokes.palette import to_hex
from support.plans import made_up_plan


def test_paints_are_counted_and_measured() -> None:
    plan = made_up_plan(paint=[0, 0, 2, 2, 2, 4])
    found = paints(plan)
    assert [paint.number for paint in found] == [1, 2, 3, 4, 5]
    assert [paint.strokes for paint in found] == [2, 0, 3, 0, 1]
    assert [paint.hex for paint in found] == [to_hex(color) for color in plan.palette.color]
    length = plan.strokes.length
    assert found[2].share == pytest.approx(float(length[2:5].sum() / length.sum()))
    assert sum(paint.share for paint in found) == pytest.approx(1)
    assert found[0].srgb == tuple(round(255 * part) for part in plan.palette.color[0].tolist())


def test_pictures_are_compared() -> None:
    gray = torch.full((3, 20, 20), 0.4)
    same = compare("same", gray, gray, 10, 10)
    assert same.psnr == pytest.approx(100) and same.distance == 0
    lighter = compare("lighter", gray + 0.2, gray, 10, 5)
    assert lighter.psnr == pytest.approx(13.98, abs=0.01)
    assert str(lighter) == f"lighter: {lighter.psnr:.2f} dB (PSNR at 5 x 10 pixels)"
    assert 19 < lighter.distance < 21 and math.isfinite(lighter.distance)
