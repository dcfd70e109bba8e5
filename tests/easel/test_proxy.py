"""Every request of every part goes to its object and comes back as what the protocol says; so do errors."""

import math
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest
import torch

from frida_painter.easel.proxy import decode_error, encode_error, find_request, make_remote, requests
from frida_painter.errors import CameraError, FridaError, MotionFailed, RobotBusy, RobotError, RobotStopped
from frida_painter.hardware.easel import PersonStroke
from frida_painter.hardware.robot import Frame, MotionReport, Waypoints, Zero
from frida_painter.hardware.timing import AxisTiming, ServoTiming, TravelLimits
from frida_painter.palette import Palette

POINT, WAY = np.array([0.1, 0.2, 0.3]), np.arange(6.0).reshape(2, 3)
STROKE = PersonStroke(3, "broad", 1, WAY[:, :2], POINT[:2], POINT[:2], POINT[:2], 0.5)
REPORT = MotionReport("stroke 1", 1.5, 2.5, POINT, left_out=True)
TIMING = AxisTiming((0.1,) * 3, (math.inf,) * 3, jerk=(0.1,) * 3, servo=ServoTiming(0.05, lift=0.1))
CALLS: dict[tuple[str, str], tuple[dict[str, Any], Any]] = {
    ("robot", "connect"): ({}, None),
    ("robot", "home"): ({}, REPORT),
    ("robot", "pose"): ({}, POINT),
    ("robot", "follow"): ({"waypoints": Waypoints("stroke 1", WAY, 0.1, ("dip", "2"))}, REPORT),
    ("robot", "stop"): ({}, None),
    ("robot", "close"): ({}, None),
    ("robot", "zero"): ({}, Zero("it was reset", homes=True)),
    ("robot", "find_zero"): ({}, None),
    ("robot", "jog"): ({"step": POINT}, None),
    ("robot", "set_zero"): ({"tip": POINT}, None),
    ("robot", "timing"): ({}, TIMING),
    ("robot", "alive_at"): ({}, -math.inf),
    ("robot", "travel_limits"): ({}, TravelLimits((0.0, 0.0, -math.inf), (1.0, 1.0, 1.0), zero_known=False)),
    ("robot", "wants_pause"): ({}, True),
    ("robot", "feels"): ({}, "force"),
    ("robot", "touch"): ({"lowest": 0.1, "speed": 0.01}, REPORT),
    ("camera", "connect"): ({}, None),
    ("camera", "capture"): ({"newer_than": -math.inf}, Frame(np.zeros((4, 5, 3), np.uint8), 1.5, 7)),
    ("camera", "close"): ({}, None),
    ("operator", "fill_wells"): ({"palette": Palette(torch.tensor([[0.9, 0.8, 0.2], [0.1, 0.1, 0.3]]))}, None),
    ("operator", "tone"): ({"ground": (0.1, 0.2, 0.3)}, None),
    ("operator", "change_brush"): ({"brush": "fine"}, None),
    ("operator", "let_dry"): ({"seconds": 60.0}, None),
    ("operator", "lay_paper"): ({}, True),
    ("operator", "lay_checker"): ({}, False),
    ("operator", "take_checker_away"): ({}, True),
    ("operator", "paint_stroke"): ({"stroke": STROKE}, None),
    ("reach", "reachable"): ({"position": WAY}, np.array([True, False])),
}


def same(one: Any, other: Any) -> bool:
    if is_dataclass(one):
        return type(one) is type(other) and all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, np.ndarray | torch.Tensor):
        return type(one) is type(other) and one.dtype == other.dtype and bool((one == other).all())
    return type(one) is type(other) and one == other


def test_every_method_of_the_protocols_is_a_request_that_comes_as_it_was_sent() -> None:
    assert {(part, name) for part in ("robot", "camera", "operator", "reach") for name in requests(part)} == set(CALLS)
    for (part, name), (arguments, result) in CALLS.items():
        heard: dict[str, Any] = {}

        class Target:
            pass

        setattr(Target, name, staticmethod(lambda heard=heard, result=result, **given: heard.update(given) or result))

        def ask(request: Any, given: Any, target: Any = Target) -> Any:
            words, arrays = request.pack(given)
            return request.result(*find_request(words).answer(target, words["with"], arrays))

        answered = getattr(make_remote(part)(ask), name)(**arguments)
        assert same(answered, result), (part, name)
        assert set(heard) == set(arguments) and all(same(heard[key], arguments[key]) for key in heard), (part, name)


@pytest.mark.parametrize(
    "words",
    [{}, {"part": "robot", "do": "_move"}, {"part": "robot", "do": "__init__"}, {"part": "serve", "do": "connect"}],
)
def test_what_no_protocol_has_is_refused(words: dict[str, str]) -> None:
    with pytest.raises(RobotError, match="does not know"):
        find_request(words)
    with pytest.raises(RobotError, match=r"'reach\.reachable', which it does not know"):
        requests("reach")["reachable"].answer(None, {}, {})


def test_errors_come_as_themselves() -> None:
    for error in (RobotBusy("busy", 7), MotionFailed("failed", "C31", 4), RobotStopped("stopped", asked=True),
                  CameraError("dark"), RobotError("no")):  # fmt: skip
        again = decode_error(encode_error(error))
        assert type(again) is type(error) and str(again) == str(error) and vars(again) == vars(error)

    class Foreign(FridaError):
        """Error of another package."""

    assert type(decode_error(encode_error(Foreign("it is theirs")))) is RobotError
