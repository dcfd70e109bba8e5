"""Every request of every part goes to its object and comes back as what the protocol says; so do errors."""

import json
import math
from dataclasses import dataclass, fields, is_dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from frida_painter.calibration import SurfaceMap
from frida_painter.easel.connection import find_request, make_remote, requests
from frida_painter.errors import RobotError
from frida_painter.hardware.easel import PersonStroke
from frida_painter.hardware.gateway import Surface
from frida_painter.hardware.robot import BrushRack, Frame, MotionReport, Waypoints, Zero
from frida_painter.hardware.timing import AxisTiming, ServoTiming, TravelLimits
from frida_painter.strokes.palette import Palette
from support.easel import CANVAS, WORKSPACE

POINT, WAY = np.array([0.1, 0.2, 0.3]), np.arange(6.0).reshape(2, 3)
STROKE = PersonStroke(3, "broad", 1, WAY[:, :2], POINT[:2], POINT[:2], POINT[:2], 0.5)
REPORT = MotionReport("stroke 1", 1.5, 2.5, POINT, left_out=True)
TIMING = AxisTiming((0.1,) * 3, (math.inf,) * 3, jerk=(0.1,) * 3, servo=ServoTiming(0.05, lift=0.1))
RACKED = replace(WORKSPACE, rack=BrushRack({"fine": (0.1, 0.2, 0.3)}, (0.0, 0.1), 0.05))
UNEVEN = Surface(CANVAS, 0.09, SurfaceMap((0.0, 0.12), (0.0, 0.09), ((0.0, 0.001), (0.0, 0.0))))
CALLS: dict[tuple[str, str], tuple[dict[str, Any], Any]] = {
    ("robot", "connect"): ({}, None),
    ("robot", "home"): ({}, REPORT),
    ("robot", "pose"): ({}, POINT),
    ("robot", "follow"): ({"waypoints": Waypoints("stroke 1", WAY, 0.1, ("dip", "2"))}, REPORT),
    ("robot", "allow"): ({"motions": (Waypoints("wipe", WAY, 0.1),) * 2, "workspace": RACKED, "surface": UNEVEN}, None),
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
    ("operator", "print_canvas"): ({}, np.arange(24, dtype=np.uint8).reshape(2, 4, 3)),
}


def same(one: Any, other: Any) -> bool:
    if is_dataclass(one):
        return type(one) is type(other) and all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, tuple) and len(one) and is_dataclass(one[0]):
        return type(one) is type(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray | torch.Tensor):
        return type(one) is type(other) and one.dtype == other.dtype and bool(np.array_equal(one, other))
    return type(one) is type(other) and one == other


def test_every_method_of_the_protocols_is_a_request_that_comes_as_it_was_sent() -> None:
    assert {(part, name) for part in ("robot", "camera", "operator") for name in requests(part)} == set(CALLS)
    for (part, name), (arguments, result) in CALLS.items():
        heard: dict[str, Any] = {}

        class Target:
            pass

        def method(*given: Any, heard: Any = heard, result: Any = result, wanted: Any = tuple(arguments)) -> Any:
            heard.update(zip(wanted, given, strict=True))  # by place: a driver may have other names for them
            return result

        setattr(Target, name, staticmethod(method))

        def ask(request: Any, given: Any, target: Any = Target) -> Any:
            words, arrays = request.pack(given)
            return request.result(*find_request(words).answer(target, words["with"], arrays))

        answered = getattr(make_remote(part, ask), name)(**arguments)
        assert same(answered, result), (part, name)
        assert set(heard) == set(arguments) and all(same(heard[key], arguments[key]) for key in heard), (part, name)


@pytest.mark.parametrize(
    "words",
    [{}, {"part": "robot", "do": "_move"}, {"part": "robot", "do": "__init__"}, {"part": "serve", "do": "connect"}],
)
def test_what_no_protocol_has_is_refused(words: dict[str, str]) -> None:
    with pytest.raises(RobotError, match="does not know"):
        find_request(words)
    with pytest.raises(RobotError, match=r"no 'robot\.zero'"):
        requests("robot")["zero"].answer(None, {}, {})


def answer(part: str, name: str, result: Any, **given: Any) -> Any:
    request = requests(part)[name]
    words, arrays = request.pack(given)
    told, found = request.answer(SimpleNamespace(**{name: lambda *given: result}), words["with"], arrays)
    return request.result(json.loads(json.dumps(told)), found)


def test_results_of_other_packages_come_as_the_protocol_states_them() -> None:
    @dataclass(frozen=True)
    class Longer(MotionReport):
        torque: float = 1.0

    assert type(answer("robot", "home", Longer("home", 1.0, 2.0, POINT))) is MotionReport
    assert answer("robot", "connect", object()) is None
    assert answer("operator", "lay_paper", None) is False and answer("operator", "lay_paper", 1) is True
    found = answer("robot", "pose", np.array([1, 0, 2]))
    assert found.dtype == np.float64 and found.tolist() == [1.0, 0.0, 2.0]
    words, arrays = requests("robot")["follow"].pack({"waypoints": Waypoints("stroke 1", WAY.astype(np.float32), 0.1)})
    heard: list[Waypoints] = []
    follow = lambda path: heard.append(path) or REPORT  # noqa: E731
    requests("robot")["follow"].answer(SimpleNamespace(follow=follow), words["with"], arrays)
    assert heard[0].position.dtype == np.float64


def test_an_answer_that_does_not_fit_is_a_robot_error() -> None:
    for words in ({}, {"result": None}, {"result": {"label": "home"}}, {"result": [1]}):
        with pytest.raises(RobotError, match="told of 'home' what cannot be"):
            requests("robot")["home"].result(words, {})
