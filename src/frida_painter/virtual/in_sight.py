"""What comes between the camera and the canvas: a person's hand, or the glare of a lamp."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.virtual.faults import InSight

# Millimetres; a grown person's hand, as it reaches into the picture from below.
_PALM, _FINGER, _WRIST = (41, 46), (17, 78), 54
_SPREAD = (-0.55, -0.2, 0.08, 0.36)  # radians, of the fingers from the hand's direction
_THUMB = (1.0, 20, 62)
_SKIN, _SHADE, _SLEEVE = (206, 160, 132), (168, 120, 96), (52, 66, 92)
_GLARE = 0.09  # of the photograph's width


def draw(image: NDArray[np.uint8], sights: list[InSight], pixels_per_millimetre: float) -> None:
    """Draws what is in sight into a photograph [rows, columns, 3] uint8 sRGB."""
    rows, columns = image.shape[:2]
    for sight in sights:
        place = (round(sight.place[0] * (columns - 1)), round(sight.place[1] * (rows - 1)))
        if sight.what == "hand":
            _draw_hand(image, place, pixels_per_millimetre)
        else:
            _draw_glare(image, place, _GLARE * columns)


def _draw_hand(image: NDArray[np.uint8], place: tuple[int, int], scale: float) -> None:
    """The palm at `place`, fingers up, the forearm down to the edge of the photograph."""
    overlay = image.copy()

    def away(angle: float, length: float) -> tuple[int, int]:
        return round(place[0] + scale * length * math.sin(angle)), round(place[1] - scale * length * math.cos(angle))

    def limb(start: tuple[int, int], end: tuple[int, int], width: float, color: tuple[int, int, int]) -> None:
        cv2.line(overlay, start, end, color, max(1, round(scale * width)), cv2.LINE_AA)

    elbow = (place[0] + round(30 * scale), image.shape[0] + round(60 * scale))
    wrist = (place[0] + round(6 * scale), place[1] + round(_PALM[1] * scale))
    limb(wrist, elbow, _WRIST, _SHADE)
    limb((wrist[0] + round(9 * scale), wrist[1] + round(60 * scale)), elbow, _WRIST * 1.5, _SLEEVE)
    for angle in _SPREAD:
        limb(away(angle, 30), away(angle, _PALM[1] + _FINGER[1] * math.cos(angle)), _FINGER[0], _SKIN)
    limb(place, away(_THUMB[0], _THUMB[2]), _THUMB[1], _SKIN)
    axes = (round(_PALM[0] * scale), round(_PALM[1] * scale))
    cv2.ellipse(overlay, place, axes, 0, 0, 360, _SKIN, -1, cv2.LINE_AA)
    image[:] = overlay


def _draw_glare(image: NDArray[np.uint8], place: tuple[int, int], radius: float) -> None:
    """A lamp that mirrors itself in wet paint: brighter than can be recorded, and a glow around it."""
    row, column = np.mgrid[: image.shape[0], : image.shape[1]]
    distance = np.hypot(column - place[0], row - place[1]) / radius
    glow = 420 * np.exp(-(distance**2))
    image[:] = np.minimum(255, image + glow[..., None]).astype(np.uint8)
