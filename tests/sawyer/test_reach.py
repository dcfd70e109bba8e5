import sys

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import RobotError, WorkspaceViolation
from frida_painter.hardware.gateway import MotionLimits
from frida_painter.hardware.robot import Waypoints
from frida_painter.virtual.bristles import find_brush
from frida_painter.virtual.tabletop import sawyer_layout
from frida_painter_drivers.sawyer.arm import SawyerReach

CANVAS = CanvasSize(14 * 0.0254, 11 * 0.0254)
WORKSPACE = sawyer_layout(CANVAS, find_brush("broad")).workspace


def test_it_reaches_its_canvas_wells_water_and_rag_and_not_the_far_end_of_the_table():
    pytest.importorskip("mink")
    reach = SawyerReach(WORKSPACE, CANVAS)
    u, v = np.meshgrid(np.linspace(0, CANVAS.width, 4), np.linspace(0, CANVAS.height, 4))
    canvas = WORKSPACE.to_robot(np.c_[u.ravel(), v.ravel()], np.full(16, 0.05))
    things = np.array([*canvas, *WORKSPACE.wells, WORKSPACE.water, WORKSPACE.rag])
    assert reach.reachable(things).all()
    far = np.array([[1.1, 0.0, 0.1], [0.6, 0.0, -0.2], [np.nan, 0.0, 0.1], [0.6, np.inf, 0.1]])
    assert not reach.reachable(far).any()


def test_what_it_does_not_reach_is_refused_with_the_whole_batch():
    pytest.importorskip("mink")
    canvas = CanvasSize(0.6, 0.6)
    workspace = sawyer_layout(canvas, find_brush("broad")).workspace
    reach = SawyerReach(workspace, canvas)
    corner = workspace.to_robot(np.array([[0.02, 0.02]]), np.array([0.06]))
    with pytest.raises(WorkspaceViolation, match="stroke 3: the arm does not reach"):
        MotionLimits(workspace, reach=reach).check([Waypoints("stroke 3", corner, 0.06)])


def test_without_mujoco_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for name in ("body", "surroundings"):
        monkeypatch.delitem(sys.modules, f"frida_painter_drivers.sawyer.{name}", raising=False)
    with pytest.raises(RobotError, match='extra "mujoco"'):
        SawyerReach(WORKSPACE, CANVAS).reachable(np.zeros((1, 3)))
