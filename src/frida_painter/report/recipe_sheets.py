"""The sheets that say how to mix the paints of a plan: made in a thread of their own, while the robot paints on."""

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from frida_painter import images
from frida_painter.errors import StorageError
from frida_painter.mixing.amounts import volumes
from frida_painter.mixing.paint_inventory import usual_paints
from frida_painter.mixing.recipe import Recipe, recipes
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.report.mixing_sheet import mixing_sheet
from frida_painter.report.palette_sheet import palette_sheet, sheet_file


class RecipeSheets:
    """Keeps the sheets of the paints of each layer in a folder, for whoever stands before the wells."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._recipes: tuple[Recipe, ...] = ()
        self._thread = ThreadPoolExecutor(1, "recipes")
        self._begun: list[Future[None]] = []

    def renew(self, plan: Plan, before: Palette | None = None) -> None:
        """Has the recipes of a plan found and its sheets written. before: paints whose sheets are there."""
        self._begun.append(self._thread.submit(self._renew, plan, before))

    def finish(self) -> tuple[tuple[Recipe, ...], int]:
        """Waits; the recipes of the last plan, and for how many plans there was no room on the disk."""
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
        known |= dict(zip(unknown, recipes(plan.palette.color.new_tensor(unknown), usual_paints()), strict=True))
        self._recipes = tuple(known[color] for color in colors)
        mixed = iter(self._recipes)
        for layer, part in plan.by_wells():
            ours, of = [next(mixed) for _ in part.palette.color], "" if layer == 1 else f", layer {layer}"
            if all(color in there for color in part.palette.color.tolist()):
                continue
            images.save(palette_sheet(part, f"Palette{of}", ours), self._folder / sheet_file("palette.png", layer))
            sheet = mixing_sheet(ours, volumes(part).tolist(), f"Mixing{of}")
            images.save(sheet, self._folder / sheet_file("mixing.png", layer))
