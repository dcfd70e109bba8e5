"""How far a virtual studio's canvas lies from where its robot believes it to be, as a person writes it."""

import math
import re

from frida_painter.errors import ConfigError

_FURTHEST, _MOST_TURNED = 0.05, 15.0


def millimetres_and_degrees(text: str | None) -> tuple[float, float, float] | None:
    """ "4mm,2deg" as 4 mm to the right and 2 degrees counter-clockwise, "3mm,-2mm,1deg" as right, up and turn.

    Returns metres right, metres up and radians; None where nothing was given. Raises ConfigError.
    """
    if text is None:
        return None
    number = r"\s*([+-]?(?:\d+(?:\.\d+)?|\.\d+))\s*"
    match = re.fullmatch(rf"{number}mm\s*(?:,{number}mm\s*)?,{number}deg\s*", str(text).lower())
    if match is None:
        raise ConfigError(
            f"--placement-error was given {str(text)[:40]!r}; it is millimetres to the right, millimetres up and "
            "degrees, like 4mm,2deg or 3mm,-2mm,1.5deg."
        )
    x, y, turn = float(match[1]) / 1000, float(match[2] or 0) / 1000, float(match[3])
    if not (math.hypot(x, y) <= _FURTHEST and abs(turn) <= _MOST_TURNED):
        raise ConfigError(
            f"--placement-error was given {text[:40]!r}; at most {_FURTHEST * 1000:g} mm and {_MOST_TURNED:g} degrees "
            "can be corrected."
        )
    return x, y, math.radians(turn)
