"""`marker`: a felt-tip whose marks are known without any photograph, as a function of a stroke's three numbers."""

import torch
from torch import Tensor

from frida_painter.plugins import BrushKind, BrushModel, StrokeFunction, StrokeLimits

# Strokes of 10 to 50 mm that bend by up to 12 mm; no mark is wider than 6 mm. In the virtual studio the fine
# brush paints for it.
KIND = BrushKind("marker", StrokeLimits((0.010, 0.050), (-0.012, 0.012)), width=0.006, studio="fine")
_SOFT = 0.0008  # metres over which an edge fades
_POINTS = 24


def marks(thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
    """thickness [n] in [0, 1], length [n] and bend [n] in metres -> magnitude [n, rows, columns] in [0, 1].

    Covered wherever the path is nearer than half the width of the tip, which is 1 to 2.5 mm.
    """
    cells = KIND.frame.cell_centers(dtype=length.dtype, device=length.device)  # [rows, columns, 2] metres
    along = torch.linspace(0, 1, _POINTS, dtype=length.dtype, device=length.device)
    path = torch.stack((length[:, None] * along, bend[:, None] * 3 * along * (1 - along)), -1)  # [n, points, 2]
    distance = torch.cdist(cells.flatten(0, 1)[None].expand(len(length), -1, -1), path).amin(-1)
    half = 0.001 + 0.0015 * thickness[:, None]
    return ((half - distance) / _SOFT + 0.5).clamp(0, 1).unflatten(1, cells.shape[:2])


MODEL = BrushModel(KIND, lambda: StrokeFunction(KIND, marks))
