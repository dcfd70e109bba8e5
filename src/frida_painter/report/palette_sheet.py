"""The palette sheet: a page to print, hang beside the easel, and mix paint from."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from frida_painter.mixing.recipe import Recipe
from frida_painter.palette import to_hex
from frida_painter.plan import Plan
from frida_painter.report.story import PaintFacts, paints
from frida_painter.sheet import INK, LINE, SOFT, Sheet, font, shortened

ROWS, COLUMNS = 1754, 1240
"""A4 at 150 dots per inch; what is on it also fits US Letter."""
_MARGIN = 96
_HEAD = 236
_FOOT = 108
_SMALL = 18  # pixels: 8.6 points when printed
_RECIPE_SIZE, _RECIPE_PITCH = 15, 20
_ADVICE = (
    "Mix each paint until its dried mark matches its swatch. A paint shop or a colorimeter works from the Lab values.",
    "Screens and printers differ: where they disagree, trust the numbers. Percentages are of all strokes' length.",
)


def palette_sheet(plan: Plan, title: str = "Palette", recipes: Sequence[Recipe] = ()) -> Tensor:
    """The plan's paints as a printed page, sRGB [3, 1754, 1240] in [0, 1].

    Lightest first: a large swatch, its number, sRGB as hex and bytes, Lab, how many strokes it is
    for and how much of the painting they are; up to 20 paints also with how to mix them, where `recipes`
    tells. Holds 1 to 64 paints.
    """
    sheet = Sheet(COLUMNS, ROWS)
    known = paints(plan, recipes)
    _head(sheet, plan, title)
    grid = _Grid.of(len(known))
    for place, paint in enumerate(known):
        left, top = grid.corner(place)
        (_card if grid.upright else _line)(sheet, paint, left, top, grid.width, grid.height)
    for row, text in enumerate(_ADVICE):
        sheet.text((_MARGIN, ROWS - _FOOT + 26 * row), text, _SMALL - 1, SOFT)
    return sheet.tensor()


def sheet_file(name: str, layer: int) -> str:
    """The name of the file for the wells that are filled before that layer: "palette.png", "palette-layer-2.png"."""
    path = Path(name)
    return name if layer == 1 else f"{path.stem}-layer-{layer}{path.suffix}"


@dataclass(frozen=True)
class _Grid:
    """Cells of the page in pixels; upright: the swatch stands above its text and not beside it."""

    columns: int
    width: int
    height: int
    gap: int
    upright: bool

    @classmethod
    def of(cls, count: int) -> "_Grid":
        upright = count <= 20
        columns = 1 if count == 1 else 2 if count <= 6 else 3 if count <= 15 or not upright else 4
        rows = math.ceil(count / columns)
        gap = 44 if upright else 36
        across = (COLUMNS - 2 * _MARGIN - gap * (columns - 1)) // columns
        down = (ROWS - _HEAD - _FOOT - 20) // rows - (gap if upright else 10)
        return cls(columns, across, min(down, 820 if upright else 96), gap, upright)

    def corner(self, place: int) -> tuple[int, int]:
        """Left and top of a cell; paints run along the rows, from the left."""
        row, column = divmod(place, self.columns)
        return _MARGIN + column * (self.width + self.gap), _HEAD + row * (
            self.height + (self.gap if self.upright else 10)
        )


def _head(sheet: Sheet, plan: Plan, title: str) -> None:
    sheet.text((_MARGIN, 84), shortened(title, 58, COLUMNS - 2 * _MARGIN), 58, INK)
    count = len(plan.palette)
    facts = f"{count} paint{'s' if count != 1 else ''} for {len(plan)} strokes on a canvas of {plan.canvas}"
    ground = to_hex(torch.tensor(plan.ground))
    toned = f", toned {ground}" if ground != "#ffffff" else ""
    brushes = f"brush{'es' if len(plan.brushes) > 1 else ''}: {', '.join(plan.brushes)}"
    sheet.text((_MARGIN, 162), f"{facts}{toned}, {brushes}", 24, SOFT)


def _card(sheet: Sheet, paint: PaintFacts, left: int, top: int, width: int, height: int) -> None:
    """A swatch with its text below."""
    below = top + height - (118 if not paint.recipe else 118 + 2 * _RECIPE_PITCH)
    sheet.draw.rectangle((left, top, left + width - 1, below - 1), fill=paint.srgb, outline=LINE, width=1)
    sheet.text((left, below + 12), str(paint.number), 44, INK)
    strokes = f"{_strokes(paint)}, {paint.share:.0%}"
    for row, text in enumerate((paint.hex, _srgb(paint), _lab(paint), strokes)):
        sheet.text((left + 66, below + 14 + 25 * row), text, _SMALL, INK if row == 0 else SOFT)
    for row, text in enumerate(_in_two_lines(paint.recipe, width)):
        sheet.text((left, below + 118 + _RECIPE_PITCH * row), text, _RECIPE_SIZE, SOFT)


def _in_two_lines(recipe: str, width: int) -> list[str]:
    """The recipe broken where it says plus; the second line is cut where even two are too short."""
    words = recipe.split(" + ")
    first = next(
        (
            count
            for count in range(len(words), 0, -1)
            if font(_RECIPE_SIZE).getlength(" + ".join(words[:count]) + " +") <= width
        ),
        1,
    )
    lines = [" + ".join(words[:first]), " + ".join(words[first:])]
    return [shortened(line, _RECIPE_SIZE, width) for line in ([lines[0] + " +", lines[1]] if lines[1] else [lines[0]])]


def _line(sheet: Sheet, paint: PaintFacts, left: int, top: int, width: int, height: int) -> None:
    """A swatch with its text beside it, for palettes that fill the page."""
    swatch, right, size = round(0.26 * width), left + width, _SMALL - 1
    sheet.draw.rectangle((left, top, left + swatch - 1, top + height - 1), fill=paint.srgb, outline=LINE, width=1)
    sheet.text((left + swatch + 12, top - 4), str(paint.number), 24, INK)
    pitch = min(26, height // 3)
    for row, text in enumerate((paint.hex, _srgb(paint), _lab(paint))):
        sheet.text((left + swatch + 50, top + pitch * row), text, size, INK if row == 0 else SOFT)
    sheet.text((right, top), _strokes(paint), size, SOFT, "ra")
    sheet.text((right, top + pitch), f"{paint.share:.0%}", size, SOFT, "ra")


def _srgb(paint: PaintFacts) -> str:
    return "sRGB {}  {}  {}".format(*paint.srgb)


def _lab(paint: PaintFacts) -> str:
    return "Lab {:.1f}  {:.1f}  {:.1f}".format(*paint.lab)


def _strokes(paint: PaintFacts) -> str:
    return f"{paint.strokes} stroke{'s' if paint.strokes != 1 else ''}"
