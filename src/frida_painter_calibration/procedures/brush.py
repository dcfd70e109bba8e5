"""The brush procedure: finds the heights of the lightest touch (thickness 0) and of the hardest press (thickness 1).

Either a person lowers the brush with jog keys, or the painter finds the heights itself: it lowers the brush in
small steps, and photographs the width of the mark that a short stroke leaves.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from frida_painter.easel.dialogue import Answer, Confirm, Finding, Jog, JogMove, Measure, Procedure, Question
from frida_painter.errors import CalibrationError
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.rectify import rectify
from frida_painter.report.chart import Series, chart
from frida_painter.strokes.plan import WHITE
from frida_painter.system import images
from frida_painter.system.sheet import CREAM, Grid, Sheet, scale
from frida_painter_calibration.procedures.paper import (
    LENGTH,
    EaselAccess,
    ask_for_paper,
    ceiling,
    fill_with_black,
    short_stroke,
    window,
)

LONGEST_BRUSH = 0.5
"""Greatest protrusion of a brush, metres."""
ABOVE_FLOOR = 0.002
"""Distance to the floor of the workspace during trial strokes, metres."""
# Cells for trial strokes (m): for light strokes and for pressed ones.
_SMALL_CELL, _LARGE_CELL = (0.030, 0.018), (0.050, 0.042)
_PITCH, _EDGE = 0.0005, 0.004  # metres of a pixel at least, and between the cells and the edge of the paper
# A pixel belongs to a mark if it is darkened by at least this share; a mark has at least this area, m2.
_DARKENED, _SMALLEST = 0.25, 2e-6
# Step of the first descent until a mark appears: this share of the way to the expected paper, but at least this many
# metres.
_SHARE, _LOWERING = 0.2, 0.0015
# Then up after a mark and down without one, with smaller steps after every turn.
_FINEST, _TURNS, _COUNTED, _MAX = 0.0001, 12, 8, 60
# Press harder, with some strokes per step, until two successive steps widen the mark by less than this share.
_PRESSING, _EACH, _WIDENING = 0.001, 2, 0.04
_NARROWER = 0.85  # a mark narrower than this share of the widest one means a fault
_BY_EYE = 0.0005
_THERE = 0.001


def brush(easel: Easel, *, name: str | None = None) -> Procedure[Finding]:
    """Finds the two heights of a brush, or asks a person for them.

    name: of the brush; None for that of the calibration
    Raises CalibrationError if no mark appears, the heights are impossible, or an answer is no height.
    Raises WorkspaceViolation before anything leaves the workspace, RobotError, CameraError and their subclasses.
    """
    record, name = easel.calibration, name or easel.calibration.brush
    answer = yield Measure(
        "How far does the brush protrude, from the robot's flange to the tip of its bristles (metres)?",
        0.0,
        LONGEST_BRUSH,
        record.protrusion,
    )
    protrusion: float | None = None
    if answer is not None:
        if isinstance(answer, bool) or not isinstance(answer, int | float) or not 0 <= answer <= LONGEST_BRUSH:
            raise CalibrationError(
                f"A brush that protrudes by {answer} m was given; it is 0 to {LONGEST_BRUSH:g} m. Repeat the brush "
                "calibration."
            )
        protrusion = float(answer)
    looking = yield Confirm(
        "The heights can be found by looking: the brush is dipped in black paint in well 1 and lowered in small steps "
        "until it marks the paper. Shall the painter do that? (If not, you lower it with the jog keys.)"
    )
    # The limit is the floor of the workspace, not the calibrated press, because the procedure searches for the press.
    trials = Trials(EaselAccess(easel, lowest=easel.workspace.lower[2]))
    found: tuple[float | None, float | None] = None, None
    exactness, ended, picture = _BY_EYE, "as set by hand", None
    if looking is True:
        lightest, exactness = yield from _find_touch(trials)
        trials.place, trials.cell = None, _LARGE_CELL
        hardest, ended = yield from _find_press(trials, lightest)
        found = lightest, hardest
        picture = draw_trials(trials, lightest, hardest)
    touch = yield from _jog(
        trials, found[0], ceiling(easel), "the lightest touch: the tip only just meets the paper", picture
    )
    press = yield from _jog(
        trials, found[1], touch, "the hardest press: the bristles are spread, and nothing bends for good", picture
    )
    trials.access.gateway.step_aside()
    if not press < touch:
        raise CalibrationError(
            f"The hardest press ({1000 * press:.2f} mm) is not below the lightest touch ({1000 * touch:.2f} mm); "
            "repeat the brush calibration."
        )
    exactness = exactness if found[0] == touch else _BY_EYE
    ended = ended if found == (touch, press) else "as set by hand"
    return Finding(
        f"The {name} brush touches at {1000 * touch:.2f} mm (to {1000 * exactness:.2f} mm) and is pressed down to "
        f"{1000 * press:.2f} mm, {1000 * (touch - press):.1f} mm further, {ended}; "
        + (f"found in {len(trials.done)} trial strokes." if trials.done else "set by hand."),
        draw_trials(trials, touch, press) if trials.done else None,
        lambda known: known.with_brush(name, touch, press, protrusion=protrusion, residual=exactness),
    )


@dataclass(frozen=True)
class Trial:
    """Trial stroke at robot z `height` in metres.

    width: of its mark, metres; 0 if it left none
    look: picture of its cell [3, h, w]
    """

    height: float
    width: float
    look: Tensor

    @property
    def marked(self) -> bool:
        """True if the stroke left a mark."""
        return self.width > 0


class Trials:
    """Short trial strokes, each on a free cell of bare paper, on as many sheets as needed.

    done: strokes so far
    cell: width and height of a stroke's place on the next sheet, metres
    place: middle of the next free cell, canvas metres; None if a new sheet is needed
    """

    def __init__(self, access: EaselAccess) -> None:
        self.access, easel = access, access.easel
        one, other = np.array(easel.calibration.corners[:2])
        pitch = max(_PITCH, easel.canvas.width / float(np.linalg.norm(other - one)))
        self.grid = PixelGrid.of_height(easel.canvas, max(8, round(easel.canvas.height / pitch)))
        self.done: list[Trial] = []
        self.cell = _SMALL_CELL
        self.place: tuple[float, float] | None = None

    def at(self, height: float) -> Generator[Question, Answer, Trial]:
        """Dips, paints a horizontal stroke at robot z `height`, and photographs it. A cell without a mark stays free.

        Raises CalibrationError without paper, FrameRejected if it is not bare, RobotError, CameraError.
        """
        easel = self.access.easel
        if self.place is None:
            yield from ask_for_paper(
                easel,
                "Lay a bare sheet of paper on the canvas's place. Does it lie there?",
                "Without paper no mark can be seen; repeat the brush calibration.",
            )
            fill_with_black(easel)
            bare = rectify(self.access.photograph().image, easel.calibration, self.grid)
            self._light = FlatField.learn(bare, WHITE)
            self._seen = true_color(self._light.correct(bare), easel.calibration)
            self._cells = self._spread_cells()
            self.place = next(self._cells)
        stroke = short_stroke(easel, self.place, LENGTH, height)
        self.access.gateway.perform([Motion(easel.workspace, easel.calibration).dip(0), stroke])
        picture = rectify(self.access.photograph().image, easel.calibration, self.grid)
        before, self._seen = self._seen, true_color(self._light.correct(picture), easel.calibration)
        here = window(self.grid, self.place, *self.cell)
        look = self._seen[:, *here]
        trial = Trial(height, self._measure(before[:, *here].mean(0).numpy(), look.mean(0).numpy()), look)
        if trial.marked:
            self.place = next(self._cells, None)
        self.done.append(trial)
        return trial

    def _measure(self, before: NDArray[np.float32], after: NDArray[np.float32]) -> float:
        """Returns the width in metres of the mark that appeared in a cell [h, w]; 0 if there is none."""
        # The brightest pixels are paper; they show how the light has changed.
        change = float(np.quantile(before, 0.8)) / max(1e-3, float(np.quantile(after, 0.8)))
        mark = after * change < (1 - _DARKENED) * before
        across, down = self.grid.pitch
        if not mark.sum() * across * down >= _SMALLEST:
            return 0.0
        columns = mark.sum(0)
        return float(np.quantile(columns[columns > 0], 0.75)) * down

    def _spread_cells(self) -> Iterator[tuple[float, float]]:
        """Yields the middles of the cells, row by row from the top left."""
        canvas = self.access.easel.canvas
        width, height = canvas.width - 2 * _EDGE, canvas.height - 2 * _EDGE
        across, down = max(1, int(width / self.cell[0])), max(1, int(height / self.cell[1]))
        for row in range(down):
            for column in range(across):
                yield _EDGE + (column + 0.5) * width / across, _EDGE + height * (1 - (row + 0.5) / down)


def _find_touch(trials: Trials) -> Generator[Question, Answer, tuple[float, float]]:
    """Returns the height at which every other stroke leaves a mark, and its standard error."""
    easel = trials.access.easel
    floor, expected = easel.workspace.lower[2] + ABOVE_FLOOR, easel.workspace.canvas_origin[2]
    start = height = ceiling(easel)
    while not (trial := (yield from trials.at(height))).marked:
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


def _find_press(trials: Trials, touch: float) -> Generator[Question, Answer, tuple[float, str]]:
    """Returns the lowest useful height, and the reason for which pressing ended."""
    bottom = trials.access.easel.workspace.lower[2] + ABOVE_FLOOR
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
            return heights[number - 2], "where the mark stops widening"
    return bottom, "where the workspace ends"


def _jog(
    trials: Trials, height: float | None, highest: float, wanted: str, picture: Tensor | None
) -> Generator[Question, Answer, float]:
    """Returns the height that a person sets with jog keys; the height found, if any, is proposed.

    The brush is held over the next free cell, or over the middle of the canvas.
    """
    easel, gateway = trials.access.easel, trials.access.gateway
    lowest, place = easel.workspace.lower[2], trials.place or (easel.canvas.width / 2, easel.canvas.height / 2)
    text = f"Lower or raise the brush until it is at {wanted}."
    proposal = None if height is None else JogMove(settled=True)
    question = Jog(text, highest if height is None else height, lowest, highest, picture, proposal)
    while True:
        move = yield question
        if not isinstance(move, JogMove) or not np.isfinite(move.step):
            raise CalibrationError(f"{move!r} is no move of a jog key; repeat the brush calibration.")
        if move.settled:
            return question.height
        next_height = question.height + move.step
        if not lowest <= next_height <= highest:
            allowed = f"{1000 * lowest:.1f} to {1000 * highest:.1f} mm"
            question = replace(question, text=f"No further than {allowed}. {text}")
            continue
        here = easel.workspace.to_robot(easel.calibration.place(np.array([place])), np.array([next_height]))
        above = here.copy()
        above[:, 2] = max(next_height, ceiling(easel))
        is_there = np.linalg.norm(gateway.pose()[:2] - here[0, :2]) < _THERE
        path = here if is_there else np.concatenate([above, here])  # it comes to its place from above
        gateway.perform([Waypoints(f"jog to {1000 * next_height:.1f} mm", path, easel.workspace.painting_speed)])
        question = replace(question, text=text, height=next_height, proposal=None)


# Picture of a brush calibration: trial strokes from the lightest to the hardest, and a chart of their widths.

_MARGIN, _SHOWN, _GAP = 40, 7, 12
_STRIP_TOP, _STRIP_HEIGHT, _CHART_TOP = 62, 112, 220
_ABOVE = 0.2  # share of the way of a press above the lightest touch that is shown


def draw_trials(trials: Trials, touch: float, press: float) -> Tensor:
    """Returns the picture of trial strokes, sRGB [3, h, w] in [0, 1].

    touch, press: the two heights, robot z in metres
    """
    near = [trial for trial in trials.done if trial.height - touch <= _ABOVE * (touch - press)] or [*trials.done]
    near.sort(key=lambda trial: (-trial.height, trial.width))
    depths, widths = [1000 * (touch - trial.height) for trial in near], [1000 * trial.width for trial in near]
    plot = images.to_uint8(
        chart(
            "Width of the mark (millimetres)",
            "millimetres below the lightest touch",
            "0: no mark",
            [
                Series("marks", depths, widths, joined=False),
                Series("lightest touch", (0.0, 0.0), (0.0, max(widths))),
                Series("hardest press", (1000 * (touch - press),) * 2, (0.0, max(widths))),
            ],
            paper=CREAM,
        )
    )
    sheet = Sheet(plot.shape[1], _CHART_TOP + plot.shape[0], CREAM)
    sheet.text((_MARGIN, 20), "Short strokes, pressed ever harder (millimetres below the lightest touch)", 20)
    strip = Grid.divide(plot.shape[1] - 2 * _MARGIN, _MARGIN, _STRIP_TOP, _SHOWN, _STRIP_HEIGHT, across=_GAP)
    left, shown = [trial for trial in near if trial.marked], [trial for trial in near if not trial.marked][:1]
    for depth in np.linspace(0, max(depths), _SHOWN - len(shown)):
        if left:
            shown.append(left.pop(int(np.argmin([abs(1000 * (touch - trial.height) - depth) for trial in left]))))
    high, wide = (max(trial.look.shape[side] for trial in shown) for side in (1, 2))
    larger = min(strip.width / wide, strip.height / high)
    for place, trial in zip(strip.corners(_SHOWN), shown, strict=False):
        rows, columns = trial.look.shape[1:]
        down, across = (high - rows) // 2, (wide - columns) // 2
        margins = (across, wide - columns - across, down, high - rows - down)  # so that all marks have one scale
        look = functional.pad(trial.look, margins, value=1.0)
        told = f"{round(1000 * (touch - trial.height), 1) + 0:.1f}" if trial.marked else "no mark"
        sheet.cell(place, scale(look, round(larger * wide), round(larger * high)), told, size=17, gap=6)
    sheet.paste(plot, (0, _CHART_TOP))
    return sheet.tensor()
