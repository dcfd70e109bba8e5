"""When the brush is dipped again at an easel: after what one dip paints, or after so many strokes."""

from dataclasses import replace
from pathlib import Path

from frida_painter.brush.dip import Dip
from frida_painter.brush.endurance import dip_shown
from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.calibration import Calibration

STROKES_PER_DIP = 4
"""Where nothing is known of a brush: what the program that was published with the paper took for all."""


def refilled(kind: BrushKind, record: Calibration, *, simulated: bool) -> BrushKind:
    """The brush with what one dip of it is good for at the easel of that record.

    That is what the record's stroke library shows; where it does not, or there is none, a fixed number of
    strokes, but in the virtual studio what is known of the project's own brushes. Raises LibraryError
    where the library is damaged.
    """
    if record.library is not None and record.brush == kind.name:
        shown = dip_shown(StrokeLibrary.load(Path(record.library.path)), kind.width)
        if shown is not None:
            return replace(kind, known_dip=shown)
    return kind if simulated else replace(kind, known_dip=Dip.of_strokes(STROKES_PER_DIP))
