"""Sheet of a stroke family, and page of a training or an evaluation: what was taught or painted beside the model's."""

import base64
import io
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from frida_painter.brush.kinds import StrokeModel
from frida_painter.brush.library import StrokeLibrary
from frida_painter.report.chart import Series, chart
from frida_painter.report.page import template
from frida_painter.strokes.family import CODE_REACH, StrokeFamily
from frida_painter.system import images
from frida_painter.system.sheet import INK, LINE, SOFT, Grid, Sheet
from frida_painter_calibration.teaching.evaluation import Learned
from frida_painter_calibration.teaching.marks import TaughtMark, align_marks

_WIDTH, _MARGIN = 1200, 40
_CELL = 120  # rows of a cell
_TAUGHT = 12
_STEPS = torch.linspace(-CODE_REACH, CODE_REACH, 5)
_WIDEST = 9  # pixels of a line at full pressure


def family_sheet(family: StrokeFamily, marks: Sequence[TaughtMark], model: StrokeModel | None = None) -> Tensor:
    """Returns the sheet of a family, sRGB [3, H, 1200] in [0, 1]: the taught marks, and the shapes of the code.

    marks: marks that it was learned from; only the first twelve are drawn
    model: stroke model, whose marks of the same shapes are drawn below; None if nothing was painted yet
    """
    grid = Grid.divide(_WIDTH - 2 * _MARGIN, _MARGIN, 110, 6, _CELL, across=12, down=12)
    blocks = [("Taught marks", [_draw_curve(curve, grid) for curve in align_marks(marks)[0][:_TAUGHT]])]
    painted: list[tuple[str, list[NDArray[np.uint8]]]] = []
    middle = sum(family.size) / 2
    for number in range(family.codes):
        code = torch.zeros(len(_STEPS), family.codes)
        code[:, number] = _STEPS
        place, pressure = family.trace(torch.linspace(0, 1, 193), torch.ones(len(code)), code)
        curves = torch.cat((place, pressure[..., None]), -1).double().numpy()
        blocks.append((f"Shape code {number + 1}", [_draw_curve(curve, grid) for curve in curves]))
        if model is not None:
            title = "" if painted else f"As the {model.brush} brush paints them, by its stroke model"
            with torch.no_grad():
                maps = model(torch.full((len(code),), 0.6), torch.full((len(code),), middle), code)
            painted.append((title, [_draw_map(one, grid) for one in maps]))
    blocks += painted
    heights = [34 + grid.rows(len(row)) * (grid.height + grid.down) for _, row in blocks]
    sheet, top = Sheet(_WIDTH, grid.top + sum(heights) + _MARGIN), grid.top
    sheet.text((_MARGIN, 26), f"Strokes of the family {family.name}", 34)
    least, most = (1000 * side for side in family.size)
    codes = "1 shape code" if family.codes == 1 else f"{family.codes} shape codes"
    sheet.text((_MARGIN, 70), f"{len(marks)} marks, {codes}, {least:.0f} to {most:.0f} mm", 20, SOFT)
    for (title, row), height in zip(blocks, heights, strict=True):
        sheet.text((_MARGIN, top), title, 20, SOFT)
        for (left, down), picture in zip(grid.corners(len(row)), row, strict=True):
            sheet.cell((left, down - grid.top + top + 30), picture, frame=LINE)
        top += height
    return sheet.tensor()


def _draw_curve(curve: NDArray[np.float64], grid: Grid) -> NDArray[np.uint8]:
    """Returns a cell with a curve [k, 3] whose width is its pressure."""
    picture = np.full((grid.height, grid.width, 3), 255, np.uint8)
    low, high = curve[:, :2].min(0), curve[:, :2].max(0)
    room = np.array([grid.width, grid.height]) - 2 * _WIDEST
    scale = min(0.95 * min(room[0], 1.6 * room[1]), *(room / np.maximum(high - low, 1e-6)))
    place = room / 2 + _WIDEST + scale * (curve[:, :2] - (low + high) / 2) * (1, -1)
    points = [(round(16 * x), round(16 * y)) for x, y in place.tolist()]
    for start, end, press in zip(points, points[1:], curve[:, 2], strict=False):
        cv2.line(picture, start, end, INK, max(1, round(_WIDEST * float(press))), cv2.LINE_AA, shift=4)
    return picture


def _draw_map(mark: Tensor, grid: Grid) -> NDArray[np.uint8]:
    """Returns a cell with a magnitude map [rows, columns]."""
    rows, columns = mark.shape
    scale = min(grid.width / columns, grid.height / rows)
    size = (max(1, round(rows * scale)), max(1, round(columns * scale)))
    near = torch.nn.functional.interpolate(mark[None, None], size, mode="bilinear", antialias=True)[0, 0]
    picture = np.full((grid.height, grid.width, 3), 255, np.uint8)
    top, left = (grid.height - size[0]) // 2, (grid.width - size[1]) // 2
    ink = torch.tensor(INK) / 255
    picture[top : top + size[0], left : left + size[1]] = images.to_uint8(1 - near * (1 - ink[:, None, None]))
    return picture


# The page of a training or an evaluation: unseen strokes beside the model's prediction, in one HTML file.

_MAX_SHOWN = 24
_BATCH = 32
_PICTURE_WIDTH = 300
_BINS = 12
_PAINT = torch.tensor([35.0, 33.0, 30.0]) / 255
_MISSED = torch.tensor([0.0, 114.0, 178.0]) / 255
_INVENTED = torch.tensor([230.0, 120.0, 20.0]) / 255


def training_page(learned: Learned, model: str, library: str, *, dirty: int) -> str:
    """Returns the page of a training as HTML without further files.

    model, library: names of both
    dirty: number of defective strokes that were left out of the training
    """
    report, held_out = learned.report, learned.library[learned.report.held_out]
    facts = [
        ("Stroke model", model),
        ("Brush", learned.model.brush),
        ("Strokes to learn from", str(len(learned.library) - len(held_out))),
        ("Strokes held out", str(len(held_out))),
        ("Dirty strokes left out", str(dirty)),
        ("Best epoch", f"{report.best_epoch} of {len(report.curve)}"),
    ]
    epochs = [float(step.epoch) for step in report.curve]
    curve = chart(
        "Error over epochs",
        "epoch",
        "mean absolute error of the magnitude (logarithmic)",
        [
            Series("held out", epochs, [max(1e-6, step.validation_error) for step in report.curve]),
            Series("learned from", epochs, [max(1e-6, step.training_error) for step in report.curve]),
        ],
        logarithmic=True,
    )
    return _page(learned.model, held_out, report.predicted, library, facts, report.validation_error, curve)


def evaluation_page(model: StrokeModel, name: str, strokes: StrokeLibrary, library: str) -> str:
    """Returns the page of an evaluation: any stroke model beside strokes that it has not seen.

    name: of the model
    library: name of the strokes' library
    """
    with torch.no_grad():
        parts = zip(*(torch.split(values, _BATCH) for values in strokes.shapes()), strict=True)
        drawn = torch.cat([model(*shapes) for shapes in parts])
    facts = [("Stroke model", name), ("Brush", model.brush), ("Strokes", str(len(strokes)))]
    error = float((drawn - strokes.maps(model.frame)).abs().mean())
    return _page(model, strokes, drawn, library, facts, error, None)


def _page(
    model: StrokeModel, strokes: StrokeLibrary, drawn: Tensor, library: str, facts: list[tuple[str, str]],
    mean_error: float, curve: Tensor | None,
) -> str:  # fmt: skip
    """Returns the HTML of a page.

    drawn: [n, rows, columns], the model's predictions of the strokes
    curve: picture of the learning curve; None without training
    """
    wanted = strokes.maps(model.frame)
    error = (drawn - wanted).abs().mean((1, 2)).double().numpy()
    counts, edges = np.histogram(error, bins=_BINS, range=(0.0, float(error.max()) * 1.0001 + 1e-9))
    (shortest, longest), (least, most) = model.limits.length, model.limits.bend
    limits = [
        ("Lengths", f"{1000 * shortest:.1f} to {1000 * longest:.1f} mm"),
        ("Bends", f"{1000 * least:.1f} to {1000 * most:.1f} mm"),
    ]
    return template("training.html").render(
        library=library,
        error=mean_error,
        least=float(error.min()),
        most=float(error.max()),
        bare=float(wanted.mean()),
        count=len(error),
        strokes=_compare(strokes, wanted, drawn, error),
        bars=[(int(count), float(count / counts.max())) for count in counts],
        edges=edges.tolist(),
        curve=None if curve is None else _data_uri(curve),
        facts=[*facts, *limits],
    )


def _compare(library: StrokeLibrary, wanted: Tensor, drawn: Tensor, error: NDArray[np.float64]) -> list[dict[str, Any]]:
    """Returns strokes from the best to the worst, an even selection if there are too many: pictures and words.

    In the difference, grey stands for paint in both, blue for paint of the brush only, orange for that of the model.
    """
    order = error.argsort(kind="stable")
    if len(order) > _MAX_SHOWN:
        order = order[np.linspace(0, len(order) - 1, _MAX_SHOWN).round().astype(int)]
    rows, columns = _crop(wanted, drawn)
    shown = []
    for place in order:
        real, modelled = wanted[place, rows, columns], drawn[place, rows, columns]
        both = torch.minimum(real, modelled)
        layers = ((0.45 * both, _PAINT), (real - both, _MISSED), (modelled - both, _INVENTED))
        difference = sum((amount * (1 - color[:, None, None]) for amount, color in layers), torch.zeros(3, 1, 1))
        shown.append({
            "real": _data_uri(1 - real * (1 - _PAINT[:, None, None])),
            "drawn": _data_uri(1 - modelled * (1 - _PAINT[:, None, None])),
            "difference": _data_uri(1 - difference),
            "shape": f"thickness {library.thickness[place]:.2f}, length {1000 * library.length_m[place]:.0f} mm, "
            f"bend {1000 * library.bend_m[place]:.0f} mm",
            "error": float(error[place]),
        })  # fmt: skip
    return shown


def _crop(wanted: Tensor, drawn: Tensor) -> tuple[slice, slice]:
    """Returns the part of the maps with paint, and a small margin."""
    inked = (torch.maximum(wanted, drawn) > 0.3).any(0)
    slices = []
    for axis in (1, 0):
        found = inked.any(axis).nonzero()[:, 0]
        first, last = (int(found[0]), int(found[-1])) if len(found) else (0, inked.shape[1 - axis] - 1)
        slices.append(slice(max(0, first - 2), last + 3))
    return slices[0], slices[1]


def _data_uri(picture: Tensor) -> str:
    """Returns a picture [3, h, w] in [0, 1] as a PNG data URI; small ones are enlarged."""
    file, drawn = io.BytesIO(), Image.fromarray(images.to_uint8(picture))
    if drawn.width < _PICTURE_WIDTH:
        size = _PICTURE_WIDTH, round(drawn.height * _PICTURE_WIDTH / drawn.width)
        drawn = drawn.resize(size, Image.Resampling.BICUBIC)
    drawn.quantize(128, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode('ascii')}"
