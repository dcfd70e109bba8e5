"""Charts of measurements: lines with bands or error bars, with the name at the end of each line."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from frida_painter.system import images
from frida_painter.system.sheet import INK, LINE, PAPER, SOFT, Color

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_CHART_WIDTH, _CHART_HEIGHT = 940, 540
_CHART_LEFT, _CHART_RIGHT, _CHART_TOP, _CHART_BOTTOM = 84, 190, 104, 66
_BEFORE_NAME, _AFTER_NAME = 14, 16
_TITLE, _TEXT, _TICK = 22, 14, 13
_POINT = 0.72  # points per pixel, at 100 pixels per inch
# Distinguishable without colour vision (Okabe and Ito).
_COLORS = ((0, 114, 178), (213, 94, 0), (0, 138, 100), (171, 92, 150), (98, 93, 85))
_INSET = 14  # from the ends of the x axis to the first and last point
_BESIDE = 5.0  # between the error bars of neighbouring lines
_FEW = 7
_STEPS = (1, 2, 2.5, 5, 10)
_DOTTED = 24  # greatest number of points that get dots


@dataclass(frozen=True)
class Series:
    """Line of a chart.

    name: at the end of the line
    x, y: points
    low, high: limits of each point, or empty
    band: True to draw the limits as a band, False for error bars
    joined: True for a line through the points, False for dots alone
    """

    name: str
    x: Sequence[float]
    y: Sequence[float]
    low: Sequence[float] = field(default=())
    high: Sequence[float] = field(default=())
    band: bool = True
    joined: bool = True


def chart(
    title: str,
    x_label: str,
    y_label: str,
    series: Sequence[Series],
    *,
    logarithmic: bool = False,
    paper: Color = PAPER,
) -> Tensor:
    """Returns a chart of up to five series, [3, 540, 940].

    y_label: above the y axis
    logarithmic: True for a logarithmic y axis; all values are then above 0

    A linear y axis starts at 0 or below.
    """
    from matplotlib import style

    with style.context("default"):  # not a matplotlibrc of the current folder, which may have LaTeX run
        return _draw_chart(title, x_label, y_label, series, logarithmic, paper)


def _draw_chart(
    title: str, x_label: str, y_label: str, series: Sequence[Series], logarithmic: bool, paper: Color
) -> Tensor:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties
    from matplotlib.transforms import ScaledTranslation

    figure = Figure((_CHART_WIDTH / 100, _CHART_HEIGHT / 100), 100, facecolor=_hex(paper))
    canvas = FigureCanvasAgg(figure)
    like = FontProperties(size=_TEXT * _POINT)
    names = [canvas.get_renderer().get_text_width_height_descent(one.name, like, False)[0] for one in series]
    right = max(_CHART_RIGHT, *(_BEFORE_NAME + name + _AFTER_NAME for name in names))
    wide, high = round(_CHART_WIDTH - _CHART_LEFT - right), _CHART_HEIGHT - _CHART_TOP - _CHART_BOTTOM
    axes = figure.add_axes(
        (_CHART_LEFT / _CHART_WIDTH, _CHART_BOTTOM / _CHART_HEIGHT, wide / _CHART_WIDTH, high / _CHART_HEIGHT),
        facecolor=_hex(paper),
    )

    def words(x: float, y: float, text: str, size: int, color: tuple[int, int, int], **where: Any) -> None:
        # A dollar sign in a name does not start a formula.
        where |= {"fontsize": size * _POINT, "color": _hex(color), "parse_math": False}
        figure.text(x / _CHART_WIDTH, y / _CHART_HEIGHT, text, **where)

    words(_CHART_LEFT, _CHART_HEIGHT - 46, title, _TITLE, INK)
    words(_CHART_LEFT, _CHART_HEIGHT - 78, y_label, _TEXT, SOFT)
    words(_CHART_LEFT + wide / 2, 16, x_label, _TEXT, SOFT, ha="center")
    _scale(axes, series, logarithmic, wide)
    for number, (one, color) in enumerate(zip(series, map(_hex, _COLORS), strict=False)):
        style: dict[str, Any] = {"color": color, "linewidth": 2.4 * _POINT, "zorder": 3}
        if not one.joined:
            style["linestyle"] = "none"
        if len(one.x) <= _DOTTED or not one.joined:
            style |= {"marker": "o", "markersize": 7.2 * _POINT, "markeredgecolor": "white", "markeredgewidth": _POINT}
        if len(one.low) and not one.band:
            aside = _BESIDE * (number - (len(series) - 1) / 2) / 100
            off = np.abs(np.array([one.low, one.high]) - np.asarray(one.y))
            moved = axes.transData + ScaledTranslation(aside, 0, figure.dpi_scale_trans)
            axes.errorbar(one.x, one.y, off, elinewidth=1.0, capsize=5 * _POINT, transform=moved, **style)
            continue
        if len(one.low):
            axes.fill_between(one.x, one.low, one.high, color=color, alpha=0.19, linewidth=0, zorder=2)
        axes.plot(one.x, one.y, **style)
    ends = [float(axes.transData.transform((one.x[-1], one.y[-1]))[1]) for one in series]
    for y, one, ink in zip(_apart(ends), series, _COLORS, strict=False):
        words(_CHART_LEFT + wide + _BEFORE_NAME, y, one.name, _TEXT, ink, va="center")
    canvas.draw()
    return images.from_uint8(np.asarray(canvas.buffer_rgba())[..., :3])


def _scale(axes: "Axes", series: Sequence[Series], logarithmic: bool, wide: int) -> None:
    """Sets limits, ticks and grid lines of both axes."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

    xs = sorted({x for one in series for x in one.x})
    ys = [y for one in series for y in (*one.y, *one.low, *one.high)]
    inset = _INSET / (wide - 2 * _INSET) * ((xs[-1] - xs[0]) or 1.0)
    axes.set_xlim(xs[0] - inset, xs[-1] + inset)
    axes.xaxis.set_major_locator(FixedLocator(xs) if len(xs) <= _FEW else MaxNLocator(5, steps=_STEPS))
    if logarithmic:
        margin = max(1.07, (max(ys) / min(ys)) ** 0.06)
        least, most = min(ys) / margin, max(ys) * margin
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(FixedLocator(log_ticks(least, most)))
        axes.yaxis.set_minor_locator(NullLocator())
    else:
        least, most = min(0.0, *ys), max(*ys, 1e-12) * 1.06
        axes.yaxis.set_major_locator(MaxNLocator(5, steps=_STEPS))
    axes.set_ylim(least, most)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
    axes.tick_params(length=0, pad=7, labelsize=_TICK * _POINT, labelcolor=_hex(SOFT))
    axes.spines[:].set_visible(False)
    axes.grid(axis="y", color=_hex(LINE), linewidth=_POINT, clip_on=False)
    axes.set_axisbelow(True)


def log_ticks(least: float, most: float) -> list[float]:
    """Returns about eight round values for a logarithmic axis between two values above 0."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    for locator in (LogLocator(subs=(1, 2, 5), numticks=99), MaxNLocator(8, steps=_STEPS)):
        found = [float(value) for value in locator.tick_values(least, most) if least <= value <= most]
        if len(found) >= 4:
            break
    return found[:: -(-len(found) // 10)]


def _hex(color: Color) -> str:
    return "#{:02x}{:02x}{:02x}".format(*color)


def _apart(wanted: Sequence[float]) -> list[float]:
    """Returns heights near the wanted ones at which texts do not overlap."""
    least = _TEXT * 1.5
    order = sorted(range(len(wanted)), key=lambda index: wanted[index])
    placed = list(wanted)
    for _ in range(50):
        for lower, upper in pairwise(order):
            short = least - (placed[upper] - placed[lower])
            if short > 0:
                placed[lower] -= short / 2
                placed[upper] += short / 2
    return placed
