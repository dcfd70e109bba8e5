"""Painting with one's own hand: every stroke is shown, with its colour, its place, its length and its pressure."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.calibration import Calibration
from frida_painter.errors import CalibrationError, FrameRejected, Interrupted
from frida_painter.frames import PixelGrid
from frida_painter.hardware.camera import Camera, Frame
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter.palette import Palette, to_hex
from frida_painter.perception.rectify import rectify
from frida_painter.session.hand_sheet import SHEET_ROWS, HandStroke, hand_sheet
from frida_painter.session.operator import PersonAsOperator
from frida_painter.session.procedures.dialogue import Answer, Confirm, Question

_MOST = 8  # strokes on one sheet, so that none is lost among the others


class ByHand(PersonAsOperator):
    """Stands for robot and operator of an easel at which a person paints; its camera remembers what it saw.

    Implements hardware.robot.Robot over `easel.robot`, which hears of a motion when the person says that
    it is done. One stroke is shown at a time, or as many of one dip as are clear to see, as the person
    likes. Raises Interrupted where they put the brush down.
    """

    def __init__(self, easel: Easel, answer: Callable[[Question], Answer]) -> None:
        super().__init__(answer)
        self._easel, self._robot = easel, easel.robot
        self.camera = Remembering(easel.camera, self._settle)
        self._width = brush_kind(easel.calibration.brush).width
        self._palette: Palette | None = None
        self._paint: int | None = None
        self._unclean = False
        self._at_once: bool | None = None  # several strokes on a sheet; None before the person has said
        self._coming: Sequence[Waypoints] = ()
        self._done_already: Sequence[Waypoints] = ()  # strokes of a sheet that was painted as a whole
        self._before = ""  # what is to be done with the brush before the next stroke
        self._since_look: list[HandStroke] = []
        self._aside, self._touched = False, True

    def fill_wells(self, palette: Palette) -> None:
        """Asks for the paints, and remembers them; and how many strokes are to be shown at a time."""
        super().fill_wells(palette)
        self._palette, self._paint = palette, None
        if self._at_once is None:
            several = Confirm(
                "Strokes are shown one at a time. Would you rather have several of one paint on a picture?",
                proposal=False,
            )
            self._at_once = self._answer(several) is True

    def foretell(self, motions: Sequence[Waypoints]) -> None:
        """Hears what will be asked for next."""
        self._coming = [motion for motion in motions if len(motion.position) > 1]

    def connect(self) -> None:
        """Nothing but the camera moves."""
        self._robot.connect()

    def home(self) -> MotionReport:
        """The brush is washed and laid aside, where there is paint on it."""
        if self._unclean:
            self._retry_after_pause(Confirm("Wash the brush and wipe it dry. Done?"))
            self._unclean, self._paint, self._before = False, None, ""
        self._touched |= self._aside  # nobody looked in between: it was a pause, and who knows what was done in it
        self._aside = True
        return self._robot.home()

    def pose(self) -> NDArray[np.float64]:
        """Where the hand was last, [3] metres."""
        return self._robot.pose()

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Asks for a stroke, and for what the brush needs before; takes note when it is done or left out."""
        if len(waypoints.position) == 1:  # a way through the air, which nobody has to be told of
            return self._robot.follow(waypoints)
        self._pass(waypoints)
        self._aside = left_out = False
        well = self._well(waypoints)
        if self._is_done(waypoints):
            pass  # it was on a sheet of several
        elif well is not None:
            self._before = self._dipping(well)
            self._paint, self._unclean = well, False
        elif self._over_canvas(waypoints):
            self._touched = True
            left_out = not self._is_painted(waypoints)
        else:
            self._unclean = True  # washing is asked for together with the dip that follows, or before a look
        return replace(self._robot.follow(waypoints), left_out=left_out)

    def stop(self) -> None:
        """Nothing more is asked for."""
        self._robot.stop()

    def close(self) -> None:
        """Lets go."""
        self._robot.close()

    def _changing_to(self, brush: str) -> str:
        self._width = brush_kind(brush).width
        return f"The next strokes are painted with the {brush} brush: wash the other one, and take this one, clean."

    def _asking_for(self, paints: str) -> str:
        return f"Mix these paints, and put them out by their numbers: {paints}. Are all of them there?"

    def _pass(self, waypoints: Waypoints) -> None:
        """Of what was foretold, only what comes after this motion is still to come."""
        later = [index + 1 for index, motion in enumerate(self._coming) if motion is waypoints]
        self._coming = self._coming[later[0] :] if later else ()

    def _is_done(self, waypoints: Waypoints) -> bool:
        """Whether a stroke is painted already, or a dip is for one that is."""
        stroke = waypoints if self._over_canvas(waypoints) else next(filter(self._over_canvas, self._coming), None)
        return stroke is not None and any(
            stroke.label == done.label and np.array_equal(stroke.position, done.position) for done in self._done_already
        )

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

    def _dipping(self, well: int) -> str:
        """How to take paint from a well, as a sentence."""
        color = "" if self._palette is None else f" ({to_hex(self._palette.color[well])})"
        if self._unclean or (self._paint is not None and self._paint != well):
            return f"Wash the brush, wipe it dry and dip it into paint {well + 1}{color}."
        return f"Dip the brush{' again' if self._paint == well else ''} into paint {well + 1}{color}."

    def _is_painted(self, waypoints: Waypoints) -> bool:
        """Whether the person has painted a stroke; False where they leave it out."""
        if self._at_once and self._are_painted(self._sheet_from(waypoints)):
            return True
        stroke = self._stroke(waypoints)
        before = [self._before] if self._before else []
        question = " ".join([*before, stroke.sentence, "Painted?"])
        title, *lines = stroke.heading
        if self._answer(Confirm(question, self._sheet([stroke], (title, *before, *lines)))) is True:
            self._before = ""
            self._since_look.append(stroke)
            return True
        self._retry_after_pause(
            Confirm(f"Is {stroke.label} to be left out? (No ends here; the rest can be painted another day.)")
        )
        return False

    def _sheet_from(self, waypoints: Waypoints) -> list[Waypoints]:
        """This stroke and what follows it with the same paint, dips between them too, up to so many strokes."""
        found = [waypoints]
        for motion in self._coming:
            if not (self._over_canvas(motion) or self._well(motion) == self._paint):
                break
            found.append(motion)
        strokes = [index for index, motion in enumerate(found) if self._over_canvas(motion)][:_MOST]
        return found[: strokes[-1] + 1]

    def _are_painted(self, motions: Sequence[Waypoints]) -> bool:
        """Whether the person has painted all of these strokes; where they have not, the first is asked for alone."""
        strokes = [self._stroke(motion) for motion in motions if self._over_canvas(motion)]
        if len(strokes) < 2:
            return False
        fresh = [after for dip, after in pairwise(motions) if not self._over_canvas(dip)]
        paint = "" if self._paint is None else f" with paint {self._paint + 1}"
        numbers = [motion.label.split()[-1] for motion in fresh]
        all_of_them = len(fresh) == len(strokes) - 1
        again = f"Dip again before {'each of the others' if all_of_them else _listed(numbers)}." if fresh else ""
        told = [line for line in (self._before, again) if line]
        order = "By their numbers, each from its ring to its arrow, pressed until it is as wide as its line."
        title = f"Strokes {strokes[0].number} to {strokes[-1].number}{paint}"
        question = f"{' '.join([*told, title])}. {order} Are all of them painted? (No asks for the first alone.)"
        if self._answer(Confirm(question, self._sheet(strokes, (title, *told, order)))) is not True:
            return False
        self._before = ""
        self._since_look += strokes
        self._done_already = [motion for motion in motions[1:] if self._over_canvas(motion)]
        return True

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

    def _sheet(self, strokes: Sequence[HandStroke], heading: Sequence[str]) -> Tensor:
        return hand_sheet(self._easel.canvas, self._paper(), self._since_look, strokes, heading, self._width)

    def _paper(self) -> Tensor:
        """The canvas as it was last seen, or bare."""
        grid = PixelGrid.of_height(self._easel.canvas, SHEET_ROWS)
        seen = self.camera.canvas(self._easel.calibration, grid)
        return torch.ones(3, grid.rows, grid.columns) if seen is None else seen

    def _settle(self) -> None:
        """Asks for the canvas to be in the camera's sight, unless it was when it was last seen."""
        if self._touched:
            folder = self._easel.calibration.camera.startswith("folder:")
            how = "Take a photograph of the canvas into the folder" if folder else "The canvas is photographed now"
            self._retry_after_pause(Confirm(f"{how}. Are your hands, brush and shadow out of the picture?"))
        self._aside = self._touched = False
        self._since_look = []

    def _retry_after_pause(self, question: Confirm) -> None:
        if self._answer(question) is not True:
            raise Interrupted("You put the brush down; what is on the canvas stays, and so does the plan.")


class Remembering:
    """A camera that remembers its last photograph; settle: called before each is taken."""

    def __init__(self, camera: Camera, settle: Callable[[], None]) -> None:
        self._camera, self._settle = camera, settle
        self._last: Frame | None = None

    def connect(self) -> None:
        """Reaches the camera."""
        self._camera.connect()

    def capture(self, newer_than: float) -> Frame:
        """A photograph taken after `newer_than` (s)."""
        self._settle()
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


def _listed(numbers: Sequence[str]) -> str:
    """ "3", "3 and 5", "3, 5 and 6"."""
    return " and ".join([", ".join(numbers[:-1])] * (len(numbers) > 1) + [numbers[-1]])
