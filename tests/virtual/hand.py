"""A hand that moves the studio's robot as a painter would, without any of the painter's code."""

import math

import numpy as np
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.faults import PlacementError
from frida_painter.hardware.robot import Waypoints
from frida_painter.strokes.palette import Palette
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.tabletop import HandNoise

EXACT = PlacementError((0.0, 0.0), 0.0)
STEADY = HandNoise(0.0, 0.0)
CANVAS = CanvasSize(0.12, 0.09)


class Hand:
    def __init__(self, *colors, brush="medium", canvas=CANVAS, seed=0, error=EXACT, state=None, **settings):
        settings.setdefault("noise", STEADY)
        settings.setdefault("cell", 0.5)
        self.studio = open_studio(
            canvas, brush, seed=seed, placement_error=error, settings=StudioSettings(**settings), state=state
        )  # fmt: skip
        self.easel = self.studio.easel
        self.easel.robot.connect()
        self.easel.camera.connect()
        if colors:
            self.easel.operator.fill_wells(Palette(torch.tensor(colors)))

    def follow(self, label, points, speed=0.2):
        """From hover height through the points and up again."""
        points = np.asarray(points, float)
        ends = points[[0, -1]].copy()
        ends[:, 2] += self.easel.workspace.hover
        return self.easel.robot.follow(Waypoints(label, np.concatenate([ends[:1], points, ends[1:]]), speed))

    def dip(self, well):
        return self.follow("dip", [self.easel.workspace.wells[well]])

    def clean(self):
        workspace = self.easel.workspace
        angle = np.linspace(0, 6 * np.pi, 37)
        self.follow("rinse", workspace.water + 0.008 * np.c_[np.cos(angle), np.sin(angle), 0 * angle])
        x, y, z = workspace.rag
        side = workspace.rag_width / 2
        self.follow("wipe", [(x - side, y, z), (x + side, y, z), (x - side, y, z), (x + side, y, z)])

    def stroke(self, x, y, length, *, angle=0.0, bend=0.0, thickness=0.8):
        u = np.linspace(0, 1, 41)
        ends = u**3 + (1 - u) ** 3
        along, aside = u * length, 3 * u * (1 - u) * bend
        cos, sin = math.cos(angle), math.sin(angle)
        place = np.c_[x + cos * along - sin * aside, y + sin * along + cos * aside]
        height = self.easel.calibration.height(0.2 * ends + thickness * (1 - ends))
        return self.follow("stroke", self.easel.workspace.to_robot(place, height), 0.06)

    def truth(self):
        """[rows, columns, 3] sRGB, two pixels a millimetre."""
        return self.studio.truth(round(self.easel.canvas.height * 2000)).permute(1, 2, 0).numpy()

    def around(self, x, y, half=0.002, image=None):
        """Mean sRGB of a small square of the canvas around (x, y) metres."""
        image = self.truth() if image is None else image
        row, column, reach = round((self.easel.canvas.height - y) * 2000), round(x * 2000), round(half * 2000)
        return image[row - reach : row + reach, column - reach : column + reach].reshape(-1, 3).mean(0)
