"""The color procedure: photographs the 24 known colours of a checker, and fits the map that corrects the camera."""

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Confirm, Finding, PointCorners, Procedure
from frida_painter.errors import CalibrationError
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.perception.color import (
    EDITIONS,
    NAMES,
    ColorFit,
    PatchReadings,
    find_checker,
    fit_color,
    read_checker,
    true_colors,
)
from frida_painter.perception.flatfield import FlatField, bare_canvas
from frida_painter.perception.markers import PATCHES, CardReading
from frida_painter.perception.rectify import rectified_pixels
from frida_painter.strokes.palette import difference
from frida_painter.system.images import from_uint8, to_linear, to_srgb
from frida_painter_calibration.procedures.paper import EaselAccess, require_four

WORST_MEAN = 3.0
"""Greatest mean CIEDE2000 of held-out patches; a map with more is refused."""
_MAX_BLOWN_OUT = 0.05
_MAX_UNEVEN = 0.12
_DIMMEST_WHITE = 0.08
_COLOR_ROWS = 240
_WORST_INKS, _WHITES = 14.0, 8
_TONES = (0.5, 2.0)  # exponents of a printer's inks
# Greatest size of a card with its rim and shadow, relative to the block of its patches' middles.
_CARD = 1.75


def color(easel: Easel) -> Procedure[Finding]:
    """Photographs a 24-patch colour checker on the bare white canvas, and fits the correction of colours.

    Raises CalibrationError if there is no chart or the map would be wrong, FrameRejected if the canvas around it is
    not bare, CameraError.
    """
    easel.operator.lay_paper()  # the robot procedure painted dots
    if not easel.operator.lay_checker():
        there = yield Confirm(
            "Lay the colour checker (24 patches) flat on the canvas, in any direction, so that some bare canvas "
            "shows on all sides. Does it lie there, without a shadow or a reflection on it?"
        )
        if there is not True:
            raise CalibrationError("Without a colour checker colours stay as the camera sees them; repeat with one.")
    frame = EaselAccess(easel).photograph().image
    gone = easel.operator.take_checker_away()
    corners = yield PointCorners(
        "Are these the middles of the dark brown, turquoise, black and white corner patches?",
        from_uint8(frame),
        find_checker(frame),
    )
    finding = read_chart(easel.calibration, easel.canvas, frame, corners)[0]
    if not gone:
        yield Confirm("Take the colour checker away again. Is the canvas free?")
    return finding


def read_chart(
    record: Calibration, canvas: CanvasSize, frame: NDArray[np.uint8], corners: object
) -> tuple[Finding, NDArray[np.float64]]:
    """Returns the finding of a checker on the bare canvas, and the outline [4, 2] of the whole card.

    corners: middles of its corner patches, (column, row) in the photograph
    Raises CalibrationError, and FrameRejected if the canvas around it is not bare.
    """
    readings, middles = _read_patches(frame, corners)
    _check(readings)
    outline = middles.mean(0) + _CARD * (middles - middles.mean(0))
    light = FlatField.of(bare_canvas(frame, record, canvas, outline).light)
    grid = PixelGrid.of_height(canvas, _COLOR_ROWS)
    place = rectified_pixels(readings.place.double().numpy(), record, grid).round().astype(int)
    column, row = place.clip(0, (grid.columns - 1, grid.rows - 1)).T
    even = readings.light / light.light(grid.rows, grid.columns).double()[:, row, column].T
    fits = [(fit_color(even, true_colors(edition)), true_colors(edition)) for edition in EDITIONS]
    fit, true = min(fits, key=lambda one: float(one[0].held_out.mean()))
    held_out, affine = fit.held_out, fit.affine
    if not float(held_out.mean()) < float(fit.before.mean()):
        held_out, affine = fit.before, torch.eye(3, 4, dtype=affine.dtype)  # the camera is accurate enough
    mean, worst = float(held_out.mean()), int(held_out.argmax())
    if not mean <= WORST_MEAN:
        raise CalibrationError(
            f"The patches are {mean:.1f} CIEDE2000 off on average after the correction; at most {WORST_MEAN:g} are "
            f"allowed (worst: {NAMES[worst]}). Is it a chart of the 24 classic colours, clean and flat, in the light "
            "of the painting alone? Repeat the color calibration."
        )
    photographed = float(difference(to_srgb(readings.light), to_srgb(true)).mean())
    finding = Finding(
        f"Corrected colours are {mean:.1f} CIEDE2000 off on average (patches that the fit did not see; at worst "
        f"{held_out[worst]:.1f}, {NAMES[worst]}); as photographed they were {photographed:.1f} off, in even light "
        f"{fit.before.mean():.1f}.",
        None,
        lambda known: known.with_color(tuple(map(tuple, affine.tolist())), residual=mean),
    )
    return finding, outline


def read_card(card: CardReading) -> Finding:
    """Returns what the printed card of colours tells.

    A printer's inks are several CIEDE2000 off. Its tone curves do not matter: they are fitted too, since a camera's
    bands are linear in light. The error of patches that the map did not see is the card's own. Its share of the squared
    deviation is left uncorrected (W. James and C. Stein, "Estimation with quadratic loss",
    1961).
    Raises CalibrationError if its colours are strange.
    """
    white = torch.ones(_WHITES, 3, dtype=torch.float64)  # white stays white
    seen = torch.cat((torch.from_numpy(card.light), white))
    inks = to_linear(torch.tensor(PATCHES, dtype=torch.float64))

    def fit(tone: NDArray[np.float64]) -> ColorFit:
        return fit_color(seen, torch.cat((inks ** torch.from_numpy(tone), white)), stray=False)

    best = fit(least_squares(lambda tone: fit(tone).held_out.numpy(), np.ones(3), bounds=_TONES, diff_step=0.01).x)
    before, after = (float(off[: len(PATCHES)].mean()) for off in (best.before, best.held_out))
    if not after <= _WORST_INKS:
        raise CalibrationError(
            f"The card's colours contradict one another by {after:.0f} CIEDE2000, and at most {_WORST_INKS:g} are "
            "allowed: it is printed in grey or with an empty ink, partly covered, or in a shadow. Lay it free, print "
            "it anew, or use a colour checker."
        )
    share = max(0.0, 1 - (after / before) ** 2)
    none = torch.eye(3, 4, dtype=torch.float64)
    affine = tuple(map(tuple, (none + share * (best.affine - none)).tolist()))
    return Finding(
        f"The card's colours are {before:.1f} CIEDE2000 off, {after:.1f} by its inks alone: {share:.0%} of the "
        "correction is taken.",
        None,
        lambda known: known.with_color(affine, residual=after),
    )


def _read_patches(frame: NDArray[np.uint8], answer: object) -> tuple[PatchReadings, NDArray[np.float64]]:
    """Returns the readings, and the corner patches' middles [4, 2], for corners from any one, in either direction.

    The first patch is that from which they are most similar to the chart's. Raises CalibrationError without four.
    """
    points = require_four(
        answer,
        "No colour checker was found in the photograph. Lay a chart of the 24 classic colours flat on the canvas, "
        "look whether the camera is in focus and the light is on, and repeat the color calibration.",
    )
    offset = points - points.mean(0)
    points = points[np.argsort(np.arctan2(offset[:, 1], offset[:, 0]))]  # clockwise
    known = to_srgb(true_colors(EDITIONS[0]))
    turned = [read_checker(frame, tuple(map(tuple, np.roll(points, -first, 0).tolist()))) for first in range(4)]
    return min(turned, key=lambda one: float(difference(to_srgb(one.light), known).mean())), points


def _check(readings: PatchReadings) -> None:
    """Raises CalibrationError if the patches cannot be read."""

    def names(wrong: Tensor) -> str:
        found = [NAMES[number] for number in torch.nonzero(wrong).flatten().tolist()]
        return ", ".join(found[:3]) + (f" and {len(found) - 3} more" if len(found) > 3 else "")

    if blown_out := names(readings.blown_out > _MAX_BLOWN_OUT):
        raise CalibrationError(
            f"The photograph is overexposed: the camera sees no difference any more above {blown_out}. Expose "
            "shorter or bring less light, and repeat the color calibration."
        )
    brightest = float(readings.light.max())
    if not brightest >= _DIMMEST_WHITE:
        raise CalibrationError(
            f"The photograph is too dark: the brightest patch reflects {brightest:.1%} of full exposure, and "
            f"{_DIMMEST_WHITE:.0%} is needed. Bring more light and repeat the color calibration."
        )
    if uneven := names(~(readings.unevenness <= _MAX_UNEVEN)):
        raise CalibrationError(
            f"The patches are not of one colour each: {uneven}. Either the camera is out of focus, or there is "
            "a reflection, a shadow or dirt on the checker, or its corners are not where they were pointed at. Mend "
            "that and repeat the color calibration."
        )
