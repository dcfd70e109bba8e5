"""When the painter looks at the canvas and plans again, and when it takes a timelapse frame for the film."""

import itertools
from dataclasses import dataclass


@dataclass(frozen=True)
class ReplanPolicy:
    """How a painting is divided: how often the painter looks and plans again, and takes timelapse frames."""

    replans: int
    timelapse_frames: int

    def batches(self, strokes: int) -> list[int]:
        """Strokes painted between two looks: `replans` + 1 batches that differ by at most one stroke."""
        count = min(self.replans + 1, strokes)
        return [strokes * (number + 1) // count - strokes * number // count for number in range(count)]

    def next_look(self, done: int, of: int) -> int:
        """How many of `of` strokes are painted when the painter looks next, `done` of them being painted now."""
        return next(end for end in itertools.accumulate(self.batches(of)) if end > done)

    def looks(self, done: int, of: int) -> int:
        """How often the arm goes aside for a picture right after stroke `done` of `of`."""
        return int(self.wants_timelapse_frame(done, of)) + int(self.next_look(done - 1, of) == done)

    def wants_timelapse_frame(self, done: int, of: int) -> bool:
        """Whether the film gets a picture after stroke `done` of `of`."""
        return done * self.timelapse_frames // of > (done - 1) * self.timelapse_frames // of
