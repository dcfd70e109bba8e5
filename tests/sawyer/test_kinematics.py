import threading

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from frida_painter.canvas_size import CanvasSize
from frida_painter.virtual.bristles import find_brush
from frida_painter.virtual.tabletop import sawyer_layout

pytest.importorskip("mink")
from frida_painter_drivers.sawyer.body import Kinematics
from frida_painter_drivers.sawyer.surroundings import make_model

CANVAS = CanvasSize(14 * 0.0254, 11 * 0.0254)
LAYOUT = sawyer_layout(CANVAS, find_brush("broad"))


@pytest.fixture(scope="module")
def kinematics():
    return Kinematics(make_model(LAYOUT.workspace, CANVAS))


def test_the_description_is_the_published_arm(kinematics):
    """Neutral posture of the maker's description: the flange 0.45, 0.16 m before the base, pointing down."""
    model = kinematics.model
    tip = kinematics.tip(model.key("neutral").qpos)
    np.testing.assert_allclose(tip, [0.4498, 0.1603, 0.0158], atol=2e-4)
    assert model.nq == model.nu == 7
    links = [model.body(f"l{number}").mass[0] for number in range(7)]
    assert sum(links) == pytest.approx(17.085, abs=0.01)  # 5.3213 + 4.505 + 1.745 + 2.5097 + 1.1136 + 1.5625 + 0.3292
    assert model.actuator_ctrlrange[:, 1].tolist() == [80, 80, 40, 40, 9, 9, 9]


@settings(max_examples=min(25, settings.default.max_examples), deadline=None)
@given(st.floats(0.35, 0.78), st.floats(-0.4, 0.4), st.floats(0.04, 0.18))
def test_a_posture_puts_the_tip_there_with_the_brush_upright_and_always_the_same(kinematics, x, y, z):
    assume(np.hypot(x, y) < 0.85)  # farther out it is all but stretched, and does not get there from everywhere at once
    place = np.array([x, y, z])
    angles = kinematics.posture(place)
    assert kinematics.miss(angles, place) < 2e-5
    lower, upper = kinematics.model.jnt_range.T
    assert ((lower <= angles) & (angles <= upper)).all()
    elsewhere = kinematics.posture(np.array([0.5, 0.0, 0.1]))
    from_there = kinematics.follow(np.tile(place, (60, 1)), elsewhere, threading.Event())[-1]
    np.testing.assert_allclose(from_there, angles, atol=1e-3)


def test_following_a_way_keeps_to_it(kinematics):
    along = np.linspace(0, 1, 200)[:, None]
    places = np.array([0.45, -0.15, 0.08]) + along * np.array([0.25, 0.3, -0.03])
    angles = kinematics.follow(places, kinematics.posture(places[0]), threading.Event())
    assert max(kinematics.miss(one, place) for one, place in zip(angles, places, strict=True)) < 2e-5
    assert kinematics.hindrance(angles, places, 0.01) is None


def test_following_ends_when_it_is_stopped(kinematics):
    stopped = threading.Event()
    stopped.set()
    places = np.repeat([[0.5, 0.0, 0.1]], 5, axis=0)
    assert len(kinematics.follow(places, kinematics.resting, stopped)) == 0


@pytest.mark.parametrize(
    ("place", "says"),
    [([1.2, 0.0, 0.1], "does not reach"), ([0.5, 0.0, -0.15], "would touch the table"), ([0.1, 0.05, 0.2], "")],
)
def test_hindrances_are_told(kinematics, place, says):
    place = np.array(place)
    told = kinematics.hindrance(kinematics.posture(place)[None], place[None], 0.01)
    assert told is not None
    assert says in told


def test_racing_joints_are_told(kinematics):
    places = np.array([[0.5, -0.2, 0.1], [0.5, 0.2, 0.1]])
    angles = np.array([kinematics.posture(place) for place in places])
    assert "joint" in kinematics.hindrance(angles, places, 0.01)
