"""Sheets to print or view: figures, doubtful strokes, surprises, palette, mixing recipes and workspace."""

import math
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import StorageError
from frida_painter.hardware.motion import STIR_RADIUS
from frida_painter.hardware.robot import BrushRack, Point, Workspace
from frida_painter.mixing.paint import Paint, usual_paints
from frida_painter.mixing.recipe import GOOD, REACHED, PaintSet
from frida_painter.mixing.shopping import DROP, MIN_MIXED, RESERVE, BrushPaints, Mixture, paints_by_brush, supplies
from frida_painter.report.story import PaintFacts, paints
from frida_painter.strokes.palette import Palette, to_hex, to_lab
from frida_painter.strokes.plan import Plan
from frida_painter.system import images, storage
from frida_painter.system.sheet import (
    A4,
    CREAM,
    INK,
    LINE,
    PAPER,
    SOFT,
    WARNING,
    Grid,
    Sheet,
    font,
    scale,
    shorten,
    to_bytes,
)
from frida_painter.system.storage import count_of

# Figures: pictures side by side on one sheet, with headings, labels and captions.

_MARGIN, _GAP = 28, 10
_TITLE, _TEXT, _SMALL = 26, 16, 15


@dataclass(frozen=True)
class Cell:
    """Picture [3, h, w] in [0, 1] with a caption below."""

    picture: Tensor
    caption: str = ""


@dataclass(frozen=True)
class FigureRow:
    """Row of a figure.

    label: at the left of the row
    cells: pictures; None for an empty place
    """

    label: str
    cells: Sequence[Cell | None]


def page(
    title: str, headings: Sequence[str], lines: Sequence[FigureRow], *, width: int = 200, framed: bool = True
) -> Tensor:
    """Returns a sheet [3, H, W] with rows of pictures.

    headings: one above each column, or none
    lines: the rows
    width: of every picture, pixels
    framed: True for a thin line around every picture, for pictures on white
    """
    left = _MARGIN + max(round(font(_TEXT).getlength(part)) for line in lines for part in line.label.split("\n")) + _GAP
    if left == _MARGIN + _GAP:
        left = _MARGIN
    top = _MARGIN + (_TITLE + 18 if title else 0) + (_TEXT + 12 if headings else 0)
    heights = [_height(line, width) for line in lines]
    grid = Grid(left, top, max(len(line.cells) for line in lines), width, 0, across=_GAP)
    sheet = Sheet(grid.right + _MARGIN, top + sum(heights) + _MARGIN - _GAP)
    sheet.text((_MARGIN, _MARGIN - 4), title, _TITLE, INK)
    for heading, (x, y) in zip(headings, grid.corners(len(headings)), strict=True):
        sheet.text((x + width / 2, y - 10), heading, _TEXT, INK, "ms")
    for line, height in zip(lines, heights, strict=True):
        _draw_line(sheet, line, grid, LINE if framed else None)
        grid = replace(grid, top=grid.top + height)
    return sheet.tensor()


def _draw_line(sheet: Sheet, line: FigureRow, row: Grid, frame: tuple[int, ...] | None) -> None:
    tall = max((_rows(cell, row.width) for cell in line.cells if cell), default=0)
    middle = (_MARGIN, row.top + tall / 2)
    sheet.draw.multiline_text(middle, line.label, fill=INK, font=font(_TEXT), anchor="lm", spacing=5)
    for cell, at in zip(line.cells, row.corners(len(line.cells)), strict=True):
        if cell is not None:
            picture = scale(cell.picture, row.width, _rows(cell, row.width))
            sheet.cell(at, picture, cell.caption, size=_SMALL, frame=frame)


def _rows(cell: Cell, width: int) -> int:
    _, height, columns = cell.picture.shape
    return round(height * width / columns)


def _height(line: FigureRow, width: int) -> int:
    captioned = any(cell and cell.caption for cell in line.cells)
    return max((_rows(cell, width) for cell in line.cells if cell), default=0) + _GAP + (_SMALL + 8 if captioned else 0)


# A card to show and to give away: a photograph and its painting in a frame.

_CARD_PICTURE, _MOUNT, _FRAME = 1300, 110, 30  # pixels: longer side of each picture, and widths around
_WOOD, _BEVEL, _SHADE = (58, 47, 39), (255, 254, 251), (196, 189, 177)


def card(pictures: Sequence[NDArray[np.uint8]], title: str, facts: str) -> Tensor:
    """Returns pictures of one shape [h, w, 3] in a frame with a mount, sRGB [3, rows, columns] in [0, 1].

    Upright ones stand side by side, others below each other; title and facts are below them.
    """
    rows, columns, _ = pictures[-1].shape
    share = _CARD_PICTURE / max(rows, columns)
    width, height = max(1, round(columns * share)), max(1, round(rows * share))
    across = len(pictures) if rows > columns else 1
    edge = _MOUNT + _FRAME
    grid = Grid(edge, edge, across, width, height, across=_MOUNT // 2, down=_MOUNT // 2)
    foot = grid.bottom(len(pictures)) + 64
    sheet = Sheet(max(grid.right, _CARD_PICTURE + edge) + edge, foot + 64 + 34 + edge, CREAM)
    middle = sheet.image.width / 2
    grid = replace(grid, left=round(middle - (grid.right - grid.left) / 2))
    sheet.draw.rectangle((0, 0, sheet.image.width - 1, sheet.image.height - 1), outline=_WOOD, width=_FRAME)
    for picture, (x, y) in zip(pictures, grid.corners(len(pictures)), strict=True):
        sheet.draw.rectangle((x - 5, y - 5, x + width + 4, y + height + 4), fill=_BEVEL)
        sheet.draw.line((x - 5, y + height + 4, x - 5, y - 5, x + width + 4, y - 5), fill=_SHADE, width=3)
        small = Image.fromarray(picture).resize((width, height), Image.Resampling.LANCZOS, reducing_gap=3.0)
        sheet.paste(small, (x, y))
    sheet.text((middle, foot), shorten(title, 46, 2 * middle - 2 * edge), 46, INK, "ma")
    sheet.text((middle, foot + 68), facts, 25, SOFT, "ma")
    return sheet.tensor()


# A picture for a decision about one stroke: is it on the canvas, or did the painting stop before it?

_RED = (200, 30, 40)
_ROWS = 720  # of the whole canvas in the picture
_POINTS = 25
_AROUND = 0.35  # margin around the stroke on every side, as a share of its extent
_DOUBT_GAP, _HEAD = 24, 44


def doubt(plan: Plan, stroke: int, photograph: Tensor, painted: Tensor) -> Tensor:
    """Returns the canvas with a frame around a stroke, and the enlarged frame: as seen, and as if painted.

    stroke: its index in the plan
    photograph: [3, H, W], the canvas now
    painted: [3, h, w], simulated canvas with that stroke

    Returns sRGB [3, rows, columns].
    """
    columns = round(_ROWS * plan.canvas.width / plan.canvas.height)
    canvas, with_stroke = (scale(picture, columns, _ROWS) for picture in (photograph, painted))
    path = plan.strokes[[stroke]].path(torch.linspace(0, 1, _POINTS))[0]  # [t, 2] metres
    pixels = plan.canvas.on_page(path) * torch.tensor([columns / plan.canvas.width, _ROWS / plan.canvas.height])
    box = _around(pixels, columns)
    side = (_ROWS - _HEAD) // 2
    sheet = Sheet(columns + side + 3 * _DOUBT_GAP, _ROWS + 2 * _DOUBT_GAP + _HEAD)
    sheet.paste(canvas, (_DOUBT_GAP, _DOUBT_GAP + _HEAD))
    sheet.draw.rectangle(
        [edge + _DOUBT_GAP + (_HEAD if place % 2 else 0) for place, edge in enumerate(box)], outline=_RED, width=3
    )
    _heading(sheet, f"The canvas now; in the frame the place of stroke {stroke + 1}", _DOUBT_GAP, _DOUBT_GAP)
    near = Grid(columns + 2 * _DOUBT_GAP, _DOUBT_GAP + _HEAD, 1, side, side, down=_HEAD)
    shown = (("As it is seen", canvas), (f"With stroke {stroke + 1}", with_stroke))
    for (words, picture), (left, top) in zip(shown, near.corners(2), strict=True):
        _heading(sheet, words, left, top - _HEAD)
        sheet.paste(picture.crop(box).resize((side, side), Image.Resampling.LANCZOS), (left, top))
        sheet.draw.rectangle((left, top, left + side, top + side), outline=_RED, width=3)
    return sheet.tensor()


def _around(path: Tensor, columns: int) -> tuple[int, int, int, int]:
    """Returns a square around the path (pixels [t, 2]), inside the picture."""
    low, high = path.amin(0), path.amax(0)
    side = min(_ROWS, columns, max(60, round(float((high - low).max()) * (1 + 2 * _AROUND)) + 40))
    middle = (low + high) / 2
    left = min(max(0, round(float(middle[0]) - side / 2)), columns - side)
    top = min(max(0, round(float(middle[1]) - side / 2)), _ROWS - side)
    return left, top, left + side, top + side


def _heading(sheet: Sheet, words: str, left: int, top: int) -> None:
    sheet.text((left, top + _HEAD / 2), words, 20, SOFT, "lm")


# A picture of a surprise: the differences between the seen and the expected canvas.

CLEARLY = 50.0
"""Lab distance that gets the strongest colour."""
_UNSEEN = 3.0
# White, yellow, orange, red, wine: evenly darker, so that the order is visible without colour vision.
_HEAT = ((1.0, 1.0, 1.0), (1.0, 0.835, 0.467), (0.961, 0.502, 0.243), (0.765, 0.122, 0.184), (0.345, 0.047, 0.180))


def difference(expected: Tensor, seen: Tensor) -> Tensor:
    """Returns the Lab distances of two pictures sRGB [3, H, W] as a heat map [3, H, W] over the pale seen picture.

    White-grey means as expected (no visible difference), then yellow, orange, red, and wine for a distance of 50
    and more. Grain finer than a hundredth of the picture is smoothed away.
    """
    first, second = (_smooth(picture) for picture in (expected, seen))
    apart = (to_lab(first) - to_lab(second)).norm(dim=-1)  # [H, W]
    strength = ((apart - _UNSEEN) / (CLEARLY - _UNSEEN)).clamp(0, 1) * (len(_HEAT) - 1)
    heat = torch.tensor(_HEAT).to(seen)
    below = strength.floor().clamp(max=len(_HEAT) - 2).long()
    share = (strength - below)[..., None]
    color = heat[below] * (1 - share) + heat[below + 1] * share  # [H, W, 3]
    light = to_lab(seen.permute(1, 2, 0))[..., :1] / 100  # [H, W, 1]
    return (color * (0.8 + 0.2 * light)).permute(2, 0, 1).clamp(0, 1)


def _smooth(picture: Tensor) -> Tensor:
    """Returns the picture as [H, W, 3] without its finest grain."""
    pixels = np.ascontiguousarray(picture.detach().permute(1, 2, 0).cpu().numpy(), dtype=np.float32)
    smooth = cv2.GaussianBlur(pixels, (0, 0), max(0.5, max(pixels.shape) / 400))
    return torch.from_numpy(np.clip(smooth, 0, 1)).to(picture)


# A picture of a plan that highlights the strokes that cannot be painted.

_FADED = 0.62  # of the way to white


def offending_strokes(plan: Plan, picture: Tensor, offending: Collection[int]) -> Tensor:
    """Returns the faded picture [3, H, W] of a plan with the paths of some strokes in red: [3, H + h, W].

    offending: indices of the strokes

    Each of these strokes has a dot at its start and its number, counted from 1 as in messages. Their count stands
    below.
    """
    rows, columns = picture.shape[1:]
    unit = max(rows, columns) / 1000
    foot = round(64 * unit)
    sheet = Sheet(columns, rows + foot)
    faded = picture.detach() + _FADED * (1 - picture.detach())
    sheet.paste(images.to_uint8(faded))
    chosen = sorted(offending)
    path = plan.strokes[chosen].path(torch.linspace(0, 1, _POINTS))  # [n, t, 2] metres
    scale = torch.tensor([columns / plan.canvas.width, rows / plan.canvas.height])
    pixels = plan.canvas.on_page(path) * scale
    for points in pixels.tolist():
        sheet.draw.line([tuple(point) for point in points], fill=_RED, width=max(2, round(4 * unit)), joint="curve")
        x, y = points[0]
        dot = 6 * unit
        sheet.draw.ellipse((x - dot, y - dot, x + dot, y + dot), fill=_RED)
    _tags(sheet, dict(zip(chosen, pixels.tolist(), strict=True)), round(22 * unit), (columns, rows))
    count = f"{len(chosen)} of {len(plan)} strokes cannot be painted here"
    sheet.text((16 * unit, rows + foot / 2), count, 26 * unit, SOFT, "lm")
    return sheet.tensor()


def _tags(sheet: Sheet, paths: dict[int, list[list[float]]], size: int, within: tuple[int, int]) -> None:
    """Draws numbers in white on red beside their strokes and inside the picture, as many as find a free place."""
    pad = size * 0.3
    taken = np.zeros((within[1], within[0]), np.bool_)
    for index, points in paths.items():
        left, top, right, bottom = sheet.draw.textbbox((0, 0), str(index + 1), font=font(size))
        width, height = right - left, bottom - top
        for x, y in (points[0], points[-1], points[_POINTS // 2]):
            x = min(max(x + size * 0.5, pad), within[0] - width - pad)
            y = min(max(y - size * 1.4, pad), within[1] - height - pad)
            box = (x - pad, y - pad, x + width + pad, y + height + pad)
            place = taken[int(box[1]) : int(box[3]) + 1, int(box[0]) : int(box[2]) + 1]
            if not place.any():
                place[:] = True
                sheet.draw.rounded_rectangle(box, radius=pad, fill=_RED)
                sheet.text((x - left, y - top), str(index + 1), size, PAPER)
                break


# Printed pages for the place where a person mixes: recipes for every paint, and the palette.

_PAGE_MARGIN = 96
_PAGE_ROOM = A4[0] - 2 * _PAGE_MARGIN


def _begin_page(title: str, facts: str, rows: int = A4[1], columns: int = A4[0]) -> Sheet:
    """Returns a page, by default in A4, with its title and a line of facts."""
    sheet = Sheet(columns, rows)
    sheet.text((_PAGE_MARGIN, 84), shorten(title, 58, _PAGE_ROOM), 58, INK)
    sheet.text((_PAGE_MARGIN, 162), facts, 24, SOFT)
    return sheet


_MIXING_SHEET_HEAD = 216
_TALLEST, _LOWEST, _BRUSH_ROW, _BRUSH_GAP = 84, 52, 96, 20
_SWATCH, _WELL_ROOM, _TOTAL = (
    60,
    214,
    128,
)  # columns of each of two swatches, of the well, and of the amount of a mixture
_MIN_TUBE = 62  # columns of a tube paint
_MIXING_ADVICE = (
    "Left swatch: the colour that is wanted; right: the dry mixture, as predicted. Below the amount: their difference",
    f"(CIEDE2000: hardly seen up to {GOOD:g}, out of reach above {REACHED:g}), without light and dark out of reach.",
    "Large numbers are parts by volume. Mix a little, let it dry, compare, correct: tubes differ. A drop is 0.05 ml.",
)


def mixing_sheet(paints: Sequence[BrushPaints], title: str) -> Tensor:
    """Returns the recipes as one printed table, sRGB [3, H, W] in [0, 1]: brush by brush, a column for each tube."""
    tubes = [supply.paint for supply in supplies(paints)]
    rows, wide = sum(len(brush.mixtures) for brush in paints), max(_MIN_TUBE, _TUBES_ROOM // len(tubes))
    foot, heads = 130, len(paints) * (_BRUSH_ROW + _BRUSH_GAP)
    height = min(_TALLEST, max(_LOWEST, (A4[1] - _MIXING_SHEET_HEAD - foot - heads) // rows))
    missed = sum(not each.recipe.within_reach for brush in paints for each in brush.mixtures)
    facts = f"{count_of(rows, 'mixture')} in the order of work; {missed or 'none'} of them out of reach of these paints"
    below = _MIXING_SHEET_HEAD + heads + height * rows
    sheet = _begin_page(title, facts, max(A4[1], below + foot), max(A4[0], A4[0] - _TUBES_ROOM + wide * len(tubes)))
    top, columns = _MIXING_SHEET_HEAD, {tube.name: _TUBES_LEFT + wide * at for at, tube in enumerate(tubes)}
    for brush in paints:
        _brush_head(sheet, brush, tubes, top, wide)
        for at, mixture in enumerate(brush.mixtures):
            _mixture_row(sheet, mixture, columns, top + _BRUSH_ROW + height * at, height)
        top += _BRUSH_ROW + height * len(brush.mixtures) + _BRUSH_GAP
    sheet.lines((_PAGE_MARGIN, sheet.image.height - 104), _MIXING_ADVICE, 17, 25)
    return sheet.tensor()


_TUBES_LEFT = _PAGE_MARGIN + 2 * _SWATCH + _WELL_ROOM
_TUBES_ROOM = _PAGE_ROOM - 2 * _SWATCH - _WELL_ROOM - _TOTAL


def _brush_head(sheet: Sheet, brush: BrushPaints, tubes: Sequence[Paint], top: int, wide: int) -> None:
    """Draws what the paints below are for, and the heads of the columns."""
    bottom = top + _BRUSH_ROW - 8
    sheet.text((_PAGE_MARGIN, top + 2), brush.title, 28)
    sheet.text((_PAGE_MARGIN, bottom - 2), shorten(brush.kept, 17, 320), 17, SOFT, "ld")
    for at, tube in enumerate(tubes):
        left = _TUBES_LEFT + wide * at
        words = tube.name.split()
        longest = max(map(font(16).getlength, words))
        size = max(10, min(16, int(16 * (wide - 6) / longest)))
        lines = [shorten(word, size, wide - 6) for word in words[:3]]
        sheet.lines((left, bottom - 12 - (size + 3) * len(lines)), lines, size, size + 3, INK)
        sheet.swatch((left, bottom - 10), wide - 8, 10, to_bytes(tube.color), LINE)


def _mixture_row(sheet: Sheet, mixture: Mixture, columns: Mapping[str, int], top: int, height: int) -> None:
    """Draws one mixture: wanted and predicted colour, well, parts with their amounts, and the whole amount."""
    recipe = mixture.recipe
    for at, color in enumerate((recipe.target, recipe.color)):
        sheet.swatch((_PAGE_MARGIN + at * _SWATCH, top), _SWATCH, height - 6, to_bytes(color))
    right, low = sheet.image.width - _PAGE_MARGIN, top + height - 8
    sheet.draw.line((_PAGE_MARGIN, top + height - 4, right, top + height - 4), fill=LINE)
    left = _PAGE_MARGIN + 2 * _SWATCH + 14
    sheet.text((left, top + height / 2 - 3), str(mixture.wells[0][1]), 38, anchor="lm")
    sheet.lines((left + 58, top + 2), (to_hex(recipe.target), shorten(mixture.also, 15, _WELL_ROOM - 76)), 15, 21)
    for paint, count in recipe.parts:
        sheet.text((columns[paint.name], top - 2), str(count), 26)
        if mixture.volume is not None:
            sheet.text((columns[paint.name], top + 28), format_amount(mixture.amounts[paint.name]), 16, SOFT)
    if mixture.volume is not None:
        sheet.text((right, top), format_amount(mixture.volume), 22, anchor="ra")
    ink = SOFT if recipe.within_reach else WARNING
    sheet.text((right, low), f"{recipe.verdict} {recipe.off:.1f}".lstrip(), 16, ink, "rd")


def format_amount(amount: float) -> str:
    """Returns whole drops as a person measures them: from half a millilitre on in millilitres."""
    millilitres = f"{amount:.2f}".rstrip("0").rstrip(".")
    return f"{millilitres} ml" if amount > 0.475 else count_of(round(amount / DROP), "drop")


_SHOPPING_ADVICE = (
    f"To mix: {RESERVE:g} times what the brush takes out of the wells, in whole drops of each part, and at least "
    f"{MIN_MIXED:g} ml",
    "of each mixture, because a brush dips in it. Makers sell tubes of other sizes too; 59 or 75 ml serve as 60.",
)


def shopping_list(paints: Sequence[BrushPaints]) -> str:
    """Returns the tubes to buy as text, with the colours that these paints cannot give."""
    bought, missed = supplies(paints), _out_of_reach(paints)
    longest = max(len(supply.paint.title) for supply in bought)
    rows = [
        f"[ ] {supply.in_tubes:<{max(len(one.in_tubes) for one in bought)}}  {supply.paint.title:<{longest}}  "
        f"{supply.mixed:6.1f} ml to mix, of which strokes take {supply.drawn:.1f} ml"
        for supply in bought
    ]
    return "\n".join(["Shopping list", "", *rows, "", *_SHOPPING_ADVICE, *(["", *missed] if missed else []), ""])


def shopping_sheet(paints: Sequence[BrushPaints], facts: str) -> Tensor:
    """Returns the tubes to buy as a printed page, sRGB [3, H, 1240] in [0, 1]."""
    bought, missed = supplies(paints), _out_of_reach(paints)
    rows = Grid(_PAGE_MARGIN, 236, 1, _PAGE_ROOM, 72, down=14)
    foot = 30 + 26 * (len(missed) + len(_SHOPPING_ADVICE))
    sheet = _begin_page("Shopping list", facts, max(A4[1], rows.bottom(len(bought)) + foot + 60))
    for supply, (left, top) in zip(bought, rows.corners(len(bought)), strict=True):
        sheet.draw.rectangle((left, top + 18, left + 34, top + 52), outline=INK, width=3)
        sheet.swatch((left + 64, top), 96, 72, to_bytes(supply.paint.color), LINE)
        sheet.text((left + 190, top + 36), supply.in_tubes, 32, anchor="lm")
        sheet.text((left + 440, top + 2), shorten(supply.paint.title, 30, rows.right - left - 440), 30)
        used = f"{supply.mixed:.1f} ml to mix, of which strokes take {supply.drawn:.1f} ml"
        sheet.text((left + 440, top + 70), used, 20, SOFT, "ld")
    sheet.lines((_PAGE_MARGIN, rows.bottom(len(bought)) + 36), (*_SHOPPING_ADVICE, *missed), 18, 26)
    return sheet.tensor()


def _out_of_reach(paints: Sequence[BrushPaints]) -> list[str]:
    """Returns a sentence for each mixture that these paints cannot give."""
    return [
        f"Layer {each.wells[0][0]}, well {each.wells[0][1]}: {to_hex(each.recipe.target)} cannot be mixed from these "
        f"paints; the recipe comes within {each.recipe.off:.1f} CIEDE2000."
        for brush in paints
        for each in brush.mixtures
        if not each.recipe.within_reach
    ]


# The palette's content also fits US Letter.
_PALETTE_SHEET_HEAD = 236
_FOOT = 108
_PALETTE_SHEET_SMALL = 18  # pixels: 8.6 points when printed
_PALETTE_SHEET_ADVICE = (
    "Mix each paint until its dried mark matches its swatch. A paint shop or a colorimeter works from the Lab values.",
    "Screens and printers differ: where they disagree, trust the numbers. Percentages are of all strokes' length.",
)


def palette_sheet(plan: Plan, title: str = "Palette") -> Tensor:
    """Returns the plan's paints as a printed page, sRGB [3, 1754, 1240] in [0, 1], lightest first.

    title: heading of the page

    Each paint has a large swatch, its number, sRGB as hex and bytes, Lab, the number of its strokes and its share
    of the painting. The page holds 1 to 64 paints.
    """
    known = paints(plan)
    count = len(known)
    upright = count <= 20  # with the text below the swatch, not beside it
    columns = 1 if count == 1 else 2 if count <= 6 else 3 if count <= 15 or not upright else 4
    across, down, tallest, draw = (44, 44, 820, _card) if upright else (36, 10, 96, _line)
    height = (A4[1] - _PALETTE_SHEET_HEAD - _FOOT - 20) // math.ceil(count / columns) - down
    place = _PAGE_MARGIN, _PALETTE_SHEET_HEAD
    grid = Grid.divide(_PAGE_ROOM, *place, columns, min(height, tallest), across=across, down=down)
    sheet = _begin_page(title, _facts(plan))
    for paint, (left, top) in zip(known, grid.corners(count), strict=True):
        draw(sheet, paint, left, top, grid.width, grid.height)
    sheet.lines((_PAGE_MARGIN, A4[1] - _FOOT), _PALETTE_SHEET_ADVICE, _PALETTE_SHEET_SMALL - 1, 26)
    return sheet.tensor()


def sheet_file(name: str, layer: int) -> str:
    """Returns the file name of the sheet for the wells of a layer: "palette.png", "palette-layer-2.png"."""
    path = Path(name)
    return name if layer == 1 else f"{path.stem}-layer-{layer}{path.suffix}"


def _facts(plan: Plan) -> str:
    facts = f"{count_of(len(plan.palette), 'paint')} for {len(plan)} strokes on a canvas of {plan.canvas}"
    ground = to_hex(torch.tensor(plan.ground))
    toned = f", toned {ground}" if ground != "#ffffff" else ""
    return f"{facts}{toned}, brush{'es' if len(plan.brushes) > 1 else ''}: {', '.join(plan.brushes)}"


def _color_in_words(paint: PaintFacts) -> tuple[str, str, str]:
    return paint.hex, "sRGB {}  {}  {}".format(*paint.srgb), "Lab {:.1f}  {:.1f}  {:.1f}".format(*paint.lab)


def _card(sheet: Sheet, paint: PaintFacts, left: int, top: int, width: int, height: int) -> None:
    """Draws a swatch with its text below."""
    below = top + height - 118
    sheet.swatch((left, top), width, below - top, paint.srgb, LINE)
    sheet.text((left, below + 12), str(paint.number), 44, INK)
    strokes = f"{count_of(paint.strokes, 'stroke')}, {paint.share:.0%}"
    for row, text in enumerate((*_color_in_words(paint), strokes)):
        sheet.text((left + 66, below + 14 + 25 * row), text, _PALETTE_SHEET_SMALL, INK if row == 0 else SOFT)


def _line(sheet: Sheet, paint: PaintFacts, left: int, top: int, width: int, height: int) -> None:
    """Draws a swatch with its text beside it, for palettes that fill the page."""
    swatch, right, size = round(0.26 * width), left + width, _PALETTE_SHEET_SMALL - 1
    sheet.swatch((left, top), swatch, height, paint.srgb, LINE)
    sheet.text((left + swatch + 12, top - 4), str(paint.number), 24, INK)
    pitch = min(26, height // 3)
    for row, text in enumerate(_color_in_words(paint)):
        sheet.text((left + swatch + 50, top + pitch * row), text, size, INK if row == 0 else SOFT)
    sheet.text((right, top), count_of(paint.strokes, "stroke"), size, SOFT, "ra")
    sheet.text((right, top + pitch), f"{paint.share:.0%}", size, SOFT, "ra")


# Recipe sheets of a plan, made in a separate thread while the robot goes on painting.


class RecipeSheets:
    """Writer of the palette sheets, the mixing sheet and the shopping list, for the person at the wells."""

    def __init__(self, folder: Path, paints: PaintSet | None = None) -> None:
        self._folder, self._owned = folder, paints or PaintSet(usual_paints())
        self._paints: tuple[BrushPaints, ...] = ()
        self._thread = ThreadPoolExecutor(1, "recipes")
        self._begun: list[Future[object]] = []

    def renew(self, plan: Plan, before: Palette | None = None) -> None:
        """Starts to compute a plan's recipes and to write its sheets.

        before: paints whose palette sheets exist already
        """
        self._begun.append(self._thread.submit(self.write, plan, before))

    def finish(self) -> tuple[tuple[BrushPaints, ...], int]:
        """Waits for the end; returns the last plan's paints by brush, and the number of plans without disk space."""
        self._thread.shutdown()
        troubles = [one.exception() for one in self._begun]
        for trouble in troubles:
            if trouble is not None and not isinstance(trouble, StorageError):
                raise trouble
        return self._paints, sum(trouble is not None for trouble in troubles)

    def write(self, plan: Plan, before: Palette | None = None) -> tuple[BrushPaints, ...]:
        """Computes a plan's recipes, writes its sheets, and returns its paints by brush. Raises StorageError.

        before: as for `renew`
        """
        there = [] if before is None else before.color.tolist()
        self._paints = paints_by_brush(plan, self._owned.mix(plan.palette.color))
        for layer, part in plan.by_wells():
            if all(color in there for color in part.palette.color.tolist()):
                continue
            of = "" if layer == 1 else f", layer {layer}"
            images.save(palette_sheet(part, f"Palette{of}"), self._folder / sheet_file("palette.png", layer))
        images.save(mixing_sheet(self._paints, "Mixing"), self._folder / "mixing.png")
        images.save(shopping_sheet(self._paints, _facts(plan)), self._folder / "shopping.png")
        storage.write_text(self._folder / "shopping.txt", shopping_list(self._paints))
        return self._paints


# A workspace to scale, seen from above.

_LONGEST = 1100  # pixels of the longer side of the bounds
_WORKSPACE_PLAN_MARGIN, _WORKSPACE_PLAN_HEAD, _WORKSPACE_PLAN_FOOT = 90, 110, 110
_TABLE, _EDGE = (243, 239, 231), (160, 154, 144)
_WATER, _RAG, _WELL, _HOME = (187, 213, 224), (226, 214, 190), (250, 247, 240), (178, 58, 44)
_BRUSH = (96, 84, 66)


def workspace_plan(workspace: Workspace, canvas: CanvasSize, title: str) -> Tensor:
    """Returns the bounds with canvas, wells, water, rag and home, sRGB [3, H, W] in [0, 1]; x right, y up."""
    return _Drawing(workspace, canvas, title).sheet.tensor()


class _Drawing:
    """Drawing of a workspace to the scale of its bounds."""

    def __init__(self, workspace: Workspace, canvas: CanvasSize, title: str) -> None:
        lower, upper = np.array(workspace.lower[:2]), np.array(workspace.upper[:2])
        self._scale = _LONGEST / float((upper - lower).max())
        width, height = (round(float(side) * self._scale) for side in upper - lower)
        self.sheet = Sheet(
            max(width, 620) + 2 * _WORKSPACE_PLAN_MARGIN, height + _WORKSPACE_PLAN_HEAD + _WORKSPACE_PLAN_FOOT
        )
        self._draw = self.sheet.draw
        self._corner = (_WORKSPACE_PLAN_MARGIN, _WORKSPACE_PLAN_HEAD + height)
        self._lower = lower
        self.sheet.text((_WORKSPACE_PLAN_MARGIN, 34), title, 36, INK, "la")
        note = "The table from above; metres in the robot's frame. Dashed: how far the brush stirs."
        if workspace.rack:
            note += " Brown: brushes in the rack, and how they are drawn out."
        self.sheet.text((_WORKSPACE_PLAN_MARGIN, self.sheet.image.height - 34), note, 19, SOFT, "ls")
        self._draw.rectangle((*self._at(lower[0], upper[1]), *self._at(upper[0], lower[1])), fill=_TABLE, outline=_EDGE)
        self._rule(upper)
        self._canvas(workspace, canvas)
        self._rag(workspace)
        self._round(workspace.water, "water", _WATER)
        for number, well in enumerate(workspace.wells, 1):
            self._round(well, str(number), _WELL)
        if workspace.rack:
            self._rack(workspace.rack)
        if workspace.home:
            self._home(workspace.home)

    def _canvas(self, workspace: Workspace, canvas: CanvasSize) -> None:
        ends = np.array([(0, 0), (canvas.width, 0), (canvas.width, canvas.height), (0, canvas.height)], float)
        corners: NDArray[np.float64] = workspace.to_robot(ends, np.zeros(4))
        self._draw.polygon([self._at(x, y) for x, y, _ in corners], fill=PAPER, outline=INK, width=2)
        x, y, _ = workspace.to_robot(np.array([[canvas.width, canvas.height]]) / 2, np.zeros(1))[0]
        self.sheet.text(self._at(x, y), "canvas", 26, SOFT, "ms")
        self.sheet.text(self._at(x, y), str(canvas), 20, SOFT, "ma")
        self.sheet.text(self._at(*corners[0, :2]), "  bottom left", 16, SOFT, "ld")

    def _rag(self, workspace: Workspace) -> None:
        x, y, _ = workspace.rag
        half = workspace.rag_width / 2
        self._draw.rectangle((*self._at(x - half, y + half / 2), *self._at(x + half, y - half / 2)), fill=_RAG)
        left, right = self._at(x - half, y), self._at(x + half, y)
        self._draw.line((*left, *right), fill=SOFT, width=2)
        self.sheet.text(self._at(x, y), "rag", 19, INK, "ms")

    def _round(self, place: Point, name: str, fill: tuple[int, int, int]) -> None:
        """Draws a well or the water, with the circle in which the brush stirs."""
        x, y = self._at(*place[:2])
        outer, stirred = 2 * STIR_RADIUS * self._scale, STIR_RADIUS * self._scale
        self._draw.ellipse((x - outer, y - outer, x + outer, y + outer), fill=fill, outline=_EDGE, width=2)
        for start in range(0, 360, 30):
            self._draw.arc((x - stirred, y - stirred, x + stirred, y + stirred), start, start + 15, fill=_EDGE, width=2)
        self.sheet.text((x, y), name, 19, INK, "mm")

    def _rack(self, rack: BrushRack) -> None:
        """Draws each brush in its fork, and the path on which it leaves the fork."""
        radius = STIR_RADIUS * self._scale
        for brush, (x, y, _) in rack.places.items():
            column, row = self._at(x, y)
            self._draw.line((column, row, *self._at(*rack.front(brush)[:2])), fill=_BRUSH, width=3)
            self._draw.ellipse((column - radius, row - radius, column + radius, row + radius), fill=_BRUSH)
            away = 1 if rack.slide[1] > 0 else -1  # the name is at the closed side of the fork
            self.sheet.text((column, row + away * (radius + 12)), brush, 19, INK, "mm")

    def _home(self, place: Point) -> None:
        x, y = self._at(*place[:2])
        self._draw.line((x - 10, y, x + 10, y), fill=_HOME, width=3)
        self._draw.line((x, y - 10, x, y + 10), fill=_HOME, width=3)
        self.sheet.text((x + 14, y), "home", 19, _HOME, "lm")

    def _rule(self, upper: NDArray[np.float64]) -> None:
        """Draws a scale in tenths of a metre along the lower and the left edge."""
        for axis in (0, 1):
            first = math.ceil(self._lower[axis] * 10 - 1e-9)
            for tenth in range(first, math.floor(upper[axis] * 10 + 1e-9) + 1):
                at = [float(self._lower[0]), float(self._lower[1])]
                at[axis] = tenth / 10
                x, y = self._at(*at)
                end = (x, y + 8) if axis == 0 else (x - 8, y)
                self._draw.line((x, y, *end), fill=_EDGE, width=2)
                anchor = "ma" if axis == 0 else "rm"
                offset = (x, y + 12) if axis == 0 else (x - 12, y)
                self.sheet.text(offset, f"{tenth / 10:g}", 16, SOFT, anchor)

    def _at(self, x: float, y: float) -> tuple[float, float]:
        left, bottom = self._corner
        return left + (x - self._lower[0]) * self._scale, bottom - (y - self._lower[1]) * self._scale
