"""Process that opens picture makers, to find what is wrong: `python -m frida_painter.web.maker_reader NAME:TEXT...`.

web/picture_choosing.py runs it. It ends with status 2, and a sentence on the standard error, if one cannot be opened.
"""

import sys

from frida_painter.errors import FridaError
from frida_painter.picture_makers.making import open_picture_maker


def main() -> None:
    """Opens the makers that the command line names; nothing is made."""
    for maker in sys.argv[1:]:
        try:
            open_picture_maker(maker)
        except FridaError as fault:
            print(f"--imagine {maker[:80]!r}: {fault}", file=sys.stderr)
            sys.exit(2)


if __name__ == "__main__":
    main()
