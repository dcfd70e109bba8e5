"""The picture of a brush calibration: trial strokes from the lightest to the hardest, and how wide they are."""

from collections.abc import Sequence

import numpy as np
from PIL import Image
from torch import Tensor

from frida_painter.session.procedures.trial_strokes import Trial
from frida_painter.sheet import CREAM, INK, LINE, SOFT, Sheet

_ROWS, _COLUMNS = 640, 1500
_MARGIN, _SHOWN, _GAP = 60, 9, 12
_STRIP_TOP, _STRIP_HEIGHT = 62, 142
_MILLIMETRES = 46.0  # across one place of the strip
_PLOT_TOP = 250
_AXES = (118, 18, 1430, 322)  # left, top, right, bottom of the plot, below _PLOT_TOP
_FINER = 2
_TOUCH, _PRESS = (46, 110, 166), (178, 62, 48)


def brush_sheet(trials: Sequence[Trial], touch: float, press: float) -> Tensor:
    """The picture, sRGB [3, 640, 1500] in [0, 1]. touch, press: the two heights, robot z in metres."""
    sheet = Sheet(_COLUMNS, _ROWS, CREAM)
    title = "Short strokes, pressed ever harder (millimetres below the lightest touch)"
    sheet.text((_MARGIN, 20), title, 20, INK)
    width = (_COLUMNS - 2 * _MARGIN - _GAP * (_SHOWN - 1)) // _SHOWN
    for number, trial in enumerate(_chosen(trials, touch)):
        left = _MARGIN + number * (width + _GAP)
        sheet.paste(_look(trial, width), (left, _STRIP_TOP))
        depth = f"{round(1000 * (touch - trial.height), 1) + 0:.1f}" if trial.marked else "no mark"
        sheet.text((left + width / 2, _STRIP_TOP + _STRIP_HEIGHT + 6), depth, 17, SOFT, "ma")
    sheet.paste(_plot(trials, touch, press), (0, _PLOT_TOP))
    return sheet.tensor()


def _chosen(trials: Sequence[Trial], touch: float) -> list[Trial]:
    """As many as there is room for: one that left the paper bare, then evenly spaced ones, each once."""
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
    """The middle of a trial's place; all places at one scale, on white paper."""
    picture = Image.fromarray((255 * trial.look.permute(1, 2, 0).numpy()).round().astype(np.uint8))
    scale = 1000 * trial.pitch * width / _MILLIMETRES
    size = max(1, round(picture.width * scale)), max(1, round(picture.height * scale))
    place = Image.new("RGB", (width, _STRIP_HEIGHT), (255, 255, 255))
    resized = picture.resize(size, Image.Resampling.LANCZOS)
    place.paste(resized, ((width - size[0]) // 2, (_STRIP_HEIGHT - size[1]) // 2))
    return place


def _plot(trials: Sequence[Trial], touch: float, press: float) -> Image.Image:
    """Width of the mark over depth, every trial a dot."""
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
    return plot.image.resize(size, Image.Resampling.LANCZOS)


def _ticks(most: float) -> list[float]:
    """Round numbers from 0 up to `most`, some six of them."""
    step = next(step for step in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 1000.0) if most / step <= 7)
    return [step * number for number in range(int(most / step) + 1)]
