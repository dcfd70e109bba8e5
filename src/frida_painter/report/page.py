"""The page of a painting: one HTML file beside its pictures, which works from a folder without a network."""

import math
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

import jinja2
from markupsafe import Markup

from frida_painter.report.sheets import sheet_file
from frida_painter.report.story import Phase, Story
from frida_painter.system import storage

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
