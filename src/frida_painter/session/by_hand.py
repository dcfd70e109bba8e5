"""Painting with one's own hand: every stroke is shown, with its colour, its place, its length and its pressure."""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.errors import CalibrationError, FrameRejected, Interrupted
from frida_painter.frames import PixelGrid
from frida_painter.hardware.camera import Camera, Frame
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter.palette import Palette, to_hex
from frida_painter.perception.rectify import rectify
from frida_painter.session.attendance import PersonAttending
from frida_painter.session.hand_sheet import SHEET_ROWS, HandStroke, hand_sheet
from frida_painter.session.procedures.dialogue import Answer, Confirm, Question

_SETTLED = "The canvas is photographed now. Are your hands, brush and shadow out of the picture?"


class ByHand(PersonAttending):
    """Stands for robot and attendant of an easel at which a person paints; its camera remembers what it saw.

    Implements hardware.robot.Robot over `easel.robot`, which hears of a motion when the person says that
    it is done. Raises Interrupted where they say that they will not.
    """

    def __init__(self, easel: Easel, answer: Callable[[Question], Answer]) -> None:
        super().__init__(answer)
        self._easel, self._robot = easel, easel.robot
        self.camera = Remembering(easel.camera)
        self._palette: Palette | None = None
        self._paint: int | None = None
        self._unclean = False
        self._since_look: list[HandStroke] = []

    def fill_wells(self, palette: Palette) -> None:
        """Asks for the paints, and remembers them."""
        super().fill_wells(palette)
        self._palette, self._paint = palette, None

    def connect(self) -> None:
        """Nothing but the camera moves."""
        self._robot.connect()

    def home(self) -> MotionReport:
        """Asks for the hand to be out of the camera's sight."""
        self._insist(Confirm(_SETTLED))
        self._since_look = []
        return self._robot.home()

    def pose(self) -> NDArray[np.float64]:
        """Where the hand was last, [3] metres."""
        return self._robot.pose()

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Asks for a stroke, or for the brush to be cleaned and dipped, and takes note when it is done."""
        well = self._well(waypoints)
        if well is not None:
            self._ask_for_paint(well)
        elif self._over_canvas(waypoints):
            self._ask_for_stroke(waypoints)
        else:
            self._unclean = True  # rinsing and wiping are asked for together with the dip that follows
        return self._robot.follow(waypoints)

    def stop(self) -> None:
        """Nothing more is asked for."""
        self._robot.stop()

    def close(self) -> None:
        """Lets go."""
        self._robot.close()

    def _well(self, waypoints: Waypoints) -> int | None:
        """The number of the well into which a motion dips; None where it does not."""
        middle = waypoints.position.mean(0)[:2]
        away = [float(np.linalg.norm(middle - well[:2])) for well in self._easel.workspace.wells]
        nearest = int(np.argmin(away))
        return nearest if away[nearest] < 0.01 else None

    def _over_canvas(self, waypoints: Waypoints) -> bool:
        place = self._easel.workspace.to_canvas(waypoints.position)
        size = self._easel.canvas
        return bool(((place >= -0.01) & (place <= (size.width + 0.01, size.height + 0.01))).all())

    def _ask_for_paint(self, well: int) -> None:
        clean = self._unclean or (self._paint is not None and self._paint != well)
        color = "" if self._palette is None else f" ({to_hex(self._palette.color[well])})"
        begin = "Clean the brush, and dip it" if clean else "Dip the brush"
        self._insist(Confirm(f"{begin} into paint {well + 1}{color}. Done?"))
        self._paint, self._unclean = well, False

    def _ask_for_stroke(self, waypoints: Waypoints) -> None:
        stroke = self._stroke(waypoints)
        picture = hand_sheet(self._easel.canvas, self._paper(), self._since_look, stroke)
        self._insist(Confirm(f"{stroke.sentence} Painted?", picture))
        self._since_look.append(stroke)

    def _stroke(self, waypoints: Waypoints) -> HandStroke:
        """What a person has to know of a motion: its part on the canvas, without coming down and lifting."""
        path = waypoints.position[1:-1] if len(waypoints.position) > 3 else waypoints.position
        record = self._easel.calibration
        depth = (record.touch_height - path[:, 2]) / (record.touch_height - record.press_height)
        color = (0.2, 0.2, 0.2)
        if self._palette is not None and self._paint is not None:
            red, green, blue = self._palette.color[self._paint].tolist()
            color = (red, green, blue)
        return HandStroke(waypoints.label, self._paint, color, self._easel.workspace.to_canvas(path), depth.clip(0, 1))

    def _paper(self) -> Tensor:
        """The canvas as it was last seen, or bare."""
        grid = PixelGrid.of_height(self._easel.canvas, SHEET_ROWS)
        seen = self.camera.canvas(self._easel.calibration, grid)
        return torch.ones(3, grid.rows, grid.columns) if seen is None else seen

    def _insist(self, question: Confirm) -> None:
        if self._answer(question) is not True:
            raise Interrupted("You put the brush down; what is on the canvas stays, and so does the plan.")


class Remembering:
    """A camera that remembers its last photograph."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._last: Frame | None = None

    def connect(self) -> None:
        """Reaches the camera."""
        self._camera.connect()

    def capture(self, newer_than: float) -> Frame:
        """A photograph taken after `newer_than` (s)."""
        self._last = self._camera.capture(newer_than)
        return self._last

    def close(self) -> None:
        """Lets go of the camera."""
        self._camera.close()

    def canvas(self, calibration: Calibration, grid: PixelGrid) -> Tensor | None:
        """The canvas [3, rows, columns] in the last photograph; None where there is none that shows it."""
        if self._last is None:
            return None
        try:
            return rectify(self._last.image, calibration, grid)
        except (FrameRejected, CalibrationError):
            return None
