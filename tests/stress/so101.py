"""Paints with an SO-101 over its simulated bus, without and with play in its gears, in the virtual studio.

    make stress PROGRAM=so101 OPTIONS="--strokes 60 --out play.jpg"

The driver speaks to servos that are played from their protocol manual; the studio's brush follows the loads behind
the gears. Both paintings begin with the same plan. --out writes both canvases side by side.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from frida_painter.virtual.bristles import find_brush
from frida_painter_drivers.so101 import PLAY, So101Robot

sys.path.insert(0, str(Path(__file__).parents[1]))
from machines.arm_bench import so101_bus
from machines.driven_arm import DrivenArm, DrivenPainting, before_the_arm, paint
from machines.simulated_time import SimulatedTime
from machines.sts_bus import BRUSH, tips
from support.virtual_painting import CANVAS, VirtualPainting

LEFT, NEAR, HEIGHT = 0.06, 0.115, 0.0
"""Place of the canvas before the arm, metres."""


@dataclass(frozen=True)
class Judged:
    """Painting with the play that was told before it, metres."""

    painting: DrivenPainting
    told: float


def main() -> int:
    """Paints and prints the figures. Returns 1 if strokes are missing, or if the play was not told honestly."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--strokes", type=int, default=60)
    options.add_argument("--replans", type=int, default=2)
    options.add_argument("--out", type=Path)
    asked = options.parse_args()
    world = VirtualPainting.made()
    exact, loose = (judged(world, asked.strokes, asked.replans, play) for play in (0.0, PLAY))
    for name, one in (("no play", exact), ("a degree of play", loose)):
        done = one.painting
        print(
            f"{name}: {done.strokes} of {asked.strokes} strokes, {done.looks} looks; tip {1000 * done.rms:.2f} mm off "
            f"(root mean square), {1000 * done.worst:.2f} mm at most"
        )
    print(f"told before: {1000 * loose.told:.1f} mm")
    if asked.out:
        pictures = [one.painting.canvas.permute(1, 2, 0).numpy() for one in (exact, loose)]
        gap = np.ones((pictures[0].shape[0], 24, 3), np.float32)
        both = np.concatenate([pictures[0], gap, pictures[1]], 1)
        Image.fromarray((255 * both).round().astype(np.uint8)).save(asked.out, quality=88)
    done = all(one.painting.strokes == asked.strokes for one in (exact, loose))
    return 0 if done and exact.painting.rms < 1e-3 and loose.told / 4 < loose.painting.rms < loose.told else 1


def judged(world: VirtualPainting, strokes: int, replans: int, play: float, colors: int = 3) -> Judged:
    """Paints a picture with so much play, radians."""
    layout = before_the_arm(LEFT, NEAR, HEIGHT, find_brush("fine").press_depth / 1000)
    clock = SimulatedTime()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serial.Serial", clock.port())
        bus, cable = so101_bus(clock, patch, np.array(layout.home), play=play)
        robot = So101Robot(cable.name, layout.home, layout.workspace.travel_speed, BRUSH)
        seen: list[np.ndarray] = []
        read = 0

        def places() -> np.ndarray:
            nonlocal read
            if fresh := bus.trace[read:]:
                seen.append(tips(np.array(fresh)))
                read += len(fresh)
            return np.concatenate(seen)

        arm = DrivenArm(robot, places, lambda: clock.now)
        painting = paint(arm, layout, strokes, replans, world, colors)
        clock.end()
    corners = np.array([(x, y) for x in (0, CANVAS.width) for y in (0, CANVAS.height)])
    told = robot.play(layout.workspace.to_robot(corners, np.full(4, HEIGHT)))
    return Judged(painting, float(np.nanmax(told)))


if __name__ == "__main__":
    sys.exit(main())
