"""The size of a canvas, as people give it and as plans keep it; loaded without any tensor."""

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from frida_painter.errors import ConfigError

if TYPE_CHECKING:
    from torch import Tensor

SMALLEST_CANVAS = 0.03
LARGEST_CANVAS = 3.0
_METRES = {"mm": 0.001, "cm": 0.01, "in": 0.0254, "m": 1.0}


@dataclass(frozen=True)
class CanvasSize:
    """Width and height of the canvas in metres, each from 0.03 to 3. Raises ConfigError."""

    width: float
    height: float

    def __post_init__(self) -> None:
        for name, metres in (("wide", self.width), ("high", self.height)):
            if not SMALLEST_CANVAS <= metres <= LARGEST_CANVAS:
                raise ConfigError(
                    f"A canvas {metres * 1000:g} mm {name} was given; each side is from "
                    f"{SMALLEST_CANVAS * 1000:g} to {LARGEST_CANVAS * 1000:g} mm, for example 14x11in or 297x210mm."
                )

    @classmethod
    def parse(cls, text: str) -> Self:
        """Reads "14x11in", "297 x 210 mm" or "40x30cm": width, then height. Raises ConfigError."""
        number = r"(\d+(?:\.\d+)?|\.\d+)"
        match = re.fullmatch(rf"\s*{number}\s*[x×]\s*{number}\s*(mm|cm|in|m)\s*", text.lower())
        if match is None:
            raise ConfigError(
                f"Canvas {text[:40]!r} is not understood; give width x height with a unit, "
                "for example 14x11in, 297x210mm or 40x30cm."
            )
        scale = _METRES[match[3]]
        return cls(float(match[1]) * scale, float(match[2]) * scale)

    @classmethod
    def of(cls, size: "CanvasSize | str") -> "CanvasSize":
        """The size itself, or what a text like "14x11in" says. Raises ConfigError."""
        return cls.parse(size) if isinstance(size, str) else size

    def turned_like(self, rows: int, columns: int) -> "CanvasSize":
        """The same canvas, put upright or on its side so that it suits a picture of that shape."""
        if (columns > rows) != (self.width > self.height):
            return CanvasSize(self.height, self.width)
        return self

    def shaped_like(self, rows: int, columns: int) -> "CanvasSize":
        """The largest canvas within this one, in the proportions of a picture of that shape.

        Raises ConfigError where its shorter side would be too short for a canvas.
        """
        scale = min(self.width / columns, self.height / rows)
        return CanvasSize(columns * scale, rows * scale)

    def on_page(self, position: "Tensor") -> "Tensor":
        """Canvas metres [..., 2] counted as pages are: from the top-left corner, x right, y down."""
        import torch

        return torch.stack((position[..., 0], self.height - position[..., 1]), -1)

    def __str__(self) -> str:
        return f"{self.width * 1000:.0f} x {self.height * 1000:.0f} mm"
