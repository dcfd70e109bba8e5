"""Drawing of an SVG, in a process with limits of time and memory, which imports only what draws."""

from xml.etree import ElementTree

from frida_painter.errors import ImageError
from frida_painter.system import operating_system
from frida_painter.system.python_process import ProcessLimits, in_own_process

SIDE = 512  # pixels of the longer side of a page and its margin
_PAGE = 0.625  # share of a side that the page takes, because many drawings exceed their page


@in_own_process(ProcessLimits(processor=10, memory=2 * 2**30))
def draw(svg: bytes, name: str) -> bytes:
    """Returns an SVG as PNG. Raises ImageError if it cannot be drawn.

    name: of the file, for messages
    """
    import resvg_py

    # No link can be followed: no file or socket can be opened, or, on Windows, there is none.
    is_closed, text = operating_system.forbid_files(), svg.decode("utf-8", "replace")
    try:
        drawing = ElementTree.fromstring(text)
        links = (link for each in drawing.iter() for name, link in each.items() if name.endswith("href"))
        if not is_closed and not all(link.lstrip().startswith(("#", "data:")) for link in links):
            raise ValueError("it has links to files")
        page = drawing.get("viewBox") or "0 0"
        left, top, *_ = map(float, page.replace(",", " ").split())
        # resvg puts the origin of a transformation at half the page's size, as if the page began at zero.
        move = f"translate({(1 - _PAGE) * left} {(1 - _PAGE) * top}) scale({_PAGE})"
        sheet = f"svg {{transform: {move}; transform-origin: 50% 50%}} svg svg {{transform: none}}"
        drawn = resvg_py.svg_to_bytes(text, style_sheet=sheet, width=SIDE, height=SIDE, dpi=96, skip_system_fonts=True)
    except (ElementTree.ParseError, ValueError) as cause:
        raise ImageError(f"{name} cannot be drawn ({str(cause)[:120]}); save it as PNG.") from cause
    return bytes(drawn)
