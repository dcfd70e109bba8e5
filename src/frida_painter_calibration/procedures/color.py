"""The color procedure: photographs the 24 known colours of a checker, and fits the map that corrects the camera."""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.easel.dialogue import Confirm, PointCorners, Procedure
from frida_painter.errors import CalibrationError
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.images import from_uint8, to_linear, to_srgb
from frida_painter.palette import difference
from frida_painter.perception.color import (
    ACROSS,
    EDITIONS,
    NAMES,
    ColorFit,
    Corners,
    PatchReadings,
    find_checker,
    fit_color,
    read_checker,
    true_colors,
)
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.rectify import rectified_pixels, rectify
from frida_painter.sheet import CREAM, INK, SOFT, Grid, Sheet, to_bytes
from frida_painter_calibration.procedures.paper import WHITE, EaselAccess

# Picture of a colour calibration: the checker in the photograph, and each patch as seen, mapped and true.

_ROWS, _COLUMNS = 650, 1500
_SIDE, _DISC = 110, 29
_PATCHES = Grid(612, 56, ACROSS, _SIDE, _SIDE, across=34, down=24)
_PHOTOGRAPH = (40, 56, 532, 508)  # left, top, width, height
_FINER = 3


def checker_sheet(
    photograph: NDArray[np.uint8], readings: PatchReadings, affine: Tensor, even: Tensor, true: Tensor, off: Tensor
) -> Tensor:
    """Returns the picture of a colour calibration, sRGB [3, 650, 1500] in [0, 1].

    affine: [3, 4], the map
    even, true: [24, 3], linear light as perceived in even light, and the true one
    off: [24] CIEDE2000, written below each patch
    """
    sheet = Sheet(_COLUMNS, _ROWS, CREAM)
    sheet.paste(_excerpt(photograph, readings), _PHOTOGRAPH[:2])
    seen, known = to_srgb(readings.light), to_srgb(true)
    mapped = to_srgb(even @ affine[:, :3].T + affine[:, 3])
    for number, place in enumerate(_PATCHES.corners(len(seen))):
        patch = _patch(*(to_bytes(colors[number]) for colors in (seen, mapped, known)))
        sheet.cell(place, patch, f"{float(off[number]):.1f}", size=16, gap=3)
    sheet.text((_PHOTOGRAPH[0], 20), "The checker as it was found", 20, INK)
    sheet.text((_PATCHES.left, 20), "Left half: as photographed. Right half: corrected. Disc: true.", 20, INK)
    foot = f"Below: CIEDE2000 of patches that the fit did not see, {float(off.mean()):.2f} on average"
    sheet.text((_PATCHES.left, _ROWS - 46), foot, 18, SOFT)
    return sheet.tensor()


def _excerpt(photograph: NDArray[np.uint8], readings: PatchReadings) -> NDArray[np.uint8]:
    """Returns the photograph around the checker, with frames around the evaluated areas."""
    _, _, width, height = _PHOTOGRAPH
    places = readings.place.numpy()
    low, high = places.min(0), places.max(0)
    scale = float(min(np.array([width, height]) / (1.45 * (high - low))))
    middle = (low + high) / 2
    shift = np.array([width, height]) / 2 - scale * middle
    view = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    excerpt = cv2.warpAffine(photograph, view, (width, height), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
    frames = (16 * (readings.outline.numpy() * scale + shift)).round().astype(np.int32)
    for color, width in ((60, 60, 60), 3), ((255, 255, 255), 1):
        cv2.polylines(excerpt, list(frames), True, color, width, cv2.LINE_AA, shift=4)
    return np.asarray(excerpt, np.uint8)


def _patch(seen: tuple[int, ...], mapped: tuple[int, ...], true: tuple[int, ...]) -> Image.Image:
    """Returns a picture of one patch: two halves, and a disc over both."""
    side, middle, disc = _FINER * _SIDE, _FINER * _SIDE // 2, _FINER * _DISC
    patch = Sheet(side, side, mapped)
    patch.draw.rectangle((0, 0, middle - 1, side), fill=seen)
    patch.draw.ellipse((middle - disc, middle - disc, middle + disc, middle + disc), fill=true)
    return patch.shrink(_SIDE, _SIDE)


WORST_MEAN = 3.0
"""Greatest mean CIEDE2000 of held-out patches; a map with more is refused."""
_MAX_BLOWN_OUT = 0.05
_MAX_UNEVEN = 0.12
_DIMMEST_WHITE = 0.08
_COLOR_ROWS = 240
_MIN_BARE = 0.1
_MAX_OFF_WHITE = 0.05
_NOTABLE_CHANGE = 0.05
# Greatest size of a card with its rim and shadow, relative to the block of its patches' middles.
_CARD = 1.75


@dataclass(frozen=True)
class ColorFinding:
    """Result of the color procedure.

    affine: [3, 4], from perceived to true linear light
    held_out: [24] CIEDE2000 of each patch, mapped by a fit to the 23 others
    fit: fit to all patches, with the errors before it in even light
    photographed: [24] CIEDE2000 of each patch as photographed
    edition: edition of the chart
    change: relative change of the light since the photograph of the bare canvas
    picture: [3, h, w], every patch as seen, mapped and true
    """

    affine: tuple[tuple[float, ...], ...]
    held_out: Tensor
    fit: ColorFit
    photographed: Tensor
    edition: str
    change: float
    picture: Tensor | None

    @property
    def sentence(self) -> str:
        """Result in plain words."""
        worst = int(self.held_out.argmax())
        changed = f" The light had changed by {self.change:.0%} meanwhile; that was taken out." * (
            self.change > _NOTABLE_CHANGE
        )
        return (
            f"Corrected colours are {self.held_out.mean():.1f} CIEDE2000 off on average (patches that the fit did not "
            f"see; at worst {self.held_out[worst]:.1f}, {NAMES[worst]}); as photographed they were "
            f"{self.photographed.mean():.1f} off, in even light {self.fit.before.mean():.1f}.{changed}"
        )

    def enter(self, record: Calibration) -> Calibration:
        """Returns the calibration with this correction of colours."""
        return record.with_color(self.affine, residual=float(self.held_out.mean()))


def color(easel: Easel, *, ground: tuple[float, float, float] = WHITE) -> Procedure[ColorFinding]:
    """Photographs the bare canvas, then a 24-patch colour checker on it, and fits the correction of colours.

    ground: colour of the canvas (sRGB)

    Raises CalibrationError if there is no chart or the map would be wrong, FrameRejected if the canvas is not bare,
    CameraError.
    """
    away, bare = easel.operator.take_checker_away(), easel.operator.lay_paper()  # the robot procedure painted dots
    if not (away and bare):
        yield Confirm("Is the canvas bare, with nothing lying on it?")
    access, grid = EaselAccess(easel), PixelGrid.of_height(easel.canvas, _COLOR_ROWS)
    field = FlatField.learn(rectify(access.photograph().image, easel.calibration, grid), ground)
    if not easel.operator.lay_checker():
        there = yield Confirm(
            "Lay the colour checker (24 patches) flat on the canvas, in any direction, so that some bare canvas "
            "shows on all sides. Does it lie there, without a shadow or a reflection on it?"
        )
        if there is not True:
            raise CalibrationError("Without a colour checker colours stay as the camera sees them; repeat with one.")
    frame = access.photograph().image
    gone = easel.operator.take_checker_away()
    corners = yield PointCorners(
        "Are these the middles of the dark brown, turquoise, black and white corner patches?",
        from_uint8(frame),
        find_checker(frame),
    )
    finding = _read_photograph(easel.calibration, grid, field, ground, frame, _four(corners))
    if not gone:
        yield Confirm("Take the colour checker away again. Is the canvas free?")
    return finding


def _read_photograph(
    record: Calibration,
    grid: PixelGrid,
    field: FlatField,
    ground: tuple[float, float, float],
    frame: NDArray[np.uint8],
    corners: Corners,
) -> ColorFinding:
    """Returns the result of the photograph of the checker. Raises CalibrationError."""
    readings = _in_order(frame, corners)
    _check(readings)
    renewed = _in_this_light(
        field, ground, rectify(frame, record, grid), rectified_pixels(np.array(corners), record, grid)
    )
    place = torch.from_numpy(rectified_pixels(readings.place.double().numpy(), record, grid))
    before, now = (_light_at(known, grid, place) for known in (field, renewed))
    even = readings.light / now
    fits = {edition: fit_color(even, true_colors(edition)) for edition in EDITIONS}
    edition = min(fits, key=lambda name: float(fits[name].held_out.mean()))
    fit, affine = fits[edition], fits[edition].affine
    held_out = fit.held_out
    if not float(held_out.mean()) < float(fit.before.mean()):
        held_out, affine = fit.before, torch.eye(3, 4, dtype=affine.dtype)  # the camera is accurate enough
    if not float(held_out.mean()) <= WORST_MEAN:
        raise CalibrationError(
            f"The patches are {held_out.mean():.1f} CIEDE2000 off on average after the correction; at most "
            f"{WORST_MEAN:g} are allowed (worst: {NAMES[int(held_out.argmax())]}). Is it a chart of the 24 classic "
            "colours, clean and flat, in the light of the painting alone? Repeat the color calibration."
        )
    return ColorFinding(
        affine=tuple(map(tuple, affine.tolist())),
        held_out=held_out,
        fit=fit,
        photographed=difference(to_srgb(readings.light), to_srgb(true_colors(edition))),
        edition=edition,
        change=float((now / before - 1).abs().mean()),
        picture=checker_sheet(frame, readings, affine, even, true_colors(edition), held_out),
    )


def _four(corners: object) -> Corners:
    """Returns the answer as four clockwise corners. Raises CalibrationError."""
    points = np.array(corners if isinstance(corners, tuple) else (), np.float64)
    if points.shape != (4, 2) or not np.isfinite(points).all():
        raise CalibrationError(
            "No colour checker was found in the photograph. Lay a chart of the 24 classic colours flat on the canvas, "
            "look whether the camera is in focus and the light is on, and repeat the color calibration."
        )
    offset = points - points.mean(0)
    clockwise = points[np.argsort(np.arctan2(offset[:, 1], offset[:, 0]))]
    return tuple((float(column), float(row)) for column, row in clockwise)


def _in_order(frame: NDArray[np.uint8], corners: Corners) -> PatchReadings:
    """Returns the readings from the starting corner with which the patches are most similar to the chart's."""
    turned = [read_checker(frame, corners[first:] + corners[:first]) for first in range(4)]
    known = to_srgb(true_colors(EDITIONS[0]))
    return min(turned, key=lambda readings: float(difference(to_srgb(readings.light), known).mean()))


def _check(readings: PatchReadings) -> None:
    """Raises CalibrationError if the patches cannot be read."""
    blown_out = [NAMES[i] for i in torch.nonzero(readings.blown_out > _MAX_BLOWN_OUT).flatten().tolist()]
    if blown_out:
        raise CalibrationError(
            f"The photograph is overexposed: the camera sees no difference any more above {_list(blown_out)}. Expose "
            "shorter or bring less light, and repeat the color calibration."
        )
    brightest = float(readings.light.max())
    if not brightest >= _DIMMEST_WHITE:
        raise CalibrationError(
            f"The photograph is too dark: the brightest patch reflects {brightest:.1%} of full exposure, and "
            f"{_DIMMEST_WHITE:.0%} is needed. Bring more light and repeat the color calibration."
        )
    uneven = [NAMES[i] for i in torch.nonzero(~(readings.unevenness <= _MAX_UNEVEN)).flatten().tolist()]
    if uneven:
        raise CalibrationError(
            f"The patches are not of one colour each: {_list(uneven)}. Either the camera is out of focus, or there is "
            "a reflection, a shadow or dirt on the checker, or its corners are not where they were pointed at. Mend "
            "that and repeat the color calibration."
        )


def _in_this_light(
    field: FlatField, ground: tuple[float, float, float], picture: Tensor, chart: NDArray[np.float64]
) -> FlatField:
    """Returns the light on the checker, from the canvas around it. Raises CalibrationError.

    picture: [3, h, w], the rectified photograph
    chart: [4, 2], middles of the corner patches in it
    """
    rows, columns = picture.shape[1:]
    outline = chart.mean(0) + _CARD * (chart - chart.mean(0))
    covered = cv2.fillConvexPoly(np.zeros((rows, columns), np.uint8), outline.round().astype(np.int32), 1)
    bare = torch.from_numpy(covered == 0)
    if not float(bare.double().mean()) >= _MIN_BARE:
        raise CalibrationError(
            f"The checker covers all but {float(bare.double().mean()):.0%} of the canvas, and {_MIN_BARE:.0%} must "
            "show, for the light is judged by it. Lay it further aside or take a smaller one, and repeat the color "
            "calibration."
        )
    light = to_linear(picture)
    renewed = field.refit(light, bare, ground)
    wanted = renewed.light(rows, columns) * to_linear(torch.tensor(ground))[:, None, None]
    off = float((light / wanted - 1).abs()[:, bare].median())
    if not off <= _MAX_OFF_WHITE:
        raise CalibrationError(
            f"The canvas around the checker looks {off:.0%} different from the bare canvas in any even light; "
            f"{_MAX_OFF_WHITE:.0%} is allowed. Leave camera and canvas as they are, and repeat the color calibration."
        )
    return renewed


def _light_at(field: FlatField, grid: PixelGrid, place: Tensor) -> Tensor:
    """Returns the light at positions [n, 2] of the rectified picture, clamped to its edge: [n, 3] float64."""
    light = field.light(grid.rows, grid.columns).double()
    column, row = place.round().long().unbind(-1)
    return light[:, row.clamp(0, grid.rows - 1), column.clamp(0, grid.columns - 1)].T


def _list(names: list[str]) -> str:
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more
