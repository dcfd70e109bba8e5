"""Where a thing stands: two bands of colour, above and below a horizon, chosen by words."""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.sentence import SentenceEncoder

Color = tuple[float, float, float]
_PAPER: Color = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Ground:
    """Its name, words of what is found there, sRGB above and below, and the share of the height above."""

    name: str
    words: str
    above: Color
    below: Color
    horizon: float

    @classmethod
    def paper(cls) -> Self:
        """Bare paper."""
        return cls("bare paper", "", _PAPER, _PAPER, 0.5)

    def picture(self, grid: PixelGrid) -> Tensor:
        """The bands, [3, H, W]; they pass into each other over a twentieth of the height."""
        height = (torch.arange(grid.rows) + 0.5) / grid.rows
        share = ((height - self.horizon) / 0.05 + 0.5).clamp(0, 1)[None, :, None]
        above, below = (torch.tensor(color)[:, None, None] for color in (self.above, self.below))
        return ((1 - share) * above + share * below).expand(3, grid.rows, grid.columns).contiguous()


_GROUNDS = (
    Ground("the sea", "sea, coast, ship, boat, fish, swimming", (0.80, 0.90, 0.97), (0.28, 0.52, 0.72), 0.70),
    Ground("a meadow", "grass, garden, animal, flower, insect", (0.86, 0.93, 0.97), (0.50, 0.68, 0.36), 0.72),
    Ground("a table", "food, fruit, kitchen, cup, dish", _PAPER, (0.78, 0.62, 0.44), 0.70),
    Ground("the sky", "sky, flying, bird, balloon, aircraft, kite", (0.68, 0.83, 0.95), (0.86, 0.93, 0.98), 0.80),
    Ground("hills", "mountain, castle, tower, building, landscape", (0.78, 0.88, 0.96), (0.55, 0.66, 0.42), 0.78),
    Ground("a road", "street, car, bus, train, traffic, city", (0.86, 0.91, 0.95), (0.58, 0.57, 0.56), 0.72),
    Ground("a room", "music, instrument, furniture, clothes, tool", (0.95, 0.92, 0.86), (0.66, 0.50, 0.38), 0.78),
    Ground("the night", "night, moon, stars, dark, ghost", (0.12, 0.15, 0.30), (0.18, 0.22, 0.34), 0.75),
)  # fmt: skip
_LEAST_LIKENESS = 0.2


def ground_of(prompt: str, sentences: SentenceEncoder) -> Ground:
    """The ground whose words are most like the prompt, or bare paper where none is like it."""
    meanings = sentences.embed([prompt, *(ground.words for ground in _GROUNDS)])
    likeness = meanings[1:] @ meanings[0]
    best = int(likeness.argmax())
    if not float(likeness[best]) >= _LEAST_LIKENESS:
        return Ground.paper()
    return _GROUNDS[best]
