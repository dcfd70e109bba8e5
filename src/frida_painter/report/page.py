"""The page of a painting: one HTML file beside its pictures, which works from a folder without a network.

The module also has charts of measurements, and the page of a training or an evaluation.
"""

import base64
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np
import torch
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from frida_painter import images, storage
from frida_painter.brush.evaluation import Learned
from frida_painter.brush.kinds import StrokeModel
from frida_painter.brush.library import StrokeLibrary
from frida_painter.report.sheets import sheet_file
from frida_painter.report.story import Phase, Story
from frida_painter.sheet import INK, LINE, PAPER, SOFT

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Loss curve as inline SVG: no script, readable in light and dark mode, described for screen readers.

_WIDTH, _HEIGHT = 960, 360
_LEFT, _RIGHT, _TOP, _BOTTOM = 72, 16, 40, 48
_FLOOR = _HEIGHT - _BOTTOM
_ROOMY = 140.0  # wide enough for "after 1000 strokes"
_LETTER = 7.0
_MIN, _MAX = 1e-12, 1e12


def curve_svg(phases: Sequence[Phase]) -> str:
    """Returns the losses over iterations as SVG, phase after phase, on a logarithmic scale.

    Points that are not finite, not above 0 or beyond all reason are omitted. Returns "" if no phase has two points
    left.
    """
    usable = [(phase.name, [(i, v) for i, v in phase.loss if _MIN < v < _MAX]) for phase in phases]
    usable = [(name, points) for name, points in usable if len(points) > 1]
    if not usable:
        return ""
    losses = [value for _, points in usable for _, value in points]
    least, most = math.log10(min(losses)), math.log10(max(losses))
    margin = max(0.02, 0.06 * (most - least))
    least, most = least - margin, most + margin
    widths = _widths([points[-1][0] - points[0][0] for _, points in usable])

    def down(value: float) -> float:
        return _TOP + (most - math.log10(value)) / (most - least) * (_FLOOR - _TOP)

    first, last = usable[0][1][0][1], usable[-1][1][-1][1]
    parts = [
        f'<svg class="curve" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" '
        f'aria-label="Loss over iterations: from {first:.3g} to {last:.3g} in {len(usable)} planning phases">'
    ]
    for value in _ticks(least, most):
        y = down(value)
        parts.append(f'<line class="rule" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="tick" x="{_LEFT - 10}" y="{y + 4.5:.1f}" text-anchor="end">{value:g}</text>')
    left = float(_LEFT)
    for number, ((name, points), width) in enumerate(zip(usable, widths, strict=True), start=1):
        if number > 1:
            parts.append(f'<line class="mark" x1="{left:.1f}" x2="{left:.1f}" y1="{_TOP - 26}" y2="{_FLOOR}"/>')
        # A name appears only if its phase is wide enough; all names are tooltips.
        roomy = width > _LETTER * len(name) + 12
        shown, unit = (escape(name), " iterations") if roomy else (str(number), "")
        first, last = points[0][0], points[-1][0]
        parts.append(f'<text class="phase" x="{left + 6:.1f}" y="{_TOP - 14}">{shown}</text>')
        parts.append(f'<text class="tick" x="{left + 6:.1f}" y="{_HEIGHT - 16}">{last - first + 1}{unit}</text>')
        step = width / max(1, last - first)
        path = " ".join(f"{left + (i - first) * step:.1f},{down(value):.1f}" for i, value in _thin_out(points))
        parts.append(f'<polyline class="line" points="{path}"><title>{escape(name)}</title></polyline>')
        left += width
    parts.append("</svg>")
    return "".join(parts)


def _widths(iterations: Sequence[int]) -> list[float]:
    """Returns the width of each phase, by its iterations, but wide enough for its name if there is room."""
    room = _WIDTH - _LEFT - _RIGHT
    least = min(_ROOMY, room / len(iterations))
    share = (room - least * len(iterations)) / max(1, sum(iterations))
    return [least + share * count for count in iterations]


def _ticks(least: float, most: float) -> Iterator[float]:
    """Yields round values 1, 2, 5 x 10^k between two powers of ten; finer ones if there are too few."""
    for steps in ((1, 2, 5), tuple(range(1, 10)), tuple(part / 10 for part in range(10, 100))):
        found = [
            float(f"{step * 10.0**decade:.6g}")
            for decade in range(math.floor(least), math.ceil(most) + 1)
            for step in steps
            if least <= math.log10(step) + decade <= most
        ]
        if len(found) >= 3:
            break
    every = max(1, math.ceil(len(found) / 6))
    yield from found[::every]


def _thin_out(points: list[tuple[int, float]]) -> list[tuple[int, float]]:
    """Returns at most about 400 of the points, including the last one."""
    every = max(1, len(points) // 400)
    return [*points[:-1][::every], points[-1]]


PAGE = "index.html"


def template(name: str) -> jinja2.Template:
    """Returns a template of this package. Rendering raises an error for undefined variables."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("frida_painter", "report/templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template(name)


def page(story: Story) -> str:
    """Returns the story as HTML that needs only the files it names."""
    # The curve is markup of this module, which escapes its texts.
    curve = Markup(curve_svg(story.phases))
    html = template("page.html").render(story=story, curve=curve, sheet_file=sheet_file)
    return html.encode("utf-8", "replace").decode("utf-8")


def write_page(story: Story, folder: Path) -> Path:
    """Writes the page to the painting's folder, atomically; returns its path. Raises StorageError."""
    path = folder / PAGE
    storage.write_text(path, page(story))
    return path


# Charts of measurements: lines with bands or error bars, with the name at the end of each line.

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
    """

    name: str
    x: Sequence[float]
    y: Sequence[float]
    low: Sequence[float] = field(default=())
    high: Sequence[float] = field(default=())
    band: bool = True


def chart(title: str, x_label: str, y_label: str, series: Sequence[Series], *, logarithmic: bool = False) -> Tensor:
    """Returns a chart of up to five series, [3, 540, 940].

    y_label: above the y axis
    logarithmic: True for a logarithmic y axis; all values are then above 0

    A linear y axis starts at 0 or below.
    """
    from matplotlib import style

    with style.context("default"):  # not a matplotlibrc of the current folder, which may have LaTeX run
        return _draw_chart(title, x_label, y_label, series, logarithmic)


def _draw_chart(title: str, x_label: str, y_label: str, series: Sequence[Series], logarithmic: bool) -> Tensor:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties
    from matplotlib.transforms import ScaledTranslation

    figure = Figure((_CHART_WIDTH / 100, _CHART_HEIGHT / 100), 100, facecolor=_hex(PAPER))
    canvas = FigureCanvasAgg(figure)
    like = FontProperties(size=_TEXT * _POINT)
    names = [canvas.get_renderer().get_text_width_height_descent(one.name, like, False)[0] for one in series]
    right = max(_CHART_RIGHT, *(_BEFORE_NAME + name + _AFTER_NAME for name in names))
    wide, high = round(_CHART_WIDTH - _CHART_LEFT - right), _CHART_HEIGHT - _CHART_TOP - _CHART_BOTTOM
    axes = figure.add_axes(
        (_CHART_LEFT / _CHART_WIDTH, _CHART_BOTTOM / _CHART_HEIGHT, wide / _CHART_WIDTH, high / _CHART_HEIGHT)
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
        if len(one.x) <= _DOTTED:
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


def _hex(color: tuple[int, int, int]) -> str:
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


# The page of a training or an evaluation: unseen strokes beside the model's prediction, in one HTML file.

_MAX_SHOWN = 24
_BATCH = 32
_TRAINING_PAGE_WIDTH = 300
_BINS = 12
_INK = torch.tensor([35.0, 33.0, 30.0]) / 255
_MISSED = torch.tensor([0.0, 114.0, 178.0]) / 255
_INVENTED = torch.tensor([230.0, 120.0, 20.0]) / 255
_TALL, _BAR, _SPACE = 190, 46, 8


@dataclass(frozen=True)
class _Stroke:
    """Stroke on the page: real, modelled, and the difference, as data URIs."""

    real: str
    drawn: str
    difference: str
    shape: str
    error: float


def training_page(learned: Learned, model: str, library: str, *, dirty: int) -> str:
    """Returns the page of a training as HTML without further files.

    model, library: names of both
    dirty: number of defective strokes that were left out of the training
    """
    report, held_out = learned.report, learned.library[learned.report.held_out]
    facts = [
        ("Stroke model", model),
        ("Brush", learned.model.brush),
        ("Strokes to learn from", str(len(learned.library) - len(held_out))),
        ("Strokes held out", str(len(held_out))),
        ("Dirty strokes left out", str(dirty)),
        ("Best epoch", f"{report.best_epoch} of {len(report.curve)}"),
    ]
    return _page(learned.model, held_out, report.predicted, library, facts, report.validation_error, _curve(learned))


def evaluation_page(model: StrokeModel, name: str, strokes: StrokeLibrary, library: str) -> str:
    """Returns the page of an evaluation: any stroke model beside strokes that it has not seen.

    name: of the model
    library: name of the strokes' library
    """
    shapes = strokes.shapes()
    with torch.no_grad():
        parts = torch.split(torch.arange(len(strokes)), _BATCH)
        drawn = torch.cat([model(*(values[part] for values in shapes)) for part in parts])
    facts = [("Stroke model", name), ("Brush", model.brush), ("Strokes", str(len(strokes)))]
    error = float((drawn - strokes.maps(model.frame)).abs().mean())
    return _page(model, strokes, drawn, library, facts, error, None)


def _page(
    model: StrokeModel, strokes: StrokeLibrary, drawn: Tensor, library: str, facts: list[tuple[str, str]],
    mean_error: float, curve: Tensor | None,
) -> str:  # fmt: skip
    """Returns the HTML of a page.

    drawn: [n, rows, columns], the model's predictions of the strokes
    curve: picture of the learning curve; None without training
    """
    wanted = strokes.maps(model.frame)
    error = (drawn - wanted).abs().mean((1, 2)).double().numpy()
    (shortest, longest), (least, most) = model.limits.length, model.limits.bend
    return template("training.html").render(
        library=library,
        error=mean_error,
        bare=float(wanted.mean()),
        count=len(error),
        strokes=_strokes(strokes, wanted, drawn, error),
        histogram=Markup(_histogram(error)),
        curve=None if curve is None else _data_uri(curve),
        facts=[
            *facts,
            ("Lengths", f"{1000 * shortest:.1f} to {1000 * longest:.1f} mm"),
            ("Bends", f"{1000 * least:.1f} to {1000 * most:.1f} mm"),
        ],
    )


def _strokes(library: StrokeLibrary, wanted: Tensor, drawn: Tensor, error: NDArray[np.float64]) -> list[_Stroke]:
    """Returns the strokes from the best to the worst, an even selection if there are too many."""
    order = error.argsort(kind="stable")
    if len(order) > _MAX_SHOWN:
        order = order[np.linspace(0, len(order) - 1, _MAX_SHOWN).round().astype(int)]
    rows, columns = _crop(wanted, drawn)
    shown = []
    for place in order:
        real, modelled = wanted[place, rows, columns], drawn[place, rows, columns]
        shown.append(
            _Stroke(
                _data_uri(_draw_ink(real)),
                _data_uri(_draw_ink(modelled)),
                _data_uri(_draw_comparison(real, modelled)),
                f"thickness {library.thickness[place]:.2f}, length {1000 * library.length_m[place]:.0f} mm, "
                f"bend {1000 * library.bend_m[place]:.0f} mm",
                float(error[place]),
            )
        )
    return shown


def _crop(wanted: Tensor, drawn: Tensor) -> tuple[slice, slice]:
    """Returns the part of the maps with paint, and a small margin."""
    inked = (torch.maximum(wanted, drawn) > 0.3).any(0)
    slices = []
    for axis in (1, 0):
        found = inked.any(axis).nonzero()[:, 0]
        first, last = (int(found[0]), int(found[-1])) if len(found) else (0, inked.shape[1 - axis] - 1)
        slices.append(slice(max(0, first - 2), last + 3))
    return slices[0], slices[1]


def _draw_ink(magnitude: Tensor) -> Tensor:
    """Returns a mark as ink on white paper, [3, rows, columns]."""
    return 1 - magnitude * (1 - _INK[:, None, None])


def _draw_comparison(real: Tensor, drawn: Tensor) -> Tensor:
    """Returns a picture of the differences between a real and a modelled mark, [3, rows, columns].

    Grey stands for paint in both, blue for paint of the brush only, orange for paint of the model only.
    """
    both = torch.minimum(real, drawn)
    layers = ((0.45 * both, _INK), (real - both, _MISSED), (drawn - both, _INVENTED))
    return 1 - sum((amount * (1 - color[:, None, None]) for amount, color in layers), torch.zeros(3, 1, 1))


def _curve(learned: Learned) -> Tensor:
    curve = learned.report.curve
    epochs = [float(step.epoch) for step in curve]
    return chart(
        "Error over epochs",
        "epoch",
        "mean absolute error of the magnitude (logarithmic)",
        [
            Series("held out", epochs, [max(1e-6, step.validation_error) for step in curve]),
            Series("learned from", epochs, [max(1e-6, step.training_error) for step in curve]),
        ],
        logarithmic=True,
    )


def _histogram(error: NDArray[np.float64]) -> str:
    """Returns a histogram of the held-out strokes' errors as inline SVG."""
    counts, edges = np.histogram(error, bins=_BINS, range=(0.0, float(error.max()) * 1.0001 + 1e-9))
    wide = _BINS * _BAR
    parts = [
        f'<svg class="bars" viewBox="0 0 {wide} {_TALL + 54}" role="img" aria-label="Histogram of the errors of '
        f'{len(error)} strokes held out, from {error.min():.4f} to {error.max():.4f}">'
    ]
    for number, count in enumerate(counts):
        tall = _TALL * count / counts.max()
        left = number * _BAR + _SPACE / 2
        parts.append(
            f'<rect x="{left:.1f}" y="{_TALL + 20 - tall:.1f}" width="{_BAR - _SPACE}" height="{tall:.1f}" rx="2"/>'
        )
        if count:
            middle = left + (_BAR - _SPACE) / 2
            parts.append(f'<text x="{middle:.1f}" y="{_TALL + 14 - tall:.1f}" text-anchor="middle">{count}</text>')
    for number in range(0, _BINS + 1, 3):
        anchor = "start" if number == 0 else "end" if number == _BINS else "middle"
        parts.append(f'<text x="{number * _BAR}" y="{_TALL + 42}" text-anchor="{anchor}">{edges[number]:.3f}</text>')
    return "".join([*parts, "</svg>"])


def _data_uri(picture: Tensor) -> str:
    """Returns a picture [3, h, w] in [0, 1] as a PNG data URI; small ones are enlarged."""
    file = io.BytesIO()
    drawn = Image.fromarray(images.to_uint8(picture))
    if drawn.width < _TRAINING_PAGE_WIDTH:
        drawn = drawn.resize(
            (_TRAINING_PAGE_WIDTH, round(drawn.height * _TRAINING_PAGE_WIDTH / drawn.width)), Image.Resampling.BICUBIC
        )
    drawn.quantize(128, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode('ascii')}"
