"""The page of a painting: one HTML file beside its pictures, which opens from a folder without a network."""

from pathlib import Path

import jinja2
from markupsafe import Markup

from frida_painter import storage
from frida_painter.report.curve import curve_svg
from frida_painter.report.palette_sheet import sheet_file
from frida_painter.report.story import Story

PAGE = "index.html"


def template(name: str) -> jinja2.Template:
    """A template of this package, which writes nothing that it was not given."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("frida_painter", "report/templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template(name)


def page(story: Story) -> str:
    """The story as HTML that needs nothing but the files it names."""
    # The curve is our own markup, whose texts are escaped where it is made.
    curve = Markup(curve_svg(story.phases))
    html = template("page.html").render(story=story, curve=curve, sheet_file=sheet_file)
    return html.encode("utf-8", "replace").decode("utf-8")


def write_page(story: Story, folder: Path) -> Path:
    """Writes the page into the painting's folder, atomically; returns its path. Raises StorageError."""
    path = folder / PAGE
    storage.write_text(path, page(story))
    return path
