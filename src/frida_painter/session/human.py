"""Painting by hand: a person paints each stroke from a picture with its colour, place, length and pressure."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Answer, Confirm, Question
from frida_painter.easel.operator import PersonAsOperator
from frida_painter.errors import CalibrationError, FrameRejected, Interrupted
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import door_of
from frida_painter.hardware.interlock import Interlock
from frida_painter.hardware.robot import Camera, Frame, MotionReport, Point, Waypoints
from frida_painter.perception.rectify import rectify
from frida_painter.strokes.palette import Palette, to_hex
from frida_painter.system import images
from frida_painter.system.sheet import CREAM, INK, LINE, SOFT, Sheet, font

# Sheet for painting by hand: the next strokes, drawn on the last seen canvas.

SHEET_ROWS = 720
_SHARP = 2  # drawn larger by this factor, then scaled down
_MARGIN, _HEAD = 64, 144
_MARK = (196, 52, 36)
_FADED = 0.4
_LEVELS = ("barely touching", "lightly", "with some pressure", "pressed well", "pressed hard")
_Color = tuple[int, int, int]


@dataclass(frozen=True)
class HandStroke:
    """Stroke for a person to paint.

    label: its name.
    paint: its number from 0, None if no paint was requested.
    color: sRGB in [0, 1].
    path [k, 2]: canvas metres.
    pressure [k]: 0 for the lightest touch, 1 for the hardest press.
    """

    label: str
    paint: int | None
    color: tuple[float, float, float]
    path: NDArray[np.float64]
    pressure: NDArray[np.float64]

    @property
    def number(self) -> str:
        """Number as text, such as "12"."""
        return self.label.split()[-1]

    @property
    def level(self) -> int:
        """Largest pressure, in five steps from 0."""
        return min(int(float(self.pressure.max()) * len(_LEVELS)), len(_LEVELS) - 1)

    @property
    def heading(self) -> tuple[str, str, str]:
        """Three lines: name and paint; begin and end; length and pressure."""
        (x, y), (end_x, end_y) = self.path[0] * 100, self.path[-1] * 100
        length = 100 * float(np.linalg.norm(np.diff(self.path, axis=0), axis=1).sum())
        return (
            self.label.capitalize() + ("" if self.paint is None else f" with paint {self.paint + 1}"),
            f"Begin {x:.1f} cm from the left and {y:.1f} cm from the bottom, end at {end_x:.1f} and {end_y:.1f} cm.",
            f"{length:.1f} cm long, {_LEVELS[self.level]}.",
        )

    @property
    def sentence(self) -> str:
        """Lines of the heading as one sentence."""
        name, where, how = self.heading
        return f"{name}: {where[:1].lower()}{where[1:-1]}; {how}"


def hand_sheet(
    canvas: CanvasSize,
    seen: Tensor,
    done: Sequence[HandStroke],
    strokes: Sequence[HandStroke],
    heading: Sequence[str],
    width: float,
) -> Tensor:
    """Returns the sheet, sRGB [3, h, w] in [0, 1]: the faded canvas with rulers in centimetres, and the strokes on it.

    seen [3, 720, w]: canvas at the last look.
    done: strokes painted since then.
    strokes: one or more strokes to paint, in order.
    heading: a title and up to three lines.
    width: width of the mark of the hardest press, in metres.
    Each stroke begins at its ring and ends at its arrow, and its line is as wide as its mark.
    """
    pen = _Pen(canvas, seen, width)
    pen.ruler()
    for stroke in done:
        pen.mark(stroke, _FADED)
    for stroke in strokes:
        pen.mark(stroke, edges=((2.5, CREAM), (1.2, INK)))  # a dark and a light edge are visible on any ground
    if len(strokes) == 1:
        pen.guides(strokes[0])
        pen.gauge(strokes[0])
    for stroke in strokes:
        pen.ends(stroke, stroke.number if len(strokes) > 1 else "")
    pen.head(strokes[0].color, heading, room=0 if len(strokes) > 1 else 220)
    columns, rows = (side // _SHARP for side in pen.sheet.image.size)
    return images.from_uint8(np.asarray(pen.sheet.shrink(columns, rows)))


class _Pen:
    """Drawing tool of the sheet; lengths and places are in pixels of the final sheet, or in metres of the canvas."""

    def __init__(self, canvas: CanvasSize, seen: Tensor, width: float) -> None:
        self.canvas, self.width = canvas, width
        self.rows, self.columns = seen.shape[1:]
        self.scale = self.rows / canvas.height  # pixels per metre
        self.sheet = Sheet((self.columns + 2 * _MARGIN) * _SHARP, (self.rows + _HEAD + _MARGIN) * _SHARP, CREAM)
        self.draw = self.sheet.draw
        faded = Image.fromarray(images.to_uint8(1 - (1 - seen) * _FADED))
        larger = faded.resize((self.columns * _SHARP, self.rows * _SHARP), Image.Resampling.BICUBIC)
        self.sheet.paste(larger, (_MARGIN * _SHARP, _HEAD * _SHARP))

    def at(self, point: Sequence[float] | NDArray[np.float64]) -> tuple[float, float]:
        """Returns a place on the canvas as (column, row)."""
        return _MARGIN + float(point[0]) * self.scale, _HEAD + self.rows - float(point[1]) * self.scale

    def mark(self, stroke: HandStroke, strength: float = 1.0, edges: Sequence[tuple[float, _Color]] = ()) -> None:
        """Draws a stroke in its colour, over edges that are wider by so many pixels."""
        for grown, fill in (*edges, (0.0, _bytes(stroke.color, strength))):
            for place, pressure in zip(_densely(stroke.path), _densely(stroke.pressure), strict=True):
                radius = max(1.5, self.scale * self.width * (0.25 + 0.75 * float(pressure)) / 2) + grown
                self._disc(self.at(place), radius, fill)

    def ends(self, stroke: HandStroke, number: str) -> None:
        """Draws a ring, with the number, at the start of a stroke, and an arrow at its end."""
        points = [np.array(self.at(point)) for point in stroke.path]
        start, tip = points[0], points[-1]
        before = next((point for point in reversed(points) if float(np.linalg.norm(tip - point)) > 8), start)
        along = (tip - before) / max(float(np.linalg.norm(tip - before)), 1e-9)
        aside = np.array([-along[1], along[0]])
        for reach, color in ((3.0, CREAM), (0.0, _MARK)):
            corners = (tip + along * (24 + 1.6 * reach), *(tip + sign * aside * (13 + reach) for sign in (1, -1)))
            back = tip - along * reach
            self.draw.polygon([self._sharp(corner) for corner in (corners[0], corners[1], back, corners[2])], color)
        begin = (float(start[0]), float(start[1]))
        for radius, color in ((15.0, CREAM), (13.5, _MARK), (10.5, CREAM)) if number else ((15.0, CREAM),):
            self._disc(begin, radius, color)
        if number:
            self._text(begin, number, 14 if len(number) < 3 else 11, INK, "mm")
        else:
            self._disc(begin, 13.5, _MARK)
            self._disc(begin, 9.5, _bytes(stroke.color))

    def guides(self, stroke: HandStroke) -> None:
        """Draws dashed lines from the start of a stroke to both rulers, with the values there."""
        x, y = self.at(stroke.path[0])
        bottom = _HEAD + self.rows
        for end in ((x, bottom), (_MARGIN, y)):
            count = max(1, int(math.dist((x, y), end) / 12))
            for near, far in ((dash / count, (dash + 0.6) / count) for dash in range(count)):
                places = [(x + (end[0] - x) * part, y + (end[1] - y) * part) for part in (near, far)]
                self._stroke(places[0], places[1], _MARK)
        for (left, top), metres in (((x, bottom + 23), stroke.path[0][0]), ((_MARGIN - 31, y), stroke.path[0][1])):
            self._box((left - 24, top - 11, left + 24, top + 11), 5, _MARK)
            self._text((left, top), f"{100 * metres:.1f}", 15, CREAM, "mm")

    def gauge(self, stroke: HandStroke) -> None:
        """Draws the pressure, in five steps."""
        right = _MARGIN + self.columns
        for level in range(len(_LEVELS)):
            radius = 6.0 + 2.6 * level
            middle = (right - 24 - 38.0 * (len(_LEVELS) - 1 - level), 58.0)
            self._disc(middle, radius, INK if level <= stroke.level else LINE)
        self._text((right - 100, 100), _LEVELS[stroke.level], 16, SOFT, "mm")

    def head(self, color: tuple[float, float, float], heading: Sequence[str], room: int) -> None:
        """Draws the swatch of the paint, a title and its lines; leaves `room` pixels free on the right."""
        self._box((_MARGIN, 26, _MARGIN + 92, 118), 12, _bytes(color), LINE)
        left = _MARGIN + 108
        most = _MARGIN + self.columns - left - room
        places = [(20, 30, INK), *((60 + 23 * row, 17, SOFT) for row in range(3))]
        for text, (top, largest, ink) in zip(heading, places, strict=False):
            size = min(largest, largest * most / max(font(largest).getlength(text), 1.0))  # no wider than `most`
            self._text((left, top), text, size, ink, "la")

    def ruler(self) -> None:
        """Draws centimetres from the left and from the bottom, every fifth with its number."""
        left, top, right, bottom = _MARGIN, _HEAD, _MARGIN + self.columns, _HEAD + self.rows
        for corners in (((left, top), (right, top)), ((right, top), (right, bottom))):
            self._stroke(*corners, LINE)
        for corners in (((left, top), (left, bottom)), ((left, bottom), (right, bottom))):
            self._stroke(*corners, SOFT)
        for length, across in ((self.canvas.width, True), (self.canvas.height, False)):
            for centimetre in range(math.floor(100 * length + 1e-6) + 1):
                along, fifth = centimetre / 100 * self.scale, centimetre % 5 == 0
                reach = 10 if fifth else 5
                x, y = (left + along, bottom) if across else (left, bottom - along)
                self._stroke((x, y), (x, y + reach) if across else (x - reach, y), SOFT)
                if fifth:
                    place = (x, y + 23) if across else (x - 14, y)
                    self._text(place, str(centimetre), 15, SOFT, "mm" if across else "rm")

    def _disc(self, middle: tuple[float, float], radius: float, fill: _Color) -> None:
        (x, y), r = self._sharp(middle), radius * _SHARP
        self.draw.ellipse((x - r, y - r, x + r, y + r), fill=fill)

    def _box(
        self, corners: tuple[float, float, float, float], round_: float, fill: _Color, line: _Color | None = None
    ) -> None:
        sharp = [value * _SHARP for value in corners]
        self.draw.rounded_rectangle(sharp, round_ * _SHARP, fill=fill, outline=line, width=2 * _SHARP if line else 0)

    def _stroke(self, start: tuple[float, float], end: tuple[float, float], color: _Color) -> None:
        self.draw.line((*self._sharp(start), *self._sharp(end)), fill=color, width=_SHARP)

    def _text(self, at: tuple[float, float], text: str, size: float, fill: _Color, anchor: str) -> None:
        self.draw.text(self._sharp(at), text, fill=fill, font=font(size * _SHARP), anchor=anchor)

    @staticmethod
    def _sharp(point: Sequence[float] | NDArray[np.float64]) -> tuple[float, float]:
        return float(point[0]) * _SHARP, float(point[1]) * _SHARP


def _densely(values: NDArray[np.float64], parts: int = 4) -> NDArray[np.float64]:
    """Returns values [k] or [k, 2] with interpolated ones between."""
    at, known = np.linspace(0, len(values) - 1, parts * (len(values) - 1) + 1), np.arange(len(values))
    if values.ndim == 1:
        return np.interp(at, known, values)
    return np.stack([np.interp(at, known, column) for column in values.T], 1)


def _bytes(color: tuple[float, float, float], strength: float = 1.0) -> _Color:
    red, green, blue = (round(255 * (1 - (1 - part) * strength)) for part in color)
    return red, green, blue


_MAX = 8  # most strokes on one sheet, so that a person can tell them apart


class ByHand(PersonAsOperator):
    """Robot and operator of an easel at which a person paints; its camera remembers the last photograph.

    Implements hardware.robot.Robot around `easel.robot`, which gets a motion after the person reports it done. The
    sheet shows one stroke at a time, or several of one paint if the person prefers that.
    Raises Interrupted if the person stops painting.
    """

    def __init__(self, easel: Easel, answer: Callable[[Question], Answer]) -> None:
        super().__init__(answer)
        self._easel, self._robot, self.allow = easel, easel.robot, door_of(easel).allow
        self.camera = Remembering(easel.camera, self._settle)
        self._width = brush_kind(easel.calibration.brush).width
        self._palette: Palette | None = None
        self._paint: int | None = None
        self._unclean = False
        self._at_once: bool | None = None  # True for several strokes on a sheet; None before the person has decided
        self._coming: Sequence[Waypoints] = ()
        self._done_already: Sequence[Waypoints] = ()  # strokes of a sheet that was painted as a whole
        self._before = ""  # instruction for the brush before the next stroke
        self._since_look: list[HandStroke] = []
        self._aside, self._touched = False, True

    def fill_wells(self, palette: Palette) -> None:
        """Asks for the paints and remembers them; the first time, asks how many strokes a sheet may show."""
        super().fill_wells(palette)
        self._palette, self._paint = palette, None
        if self._at_once is None:
            several = Confirm(
                "Strokes are shown one at a time. Would you rather have several of one paint on a picture?",
                proposal=False,
            )
            self._at_once = self._answer(several) is True

    def foretell(self, motions: Sequence[Waypoints]) -> None:
        """Receives the motions that follow."""
        self._coming = [motion for motion in motions if len(motion.position) > 1]

    def connect(self) -> None:
        """Connects `easel.robot`."""
        self._robot.connect()

    def home(self) -> MotionReport:
        """Asks the person to wash the brush if there is paint on it, then moves to the home position."""
        if self._unclean:
            self._retry_after_pause(Confirm("Wash the brush and wipe it dry. Done?"))
            self._unclean, self._paint, self._before = False, None, ""
        self._touched |= self._aside  # it was a pause, in which the canvas may have been touched
        self._aside = True
        return self._robot.home()

    def pose(self) -> NDArray[np.float64]:
        """Returns the last position of the hand, [3] metres."""
        return self._robot.pose()

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Asks the person for a stroke and for the brush work before it; reports it as done or left out."""
        if len(waypoints.position) == 1:  # travel through the air needs no request
            return self._robot.follow(waypoints)
        # This motion and the ones before it are over.
        later = [index + 1 for index, motion in enumerate(self._coming) if motion is waypoints]
        self._coming = self._coming[later[0] :] if later else ()
        self._aside = left_out = False
        well = self._well(waypoints)
        if self._is_done(waypoints):
            pass  # already painted from a sheet of several strokes
        elif well is not None:
            self._before = self._dipping(well)
            self._paint, self._unclean = well, False
        elif self._over_canvas(waypoints):
            self._touched = True
            left_out = not self._is_painted(waypoints)
        else:
            self._unclean = True  # washing is requested together with the next dip, or before a look
        return replace(self._robot.follow(waypoints), left_out=left_out)

    def stop(self) -> None:
        """Stops: asks for no further motion."""
        self._robot.stop()

    def close(self) -> None:
        """Closes `easel.robot`."""
        self._robot.close()

    def _changing_to(self, brush: str) -> str:
        self._width = brush_kind(brush).width
        return f"The next strokes are painted with the {brush} brush: wash the other one, and take this one, clean."

    def _asking_for(self, paints: str) -> str:
        return f"Mix these paints, and put them out by their numbers: {paints}. Are all of them there?"

    def _is_done(self, waypoints: Waypoints) -> bool:
        """Returns True if a stroke is painted already, or if a dip belongs to a painted stroke."""
        stroke = waypoints if self._over_canvas(waypoints) else next(filter(self._over_canvas, self._coming), None)
        return stroke is not None and any(
            stroke.label == done.label and np.array_equal(stroke.position, done.position) for done in self._done_already
        )

    def _well(self, waypoints: Waypoints) -> int | None:
        """Returns the number of the well that a motion dips into; None for another motion."""
        middle = waypoints.position.mean(0)[:2]
        away = [float(np.linalg.norm(middle - well[:2])) for well in self._easel.workspace.wells]
        nearest = int(np.argmin(away))
        return nearest if away[nearest] < 0.01 else None

    def _over_canvas(self, waypoints: Waypoints) -> bool:
        place = self._easel.workspace.to_canvas(waypoints.position)
        size = self._easel.canvas
        return bool(((place >= -0.01) & (place <= (size.width + 0.01, size.height + 0.01))).all())

    def _dipping(self, well: int) -> str:
        """Returns the instruction to take paint from a well."""
        color = "" if self._palette is None else f" ({to_hex(self._palette.color[well])})"
        if self._unclean or (self._paint is not None and self._paint != well):
            return f"Wash the brush, wipe it dry and dip it into paint {well + 1}{color}."
        return f"Dip the brush{' again' if self._paint == well else ''} into paint {well + 1}{color}."

    def _is_painted(self, waypoints: Waypoints) -> bool:
        """Returns True if the person has painted a stroke; False if they leave it out."""
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
        """Returns this stroke and the following ones of the same paint, with the dips between, up to 8 strokes."""
        found = [waypoints]
        for motion in self._coming:
            if not (self._over_canvas(motion) or self._well(motion) == self._paint):
                break
            found.append(motion)
        strokes = [index for index, motion in enumerate(found) if self._over_canvas(motion)][:_MAX]
        return found[: strokes[-1] + 1]

    def _are_painted(self, motions: Sequence[Waypoints]) -> bool:
        """Returns True if the person has painted all of these strokes; otherwise the first one is requested alone."""
        strokes = [self._stroke(motion) for motion in motions if self._over_canvas(motion)]
        if len(strokes) < 2:
            return False
        fresh = [after for dip, after in pairwise(motions) if not self._over_canvas(dip)]
        paint = "" if self._paint is None else f" with paint {self._paint + 1}"
        numbers = [motion.label.split()[-1] for motion in fresh]
        all_of_them = len(fresh) == len(strokes) - 1
        again = f"Dip again before {'each of the others' if all_of_them else _list_numbers(numbers)}." if fresh else ""
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
        """Returns the stroke of a motion: its part on the canvas, without lowering and lifting."""
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
        """Returns the canvas at the last look, or a white one."""
        grid = PixelGrid.of_height(self._easel.canvas, SHEET_ROWS)
        seen = self.camera.canvas(self._easel.calibration, grid)
        return torch.ones(3, grid.rows, grid.columns) if seen is None else seen

    def _settle(self) -> None:
        """Asks the person to clear the camera's view, unless nothing has changed since the last look."""
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
    """Camera that remembers its last photograph.

    settle: called before each photograph.
    """

    def __init__(self, camera: Camera, settle: Callable[[], None]) -> None:
        self._camera, self._settle = camera, settle
        self._last: Frame | None = None

    def connect(self) -> None:
        """Connects the camera."""
        self._camera.connect()

    def capture(self, newer_than: float) -> Frame:
        """Returns a photograph taken after `newer_than` (s)."""
        self._settle()
        self._last = self._camera.capture(newer_than)
        return self._last

    def close(self) -> None:
        """Closes the camera."""
        self._camera.close()

    def canvas(self, calibration: Calibration, grid: PixelGrid) -> Tensor | None:
        """Returns the canvas [3, rows, columns] of the last photograph; None if no photograph shows it."""
        if self._last is None:
            return None
        try:
            return rectify(self._last.image, calibration, grid)
        except (FrameRejected, CalibrationError):
            return None


def _list_numbers(numbers: Sequence[str]) -> str:
    """Returns numbers as text, such as "3", "3 and 5" or "3, 5 and 6"."""
    return " and ".join([", ".join(numbers[:-1])] * (len(numbers) > 1) + [numbers[-1]])


# Robot of the easel kind `human`: a person paints in the robot's place.
#
# The painting process asks the person for a motion first, and sends it here when it is done (`ByHand`). Stops,
# locks, clocks and records therefore work as for any other robot.


class HumanRobot:
    """Robot that reports each motion as done; implements hardware.robot.Robot."""

    def __init__(self, home: Point) -> None:
        self._home = np.array(home)
        self._tip = self._home
        self._interlock = Interlock("the person")

    def connect(self) -> None:
        """Begins with the hand at the home position."""
        self._tip = self._home
        self._interlock.mark_connected()

    def home(self) -> MotionReport:
        """Returns the report of a motion to the home position."""
        return self.follow(Waypoints("home", self._home[None], 1.0))

    def pose(self) -> NDArray[np.float64]:
        """Returns the last position of the hand, [3] metres."""
        self._interlock.require_ready("pose")
        return self._tip.copy()

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Stores the motion as done. Raises RobotStopped after a stop, MotionFailed if the waypoints are no path."""
        self._interlock.require_ready(waypoints.label)
        self._interlock.require_path(waypoints)
        self._tip = waypoints.position[-1].copy()
        now = time.monotonic()
        return MotionReport(waypoints.label, now, now, self._tip.copy())

    def stop(self) -> None:
        """Accepts no further motions; only the person can stop the hand itself."""
        self._interlock.stop()

    def close(self) -> None:
        """Closes the connection."""
        self._interlock.mark_disconnected()
