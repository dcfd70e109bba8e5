"""Process that draws one SVG as PNG with limits of time and memory. As a file, it imports only what draws."""

import resource
import sys
from contextlib import suppress
from xml.etree import ElementTree

SIDE = 512  # pixels of the longer side of a page and its margin
_PAGE = 0.625  # share of a side that the page takes, because many drawings exceed their page
_SECONDS, _BYTES = 10, 2 * 2**30


def main() -> None:
    """Draws the input."""
    import resvg_py

    svg = sys.stdin.buffer.read().decode("utf-8", "replace")
    for kind, most in ((resource.RLIMIT_CPU, _SECONDS), (resource.RLIMIT_AS, _BYTES)):
        with suppress(ValueError):  # the system has no such limit, or a lower one
            resource.setrlimit(kind, (most, most))
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, 0))  # no link can be followed: no file or socket can be opened
    page = ElementTree.fromstring(svg).get("viewBox") or "0 0"
    left, top, *_ = map(float, page.replace(",", " ").split())
    # resvg puts the origin of a transformation at half the page's size, as if the page began at zero.
    move = f"translate({(1 - _PAGE) * left} {(1 - _PAGE) * top}) scale({_PAGE})"
    sheet = f"svg {{transform: {move}; transform-origin: 50% 50%}} svg svg {{transform: none}}"
    drawn = resvg_py.svg_to_bytes(svg, style_sheet=sheet, width=SIDE, height=SIDE, dpi=96, skip_system_fonts=True)
    sys.stdout.buffer.write(bytes(drawn))


if __name__ == "__main__":
    main()
