"""Sheets to print or view: figures, doubtful strokes, surprises, palette, mixing recipes and workspace."""

import math
from collections.abc import Collection, Sequence
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
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import GOOD, REACHED, PaintSet, Recipe, volumes
from frida_painter.report.story import PaintFacts, paints
from frida_painter.strokes.palette import Palette, to_hex, to_lab
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter.system.sheet import A4, INK, LINE, PAPER, SOFT, WARNING, Grid, Sheet, font, scale, shorten, to_bytes
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


def _begin_page(title: str, facts: str, rows: int = A4[1]) -> Sheet:
    """Returns a page as wide as A4 with its title and a line of facts."""
    sheet = Sheet(A4[0], rows)
    sheet.text((_PAGE_MARGIN, 84), shorten(title, 58, _PAGE_ROOM), 58, INK)
    sheet.text((_PAGE_MARGIN, 162), facts, 24, SOFT)
    return sheet


_MIXING_SHEET_HEAD = 244
_TALLEST, _LOWEST = 118, 78
_SWATCH, _BAR = 92, 22
_DROP = 0.05  # millilitres
_ADVICE = (
    "Left of each pair the colour that is wanted, right of it what the mixture is predicted to be when it is dry.",
    f"The number is the difference of the two (CIEDE2000): up to {GOOD:g} hardly seen, above {REACHED:g} out of reach.",
    "It leaves out light and dark that no mixture of these paints has (as dark as it gets, as light as it gets).",
    "Mix a little, let it dry, compare, correct: tubes differ. A drop is 0.05 ml, a trace the tip of a knife.",
)


def mixing_sheet(recipes: Sequence[Recipe], volumes: Sequence[float] | None, title: str) -> Tensor:
    """Returns the recipes as a printed page, sRGB [3, H, 1240] in [0, 1], in the order of the wells.

    volumes: millilitres of each paint; None if unknown
    """
    supplies = _supplies(recipes, volumes)
    foot = 172 + 30 * -(-len(supplies) // 3) if supplies else 136
    height = min(_TALLEST, max(_LOWEST, (A4[1] - _MIXING_SHEET_HEAD - foot) // len(recipes)))
    grid = Grid(_PAGE_MARGIN, _MIXING_SHEET_HEAD, 1, _PAGE_ROOM, height - 20, down=20)
    missed = sum(not recipe.within_reach for recipe in recipes)
    reach = f"{missed} of them out of reach of these paints" if missed else "all of them within reach of these paints"
    facts = f"How to mix {count_of(len(recipes), 'paint')}, in parts by volume; {reach}"
    sheet = _begin_page(title, facts, max(A4[1], grid.bottom(len(recipes)) + 20 + foot))
    for index, (recipe, at) in enumerate(zip(recipes, grid.corners(len(recipes)), strict=True)):
        _recipe(sheet, index, recipe, volumes[index] if volumes else None, at, grid)
    below = sheet.image.height - foot + 20
    if supplies:
        sheet.text((_PAGE_MARGIN, below), "Needed in all, with half of it left in brush and wells", 21)
        list_of = Grid(_PAGE_MARGIN, below + 34, 3, 350, 30)
        for (name, volume), at in zip(supplies, list_of.corners(len(supplies)), strict=True):
            sheet.text(at, f"{volume:.0f} ml  {name}", 19, SOFT)
    sheet.lines((_PAGE_MARGIN, sheet.image.height - 110), _ADVICE, 17, 25)
    return sheet.tensor()


def _recipe(sheet: Sheet, index: int, recipe: Recipe, volume: float | None, at: tuple[int, int], grid: Grid) -> None:
    """Draws one row: number, wanted and predicted colour side by side, the parts in words and as a bar, the amounts."""
    (edge, top), height = at, grid.height
    left = edge + 64
    sheet.text((edge, top + height // 2), str(index + 1), 40, anchor="lm")
    for x, color in ((left, recipe.target), (left + _SWATCH, recipe.color)):
        sheet.swatch((x, top), _SWATCH, height, to_bytes(color))
    sheet.draw.rectangle((left, top, left + 2 * _SWATCH - 1, top + height - 1), outline=LINE)
    right = left + 2 * _SWATCH + 30
    fill = INK if recipe.within_reach else WARNING
    verdict = f"{recipe.off:.1f}  {recipe.verdict}".rstrip()
    room = grid.right - right - 30 - max(60, round(font(20).getlength(verdict)))
    size = next(size for size in (22, 20, 18, 16, 14, 12) if font(size).getlength(recipe.words) <= room or size == 12)
    sheet.text((right, top - 1), recipe.words, size, fill)
    sheet.text((grid.right, top - 1), verdict, 20, SOFT if recipe.within_reach else WARNING, "ra")
    _bar(sheet, recipe, right, top + 34)
    facts = to_hex(recipe.target)
    if volume is not None:
        amounts = recipe.volumes(volume)
        facts += "   " + "   ".join(_format_millilitres(amount) for amount in amounts)
    sheet.text((right, top + 34 + _BAR + 6), facts, 17, SOFT)


def _bar(sheet: Sheet, recipe: Recipe, left: int, top: int) -> None:
    """Draws the parts as lengths in their paints' colours, none too short to be visible."""
    width = A4[0] - _PAGE_MARGIN - left
    shares = recipe.volumes(1.0)
    least = 10 / width
    widths = [max(share, least) for share in shares]
    x = float(left)
    for (paint, _), share in zip(recipe.parts, widths, strict=True):
        end = x + width * share / sum(widths)
        sheet.draw.rectangle((round(x), top, round(end) - 2, top + _BAR), fill=to_bytes(paint.color), outline=LINE)
        x = end


def _supplies(recipes: Sequence[Recipe], volumes: Sequence[float] | None) -> list[tuple[str, float]]:
    """Returns the millilitres of each tube paint for all mixtures, most first."""
    needed: dict[str, float] = {}
    for recipe, volume in zip(recipes, volumes or (), strict=False):
        for (paint, _), amount in zip(recipe.parts, recipe.volumes(volume), strict=True):
            needed[paint.name] = needed.get(paint.name, 0.0) + amount
    return sorted(((name, max(1.0, volume)) for name, volume in needed.items()), key=lambda one: (-one[1], one[0]))


def _format_millilitres(amount: float) -> str:
    """Returns millilitres as a person measures them: less than a tenth in drops."""
    if amount >= 0.095:
        return f"{amount:.1f} ml"
    drops = round(amount / _DROP)
    return count_of(drops, "drop") if drops else "a trace"


# The palette's content also fits US Letter.
_PALETTE_SHEET_HEAD = 236
_FOOT = 108
_PALETTE_SHEET_SMALL = 18  # pixels: 8.6 points when printed
_RECIPE_SIZE, _RECIPE_PITCH = 15, 20
_PALETTE_SHEET_ADVICE = (
    "Mix each paint until its dried mark matches its swatch. A paint shop or a colorimeter works from the Lab values.",
    "Screens and printers differ: where they disagree, trust the numbers. Percentages are of all strokes' length.",
)


def palette_sheet(plan: Plan, title: str = "Palette", recipes: Sequence[Recipe] = ()) -> Tensor:
    """Returns the plan's paints as a printed page, sRGB [3, 1754, 1240] in [0, 1], lightest first.

    title: heading of the page
    recipes: one per paint, or none; shown for up to 20 paints

    Each paint has a large swatch, its number, sRGB as hex and bytes, Lab, the number of its strokes and its share
    of the painting. The page holds 1 to 64 paints.
    """
    known = paints(plan, recipes)
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
    below = top + height - (118 if not paint.recipe else 118 + 2 * _RECIPE_PITCH)
    sheet.swatch((left, top), width, below - top, paint.srgb, LINE)
    sheet.text((left, below + 12), str(paint.number), 44, INK)
    strokes = f"{count_of(paint.strokes, 'stroke')}, {paint.share:.0%}"
    for row, text in enumerate((*_color_in_words(paint), strokes)):
        sheet.text((left + 66, below + 14 + 25 * row), text, _PALETTE_SHEET_SMALL, INK if row == 0 else SOFT)
    sheet.lines((left, below + 118), _in_two_lines(paint.recipe, width), _RECIPE_SIZE, _RECIPE_PITCH)


def _in_two_lines(recipe: str, width: int) -> list[str]:
    """Returns the recipe in at most two lines, broken at a plus; the second line is cut if it is too long."""
    words, face = recipe.split(" + "), font(_RECIPE_SIZE)
    starts = ((count, " + ".join(words[:count])) for count in range(len(words), 0, -1))
    count = next((count for count, line in starts if face.getlength(f"{line} +") <= width), 1)
    first, second = " + ".join(words[:count]), " + ".join(words[count:])
    return [shorten(line, _RECIPE_SIZE, width) for line in ([f"{first} +", second] if second else [first])]


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
    """Writer of the palette and mixing sheets of each layer, for the person at the wells."""

    def __init__(self, folder: Path, paints: PaintSet | None = None) -> None:
        self._folder, self._paints = folder, paints or PaintSet(usual_paints())
        self._recipes: tuple[Recipe, ...] = ()
        self._thread = ThreadPoolExecutor(1, "recipes")
        self._begun: list[Future[None]] = []

    def renew(self, plan: Plan, before: Palette | None = None) -> None:
        """Starts to compute a plan's recipes and to write its sheets.

        before: paints whose sheets exist already
        """
        self._begun.append(self._thread.submit(self._renew, plan, before))

    def finish(self) -> tuple[tuple[Recipe, ...], int]:
        """Waits for the end; returns the last plan's recipes, and the number of plans without disk space."""
        self._thread.shutdown()
        troubles = [one.exception() for one in self._begun]
        for trouble in troubles:
            if trouble is not None and not isinstance(trouble, StorageError):
                raise trouble
        return self._recipes, sum(trouble is not None for trouble in troubles)

    def _renew(self, plan: Plan, before: Palette | None) -> None:
        there = [] if before is None else before.color.tolist()
        known = {tuple(recipe.target.tolist()): recipe for recipe in self._recipes}
        colors = [tuple(color) for color in plan.palette.color.tolist()]
        unknown = sorted(set(colors) - set(known))
        known |= dict(zip(unknown, self._paints.mix(plan.palette.color.new_tensor(unknown)), strict=True))
        self._recipes = tuple(known[color] for color in colors)
        mixed = iter(self._recipes)
        for layer, part in plan.by_wells():
            ours, of = [next(mixed) for _ in part.palette.color], "" if layer == 1 else f", layer {layer}"
            if all(color in there for color in part.palette.color.tolist()):
                continue
            images.save(palette_sheet(part, f"Palette{of}", ours), self._folder / sheet_file("palette.png", layer))
            sheet = mixing_sheet(ours, volumes(part).tolist(), f"Mixing{of}")
            images.save(sheet, self._folder / sheet_file("mixing.png", layer))


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
