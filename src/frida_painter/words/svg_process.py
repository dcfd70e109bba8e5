"""A process of its own that draws one SVG: standard input to standard output. What takes too long or too much, ends.

Run as a file, so that nothing but the package that draws is imported.
"""

import sys

_SECONDS = 10
_MEMORY = 2 * 2**30  # bytes
_MOST = 16 * 2**20


def main() -> None:
    """Draws what comes in: the width and height in pixels on the first line, then the SVG."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS))
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    except (ImportError, ValueError, OSError):
        pass  # not on this system; the caller's own clock is left
    import resvg_py

    size, _, svg = sys.stdin.buffer.read(_MOST).partition(b"\n")
    width, height = map(int, size.split())
    drawn = resvg_py.svg_to_bytes(svg_string=svg.decode("utf-8"), width=width, height=height, skip_system_fonts=True)
    sys.stdout.buffer.write(bytes(drawn))


if __name__ == "__main__":
    main()
