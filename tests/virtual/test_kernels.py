import pytest

from frida_painter.errors import ConfigError
from frida_painter.virtual import bristles, camera, canvas
from frida_painter.virtual.studio import load_kernels
from virtual.hand import Hand


def loaded() -> dict[str, int]:
    """How many versions of each kernel are loaded."""
    kernels = (bristles._trail, canvas._settle, canvas._exchange, canvas._look, camera._lay, camera._develop)
    return {kernel.__name__: len(kernel.signatures) for kernel in kernels}


def test_nothing_is_left_to_load_when_painting_begins() -> None:
    load_kernels("fine")
    before = loaded()
    hand = Hand((0.2, 0.2, 0.3), (0.8, 0.7, 0.1), brush="broad")
    hand.dip(0)
    hand.stroke(0.03, 0.03, 0.04)
    hand.dip(1)
    hand.stroke(0.03, 0.035, 0.04, angle=0.4)
    hand.easel.camera.capture(0)
    assert loaded() == before and all(before.values())


def test_of_a_brush_that_there_is_not_nothing_is_loaded() -> None:
    with pytest.raises(ConfigError):
        load_kernels("broom")
