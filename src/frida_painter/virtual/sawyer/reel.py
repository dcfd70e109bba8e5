"""A film in the making, put away piece by piece: a crash costs its last two seconds, and the next run goes on."""

import contextlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frida_painter import video
from frida_painter.video import RATE, VideoEncoder

_PIECE = 2 * RATE  # pictures
_HELD = 2 * RATE  # at the end


class Reel:
    """Takes pictures until `finish`, which puts together the film of this and all earlier runs.

    path: of the film; its pieces stay in a hidden folder beside it. pixels: the array [rows, columns, 3]
    that every picture is drawn into. count: pictures so far, those of earlier runs included. Raises
    StorageError.
    """

    def __init__(self, path: Path, pixels: NDArray[np.uint8]) -> None:
        self._path, self._pixels = path, pixels
        self._folder = path.with_name(f".{path.stem}")
        self._pieces = sorted(self._folder.glob("[0-9]*.mp4"))  # each is called by the number of its first picture
        self._earlier = len(self._pieces)
        self.count = int(self._pieces[-1].stem) + video.count(self._pieces[-1]) if self._pieces else 0
        self._encoder: VideoEncoder | None = None
        self._taken = 0  # in this piece

    def send(self) -> None:
        """Takes the array as it is now as the next picture."""
        if self._encoder is None:
            piece = self._folder / f"{self.count:06}.mp4"
            self._encoder = VideoEncoder(piece, self._pixels, RATE)
            self._pieces.append(piece)
            self._taken = 0
        self._encoder.send()
        self.count += 1
        self._taken += 1
        if self._taken == _PIECE:
            self._put_away()

    def finish(self) -> None:
        """Makes the film, which rests on its last picture, unless there was nothing new to see."""
        self._put_away()
        if len(self._pieces) == self._earlier:
            return
        end = self._folder / "end.mp4"
        resting = VideoEncoder(end, self._pixels, RATE)
        for _ in range(_HELD):
            resting.send()
        resting.finish()
        try:
            video.join([*self._pieces, end], self._path)
        finally:
            with contextlib.suppress(OSError):
                end.unlink()

    def _put_away(self) -> None:
        if self._encoder is not None:
            self._encoder.finish()
            self._encoder = None
