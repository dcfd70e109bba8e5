"""The command that tells how to mix a palette from the paints that a person owns."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from frida_painter import storage
from frida_painter.errors import ConfigError
from frida_painter.mixing.finish import Finish
from frida_painter.options import out_file, whole_number_within

if TYPE_CHECKING:
    from frida_painter.mixing.recipe import Recipe
    from frida_painter.palette import Palette


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("mix")(mix)


def mix(
    what: Annotated[
        Path,
        typer.Argument(
            metavar="PLAN|PALETTE",
            help="A plan.json, the folder of a painting, or a palette in any form that --palette of paint takes.",
            show_default=False,
        ),
    ],
    paints: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A file of the paints that you own (TOML). [dim]six common acrylics[/]"),
    ] = None,
    most: Annotated[
        int,
        typer.Option(parser=whole_number_within(1, 4), metavar="N", help="Maximum number of paints in one mixture."),
    ] = 4,
    finish: Annotated[
        Finish, typer.Option(metavar="NAME", help="The finish of the dry paint: matte, or gloss, which looks darker.")
    ] = Finish.matte,
    out: Annotated[
        Path, typer.Option(parser=out_file, metavar="FILE", help="The sheet to write, .png or .jpg.")
    ] = Path("mixing.png"),
) -> None:
    """Give a recipe for each colour of a palette, from the paints that you own, with the predicted error.

    For a plan it also gives the amount of each paint, and the paints of each filling of the wells on their
    own, with a sheet each (mixing-layer-2.png). Colours that your paints cannot reach are marked.
    The recipes are also written as a sheet to print. docs/how-to/mix.md explains the file of your own paints.
    """
    if out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ConfigError(f"--out was given {str(out)!r}; the picture ends in .png or .jpg.")
    from frida_painter import images
    from frida_painter.mixing.paint_inventory import read_paints, usual_paints
    from frida_painter.mixing.recipe import recipes
    from frida_painter.report.mixing_sheet import mixing_sheet
    from frida_painter.report.palette_sheet import sheet_file
    from frida_painter.session.opening import prepare_process

    prepare_process()
    owned = read_paints(paints) if paints else usual_paints()
    for layer, palette, wanted in _wanted(what):
        of, sheet = ("", out) if layer == 1 else (f", layer {layer}", out.with_name(sheet_file(out.name, layer)))
        found = recipes(palette.color, owned, most, finish)
        images.save(mixing_sheet(found, wanted, f"Mixing{of}"), sheet)
        if of:
            print(f"\nFill the wells anew before layer {layer}:")
        _show(found, wanted)
        print(f"The sheet: {sheet}")


def _wanted(path: Path) -> list[tuple[int, "Palette", list[float] | None]]:
    """For each time that the wells are filled: before which layer, from 1, with which paints, and how much of each.

    That is in millilitres, None where no plan says what the paints are for.
    """
    from frida_painter.mixing.amounts import volumes
    from frida_painter.perception.swatches import read_palette
    from frida_painter.plan import Plan

    if path.is_dir() or _is_plan(path):
        plan = Plan.load(path)
        return [(layer, part.palette, volumes(part).tolist()) for layer, part in plan.by_wells()]
    return [(1, read_palette(path, None), None)]


def _is_plan(path: Path) -> bool:
    """Whether a file begins as a plan does. Raises ConfigError where there is no such file."""
    with storage.opened(path, "a plan or a palette", storage.MAX_JSON_BYTES, ConfigError) as file:
        return b'"frida-painter plan"' in file.read(200)


def _show(found: list["Recipe"], wanted: list[float] | None) -> None:
    from frida_painter.mixing.recipe import GOOD
    from frida_painter.palette import to_hex

    table = Table("", "colour", "parts", "off", "", box=None, padding=(0, 2, 0, 0))
    for number, recipe in enumerate(found, 1):
        color = to_hex(recipe.target)
        amount = f"{wanted[number - 1]:.0f} ml" if wanted else ""
        off = f"[{'red' if not recipe.within_reach else 'yellow' if recipe.difference > GOOD else 'green'}]"
        table.add_row(f"[on {color}]    [/] {number}", color, recipe.words, f"{off}{recipe.difference:.1f}[/]", amount)
    console = Console(highlight=False, soft_wrap=True)
    console.print(table)
    missed = [str(number) for number, recipe in enumerate(found, 1) if not recipe.within_reach]
    if missed:
        console.print(
            f"Out of reach of these paints (more than 5 CIEDE2000 off): {', '.join(missed)}. "
            "What stands there comes nearest; own more paints, or plan with what you can mix (--palette)."
        )
