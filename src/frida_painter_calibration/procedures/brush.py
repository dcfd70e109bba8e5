"""The brush procedure: finds the heights of the lightest touch (thickness 0) and of the hardest press (thickness 1).

Either a person lowers the brush with jog keys, or the painter finds the heights itself: it lowers the brush in
small steps, and photographs the width of the mark that a short stroke leaves.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.easel.dialogue import Answer, Confirm, Jog, JogMove, Measure, Procedure, Question
from frida_painter.errors import CalibrationError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import Waypoints
from frida_painter.sheet import CREAM, INK, LINE, SOFT, Grid, Sheet
from frida_painter_calibration.procedures.paper import WHITE, EaselAccess, Trial, TrialPaper, ask_for_paper, ceiling

# Picture of a brush calibration: trial strokes from the lightest to the hardest, with their widths.

_ROWS, _COLUMNS = 640, 1500
_MARGIN, _SHOWN, _GAP = 60, 9, 12
_STRIP_TOP, _STRIP_HEIGHT = 62, 142
_MILLIMETRES = 46.0  # across one place of the strip
_PLOT_TOP = 250
_AXES = (118, 18, 1430, 322)  # left, top, right, bottom of the plot, below _PLOT_TOP
_FINER = 2
_TOUCH, _PRESS = (46, 110, 166), (178, 62, 48)


def brush_sheet(trials: Sequence[Trial], touch: float, press: float) -> Tensor:
    """Returns the picture of a brush calibration, sRGB [3, 640, 1500] in [0, 1].

    touch, press: the two heights, robot z in metres
    """
    sheet = Sheet(_COLUMNS, _ROWS, CREAM)
    title = "Short strokes, pressed ever harder (millimetres below the lightest touch)"
    sheet.text((_MARGIN, 20), title, 20, INK)
    strip = Grid.divide(_COLUMNS - 2 * _MARGIN, _MARGIN, _STRIP_TOP, _SHOWN, _STRIP_HEIGHT, across=_GAP)
    for number, trial in enumerate(_chosen(trials, touch)):
        depth = f"{round(1000 * (touch - trial.height), 1) + 0:.1f}" if trial.marked else "no mark"
        sheet.cell(strip.corner(number), _look(trial, strip.width), depth, size=17, gap=6)
    sheet.paste(_plot(trials, touch, press), (0, _PLOT_TOP))
    return sheet.tensor()


def _chosen(trials: Sequence[Trial], touch: float) -> list[Trial]:
    """Returns as many trials as fit: one without a mark, then evenly spaced ones, each once."""
    bare = [trial for trial in trials if not trial.marked]
    left = [trial for trial in trials if trial.marked]
    chosen = [min(bare, key=lambda trial: trial.height)] if bare else []
    for height in np.linspace(touch, min(trial.height for trial in trials), _SHOWN - len(chosen)):
        if left:
            nearest = min(left, key=lambda trial: abs(trial.height - height))
            chosen.append(nearest)
            left.remove(nearest)
    return sorted(chosen, key=lambda trial: (trial.marked, -trial.height))


def _look(trial: Trial, width: int) -> Image.Image:
    """Returns the middle of a trial's picture on white paper; all trials have the same scale."""
    picture = Image.fromarray((255 * trial.look.permute(1, 2, 0).numpy()).round().astype(np.uint8))
    scale = 1000 * trial.pitch * width / _MILLIMETRES
    size = max(1, round(picture.width * scale)), max(1, round(picture.height * scale))
    place = Image.new("RGB", (width, _STRIP_HEIGHT), (255, 255, 255))
    resized = picture.resize(size, Image.Resampling.LANCZOS)
    place.paste(resized, ((width - size[0]) // 2, (_STRIP_HEIGHT - size[1]) // 2))
    return place


def _plot(trials: Sequence[Trial], touch: float, press: float) -> Image.Image:
    """Returns a plot of the mark's width over depth, with a dot for every trial."""
    size = _COLUMNS, _ROWS - _PLOT_TOP
    plot = Sheet(_FINER * size[0], _FINER * size[1], CREAM)
    left, top, right, bottom = (_FINER * side for side in _AXES)
    deepest = 1000 * (touch - min(press, *(trial.height for trial in trials)))
    first, last = -0.2 * deepest, 1.06 * deepest
    widest = 1.12 * max(1.0, *(1000 * trial.width for trial in trials))

    def across(depth: float) -> float:
        return left + (right - left) * (depth - first) / (last - first)

    def up(width: float) -> float:
        return bottom - (bottom - top) * width / widest

    for width in _ticks(widest):
        plot.draw.line((left, up(width), right, up(width)), fill=LINE, width=_FINER)
        plot.text((left - 20, up(width)), f"{width:g}", 17 * _FINER, SOFT, "rm")
    for depth in _ticks(last):
        plot.text((across(depth), bottom + 16), f"{depth:g}", 17 * _FINER, SOFT, "ma")
    for depth, color, name in ((0.0, _TOUCH, "lightest touch"), (1000 * (touch - press), _PRESS, "hardest press")):
        plot.draw.line((across(depth), top, across(depth), bottom), fill=color, width=2 * _FINER)
        plot.text((across(depth) - 16, top + 4), name, 18 * _FINER, color, "ra")
    for trial in trials:
        depth = 1000 * (touch - trial.height)
        if depth >= first:
            x, y, radius = across(depth), up(1000 * trial.width), 5 * _FINER
            dot = (x - radius, y - radius, x + radius, y + radius)
            plot.draw.ellipse(dot, fill=INK if trial.marked else CREAM, outline=INK, width=_FINER)
    below = "mm below the lightest touch; up: width of the mark, mm; open dots: no mark"
    plot.text((right, bottom + 60), below, 17 * _FINER, SOFT, "ra")
    return plot.shrink(*size)


def _ticks(most: float) -> list[float]:
    """Returns about six round numbers from 0 to `most`."""
    step = next(step for step in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 1000.0) if most / step <= 7)
    return [step * number for number in range(int(most / step) + 1)]


LONGEST_BRUSH = 0.5
"""Greatest protrusion of a brush, metres."""
ABOVE_FLOOR = 0.002
"""Distance to the floor of the workspace during trial strokes, metres."""
# Cells for trial strokes (m): for light strokes and for pressed ones.
_SMALL_CELL, _LARGE_CELL = (0.030, 0.018), (0.050, 0.042)
# Step of the first descent until a mark appears: this share of the way to the expected paper, but at least this many
# metres.
_SHARE, _LOWERING = 0.2, 0.0015
# Then up after a mark and down without one, with smaller steps after every turn.
_FINEST, _TURNS, _COUNTED, _MAX = 0.0001, 12, 8, 60
# Press harder, with some strokes per step, until two successive steps widen the mark by less than this share.
_PRESSING, _EACH, _WIDENING = 0.001, 2, 0.04
# A mark narrower than this share of the widest one means a fault.
_NARROWER = 0.85
_BY_EYE = 0.0005
_THERE = 0.001


@dataclass(frozen=True)
class BrushFinding:
    """Result of the brush procedure, lengths in metres.

    brush: name of the brush
    touch_height, press_height: robot z
    exactness: accuracy of the touch height
    protrusion: from the flange to the tip; None if unknown
    trials: strokes from which the heights were found; empty if a person set them
    ended: reason for which pressing ended, in words
    """

    brush: str
    touch_height: float
    press_height: float
    exactness: float
    protrusion: float | None
    trials: tuple[Trial, ...]
    ended: str

    @property
    def sentence(self) -> str:
        """Result in plain words."""
        touch, press = 1000 * self.touch_height, 1000 * self.press_height
        how = f"found in {len(self.trials)} trial strokes" if self.trials else "set by hand"
        return (
            f"The {self.brush} brush touches at {touch:.2f} mm (to {1000 * self.exactness:.2f} mm) and is pressed down "
            f"to {press:.2f} mm, {touch - press:.1f} mm further, {self.ended}; {how}."
        )

    @property
    def picture(self) -> Tensor | None:
        """Trial strokes and their widths; None if a person set the heights."""
        return brush_sheet(self.trials, self.touch_height, self.press_height) if self.trials else None

    def enter(self, record: Calibration) -> Calibration:
        """Returns the calibration with this brush and its heights."""
        return record.with_brush(
            self.brush, self.touch_height, self.press_height, protrusion=self.protrusion, residual=self.exactness
        )


def brush(
    easel: Easel,
    *,
    name: str | None = None,
    deepest: float | None = None,
    ground: tuple[float, float, float] = WHITE,
) -> Procedure[BrushFinding]:
    """Finds the two heights of a brush, or asks a person for them.

    name: of the brush; None for that of the calibration
    deepest: metres by which the brush may be pressed below its lightest touch; None if unknown
    ground: colour of the paper (sRGB)

    Raises CalibrationError if no mark appears, the heights are impossible, or an answer is no height.
    Raises WorkspaceViolation before anything leaves the workspace, RobotError, CameraError and their subclasses.
    """
    record = easel.calibration
    protrusion = yield Measure(
        "How far does the brush protrude, from the robot's flange to the tip of its bristles (metres)?",
        0.0,
        LONGEST_BRUSH,
        record.protrusion,
    )
    looking = yield Confirm(
        "The heights can be found by looking: the brush is dipped in black paint in well 1 and lowered in small steps "
        "until it marks the paper. Shall the painter do that? (If not, you lower it with the jog keys.)"
    )
    # The limit is the floor of the workspace, not the calibrated press, because the procedure searches for the press.
    access = EaselAccess(easel, lowest=easel.workspace.lower[2])
    found = (yield from _by_looking(access, deepest, ground)) if looking is True else _Found()
    paper = easel.canvas.width / 2, easel.canvas.height / 2
    place = found.place or paper
    touch = yield from _jog(
        access, place, found, found.touch, ceiling(easel), "the lightest touch: the tip only just meets the paper"
    )
    press = yield from _jog(
        access,
        place,
        found,
        found.press,
        touch,
        "the hardest press: the bristles are spread, and nothing bends for good",
    )
    access.step_aside()
    by_hand = found.touch != touch or found.press != press
    return BrushFinding(
        brush=name or record.brush,
        touch_height=touch,
        press_height=_below(press, touch),
        exactness=_BY_EYE if found.touch != touch else found.exactness,
        protrusion=_protrusion(protrusion),
        trials=found.trials,
        ended="as set by hand" if by_hand else found.ended,
    )


@dataclass(frozen=True)
class _Found:
    """Result of the trial strokes; the defaults stand for no trials."""

    touch: float | None = None
    press: float | None = None
    exactness: float = _BY_EYE
    ended: str = "as set by hand"
    place: tuple[float, float] | None = None
    trials: tuple[Trial, ...] = ()

    @property
    def picture(self) -> Tensor | None:
        if self.touch is None or self.press is None:
            return None
        return brush_sheet(self.trials, self.touch, self.press)


class _Trials:
    """Trial strokes, one after another, on as many sheets of paper as needed."""

    def __init__(self, access: EaselAccess, ground: tuple[float, float, float]) -> None:
        self._access, self._ground = access, ground
        self._paper: TrialPaper | None = None
        self._cell = _SMALL_CELL
        self.done: list[Trial] = []

    @property
    def place(self) -> tuple[float, float] | None:
        return self._paper.free_place if self._paper else None

    def start_over(self, cell: tuple[float, float]) -> None:
        """Makes the next stroke use fresh paper with cells of that size."""
        self._paper, self._cell = None, cell

    def at(self, height: float) -> Generator[Question, Answer, Trial]:
        """Paints a trial stroke; asks a person for paper if the operator cannot lay it."""
        if self._paper is None or self._paper.is_full:
            yield from ask_for_paper(
                self._access.easel,
                "Lay a bare sheet of paper on the canvas's place. Does it lie there?",
                "Without paper no mark can be seen; repeat the brush calibration.",
            )
            self._paper = TrialPaper(self._access, self._cell, self._ground)
        trial = self._paper.stroke(height)
        self.done.append(trial)
        return trial


def _by_looking(
    access: EaselAccess, deepest: float | None, ground: tuple[float, float, float]
) -> Generator[Question, Answer, _Found]:
    """Finds the heights by lowering the brush and photographing its marks."""
    easel, trials = access.easel, _Trials(access, ground)
    floor = easel.workspace.lower[2] + ABOVE_FLOOR
    touch, exactness = yield from _touch(trials, ceiling(easel), easel.workspace.canvas_origin[2], floor)
    bottom, ended = floor, "where the workspace ends"
    if deepest is not None and touch - deepest > floor:
        bottom, ended = touch - deepest, "as far as the brush may be pressed"
    trials.start_over(_LARGE_CELL)
    press, stopped = yield from _press(trials, touch, bottom)
    ended = "where the mark stops widening" if stopped else ended
    return _Found(touch, press, exactness, ended, trials.place, tuple(trials.done))


def _touch(
    trials: _Trials, height: float, expected: float, floor: float
) -> Generator[Question, Answer, tuple[float, float]]:
    """Returns the height at which every other stroke leaves a mark, and its standard error."""
    start = height
    while True:
        trial = yield from trials.at(height)
        if trial.marked:
            break
        height = max(floor, height - max(_LOWERING, _SHARE * (height - expected)))
        if not height < trial.height:
            raise CalibrationError(
                f"No mark appeared down to {1000 * trial.height:.1f} mm, close to the workspace's floor. Is "
                "the brush mounted, is black paint in well 1, and does the camera see the paper? Then repeat the "
                "brush calibration."
            )
    if height == start:
        raise CalibrationError(
            f"The brush marks the paper already at {1000 * height:.1f} mm, hover height above the canvas. Lower the "
            "canvas or set the workspace right, and repeat the brush calibration."
        )
    step, turns = _LOWERING / 2, list[float]()
    for _ in range(_MAX):
        before = trial
        height = max(floor, height + step if trial.marked else height - step)
        trial = yield from trials.at(height)
        if trial.marked != before.marked:
            turns.append((trial.height + before.height) / 2)
            step = max(_FINEST, step / 2)
        if len(turns) == _TURNS:
            counted = np.array(turns[-_COUNTED:])
            return float(counted.mean()), max(_FINEST, float(counted.std() / np.sqrt(_COUNTED)))
    raise CalibrationError(
        f"The height at which the brush begins to mark could not be told in {len(trials.done)} strokes: they mark the "
        "paper or leave it bare regardless of height. Is there paint enough, is the brush firm in its holder, is the "
        "paper flat? Then repeat the brush calibration."
    )


def _press(trials: _Trials, touch: float, bottom: float) -> Generator[Question, Answer, tuple[float, bool]]:
    """Returns the lowest useful height, not below `bottom`, and True if the mark stopped widening there."""
    if not touch - bottom >= _PRESSING:
        raise CalibrationError(
            f"The brush touches at {1000 * touch:.1f} mm, and must not go below {1000 * bottom:.1f} mm: there is no "
            "room to press. Lower the workspace's floor or raise the canvas, and repeat the brush calibration."
        )
    widths: list[float] = []
    heights = [*np.arange(touch - _PRESSING, bottom + _PRESSING / 2, -_PRESSING).tolist(), bottom]
    for number, height in enumerate(heights):
        width = 0.0
        for _ in range(_EACH):
            width += (yield from trials.at(height)).width / _EACH
        widths.append(width)
        if not width >= _NARROWER * max(widths):
            raise CalibrationError(
                f"Pressed down to {1000 * height:.1f} mm, the brush marks {1000 * width:.1f} mm wide, and higher up it "
                f"marked {1000 * max(widths):.1f} mm. Is there paint enough in well 1, and is the brush firm in its "
                "holder? Then repeat the brush calibration."
            )
        if number > 1 and max(widths[-2:]) < (1 + _WIDENING) * widths[-3]:
            return heights[number - 2], True
    return bottom, False


def _jog(
    access: EaselAccess, place: tuple[float, float], found: _Found, height: float | None, highest: float, wanted: str
) -> Generator[Question, Answer, float]:
    """Returns the height that a person sets with jog keys; the height found, if any, is proposed."""
    lowest = access.easel.workspace.lower[2]
    text = f"Lower or raise the brush until it is at {wanted}."
    question = Jog(
        text,
        height=highest if height is None else height,
        lowest=lowest,
        highest=highest,
        picture=found.picture,
        proposal=None if height is None else JogMove(settled=True),
    )
    while True:
        move = yield question
        if not isinstance(move, JogMove) or not np.isfinite(move.step):
            raise CalibrationError(f"{move!r} is no move of a jog key; repeat the brush calibration.")
        if move.settled:
            return question.height
        wanted_height = question.height + move.step
        if lowest <= wanted_height <= highest:
            access.perform([_hold(access, place, wanted_height)])
            question = replace(question, text=text, height=wanted_height, proposal=None)
        else:
            allowed = f"{1000 * lowest:.1f} to {1000 * highest:.1f} mm"
            question = replace(question, text=f"No further than {allowed}. {text}")


def _hold(access: EaselAccess, place: tuple[float, float], height: float) -> Waypoints:
    """Returns the motion that holds the brush over a place of the canvas (m) at a height, coming from above."""
    easel = access.easel
    here = easel.workspace.to_robot(easel.calibration.place(np.array([place])), np.array([height]))
    above = here.copy()
    above[:, 2] = max(height, ceiling(easel))
    there = np.linalg.norm(access.pose()[:2] - here[0, :2]) < _THERE
    position = here if there else np.concatenate([above, here])
    return Waypoints(f"jog to {1000 * height:.1f} mm", position, easel.workspace.painting_speed)


def _below(press: float, touch: float) -> float:
    """Returns the press height if it is below the touch. Raises CalibrationError otherwise."""
    if not press < touch:
        raise CalibrationError(
            f"The hardest press ({1000 * press:.2f} mm) is not below the lightest touch ({1000 * touch:.2f} mm); "
            "repeat the brush calibration."
        )
    return press


def _protrusion(answer: object) -> float | None:
    """Returns the protrusion in metres; None if unknown. Raises CalibrationError."""
    if answer is None:
        return None
    if isinstance(answer, bool) or not isinstance(answer, int | float) or not 0 <= answer <= LONGEST_BRUSH:
        raise CalibrationError(
            f"A brush that protrudes by {answer} m was given; it is 0 to {LONGEST_BRUSH:g} m. Repeat the brush "
            "calibration."
        )
    return float(answer)
