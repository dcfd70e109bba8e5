"""The mixing sheet: a page to lie beside the bowls, with a recipe for every paint of a palette."""

from collections.abc import Sequence

from torch import Tensor

from frida_painter.mixing.recipe import GOOD, Recipe
from frida_painter.palette import to_hex
from frida_painter.sheet import INK, LINE, SOFT, WARNING, Sheet, font, to_bytes

COLUMNS = 1240
"""A4 at 150 dots per inch; a palette of more than 16 paints makes the page longer."""
_ROWS = 1754
_MARGIN, _HEAD = 96, 244
_TALLEST, _LOWEST = 118, 78
_SWATCH, _BAR = 92, 22
_DROP = 0.05  # millilitres
_ADVICE = (
    "Left of each pair the colour that is wanted, right of it what the mixture is predicted to be when it is dry.",
    "The number behind the parts is their difference (CIEDE2000): below 2 hardly seen, above 5 out of reach.",
    "Mix a little first, let it dry, compare, and correct: tubes of one name differ from maker to maker.",
    "A drop is 0.05 ml, and a trace is what stays on the tip of a knife.",
)


def mixing_sheet(recipes: Sequence[Recipe], volumes: Sequence[float] | None, title: str) -> Tensor:
    """The recipes as a printed page, sRGB [3, H, 1240] in [0, 1], in the order of the wells.

    volumes: millilitres wanted of each paint, None where that is not known.
    """
    supplies = _supplies(recipes, volumes)
    foot = 172 + 30 * -(-len(supplies) // 3) if supplies else 136
    row = min(_TALLEST, max(_LOWEST, (_ROWS - _HEAD - foot) // len(recipes)))
    sheet = Sheet(COLUMNS, max(_ROWS, _HEAD + row * len(recipes) + foot))
    sheet.text((_MARGIN, 84), title, 58)
    missed = sum(not recipe.within_reach for recipe in recipes)
    reach = f"{missed} of them out of reach of these paints" if missed else "all of them within reach of these paints"
    plural = "" if len(recipes) == 1 else "s"
    sheet.text((_MARGIN, 162), f"How to mix {len(recipes)} paint{plural}, in parts by volume; {reach}", 24, SOFT)
    for index, recipe in enumerate(recipes):
        _recipe(sheet, index, recipe, volumes[index] if volumes else None, _HEAD + index * row, row)
    below = sheet.image.height - foot + 20
    if supplies:
        sheet.text((_MARGIN, below), "Needed in all, with half of it left in brush and wells", 21)
        for place, (name, volume) in enumerate(supplies):
            column, line = place % 3, place // 3
            sheet.text((_MARGIN + 350 * column, below + 34 + 30 * line), f"{volume:.0f} ml  {name}", 19, SOFT)
    for line, text in enumerate(_ADVICE):
        sheet.text((_MARGIN, sheet.image.height - 110 + 25 * line), text, 17, SOFT)
    return sheet.tensor()


def _recipe(
    sheet: Sheet, index: int, recipe: Recipe, volume: float | None, top: int, row: int
) -> None:  # fmt: skip
    """One row: number, wanted and predicted colour side by side, the parts in words and as a bar, the amounts."""
    height = row - 20
    left = _MARGIN + 64
    sheet.text((_MARGIN, top + height // 2), str(index + 1), 40, anchor="lm")
    for place, color in enumerate((recipe.target, recipe.color)):
        x = left + place * _SWATCH
        sheet.draw.rectangle((x, top, x + _SWATCH - 1, top + height - 1), fill=to_bytes(color))
    sheet.draw.rectangle((left, top, left + 2 * _SWATCH - 1, top + height - 1), outline=LINE)
    right = left + 2 * _SWATCH + 30
    fill = INK if recipe.within_reach else WARNING
    room = COLUMNS - _MARGIN - right - (150 if not recipe.within_reach else 90)
    size = next(size for size in (22, 20, 18, 16, 14, 12) if font(size).getlength(recipe.words) <= room or size == 12)
    sheet.text((right, top - 1), recipe.words, size, fill)
    verdict = f"{recipe.difference:.1f}"
    if not recipe.within_reach:
        verdict += "  out of reach"
    elif recipe.difference > GOOD:
        verdict += "  near"
    sheet.text((COLUMNS - _MARGIN, top - 1), verdict, 20, SOFT if recipe.within_reach else WARNING, "ra")
    _bar(sheet, recipe, right, top + 34)
    facts = to_hex(recipe.target)
    if volume is not None:
        amounts = recipe.volumes(volume)
        facts += "   " + "   ".join(_measured(amount) for amount in amounts)
    sheet.text((right, top + 34 + _BAR + 6), facts, 17, SOFT)


def _bar(sheet: Sheet, recipe: Recipe, left: int, top: int) -> None:
    """The parts as lengths, each in its paint's own colour, and never so short that it is not seen."""
    width = COLUMNS - _MARGIN - left
    shares = recipe.volumes(1.0)
    least = 10 / width
    widths = [max(share, least) for share in shares]
    x = float(left)
    for (paint, _), share in zip(recipe.parts, widths, strict=True):
        end = x + width * share / sum(widths)
        sheet.draw.rectangle((round(x), top, round(end) - 2, top + _BAR), fill=to_bytes(paint.color), outline=LINE)
        x = end


def _supplies(recipes: Sequence[Recipe], volumes: Sequence[float] | None) -> list[tuple[str, float]]:
    """Millilitres of each paint that all mixtures take together, most first."""
    needed: dict[str, float] = {}
    for recipe, volume in zip(recipes, volumes or (), strict=False):
        for (paint, _), amount in zip(recipe.parts, recipe.volumes(volume), strict=True):
            needed[paint.name] = needed.get(paint.name, 0.0) + amount
    return sorted(((name, max(1.0, volume)) for name, volume in needed.items()), key=lambda one: (-one[1], one[0]))


def _measured(amount: float) -> str:
    """Millilitres as a person measures them: below a tenth in drops."""
    if amount >= 0.095:
        return f"{amount:.1f} ml"
    drops = round(amount / _DROP)
    return "a trace" if drops == 0 else "1 drop" if drops == 1 else f"{drops} drops"
