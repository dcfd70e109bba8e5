"""A curve of losses as inline SVG: no script, readable in light and dark, told to screen readers."""

import math
from collections.abc import Iterator, Sequence
from html import escape

from frida_painter.report.story import Phase

_WIDTH, _HEIGHT = 960, 360
_LEFT, _RIGHT, _TOP, _BOTTOM = 72, 16, 40, 48
_FLOOR = _HEIGHT - _BOTTOM
_ROOMY = 140.0  # wide enough for "after 1000 strokes"
_LETTER = 7.0
_LEAST, _MOST = 1e-12, 1e12


def curve_svg(phases: Sequence[Phase]) -> str:
    """Losses over iterations, phase after phase from left to right, the loss on a logarithmic scale.

    Points that are not finite, not above 0 or beyond all reason are left out; "" where no phase has
    two points left.
    """
    usable = [(phase.name, [(i, v) for i, v in phase.loss if _LEAST < v < _MOST]) for phase in phases]
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
        # A name is shown where its phase is wide enough to hold it; all are there for the pointer.
        roomy = width > _LETTER * len(name) + 12
        shown, unit = (escape(name), " iterations") if roomy else (str(number), "")
        first, last = points[0][0], points[-1][0]
        parts.append(f'<text class="phase" x="{left + 6:.1f}" y="{_TOP - 14}">{shown}</text>')
        parts.append(f'<text class="tick" x="{left + 6:.1f}" y="{_HEIGHT - 16}">{last - first + 1}{unit}</text>')
        step = width / max(1, last - first)
        path = " ".join(f"{left + (i - first) * step:.1f},{down(value):.1f}" for i, value in _thinned(points))
        parts.append(f'<polyline class="line" points="{path}"><title>{escape(name)}</title></polyline>')
        left += width
    parts.append("</svg>")
    return "".join(parts)


def _widths(iterations: Sequence[int]) -> list[float]:
    """Width of each phase: by its iterations, but none too narrow for its name as long as there is room."""
    room = _WIDTH - _LEFT - _RIGHT
    least = min(_ROOMY, room / len(iterations))
    share = (room - least * len(iterations)) / max(1, sum(iterations))
    return [least + share * count for count in iterations]


def _ticks(least: float, most: float) -> Iterator[float]:
    """Round values 1, 2, 5 x 10^k between two powers of ten; finer ones where these are too few."""
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


def _thinned(points: list[tuple[int, float]]) -> list[tuple[int, float]]:
    """At most about 400 of the points, the last one always among them."""
    every = max(1, len(points) // 400)
    return [*points[:-1][::every], points[-1]]
