"""Settings of drivers: a value that cannot be is refused in a sentence with the range."""

import math
from typing import Any

import pytest

from frida_painter.errors import ConfigError
from frida_painter_drivers.axidraw import AxidrawSettings
from frida_painter_drivers.franka import FrankaRobot
from frida_painter_drivers.rosbridge import RosbridgeConnection, RosRobot
from frida_painter_drivers.so101 import So101Robot
from frida_painter_drivers.xarm import XarmRobot

HOME, NOBODY = (0.3, -0.1, 0.3), RosbridgeConnection("127.0.0.1")
WRONG: list[tuple[type, tuple[Any, ...], list[dict[str, Any]]]] = [
    (AxidrawSettings, (HOME,), [
        {"approach": 0.0}, {"approach": math.nan}, {"lift": "hydraulic"}, {"down_speed": 0.0}, {"up_speed": 9.0}]),
    (FrankaRobot, ("10.0.0.2", HOME), [
        {"approach": 0.0}, {"brush_length": -1.0}, {"turn": 200.0}, {"force": 1.0}, {"touch_force": math.nan}]),
    (RosRobot, (HOME, NOBODY, NOBODY), [{"approach": 0.0}, {"approach": 1.1}, {"namespace": "brush"}]),
    (So101Robot, ("/dev/null", HOME), [{"approach": 0.0}, {"approach": 0.6}, {"brush_length": math.nan}]),
    (XarmRobot, ("10.0.0.2", HOME), [{"approach": 0.0}, {"brush_length": -1.0}]),
]  # fmt: skip


def test_settings_that_cannot_be_are_refused() -> None:
    for kind, given, mistakes in WRONG:
        kind(*given)
        for wrong in mistakes:
            with pytest.raises(ConfigError, match=" was given "):
                kind(*given, **wrong)
