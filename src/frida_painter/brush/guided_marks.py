"""Marks from the way of a tip that a person guides over the canvas: cut by its height, and kept in a file.

A mark begins if the tip comes down to the lightest touch, and ends if it rises well above that, because a hand
trembles. The file is one of those that `read_marks` reads.
"""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frida_painter import storage
from frida_painter.brush.teaching import MAX_MARKS, TaughtMark
from frida_painter.errors import FamilyError

_LIFTED = 0.002  # metres above the lightest touch at which a mark has ended
_APART = 0.0003  # metres between two kept places, so that a hand that rests adds no way
_LIGHTEST = 0.02  # pressure of a tip that trembles above the canvas within a mark
Mark = NDArray[np.float64]


class MarkCutter:
    """Cuts the way of a tip into marks, sample by sample.

    press: metres from the lightest touch down to the hardest press
    marks: finished marks [k, 4] with x and y on the canvas in metres, metres below the lightest touch, and seconds
    """

    def __init__(self, press: float) -> None:
        self.press = press
        self.marks: list[Mark] = []
        self._touching: list[tuple[float, float, float, float]] = []

    def add(self, place: NDArray[np.float64], height: float, at: float) -> None:
        """Adds a sample of the tip.

        place [2]: on the canvas, metres
        height: metres above the lightest touch; below 0 on the canvas
        at: seconds
        """
        if height <= 0 or (self._touching and height <= _LIFTED):
            self._touching.append((float(place[0]), float(place[1]), -height, at))
        elif self._touching:
            self.finish()

    def finish(self) -> None:
        """Ends a mark that is not ended yet."""
        if not self._touching:
            return
        mark = np.array(self._touching)
        self._touching = []
        mark = mark[: 1 + int(np.flatnonzero(mark[:, 2] >= 0)[-1])]  # without the way up
        kept = [0]
        for index in range(1, len(mark)):
            if float(np.linalg.norm(mark[index, :2] - mark[kept[-1], :2])) >= _APART:
                kept.append(index)
        self.marks.append(mark[kept])

    def save(self, path: Path) -> list[str]:
        """Writes the marks as a file of marks; returns a sentence about each touch that is no mark.

        The deepest place of all, or the hardest press if that is deeper, is a pressure of 1.
        Raises FamilyError if there is no mark or there are too many, StorageError.
        """
        deepest = max([self.press, *(float(mark[:, 2].max()) for mark in self.marks)])
        kept, left_out = [], []
        for number, mark in enumerate(self.marks, 1):
            pressure = np.clip(mark[:, 2] / deepest, _LIGHTEST, 1)
            try:
                TaughtMark(mark[:, :2], pressure, name=f"Touch {number}")
            except FamilyError as because:
                left_out.append(f"Left out: {because}")
                continue
            columns = {"x": 1000 * mark[:, 0], "y": 1000 * mark[:, 1], "pressure": pressure}
            columns["time"] = mark[:, 3] - mark[0, 3]
            kept.append({name: np.round(column, 4).tolist() for name, column in columns.items()})
        if not 1 <= len(kept) <= MAX_MARKS:
            raise FamilyError(
                f"{len(self.marks)} touches of the canvas were recorded, and {len(kept)} of them are marks; guide the "
                f"tip down to the canvas for each mark, up to {MAX_MARKS:,} of them, and lift it in between."
            )
        storage.write_text(path, json.dumps({"unit": "mm", "marks": kept}) + "\n")
        return left_out
