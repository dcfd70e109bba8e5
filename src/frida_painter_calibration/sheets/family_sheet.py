"""Sheet of a stroke family: the marks that a person taught, the shapes of the code, and the predicted marks."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import StrokeModel
from frida_painter.sheet import INK, LINE, PAPER, SOFT, Grid, Sheet
from frida_painter.stroke_family import CODE_REACH, StrokeFamily
from frida_painter_calibration.teaching.marks import TaughtMark, align_marks

_WIDTH, _MARGIN = 1200, 40
_CELL = (180, 120)
_SHOWN = 12
_STEPS = (-CODE_REACH, -CODE_REACH / 2, 0.0, CODE_REACH / 2, CODE_REACH)
_WIDEST = 9  # pixels of a line at full pressure


def family_sheet(family: StrokeFamily, marks: Sequence[TaughtMark], model: StrokeModel | None = None) -> Tensor:
    """Returns the sheet of a family, sRGB [3, H, 1200] in [0, 1].

    marks: marks that it was learned from; only the first twelve are drawn
    model: stroke model, whose marks of the same shapes are drawn below; None if nothing was painted yet
    """
    shapes = _shapes(family)
    taught = [_scale(curve, 1.0) for curve in align_marks(marks)[0][:_SHOWN]]
    rows = [("Taught marks", taught)]
    rows += [(f"Shape code {number + 1}", row) for number, row in enumerate(shapes)]
    grid = Grid.divide(_WIDTH - 2 * _MARGIN, _MARGIN, 110, 6, _CELL[1], across=12, down=12)
    height, tops = grid.top, []
    for _, row in rows:
        tops.append(height)
        height += 34 + grid.rows(len(row)) * (grid.height + grid.down)
    drawn = [] if model is None else _predicted(family, model)
    sheet = Sheet(_WIDTH, height + (34 + len(drawn) * (grid.height + grid.down) if drawn else 0) + _MARGIN)
    sheet.text((_MARGIN, 26), f"Strokes of the family {family.name}", 34, INK)
    least, most = (1000 * side for side in family.size)
    about = (
        f"{len(marks)} marks, {family.codes} shape code{'s' if family.codes > 1 else ''}, {least:.0f} to {most:.0f} mm"
    )
    sheet.text((_MARGIN, 70), about, 20, SOFT)
    for (title, row), top in zip(rows, tops, strict=True):
        sheet.text((_MARGIN, top), title, 20, SOFT)
        for number, curve in enumerate(row):
            left, down = grid.corner(number)
            _draw(sheet, curve, (left, down - grid.top + top + 30), (grid.width, grid.height))
    if drawn:
        assert model is not None
        sheet.text((_MARGIN, height), f"As the {model.brush} brush paints them, by its stroke model", 20, SOFT)
        for line, maps in enumerate(drawn):
            for number, one in enumerate(maps):
                left = grid.corner(number)[0]
                _paste(sheet, one, (left, height + 30 + line * (grid.height + grid.down)), (grid.width, grid.height))
    return sheet.tensor()


def _codes(family: StrokeFamily) -> list[Tensor]:
    """Returns five codes along each mode."""
    found = []
    for number in range(family.codes):
        code = torch.zeros(len(_STEPS), family.codes)
        code[:, number] = torch.tensor(_STEPS)
        found.append(code)
    return found


def _shapes(family: StrokeFamily) -> list[list[NDArray[np.float64]]]:
    fraction = torch.linspace(0, 1, 193)
    rows = []
    for code in _codes(family):
        place, pressure = family.trace(fraction, torch.ones(len(code)), code)
        curves = torch.cat((place, pressure[..., None]), -1).double().numpy()
        rows.append([_scale(curve, 1.0) for curve in curves])
    return rows


@torch.no_grad()
def _predicted(family: StrokeFamily, model: StrokeModel) -> list[Tensor]:
    middle = sum(family.size) / 2
    return [model(torch.full((len(code),), 0.6), torch.full((len(code),), middle), code) for code in _codes(family)]


def _scale(curve: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Returns a curve [k, 3] of that size about its centre."""
    low, high = curve[:, :2].min(0), curve[:, :2].max(0)
    return np.c_[(curve[:, :2] - (low + high) / 2) * size, curve[:, 2]]


def _draw(sheet: Sheet, curve: NDArray[np.float64], at: tuple[int, int], room: tuple[int, int]) -> None:
    """Draws a curve whose width is its pressure into a cell."""
    sheet.draw.rectangle((*at, at[0] + room[0], at[1] + room[1]), outline=LINE)
    scale = min((room[0] - 2 * _WIDEST), 1.6 * (room[1] - 2 * _WIDEST)) * 0.95
    extent = np.ptp(curve[:, :2], axis=0).max() or 1.0
    scale = min(scale, (room[1] - 2 * _WIDEST) / max(np.ptp(curve[:, 1]), 1e-6), (room[0] - 2 * _WIDEST) / extent)
    x = at[0] + room[0] / 2 + scale * curve[:, 0]
    y = at[1] + room[1] / 2 - scale * curve[:, 1]
    for start in range(len(curve) - 1):
        wide = max(1, round(_WIDEST * float(curve[start, 2])))
        half = wide / 2
        sheet.draw.line((x[start], y[start], x[start + 1], y[start + 1]), fill=INK, width=wide)
        sheet.draw.ellipse((x[start] - half, y[start] - half, x[start] + half, y[start] + half), fill=INK)


def _paste(sheet: Sheet, mark: Tensor, at: tuple[int, int], room: tuple[int, int]) -> None:
    """Draws a magnitude map [rows, columns] into a cell."""
    rows, columns = mark.shape
    scale = min(room[0] / columns, room[1] / rows)
    size = (max(1, round(rows * scale)), max(1, round(columns * scale)))
    near = torch.nn.functional.interpolate(mark[None, None], size, mode="bilinear", antialias=True)[0, 0, ..., None]
    picture = (1 - near) * torch.tensor(PAPER) + near * torch.tensor(INK)
    sheet.draw.rectangle((*at, at[0] + room[0], at[1] + room[1]), outline=LINE)
    left, top = at[0] + (room[0] - size[1]) // 2, at[1] + (room[1] - size[0]) // 2
    sheet.paste(picture.round().to(torch.uint8).numpy(), (left, top))
