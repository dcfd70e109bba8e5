"""Small brushes, stroke models and libraries for tests."""

import numpy as np
import torch

from frida_painter.brush.kinds import BrushKind, StrokeModel
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.table import StrokeTable, TableDetail, cached_table
from frida_painter.frames import MapFrame
from frida_painter.strokes.family import StrokeFamily, spline_matrix
from frida_painter.strokes.strokes import StrokeLimits
from frida_painter_calibration.teaching.bezier import BezierStroke, RibbonShape
from made_once import made_by_this_code

SMALL = BrushKind("small", StrokeLimits((0.010, 0.030), (-0.008, 0.008)), 0.008)


def small_frame(rows: int = 24, columns: int = 42) -> MapFrame:
    """Cells of 1 mm, as they come."""
    return MapFrame(-0.006, 0.036, -0.012, 0.012, rows, columns)


def ribbon(rows: int = 24, columns: int = 42) -> BezierStroke:
    return BezierStroke("small", small_frame(rows, columns), SMALL.limits, RibbonShape(1.0, 4.0, 1.5)).requires_grad_(
        False
    )


def coarse_table(model: StrokeModel) -> StrokeTable:
    """In the place of a painter's own table: it is quickly made, once for each model, and quickly looked up in."""
    detail = TableDetail((2, 2, 2), 8)
    if not isinstance(model, torch.nn.Module):
        return StrokeTable.of(model, detail=detail)
    return cached_table(model, detail, made_by_this_code() / "tables")


def shapes(count: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> tuple[torch.Tensor, ...]:
    chance = torch.Generator().manual_seed(seed)
    thickness, along, aside = torch.rand(3, count, generator=chance, dtype=torch.float64).to(dtype)
    return thickness, 0.010 + 0.020 * along, -0.008 + 0.016 * aside


def small_library(count: int = 12, seed: int = 0) -> StrokeLibrary:
    """Photographs of the ribbon on a finer frame, as a camera would have taken them."""
    thickness, length, bend = shapes(count, seed)
    finer = small_frame(72, 126)
    painted = BezierStroke("small", finer, SMALL.limits, RibbonShape(1.0, 4.0, 1.5))
    with torch.no_grad():
        magnitude = painted(thickness, length, bend)
    pitch = finer.pitch[0]
    return StrokeLibrary(
        magnitude=(255 * magnitude).round().numpy().astype(np.uint8),
        length_m=length.numpy(),
        bend_m=bend.numpy(),
        thickness=thickness.numpy(),
        metres_per_pixel=pitch,
        origin_px=(finer.top / pitch - 0.5, -finer.left / pitch - 0.5),
        recorded_index=np.arange(count, dtype=np.int32),
    )


def wave_family(name: str = "wave") -> StrokeFamily:
    """A family that is quickly made: a wave of 20 to 50 mm, with one code for its height."""
    u = torch.linspace(-0.06, 1.06, 20)
    mean = torch.stack((u, 0.15 * torch.sin(6 * u), 0.3 + 0.6 * torch.sin(3 * u).clamp(0, 1)), -1)
    modes = torch.stack((0 * u, 0.04 * torch.sin(6 * u), 0 * u), -1)[None]
    start = spline_matrix(torch.zeros(1), 20)
    mean[:, :2] -= (start @ mean)[:, :2]
    modes[..., :2] -= (start @ modes)[..., :2]
    return StrokeFamily(name, mean, modes, (0.020, 0.050))
