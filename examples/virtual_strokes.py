"""Paints a sheet of strokes in the virtual studio and keeps it as a picture: python examples/virtual_strokes.py [FILE].

Left: pressed ever harder from top to bottom, of different lengths and bends, each with a full brush. Right, from the
top: one brushful used up in four strokes; wet paint over wet paint; the same over dry paint; wet strokes anyhow.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.motion import Motion
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.strokes import Strokes
from frida_painter.virtual.studio import open_studio
from frida_painter.virtual.tabletop import PlacementError

SHEET = CanvasSize(0.50, 0.30)
BLACK, BLUE, YELLOW, WHITE, RED, GREEN = range(6)
PAINTS = Palette(
    torch.tensor(
        [[0.08, 0.08, 0.09], [0.1, 0.3, 0.72], [0.98, 0.84, 0.12], [1, 1, 1], [0.8, 0.16, 0.14], [0.1, 0.45, 0.28]]
    )
)


class Painter:
    def __init__(self) -> None:
        self.studio = open_studio(SHEET, "broad", seed=3, placement_error=PlacementError((0.0, 0.0), 0.0))
        easel = self.studio.easel
        easel.robot.connect()
        easel.operator.fill_wells(PAINTS)
        self.robot, self.motion = easel.robot, Motion(easel.workspace, easel.calibration)

    def take(self, paint: int) -> None:
        for motion in (self.motion.rinse(), self.motion.wipe(), self.motion.dip(paint)):
            self.robot.follow(motion)

    def stroke(self, x: float, y: float, length: float, *, angle=0.0, bend=0.0, thickness=0.5) -> None:
        numbers = (torch.tensor([value], dtype=torch.float32) for value in (angle, length, bend, thickness))
        angle_, length_, bend_, thickness_ = numbers
        stroke = Strokes(torch.tensor([[x, y]]), angle_, length_, bend_, thickness_, torch.zeros(1, 3))
        self.robot.follow(self.motion.stroke(stroke, 0))


def paint(painter: Painter) -> None:
    lengths, bends = (0.065, 0.028, 0.05), (0.0, -0.008, 0.018)
    for row in range(7):
        for column in range(3):
            painter.take(BLACK)
            thickness, turn = (3 * row + column) / 20, -1 if row % 2 else 1
            bend = turn * bends[(row + column) % 3] * (0.5 if column == 1 else 1)
            painter.stroke(
                0.015 + 0.09 * column + 0.01 * (column == 1), 0.28 - 0.041 * row, lengths[column],
                bend=bend, thickness=thickness,
            )  # fmt: skip
    painter.take(BLUE)
    for y in (0.275, 0.245, 0.215, 0.185):
        painter.stroke(0.30, y, 0.075, thickness=0.95)
    for dry in (False, True):
        middle = 0.075 if dry else 0.215
        for x, color in ((0.41, BLUE), (0.44, RED), (0.47, BLACK)):
            painter.take(color)
            painter.stroke(x, middle + 0.06, 0.075, angle=-np.pi / 2, thickness=0.5)
        if dry:
            painter.studio.wait(3600)
        for y, color in ((0.03, YELLOW), (-0.005, WHITE)):
            painter.take(color)
            painter.stroke(0.395, middle + y, 0.075, thickness=0.5)
    random = np.random.default_rng(5)
    for number, color in enumerate((GREEN, BLUE, RED, YELLOW, GREEN, BLUE, WHITE, RED, YELLOW)):
        painter.take(color)
        x, y = 0.30 + 0.022 * (number % 3), 0.035 + 0.035 * (number // 3) + random.uniform(-0.01, 0.01)
        painter.stroke(x, y, random.uniform(0.03, 0.05), angle=random.uniform(-0.6, 0.6),
                       bend=random.uniform(-0.015, 0.015), thickness=random.uniform(0.2, 0.9))  # fmt: skip


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "virtual-strokes.jpg")
    artist = Painter()
    paint(artist)
    picture = artist.studio.truth(780).permute(1, 2, 0).numpy()[..., ::-1]
    cv2.imwrite(str(target), np.rint(picture * 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 88])
    print(f"{target}: {target.stat().st_size / 1000:.0f} kB")
