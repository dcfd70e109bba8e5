"""Camera of the studio: perspective, lens, uneven light, a colour cast, noise, and eight bits of sRGB."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import CameraError, StaleFrame
from frida_painter.frames import Lens
from frida_painter.hardware.faults import NO_FAULTS, Faults, InSight
from frida_painter.hardware.robot import Frame
from frida_painter.virtual.paint import to_linear, to_srgb
from frida_painter.virtual.robot import Clock
from frida_painter.virtual.simulation_log import Note, ignore_entry
from frida_painter.virtual.tabletop import Checker, Table

# Obstacles between the camera and the canvas: a person's hand, or the glare of a lamp.

# Hand of an adult in millimetres; it reaches into the picture from below.
_PALM, _FINGER, _WRIST = (41, 46), (17, 78), 54
_SPREAD = (-0.55, -0.2, 0.08, 0.36)  # radians of the fingers from the hand's direction
_THUMB = (1.0, 20, 62)
_SKIN, _SHADE, _SLEEVE = (206, 160, 132), (168, 120, 96), (52, 66, 92)
_GLARE = 0.09  # of the photograph's width


def draw(image: NDArray[np.uint8], sights: list[InSight], pixels_per_millimetre: float) -> None:
    """Draws obstacles into a photograph [rows, columns, 3] uint8 sRGB."""
    rows, columns = image.shape[:2]
    for sight in sights:
        place = (round(sight.place[0] * (columns - 1)), round(sight.place[1] * (rows - 1)))
        if sight.what == "hand":
            _draw_hand(image, place, pixels_per_millimetre)
        else:
            _draw_glare(image, place, _GLARE * columns)


def _draw_hand(image: NDArray[np.uint8], place: tuple[int, int], scale: float) -> None:
    """Draws the palm at `place`, with the fingers up and the forearm down to the edge of the photograph."""
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
    """Draws a lamp reflected in wet paint: brighter than white, with a glow around it."""
    row, column = np.mgrid[: image.shape[0], : image.shape[1]]
    distance = np.hypot(column - place[0], row - place[1]) / radius
    glow = 420 * np.exp(-(distance**2))
    image[:] = np.minimum(255, image + glow[..., None]).astype(np.uint8)


Corners = tuple[tuple[float, float], ...]

_TONES = 4096
_NOISE_BANK = 1 << 18
_TABLE_SRGB = (0.42, 0.39, 0.36)
_ARM_WIDTH, _ARM_COLOR = 45.0, (58, 60, 64)


@dataclass(frozen=True)
class CameraSpec:
    """Position and properties of the camera.

    photograph: (rows, columns).
    tilt, side: angles in radians from below and from the side; 0, 0 is straight on.
    roll: radians.
    filling: share of the photograph that the canvas spans.
    lens: barrel distortion at the photograph's corner, share of the radius.
    falloff: light that the darkest corner lacks, share.
    cast: gain of the three channels.
    bleed: light that leaks between channels.
    noise: standard deviation at full light, share of it.
    exposure: seconds.
    """

    photograph: tuple[int, int] = (1200, 1600)
    tilt: float = math.radians(16)
    side: float = math.radians(7)
    roll: float = math.radians(0.8)
    filling: float = 0.88
    lens: float = 0.006
    falloff: float = 0.28
    cast: tuple[float, float, float] = (0.97, 0.92, 0.84)
    bleed: float = 0.02
    noise: float = 0.008
    exposure: float = 0.1

    @classmethod
    def ideal(cls, rows: int = 1200, columns: int = 1600) -> "CameraSpec":
        """Returns a camera straight above the canvas, without distortion, cast, falloff or noise."""
        return cls((rows, columns), 0.0, 0.0, 0.0, 0.95, 0.0, 0.0, (1.0, 1.0, 1.0), 0.0, 0.0)


class VirtualCamera:
    """Camera above a table; implements hardware.robot.Camera.

    corners: first position of the canvas's corners, in pixels.
    lens: distortion of the lens, None without one.
    note: called for every photograph.
    """

    def __init__(self, spec: CameraSpec, table: Table, clock: Clock, random: np.random.Generator) -> None:
        self.faults: Faults = NO_FAULTS
        self.photographs = 0
        self.note: Note = ignore_entry
        self._spec, self._table, self._clock, self._random = spec, table, clock, random
        width, height = table.canvas.width, table.canvas.height
        self._to_canvas, self.corners = _optics(spec, width, height)
        self.lens = _lens(spec)
        self._light = _light(spec, random)
        self._mix = (np.eye(3) * (1 - 3 * spec.bleed) + spec.bleed) * np.array(spec.cast)[:, None]
        self._tones = np.rint(255 * to_srgb(np.linspace(0, 1, _TONES))).astype(np.uint8)
        self._noise = (spec.noise * random.standard_normal(_NOISE_BANK)).astype(np.float32)
        self._pixels = np.empty((*spec.photograph, 3), np.float32)
        self._bare_row = np.tile(to_linear(np.array(_TABLE_SRGB)).astype(np.float32), (spec.photograph[1], 1))
        self._last: Frame | None = None
        self._connected = False

    def connect(self) -> None:
        """Switches the camera on; a second call changes nothing."""
        self._connected = True

    def close(self) -> None:
        """Switches the camera off."""
        self._connected = False

    def capture(self, newer_than: float) -> Frame:
        """Returns a photograph of the current canvas, later than `newer_than` (s of the studio's clock).

        Raises StaleFrame if `newer_than` is in the future, or if the stale fault returns the last frame. Raises
        CameraError if the camera is not connected, or does not answer.
        """
        if not self._connected:
            raise CameraError("The virtual camera is not connected; call connect() first.")
        number, self.photographs = self.photographs, self.photographs + 1
        if number in self.faults.failed_photographs:
            raise CameraError("The virtual camera does not answer; look at its cable, and connect it again.")
        frame = self._last
        if frame is None or number not in self.faults.stale_photographs:
            self._clock.now += self._spec.exposure
            frozen = frame is not None and number in self.faults.frozen_photographs
            frame = Frame(frame.image if frame and frozen else self._expose(number), self._clock.now, number)
        self.note({"did": "photograph", "now": self._clock.now, "exposed": frame is not self._last})
        self._last = frame
        if not frame.captured_at > newer_than:
            raise StaleFrame(
                f"The virtual camera has a photograph of {frame.captured_at:.2f} s; one later than "
                f"{newer_than:.2f} s was asked for; take another."
            )
        return frame

    def remember(self, exposed: bool) -> None:
        """Repeats the effects of a photograph from the log, without the photograph itself."""
        self.photographs += 1
        if exposed:
            self._grain()

    def push(self, right: float, up: float, turn: float = 0.0) -> None:
        """Moves the camera over the table, in mm, and turns it about the canvas's middle, in radians."""
        middle = np.array([self._table.canvas.width, self._table.canvas.height]) / 2
        cos, sin = math.cos(turn), math.sin(turn)
        turned = (self._to_canvas - middle) @ np.array([[cos, sin], [-sin, cos]]) + middle + (right, up)
        self._to_canvas = turned.astype(np.float32)

    def _expose(self, number: int) -> NDArray[np.uint8]:
        scene = self._scene()
        blur = self.faults.blur_of(number) * scene.shape[1]
        if blur > 0:
            scene = np.asarray(cv2.GaussianBlur(scene, (0, 0), blur), np.float32)
        change = self.faults.light_of(number)
        light = self._light * _leaning(self._light.shape, change.lean) if any(change.lean) else self._light
        mix = (self._mix * np.array(change.gain)[:, None]).astype(np.float32)
        image = np.empty(scene.shape, np.uint8)
        _develop(scene, light, mix, self._tones, self._noise, self._grain(), image)
        self._show_arm(image)
        sights = [sight for sight in self.faults.in_sight if sight.concerns(number)]
        draw(image, sights, math.dist(*self.corners[:2]) / self._table.canvas.width)
        return image

    def _grain(self) -> int:
        """Returns a random start in the bank of noise for a photograph."""
        return int(self._random.integers(_NOISE_BANK))

    def _scene(self) -> NDArray[np.float32]:
        """Returns the linear reflectance at each pixel [rows, columns, 3]; valid until the next call."""
        canvas, knock = self._table.canvas, self._table.knock
        scene = self._pixels
        scene[:] = self._bare_row
        self._lay_cards(self._table.under, scene)
        # Current position of the canvas: table (mm) -> cells.
        cos, sin = math.cos(knock.turn), math.sin(knock.turn)
        center = np.array([canvas.width, canvas.height]) / 2
        back = np.array([[cos, sin], [-sin, cos]]) / canvas.cell
        shift = center / canvas.cell - back @ (center + 1000 * np.array(knock.shift)) - 0.5
        # The last cells of a canvas may reach beyond its edge.
        whole = (canvas.height / canvas.cell, canvas.width / canvas.cell)
        _lay(canvas.reflectance(), whole, self._to_canvas, np.c_[back, shift].astype(np.float32), scene)
        checker = self._table.checker
        self._lay_cards((*self._table.over, *([] if checker is None else [checker])), scene)
        return scene

    def _lay_cards(self, cards: Iterable[Checker], scene: NDArray[np.float32]) -> None:
        for card in cards:
            shape = (float(card.looks.shape[0]), float(card.looks.shape[1]))
            _lay(card.looks, shape, self._to_canvas, card.cells().astype(np.float32), scene)

    def _show_arm(self, image: NDArray[np.uint8]) -> None:
        """Draws the arm into the picture if it is not at the home position."""
        canvas, tip = self._table.canvas, self._table.tip
        size = np.array([canvas.width, canvas.height])
        if (tip < -_ARM_WIDTH).any() or (tip > size + _ARM_WIDTH).any():
            return
        around = np.array([(0, size[1]), size, (size[0], 0), (0, 0)], np.float32)
        to_photograph = cv2.getPerspectiveTransform(around, np.array(self.corners, np.float32))
        ends = np.array([[tip, self._table.base]])
        start, end = cv2.perspectiveTransform(ends, to_photograph)[0].round().astype(int)
        pixels = math.dist(*self.corners[:2]) / canvas.width
        cv2.line(image, start.tolist(), end.tolist(), _ARM_COLOR, max(1, round(_ARM_WIDTH * pixels)), cv2.LINE_AA)


def _optics(spec: CameraSpec, width: float, height: float) -> tuple[NDArray[np.float32], Corners]:
    """Returns the view of each pixel, and the canvas's corners in pixels.

    The view [rows, columns, 2] is the point on the canvas plane in mm.
    """
    rows, columns = spec.photograph
    distance = 2.2 * math.hypot(width, height)
    tilt = np.array([[1, 0, 0], [0, math.cos(spec.tilt), math.sin(spec.tilt)],
                     [0, -math.sin(spec.tilt), math.cos(spec.tilt)]])  # fmt: skip
    side = np.array([[math.cos(spec.side), 0, math.sin(spec.side)], [0, 1, 0],
                     [-math.sin(spec.side), 0, math.cos(spec.side)]])  # fmt: skip
    roll = np.array([[math.cos(spec.roll), -math.sin(spec.roll), 0], [math.sin(spec.roll), math.cos(spec.roll), 0],
                     [0, 0, 1]])  # fmt: skip
    turned = roll @ tilt @ side
    # From canvas millimetres, y up, to camera coordinates, y down.
    pose = np.diag([1.0, -1.0, -1.0]) @ np.c_[turned[:, :2], turned @ (-width / 2, -height / 2, 0) - (0, 0, distance)]
    world = np.array([(0, height, 1), (width, height, 1), (width, 0, 1), (0, 0, 1)], float)
    seen = world @ pose.T
    seen = seen[:, :2] / seen[:, 2:]
    low, high = seen.min(0), seen.max(0)
    focal = spec.filling * float(np.min(np.array([columns, rows]) / (high - low)))
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
    lens = np.array([[focal, 0, 0], [0, focal, 0], [0, 0, 1]])
    lens[:2, 2] = -focal * (low + high) / 2
    homography = lens @ pose  # canvas (x, y, 1) mm -> pixels from the middle, before distortion
    reach = float(np.hypot(*middle))

    def straightened(pixel: NDArray[np.float64]) -> NDArray[np.float64]:
        offset = pixel - middle
        return offset * (1 + spec.lens * ((offset / reach) ** 2).sum(-1, keepdims=True))

    ideal = world @ homography.T
    ideal = ideal[:, :2] / ideal[:, 2:]
    corners = ideal + middle
    for _ in range(20):
        corners += ideal - straightened(corners)
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).astype(np.float64)
    view = cv2.perspectiveTransform(straightened(grid), np.linalg.inv(homography))
    return view.astype(np.float32), tuple((float(x), float(y)) for x, y in corners)


def _lens(spec: CameraSpec) -> Lens | None:
    """Returns the lens in the form of a calibration: the series that inverts r (1 + lens r^2)."""
    if spec.lens == 0:
        return None
    rows, columns = spec.photograph
    middle = ((columns - 1) / 2, (rows - 1) / 2)
    reach = math.hypot(*middle)
    return Lens((reach, reach), middle, (-spec.lens, 3 * spec.lens**2, 0.0, 0.0, -12 * spec.lens**3))


def _light(spec: CameraSpec, random: np.random.Generator) -> NDArray[np.float32]:
    """Returns the brightness of the light over the photograph [rows, columns]: a lamp to one side, and the vignette."""
    rows, columns = spec.photograph
    down, across = np.linspace(-1, 1, rows)[:, None], np.linspace(-1, 1, columns)[None]
    angle = random.uniform(0, 2 * math.pi)
    lamp = (1 + math.cos(angle) * across + math.sin(angle) * down) / (1 + abs(math.cos(angle)) + abs(math.sin(angle)))
    vignette = (across**2 + down**2) / 2
    return (0.97 * (1 - spec.falloff * (0.6 * (1 - lamp) / 2 + 0.7 * vignette))).astype(np.float32)


def _leaning(shape: tuple[int, ...], lean: tuple[float, float]) -> NDArray[np.float32]:
    """Returns the factor of brightness [rows, columns] if the light comes from the (right, lower) side."""
    down, across = np.linspace(-1, 1, shape[0])[:, None], np.linspace(-1, 1, shape[1])[None]
    return np.maximum(0, 1 + lean[0] * across + lean[1] * down).astype(np.float32)


@numba.njit(cache=True, nogil=True)
def _lay(looks, shape, view, to_cell, scene):  # type: ignore[no-untyped-def]
    """Draws a flat thing with looks [high, wide, 3], of `shape` (rows, columns), at each pixel that looks at it."""
    high, wide = looks.shape[0], looks.shape[1]
    for r in range(scene.shape[0]):
        for c in range(scene.shape[1]):
            x = to_cell[0, 0] * view[r, c, 0] + to_cell[0, 1] * view[r, c, 1] + to_cell[0, 2]
            y = to_cell[1, 0] * view[r, c, 0] + to_cell[1, 1] * view[r, c, 1] + to_cell[1, 2]
            if -0.5 <= x <= shape[1] - 0.5 and -0.5 <= y <= shape[0] - 0.5:
                x, y = min(max(x, 0.0), wide - 1.0), min(max(y, 0.0), high - 1.0)
                left, above = min(int(x), wide - 2), min(int(y), high - 2)
                u, v = x - left, y - above
                p, q, s, t = (1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v
                # Unsigned indices need no wrap-around and no slices need no reference counts: five times as fast.
                i, j = numba.uint64(above), numba.uint64(left)
                k, m = i + numba.uint64(1), j + numba.uint64(1)
                for band in range(3):
                    scene[r, c, band] = (
                        p * looks[i, j, band] + q * looks[i, m, band] + s * looks[k, j, band] + t * looks[k, m, band]
                    )


@numba.njit(cache=True, nogil=True)
def _develop(scene, light, mix, tones, noise, offset, image):  # type: ignore[no-untyped-def]
    """Writes the photograph: the scene's light in the sensor's channels, with noise, in eight bits."""
    bank, last = noise.shape[0], tones.shape[0] - 1
    position = offset
    for r in range(image.shape[0]):
        for c in range(image.shape[1]):
            red, green, blue = scene[r, c, 0], scene[r, c, 1], scene[r, c, 2]
            for band in range(3):
                value = light[r, c] * (mix[band, 0] * red + mix[band, 1] * green + mix[band, 2] * blue)
                # Photon noise: its variance grows with the light.
                value += noise[position] * math.sqrt(max(value, 0.0) + 0.002)
                position += 1
                if position >= bank:
                    position = 0
                image[r, c, band] = tones[int(min(max(value, 0.0), 1.0) * last + 0.5)]
