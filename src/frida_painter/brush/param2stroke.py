"""The paper's stroke model: a small network from the shape of a stroke to the mark that it leaves."""

from pathlib import Path
from typing import Self

import torch
from torch import Tensor, nn

from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.model_file import ModelFile, write_model
from frida_painter.brush.squash import squash
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits

FORMAT = "frida-painter param2stroke"
VERSION = 1
HIDDEN = 96
CHANNELS = 12
_UPSCALE = 2
_SPREAD = 6.0
_BARE = 3.0


class Param2Stroke(nn.Module):
    """Two linear layers, two convolutions, a bilinear upscaler (paper, "Brush Stroke Model").

    The linear layers draw the mark as logits on cells twice as large as those of the map, the
    convolutions refine it, the upscaler brings it to the map's size, and the squash at the end
    turns it into magnitudes: squashed after the upscaling, edges may be sharper than the cells.

    limits: the lengths and bends that the inputs are normalised by; frame: the rectangle of the
    map, with even numbers of rows and columns.
    """

    def __init__(self, brush: str, frame: MapFrame, limits: StrokeLimits) -> None:
        super().__init__()
        if frame.rows % _UPSCALE or frame.columns % _UPSCALE:
            raise ValueError(f"a map of {frame.rows} x {frame.columns} cells cannot be upscaled by {_UPSCALE}")
        self.brush = brush
        self.frame = frame
        self.limits = limits
        self.coarse = (frame.rows // _UPSCALE, frame.columns // _UPSCALE)
        self.widen = nn.Linear(3, HIDDEN)
        self.draw = nn.Linear(HIDDEN, self.coarse[0] * self.coarse[1])
        self.refine = nn.Conv2d(1, CHANNELS, 3, padding=1)
        self.gather = nn.Conv2d(CHANNELS, 1, 3, padding=1)
        with torch.no_grad():
            # Larger first weights let a small network draw edges that move with its inputs; and it begins
            # with bare paper, because on the way there it might come to rest on bare paper for good.
            self.widen.weight.mul_(_SPREAD)
            self.widen.bias.mul_(_SPREAD)
            self.gather.bias = nn.Parameter(torch.tensor([-_BARE]))

    @classmethod
    def fresh(cls, kind: BrushKind, seed: int = 0) -> Self:
        """An untrained model for a brush, the same for the same seed."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return cls(kind.name, kind.frame, kind.limits)

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """thickness [n] in [0, 1], length [n] and bend [n] in metres -> magnitude [n, rows, columns] in [0, 1]."""
        return squash(self.logits(thickness, length, bend))

    def logits(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """The map before the squash, [n, rows, columns]."""
        shape = torch.stack((thickness, _normal(length, self.limits.length), _normal(bend, self.limits.bend)), -1)
        hidden = nn.functional.silu(self.widen(2 * shape - 1))  # [n, hidden]
        drawing = self.draw(hidden).unflatten(1, (1, *self.coarse))  # [n, 1, rows / 2, columns / 2]
        refined = self.gather(nn.functional.silu(self.refine(drawing)))
        return nn.functional.interpolate(refined, scale_factor=_UPSCALE, mode="bilinear", align_corners=False)[:, 0]

    def save(self, path: Path) -> str:
        """Writes the weights with all that belongs to them; returns the file's sha256. Raises StorageError."""
        return write_model(path, FORMAT, VERSION, self, self.state_dict())

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads weights that `save` wrote. Raises WeightsError where they are missing, damaged or do not fit."""
        return cls.restored(ModelFile.read(path))

    @classmethod
    def restored(cls, file: ModelFile) -> Self:
        """The model in a file of weights. Raises WeightsError where it is of another kind or does not fit."""
        file.require(FORMAT, VERSION)
        try:
            model = cls(file.brush, file.frame, file.limits)
        except ValueError as cause:
            raise file.misfit(cause) from cause
        file.fill(model)
        return model


def _normal(value: Tensor, bounds: tuple[float, float]) -> Tensor:
    """The value as a share of the way from the lower to the upper bound."""
    return (value - bounds[0]) / (bounds[1] - bounds[0])
