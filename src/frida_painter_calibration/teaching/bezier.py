"""Analytic stroke model: a ribbon with soft edges along the Bezier path, six numbers for each brush.

It is the comparison in the paper's Fig. "real versus simulated strokes" (drawn by DiffVG there). It also serves
as the stroke model of a brush without photographed strokes.
"""

from dataclasses import asdict, dataclass

import torch
from torch import Tensor, nn

from frida_painter.brush.kinds import END_THICKNESS, BrushKind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.frames import MapFrame
from frida_painter.strokes.strokes import StrokeLimits

_SEGMENTS = 24
_MM = 1000.0
_BATCH = 24
_RATE = 0.2
_RANGES = {"lightest": (0.0, 100.0), "hardest": (0.0, 100.0), "softness": (0.05, 50.0), "opacity": (0.0, 1.0)}


@dataclass(frozen=True)
class RibbonShape:
    """Shape of the ribbon. Lengths are in millimetres.

    lightest, hardest: half of its width at thickness 0 and 1
    softness: width of its edge
    ahead, aside: offset from the path, along and across the stroke
    opacity: magnitude inside, in [0, 1]
    """

    lightest: float
    hardest: float
    softness: float
    ahead: float = 0.0
    aside: float = 0.0
    opacity: float = 0.95

    @classmethod
    def typical(cls, width: float) -> "RibbonShape":
        """Returns a plausible ribbon for a brush.

        width: width of its widest mark in metres
        """
        half = width * _MM / 2
        return cls(lightest=0.2 * half, hardest=0.9 * half, softness=0.25 * half)


class BezierStroke(nn.Module):
    """Analytic stroke model, differentiable in the stroke and in the shape of its ribbon.

    The magnitude of a cell depends on its distance to the nearest point of the path, minus half the ribbon's
    width there. It falls from the opacity to exactly zero over the soft edge.
    """

    def __init__(self, brush: str, frame: MapFrame, limits: StrokeLimits, shape: RibbonShape) -> None:
        super().__init__()
        self.brush, self.frame, self.limits = brush, frame, limits
        self.shape = nn.ParameterDict({name: torch.tensor(value) for name, value in asdict(shape).items()})

    @classmethod
    def typical(cls, kind: BrushKind) -> "BezierStroke":
        """Returns the model of a brush without recorded strokes."""
        return cls(kind.name, kind.frame, kind.limits, RibbonShape.typical(kind.width))

    @property
    def ribbon(self) -> RibbonShape:
        """Shape of the ribbon as Python numbers."""
        return RibbonShape(**{name: float(value.detach()) for name, value in self.shape.items()})

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns magnitudes [n, rows, columns] for thickness [n] in [0, 1], length [n] and bend [n] in metres."""
        shape = self.shape
        cell = self.frame.cell_centers(dtype=length.dtype, device=length.device) * _MM  # [rows, columns, 2]
        cell_x, cell_y = cell[..., 0] - shape["ahead"], cell[..., 1] - shape["aside"]
        fraction = torch.linspace(0, 1, _SEGMENTS + 1, dtype=length.dtype, device=length.device)
        middle = 3 * fraction * (1 - fraction)
        path_x = _MM * length[:, None] * fraction  # [n, segments + 1]
        path_y = _MM * bend[:, None] * middle
        height = END_THICKNESS * (1 - middle) + thickness[:, None] * middle
        half_width = shape["lightest"] + height * (shape["hardest"] - shape["lightest"])
        x, y, wide = (part[..., None, None] for part in (path_x, path_y, half_width))  # [n, segments + 1, 1, 1]
        beyond = None
        for start in range(_SEGMENTS):
            run, rise, widening = (part[:, start + 1] - part[:, start] for part in (x, y, wide))
            from_x, from_y = cell_x - x[:, start], cell_y - y[:, start]
            nearest = ((from_x * run + from_y * rise) / (run * run + rise * rise + 1e-12)).clamp(0, 1)
            off_x, off_y = from_x - nearest * run, from_y - nearest * rise
            # The small constant keeps the gradient of the root finite on the path.
            away = torch.sqrt(off_x * off_x + off_y * off_y + 1e-9) - wide[:, start] - nearest * widening
            beyond = away if beyond is None else torch.minimum(beyond, away)
        assert beyond is not None
        edge = (0.5 - beyond / shape["softness"]).clamp(0, 1)
        return shape["opacity"] * edge * edge * (3 - 2 * edge)


def fit_bezier(model: BezierStroke, library: StrokeLibrary, *, seed: int = 0, steps: int = 150) -> float:
    """Fits the ribbon's six numbers to a library, in place, by Adam on the mean absolute error.

    Returns the error over the whole library on the model's frame.
    """
    thickness, length, bend = library.shapes()
    wanted = library.maps(model.frame)
    optimizer = torch.optim.Adam(model.parameters(), lr=_RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, max_lr=_RATE, total_steps=steps)
    chance = torch.Generator().manual_seed(seed)
    for _ in range(steps):
        some = torch.randperm(len(library), generator=chance)[:_BATCH]
        error = (model(thickness[some], length[some], bend[some]) - wanted[some]).abs().mean()
        optimizer.zero_grad()
        error.backward()
        optimizer.step()
        schedule.step()
        with torch.no_grad():
            for name, (least, most) in _RANGES.items():
                model.shape[name].clamp_(least, most)
    with torch.no_grad():
        parts = zip(*(torch.split(part, _BATCH) for part in (thickness, length, bend, wanted)), strict=True)
        return sum(float((model(*shape) - mark).abs().sum()) for *shape, mark in parts) / wanted.numel()
