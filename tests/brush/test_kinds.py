import pytest

from frida_painter.brush.bezier import BezierStroke
from frida_painter.brush.kinds import KINDS, brush_kind
from frida_painter.errors import ConfigError
from marks import shapes


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_no_mark_of_the_typical_brush_is_cut_off_by_its_frame(kind):
    thickness, _, _ = shapes(1)
    model = BezierStroke.typical(kind).requires_grad_(False)
    for length in kind.limits.length:
        for bend in kind.limits.bend:
            mark = model(thickness * 0 + 1, thickness * 0 + length, thickness * 0 + bend)[0]
            assert mark.amax() > 0.9
            assert mark[[0, -1]].amax() == mark[:, [0, -1]].amax() == 0


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_frames_have_square_cells_and_are_symmetric_about_the_stroke(kind):
    across, down = kind.frame.pitch
    assert across == pytest.approx(down)
    assert kind.frame.top == pytest.approx(-kind.frame.bottom)
    assert kind.frame.rows % 2 == kind.frame.columns % 2 == 0


def test_an_unknown_brush_is_refused_and_the_known_ones_are_named():
    with pytest.raises(ConfigError, match="fine, medium, broad"):
        brush_kind("broom")
