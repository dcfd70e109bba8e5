"""Outlines traced in the air: the edges of the canvas and of the painting, for a person who watches the brush.

The tip goes round both at the workspace's hover height above the canvas.
"""

import itertools
from collections.abc import Callable

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints
from frida_painter.strokes.plan import Plan

_STEP = 0.01  # metres between two waypoints; every waypoint is checked
_SAMPLES = 17  # points on each stroke


def plan_outlines(easel: Easel, plan: Plan | None = None) -> list[Waypoints]:
    """Returns the motions that trace the canvas and then the strokes of a plan, one for each straight side.

    The canvas is traced from its bottom-left corner, counter-clockwise as seen from above.
    """
    size = easel.canvas
    corners = np.array([(0.0, 0.0), (size.width, 0.0), (size.width, size.height), (0.0, size.height)])
    motions = _round("canvas", corners, easel)
    if plan is not None and len(plan):
        motions += _round("painting", outline_strokes(plan), easel)
    return motions


def outline_strokes(plan: Plan) -> NDArray[np.float64]:
    """Returns the corners [k, 2] of the convex outline of all strokes, in canvas metres, counter-clockwise."""
    places = plan.strokes.path(torch.linspace(0, 1, _SAMPLES)).detach().reshape(-1, 2)
    return np.asarray(cv2.convexHull(places.float().cpu().numpy(), clockwise=False)[:, 0], np.float64)


def trace_outlines(
    easel: Easel, motions: list[Waypoints], tell: Callable[[str], None], stop_asked: Callable[[], bool]
) -> bool:
    """Makes the motions of `plan_outlines`, and moves the arm to its home position; the robot is connected.

    tell: receives the name of each side before it is traced.
    stop_asked: asked before each side; the arm then goes to its home position at once.
    Returns True if all was traced.
    Raises WorkspaceViolation before anything moves, and RobotError.
    """
    gateway = RobotGateway(easel)
    gateway.check(motions)
    traced = 0
    for motion in motions:
        if stop_asked():
            break
        tell(motion.label)
        gateway.perform((motion,))
        traced += 1
    gateway.step_aside()
    return traced == len(motions)


def _round(what: str, corners: NDArray[np.float64], easel: Easel) -> list[Waypoints]:
    """Returns the motions round a closed outline: to above its first corner, along each side, and up."""
    workspace, motion = easel.workspace, Motion(easel.workspace, easel.calibration)
    low = min(easel.calibration.highest_touch + workspace.hover, motion.travel_height)
    first = _over(corners[:1], low, easel)
    above = _over(corners[:1], motion.travel_height, easel)
    motions = [Waypoints(f"to the {what}", np.concatenate([above, first]), workspace.travel_speed)]
    closed = np.concatenate([corners, corners[:1]])
    for number, (start, end) in enumerate(itertools.pairwise(closed), 1):
        count = max(2, int(np.ceil(np.linalg.norm(end - start) / _STEP)) + 1)
        side = start + np.linspace(0, 1, count)[:, None] * (end - start)
        label = f"side {number} of {len(corners)} of the {what}"
        motions.append(Waypoints(label, _over(side, low, easel), workspace.painting_speed))
    return [*motions, Waypoints(f"up from the {what}", above, workspace.travel_speed)]


def _over(places: NDArray[np.float64], height: float, easel: Easel) -> NDArray[np.float64]:
    """Returns places [k, 2] of the canvas at a robot height, in the robot's metres [k, 3], as strokes are sent."""
    return easel.workspace.to_robot(easel.calibration.place(places), np.full(len(places), height))
