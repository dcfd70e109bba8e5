"""Magnitude maps from one frame to another: as much paint per area, on other cells."""

import torch
from torch import Tensor

from frida_painter.frames import MapFrame


def resample(maps: Tensor, given: MapFrame, wanted: MapFrame) -> Tensor:
    """maps [n, rows, columns] on the cells of `given` -> on the cells of `wanted`; zero beyond the given ones.

    Along each axis: onto larger cells their mean over the area, onto smaller ones linear interpolation.
    """
    columns = _shares(given.left, given.pitch[0], given.columns, wanted.left, wanted.pitch[0], wanted.columns)
    rows = _shares(-given.top, given.pitch[1], given.rows, -wanted.top, wanted.pitch[1], wanted.rows)
    return rows.to(maps) @ maps @ columns.to(maps).T


def _shares(given_start: float, given_pitch: float, given_cells: int, start: float, pitch: float, cells: int) -> Tensor:
    """How much each given cell counts in each wanted one along one axis, [cells, given_cells]."""
    given_center = given_start + (torch.arange(given_cells, dtype=torch.float64) + 0.5) * given_pitch
    center = start + (torch.arange(cells, dtype=torch.float64) + 0.5) * pitch
    apart = (center[:, None] - given_center).abs()
    if pitch > given_pitch:
        overlap = (pitch + given_pitch) / 2 - apart
        return overlap.clamp(0, given_pitch) / pitch
    return (1 - apart / given_pitch).clamp(min=0)
