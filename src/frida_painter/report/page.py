"""The page of a painting: one HTML file beside its pictures, which works from a folder without a network."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from frida_painter.planning.forecast import SimilarityForecast
from frida_painter.planning.mixable import mixing_changes
from frida_painter.report.sheets import format_amount, sheet_file
from frida_painter.strokes.palette import to_hex
from frida_painter.system import storage
from frida_painter.system.storage import count_of

# Loss curve as inline SVG: no script, readable in light and dark mode, described for screen readers.

_LEFT, _RIGHT, _TOP, _FLOOR = 72, 944, 40, 312  # of the curves, in templates/curve.svg
_LETTER = 7.0
_MIN, _MAX = 1e-12, 1e12
_MAX_POINTS = 400  # about, of a phase


def curve_svg(phases: Sequence[tuple[str, Sequence[tuple[int, float]]]]) -> str:
    """Returns the losses over iterations as SVG, phase after phase, on a logarithmic scale.

    phases: name of each planning phase, and its (iteration, loss) in order.
    Points that are not finite, not above 0 or beyond all reason are omitted. Returns "" if no phase has two points
    left.
    """
    usable = [(name, [(i, v) for i, v in loss if _MIN < v < _MAX]) for name, loss in phases]
    usable = [(name, points) for name, points in usable if len(points) > 1]
    if not usable:
        return ""
    losses = [value for _, points in usable for _, value in points]
    least, most = math.log10(min(losses)), math.log10(max(losses))
    margin = max(0.02, 0.06 * (most - least))
    least, most = least - margin, most + margin
    width = (_RIGHT - _LEFT) / len(usable)

    def down(value: float) -> float:
        return _TOP + (most - math.log10(value)) / (most - least) * (_FLOOR - _TOP)

    drawn, left = [], float(_LEFT)
    for name, points in usable:
        first, last = points[0][0], points[-1][0]
        step = width / max(1, last - first)
        some = [*points[: -1 : max(1, len(points) // _MAX_POINTS)], points[-1]]
        path = " ".join(f"{left + (i - first) * step:.1f},{down(value):.1f}" for i, value in some)
        drawn.append((name, width > _LETTER * len(name) + 12, left, last - first + 1, path))
        left += width
    ticks = [(value, down(value)) for value in (losses[0], min(losses))]
    return template("curve.svg").render(phases=drawn, ticks=ticks, first=losses[0], last=losses[-1])


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


def page(story: Mapping[str, Any]) -> str:
    """Returns the page of a painting as HTML that needs only the files it names.

    story: content by name. described: the painting (recorder.py). state, plan, painting, comparisons. paints: by
    brush. supplies: tubes to buy. looks: the look and the plan of the rest that followed, as events. left_out: number
    of pictures for which there was no room. has_film: True if there is one. arm_film: its file; "" if there is none.
    watched: False if nobody photographed the finished canvas.
    """
    # The curve is markup of this module, which escapes its texts.
    known: dict[str, Any] = {"curve": Markup(curve_svg(story["state"].planning.phases)), "forecast": SimilarityForecast}
    known |= {"sheet_file": sheet_file, "to_hex": to_hex, "format_amount": format_amount}
    known |= {"count_of": count_of, "mixing_changes": mixing_changes}
    html = template("page.html").render(story=story, **known)
    return html.encode("utf-8", "replace").decode("utf-8")


def write_page(story: Mapping[str, Any], folder: Path) -> Path:
    """Writes the page to the painting's folder, atomically; returns its path. Raises StorageError."""
    path = folder / PAGE
    storage.write_text(path, page(story))
    return path
