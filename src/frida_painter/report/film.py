"""The film of a painting: frames stream into an H.264 file that every browser plays."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ImageError
from frida_painter.system import images, storage
from frida_painter.system.video import RATE, VideoEncoder

Color = tuple[float, float, float]

SECONDS = 15.0
HOLD = 2.0
_ROWS, _COLUMNS = 1080, 1920
_MARGIN, _BAR = 43, 14  # pixels; they leave 960 rows
_MOUNT = (244, 241, 235)
_TRACK = (226, 221, 212)


class FilmWriter:
    """Writer of the film while the painting is made. Used in a `with` block.

    path: of the film
    expected: expected number of frames

    The film lasts about 15 seconds for any number of frames, with the same time for each stroke, and shows the last
    frame for two more. Each frame has a mount. A bar below it grows with the colours of the paints in order of use.
    Only one frame is in memory. The film appears when the block ends, for any reason, if there was a frame.
    Raises StorageError.
    """

    def __init__(self, path: Path, expected: int) -> None:
        self.path = path
        self._room = min(max(1, expected), round(RATE * SECONDS))
        self._rate = max(1.0, self._room / SECONDS)
        self._shown = 0
        self._stage: _Stage | None = None
        self._encoder: VideoEncoder | None = None

    def __enter__(self) -> Self:
        return self

    def add(self, frame: NDArray[np.uint8], done: float, color: Color | None = None) -> None:
        """Adds the canvas [H, W, 3] at a share `done` of the strokes, from 0 to 1, never less than before.

        color: of the paint on the brush, sRGB in [0, 1]

        A frame of a different size is resized to that of the first. Raises StorageError.
        """
        if self._stage is None or self._encoder is None:
            self._stage = _Stage(*frame.shape[:2])
            self._encoder = VideoEncoder(self.path, self._stage.pixels, self._rate)
        self._stage.show(frame, min(1.0, done), color)
        # Surplus frames are thinned evenly; a late frame is shown longer.
        until = max(1, round(min(1.0, done) * self._room))
        while self._shown < until:
            self._encoder.send()
            self._shown += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._encoder is not None and self._encoder.running:
            for _ in range(round(HOLD * self._rate)):
                self._encoder.send()
            self._encoder.finish()


class _Stage:
    """Film picture of 1920 x 1080 pixels: the canvas on its mount, with the bar of paints below."""

    def __init__(self, rows: int, columns: int) -> None:
        below = _MARGIN // 2 + _BAR - 1
        share = min((_ROWS - 2 * _MARGIN - below) / rows, (_COLUMNS - 2 * _MARGIN) / columns)
        self._rows, self._columns = max(2, round(rows * share)), max(2, round(columns * share))
        self.pixels = np.empty((_ROWS, _COLUMNS, 3), np.uint8)
        self.pixels[:] = _MOUNT
        top, left = (_ROWS - below - self._rows) // 2, (_COLUMNS - self._columns) // 2
        self._canvas = self.pixels[top : top + self._rows, left : left + self._columns]
        top += self._rows + _MARGIN // 2
        self._bar = self.pixels[top : top + _BAR, left : left + self._columns]
        self._bar[:] = _TRACK
        self._reached = 0

    def show(self, frame: NDArray[np.uint8], progress: float, color: Color | None) -> None:
        """Draws a frame on the mount and extends the bar to `progress` in [0, 1]."""
        if frame.shape[:2] != (self._rows, self._columns):
            way = cv2.INTER_AREA if frame.shape[0] > self._rows else cv2.INTER_CUBIC
            frame = np.asarray(cv2.resize(frame, (self._columns, self._rows), interpolation=way), np.uint8)
        self._canvas[:] = frame
        reached = round(progress * self._columns)
        if color is not None:
            self._bar[:, self._reached : reached] = [round(255 * part) for part in color]
        self._reached = reached


# The sketchbook: timelapse frames, stored during the painting, so that another run can continue the film.

SKETCHBOOK = "sketchbook"


def keep_frame(folder: Path, stroke: int, picture: NDArray[np.uint8]) -> str:
    """Stores the timelapse frame [H, W, 3] after a stroke in a painting's folder; returns its name there.

    Raises StorageError if the disk is full.
    """
    path = storage.find_unused(folder / SKETCHBOOK / f"glimpse-{stroke:06d}.jpg")
    images.save(picture, path)
    return f"{SKETCHBOOK}/{path.name}"


def kept_frames(folder: Path, painted: int) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Yields the timelapse frames up to stroke `painted` with the numbers of their strokes; skips damaged ones."""
    files = (folder / SKETCHBOOK).glob("glimpse-*.jpg")
    frames = [([int(part) for part in path.stem.split("-")[1:]], path) for path in files]
    for (stroke, *_), path in sorted(frames):
        if stroke <= painted:
            with suppress(ImageError):
                yield stroke, images.to_uint8(images.load(path))
