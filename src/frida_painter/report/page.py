"""The page of a painting: one HTML file beside its pictures, which works from a folder without a network."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2

from frida_painter.planning.forecast import SimilarityForecast
from frida_painter.planning.mixable import mixing_changes
from frida_painter.report.sheets import format_amount, sheet_file
from frida_painter.strokes.palette import to_hex
from frida_painter.system import storage
from frida_painter.system.storage import count_of

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
    brush. supplies: tubes to buy. looks: the look and the plan of the rest that followed, as events. size: columns and
    rows of painting.png. left_out: number of pictures for which there was no room. has_film, has_card: True if there
    are these files. arm_film: its file; "" if there is none. watched: False if nobody photographed the finished canvas.
    """
    known: dict[str, Any] = {"sheet_file": sheet_file, "to_hex": to_hex, "format_amount": format_amount}
    known |= {"count_of": count_of, "mixing_changes": mixing_changes, "forecast": SimilarityForecast}
    html = template("page.html").render(story=story, **known)
    return html.encode("utf-8", "replace").decode("utf-8")


def write_page(story: Mapping[str, Any], folder: Path) -> Path:
    """Writes the page to the painting's folder, atomically; returns its path. Raises StorageError."""
    path = folder / PAGE
    storage.write_text(path, page(story))
    return path
