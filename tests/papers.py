"""A small virtual easel for stroke libraries, and cameras that see what is not there."""

from dataclasses import dataclass, replace

import numpy as np

from frida_painter.brush.kinds import BrushKind
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.faults import NO_FAULTS, Faults, PlacementError
from frida_painter.hardware.robot import Frame
from frida_painter.strokes.strokes import StrokeLimits
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, VirtualStudio, open_studio

KIND = BrushKind("fine", StrokeLimits((0.010, 0.030), (-0.010, 0.010)), 0.010)
SHEET = CanvasSize(0.10, 0.07)
PLACES = 4
"""As many strokes fit on a sheet."""


def paper_studio(faults: Faults = NO_FAULTS, *, size: CanvasSize = SHEET, seed: int = 0) -> VirtualStudio:
    """A studio with a calibrated robot, connected, whose small photographs are quickly taken."""
    studio = open_studio(
        size,
        "fine",
        seed=seed,
        placement_error=PlacementError((0.0, 0.0), 0.0),
        faults=faults,
        settings=StudioSettings(cell=0.4, camera=CameraSpec((420, 560))),
    )
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return studio


def proposed(question):
    """What the procedure would answer itself."""
    return question.proposal


@dataclass
class SpoiledCamera:
    """The studio's camera, whose photographs are changed by `spoil(image, number)` on the way."""

    camera: object
    spoil: object
    taken: int = 0

    def connect(self) -> None: ...

    def close(self) -> None: ...

    def capture(self, newer_than: float) -> Frame:
        frame = self.camera.capture(newer_than)
        self.taken += 1
        return replace(frame, image=self.spoil(frame.image.copy(), self.taken - 1))


def spoiled(studio: VirtualStudio, spoil):
    """The studio's easel with such a camera."""
    return replace(studio.easel, camera=SpoiledCamera(studio.easel.camera, spoil))


def dark_bar(image: np.ndarray) -> np.ndarray:
    """Something dark stands across the picture."""
    image[:, 266:300] = 40
    return image
