"""Settings of drivers: a value that cannot be is refused in a sentence with the range."""

import math
from typing import Any

import pytest

from frida_painter.errors import ConfigError
from frida_painter_drivers.axidraw import AxidrawSettings
from frida_painter_drivers.franka_settings import FrankaSettings
from frida_painter_drivers.rosbridge import RosSettings
from frida_painter_drivers.so101 import So101Settings
from frida_painter_drivers.xarm import XarmSettings

HOME = (0.3, -0.1, 0.3)
WRONG: list[tuple[type, tuple[Any, ...], dict[str, Any]]] = [
    *((AxidrawSettings, (HOME,), wrong) for wrong in (
        {"approach": 0.0}, {"acceleration": math.nan}, {"lift": "hydraulic"}, {"down_speed": 0.0}, {"up_speed": 9.0})),
    *((FrankaSettings, ("10.0.0.2", HOME), wrong) for wrong in (
        {"approach": 0.0}, {"brush_length": -1.0}, {"turn": 200.0}, {"force": 1.0}, {"touch_force": math.nan},
        {"acceleration": 0.0})),
    *((RosSettings, (HOME,), wrong) for wrong in ({"approach": 0.0}, {"namespace": "brush"})),
    *((So101Settings, ("/dev/null", HOME), wrong) for wrong in (
        {"approach": 0.0}, {"brush_length": -1.0}, {"acceleration": math.nan})),
    *((XarmSettings, ("10.0.0.2", HOME), wrong) for wrong in (
        {"approach": 0.0}, {"brush_length": -1.0}, {"blend": math.nan}, {"acceleration": 0.0},
        {"tool": (180.0, math.nan, 0.0)})),
]  # fmt: skip


def test_settings_that_cannot_be_are_refused() -> None:
    for kind, given, wrong in WRONG:
        kind(*given)
        with pytest.raises(ConfigError, match=" was given "):
            kind(*given, **wrong)
