"""Where a thing stands: bands of colour above and below a horizon, chosen by words.

Above it is mostly bare paper: strokes that a sky would take are better spent on the thing.
"""

from collections.abc import Sequence
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
    """Its name, words of what is found there, sRGB above and below, and the share of the height above.

    least: how like those words what is said must be; a ground that leaves no paper bare must be asked for.
    """

    name: str
    words: str
    above: Color
    below: Color
    horizon: float
    least: float = 0.2

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
    Ground("the sea", "sea, coast, beach, lighthouse, ship, boat, fish, swimming", _PAPER, (0.28, 0.52, 0.72), 0.72),
    Ground("a meadow", "grass, field, garden, animal, flower, insect", _PAPER, (0.50, 0.68, 0.36), 0.74),
    Ground("a table", "food, fruit, kitchen, cup, dish", _PAPER, (0.78, 0.62, 0.44), 0.70),
    Ground("the sky", "sky, flying, bird, balloon, aircraft, kite", _PAPER, (0.70, 0.84, 0.95), 0.72),
    Ground("hills", "mountain, castle, tower, building, landscape", _PAPER, (0.55, 0.66, 0.42), 0.80),
    Ground("a road", "street, car, bus, train, traffic, city", _PAPER, (0.58, 0.57, 0.56), 0.76),
    Ground("a room", "music, instrument, furniture, clothes, tool", _PAPER, (0.66, 0.50, 0.38), 0.80),
    Ground("the night", "night, moon, stars, dark", (0.12, 0.15, 0.30), (0.18, 0.22, 0.34), 0.75, 0.35),
    Ground("a sunset", "sunset, sunrise, dawn, dusk, evening", (0.98, 0.78, 0.52), (0.60, 0.40, 0.42), 0.72, 0.4),
)  # fmt: skip


def ground_of(said: Sequence[str], sentences: SentenceEncoder) -> Ground:
    """The ground whose words are most like all that is said of a thing, or bare paper where none is like it."""
    meanings = sentences.embed([*said, *(ground.words for ground in _GROUNDS)])
    similarity = (meanings[len(said) :] @ meanings[: len(said)].T).mean(1)
    enough = similarity >= torch.tensor([ground.least for ground in _GROUNDS])
    if not bool(enough.any()):
        return Ground.paper()
    return _GROUNDS[int(similarity.masked_fill(~enough, -1).argmax())]
