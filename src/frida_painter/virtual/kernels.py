"""Loads the compiled kernels with which a studio computes, before anything depends on how soon it answers."""

import numpy as np
import torch

from frida_painter.frames import CanvasSize
from frida_painter.hardware.robot import Waypoints
from frida_painter.palette import Palette
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, open_studio


def load_kernels(brush: str) -> None:
    """Dips, touches and photographs once in a studio of no consequence: half a second, some more where none are cached.

    Loading holds up every thread of a process, the one that watches for a stop as well. Raises
    ConfigError where there is no such brush.
    """
    settings = StudioSettings(cell=2.0, camera=CameraSpec((30, 40)))
    easel = open_studio(CanvasSize(0.2, 0.2), brush, settings=settings).easel
    easel.robot.connect()
    easel.camera.connect()
    easel.operator.fill_wells(Palette(torch.full((1, 3), 0.5)))
    x, y, z = easel.workspace.canvas_origin
    down = np.array([[x + 0.01, y + 0.01, z + 0.01], [x + 0.01, y + 0.01, z - 0.001], [x + 0.01, y + 0.02, z - 0.001]])
    easel.robot.follow(Waypoints("dip", np.array([easel.workspace.wells[0]]), 0.1))
    easel.robot.follow(Waypoints("touch", down, 0.1))
    easel.camera.capture(0.0)
