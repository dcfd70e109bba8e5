import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter_drivers.sawyer.arm_film import hang_inset

RED, BLUE, SCENE = (200, 20, 20), (20, 20, 200), 120


@pytest.mark.parametrize("canvas", [CanvasSize(0.3, 0.2), CanvasSize(0.2, 0.3), CanvasSize(0.9, 0.1)])
def test_the_whole_canvas_hangs_upright_in_the_upper_right_corner(canvas):
    painting = np.empty((64, 64, 3), np.uint8)
    painting[:32], painting[32:] = RED, BLUE  # the lower half, and the upper one
    pixels = np.full((540, 960, 3), SCENE, np.uint8)
    hang_inset(canvas, painting, pixels)
    red, blue = (np.argwhere((pixels == color).all(-1)) for color in (RED, BLUE))
    assert blue[:, 0].max() < red[:, 0].min()
    seen = np.concatenate([red, blue])
    height, width = np.ptp(seen, axis=0) + 1
    assert width / height == pytest.approx(canvas.width / canvas.height, rel=0.05)
    assert seen[:, 1].min() > 0.6 * 960
    hidden = np.argwhere((pixels != SCENE).any(-1))
    assert (hidden.min(0) > (0, 600)).all() and (hidden.max(0) < (400, 959)).all()
    assert np.ptp(hidden, axis=0).max() < 288 + 30
