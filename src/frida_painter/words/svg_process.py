"""Separate process that draws one SVG from standard input to standard output, with limits on time and memory.

It runs as a file, so that it imports only the package that draws.
"""

import sys

_SECONDS = 10
_MEMORY = 2 * 2**30  # bytes
_MAX = 16 * 2**20


def main() -> None:
    """Draws the input: width and height in pixels on the first line, then the SVG."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS))
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    except (ImportError, ValueError, OSError):
        pass  # not on this system; the caller's time limit remains
    import resvg_py

    size, _, svg = sys.stdin.buffer.read(_MAX).partition(b"\n")
    width, height = map(int, size.split())
    drawn = resvg_py.svg_to_bytes(svg_string=svg.decode("utf-8"), width=width, height=height, skip_system_fonts=True)
    sys.stdout.buffer.write(bytes(drawn))


if __name__ == "__main__":
    main()
