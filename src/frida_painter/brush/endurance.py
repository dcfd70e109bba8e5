"""What one dip of a brush paints, and how marks fade meanwhile, as far as a stroke library shows it."""

import numpy as np
from numpy.typing import NDArray

from frida_painter.brush.dip import Dip, painted_area
from frida_painter.brush.flaw import Flaw
from frida_painter.brush.judge import judge
from frida_painter.brush.library import StrokeLibrary

_FADED = 0.7  # of the paint that a stroke of a full brush has; those that matter are painted before
_FEWEST = 12  # strokes of a full brush, and as many of others
# What a brush that runs out does to a stroke; other flaws tell nothing of it.
_DRY = (Flaw.NONE, Flaw.EMPTY, Flaw.TORN, Flaw.SKIPPED)


def dip_shown(library: StrokeLibrary, width: float) -> Dip | None:
    """What one dip paints before marks are faint, as a library shows that was painted with fewer dips than strokes.

    width: of the brush's widest mark, metres. None where the library does not tell how much had been
    painted since the dip before each stroke, or has too few strokes of a brush that was no longer full.
    What a stroke has of the paint that the full brush leaves in strokes of its shape is fitted, over what
    was painted until its end, by what can only fall (isotonic regression); a dip is over where that falls
    below 70 %, or where the library ends.
    """
    from sklearn.isotonic import IsotonicRegression  # slow to load

    if library.since_dip is None:
        return None
    usable = np.isin(judge(library), _DRY)
    full = usable & (library.since_dip == 0) & (judge(library) == Flaw.NONE)
    if full.sum() < _FEWEST or (usable & (library.since_dip > 0)).sum() < _FEWEST:
        return None
    share = _paint(library) / _usual_paint(library, full)
    thickness, length, _ = library.shapes()
    until = library.since_dip + painted_area(length, thickness, width).double().numpy()
    order = np.argsort(until[usable])
    ends, shares = until[usable][order], share[usable][order]
    kept = IsotonicRegression(increasing=False).fit_transform(ends, shares.clip(0, 1.2))
    lasting = np.flatnonzero(kept >= _FADED)
    if len(lasting) == 0:
        return None
    last = lasting[-1]
    return Dip(float(ends[last]), fades=float(max(0.0, 1 - kept[last])))


def _paint(library: StrokeLibrary) -> NDArray[np.float64]:
    """Paint in each mark, in pixels of full paint, [n]."""
    return library.magnitude.sum((1, 2), dtype=np.int64) / 255


def _usual_paint(library: StrokeLibrary, full: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The paint that a full brush leaves in strokes of these shapes, [n]; full [n]: which ones it painted."""
    length, press, bend = library.length_m, library.thickness, np.abs(library.bend_m)
    terms = np.stack((np.ones_like(length), length, press, length * press, bend), 1).astype(np.float64)
    paint = _paint(library)
    known = np.linalg.lstsq(terms[full], paint[full], rcond=None)[0]
    return np.asarray(np.maximum(terms @ known, 0.1 * np.median(paint[full])))
