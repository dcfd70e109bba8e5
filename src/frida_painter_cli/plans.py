"""Commands for plans and workspaces: mix, export, check, and workspace example and draw."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.mixing import Finish
from frida_painter.registry import Later
from frida_painter.runs.options import (
    CameraOption,
    RobotOption,
    WorkspaceOption,
    any_number,
    number_within,
    out_file,
    out_folder,
    taking,
    whole_number_option,
    with_fields,
)
from frida_painter.system import storage
from frida_painter.system.storage import count_of
from frida_painter_cli.options import PictureOut, PlanFile

if TYPE_CHECKING:
    from frida_painter.mixing.shopping import BrushPaints
    from frida_painter.strokes.palette import Palette
    from frida_painter.strokes.plan import Plan

_Record = Annotated[
    Path | None, taking("FILE", "The easel's calibration record. [dim]the heights of the workspace[/]", "--calibration")
]
_trace_plan = Later("frida_painter_calibration.commands.without_camera:trace_plan")


# Command for recipes of a palette from a person's own paints.


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
        Path | None, taking("FILE", "A file of the paints that you own (TOML). [dim]six common acrylics[/]")
    ] = None,
    most: Annotated[int, whole_number_option(1, 4, "Maximum number of paints in one mixture.")] = 4,
    finish: Annotated[
        Finish | None,
        taking(
            "NAME",
            "The finish of the dry paint: matte, or gloss, which looks darker. [dim]that of the file of paints, "
            "else gloss[/]",
            show_default=False,
        ),
    ] = None,
    out: PictureOut = Path("mixing.png"),
) -> None:
    """Give a recipe for each colour of a palette, from the paints that you own, with the predicted error.

    For a plan it also gives the amounts, brush by brush in the order of work, and the tubes to buy. Colours that
    your paints cannot reach are marked. The recipes are also written as a sheet to print. docs/how-to/mix.md
    explains the file of your own paints.
    """
    from frida_painter.mixing.paint import usual_paints
    from frida_painter.mixing.recipe import PaintSet
    from frida_painter.mixing.shopping import BrushPaints, Mixture, paints_by_brush
    from frida_painter.report.sheets import mixing_sheet, shopping_list
    from frida_painter.system import images
    from frida_painter.system.devices import prepare_process

    prepare_process()
    owned = (PaintSet.of(paints) if paints else None) or PaintSet(usual_paints())
    plan, palette = _read_plan_or_palette(what)
    recipes = replace(owned, finish=finish or owned.finish).mix(palette.color, most)
    if plan is not None:
        found = paints_by_brush(plan, recipes)
    else:
        found = (BrushPaints("", tuple(Mixture(recipe, ((1, well),)) for well, recipe in enumerate(recipes, 1))),)
    images.save(mixing_sheet(found, "Mixing"), out)
    _show(found)
    if plan is not None:
        print(shopping_list(found))
    print(f"The sheet: {out}")


def _read_plan_or_palette(path: Path) -> tuple["Plan | None", "Palette"]:
    """Returns the plan of a file or folder with all its paints; no plan if the file is a palette."""
    from frida_painter.perception.color import read_palette
    from frida_painter.strokes.plan import Plan

    is_plan = path.is_dir()
    if not is_plan:
        with storage.open_checked(path, "a plan or a palette", storage.MAX_JSON_BYTES, ConfigError) as file:
            is_plan = b'"frida-painter plan"' in file.read(200)
    plan = Plan.load(path) if is_plan else None
    return plan, read_palette(path, None) if plan is None else plan.palette


def _show(paints: tuple["BrushPaints", ...]) -> None:
    from frida_painter.mixing.recipe import GOOD, REACHED
    from frida_painter.report.sheets import format_amount
    from frida_painter.strokes.palette import to_hex

    console = Console(highlight=False, soft_wrap=True)
    for brush in paints:
        if brush.title:
            console.print("", brush.title, *filter(None, [brush.kept]), sep="\n", markup=False)
        table = Table("", "colour", "parts", "off", "to mix", box=None, padding=(0, 2, 0, 0))
        for mixture in brush.mixtures:
            recipe, color = mixture.recipe, to_hex(mixture.recipe.target)
            mood = "red" if not recipe.within_reach else "yellow" if recipe.off > GOOD else "green"
            off = f"[{mood}]{recipe.off:.1f}  {recipe.verdict}".rstrip() + "[/]"
            amount = "" if mixture.volume is None else f"{format_amount(mixture.volume)}  [dim]{mixture.also}[/]"
            table.add_row(f"[on {color}]    [/] {mixture.wells[0][1]}", color, recipe.words, off, amount)
        console.print(table)
    if any(not mixture.recipe.within_reach for brush in paints for mixture in brush.mixtures):
        console.print(
            f"Out of reach of these paints: more than {REACHED:g} CIEDE2000 off. What stands there comes nearest; own "
            "more paints, or plan with what you can mix (--palette)."
        )


# Command that writes plans for other programs and for machines: export.


@dataclass(frozen=True)
class SvgOptions:
    """Options of an export as SVG; some are for G-code too."""

    regroup: Annotated[
        bool,
        typer.Option(
            help="svg: exactly one layer per paint in each layer of the plan, even if a paint returns later. Changes "
            "which strokes lie on top."
        ),
    ] = False
    dips: Annotated[bool, typer.Option(help="svg: add a layer with a pause for every dip of the brush (AxiDraw).")] = (
        False
    )
    refill: Annotated[
        float | None,
        taking(
            "MM",
            "svg with --dips, gcode: millimetres that a dip paints with the whole width of a brush. [dim]as the "
            "painting's settings say[/]",
            parser=number_within(5, 10_000),
        ),
    ] = None
    title: Annotated[str, taking("TEXT", "svg, gcode: a title for a pen, in the lower left corner.")] = ""
    signature: Annotated[str, taking("TEXT", "svg, gcode: a signature for a pen, in the lower right corner.")] = ""


@dataclass(frozen=True)
class GcodeOptions:
    """Options of an export as G-code."""

    flavour: Annotated[
        str | None, taking("NAME", "gcode: the dialect, grbl or marlin. [dim]grbl[/]", show_default=False)
    ] = None
    press: Annotated[
        float | None, taking("MM", "gcode: depth of the hardest press in mm; 0 for a pen. [dim]2[/]", parser=any_number)
    ] = None
    lift: Annotated[float | None, taking("MM", "gcode: height of travel moves in mm. [dim]5[/]", parser=any_number)] = (
        None
    )
    workspace: Annotated[
        Path | None, taking("FILE", "gcode: the workspace file (TOML), for a machine that dips by itself.")
    ] = None
    calibration: Annotated[Path | None, taking("FILE", "gcode, with --workspace: the easel's calibration record.")] = (
        None
    )
    drying: Annotated[
        float | None,
        taking(
            "MINUTES",
            "gcode: how long a layer dries before the next one. [dim]as the painting's settings say, else 20[/]",
            parser=number_within(0, 1440),
        ),
    ] = None
    own: Annotated[
        Path | None, taking("FILE", "gcode: lines of your own at start, end, lift, dips and changes (TOML).")
    ] = None


def export(
    *,
    plan: PlanFile,
    to: Annotated[
        str,
        taking(
            "KIND",
            "svg is for Inkscape and plotters, gcode for GRBL and Marlin machines, csv is a table, png a picture. "
            "Your own packages can add kinds.",
            "--to",
        ),
    ] = "svg",
    out: Annotated[Path | None, taking("FILE", "The file to write. [dim]strokes.KIND[/]", parser=out_file)] = None,
    per_paint: Annotated[
        bool,
        typer.Option(
            "--per-paint",
            help="One file per paint of each layer, numbered in the order of work. Changes which strokes lie on top.",
        ),
    ] = False,
    svg: SvgOptions,
    gcode: GcodeOptions,
) -> None:
    """Export the strokes of a plan as SVG, G-code or CSV, in millimetres.

    SVG has one layer per paint, and names the brush where there are several. CSV has one row per stroke.
    The zero of the G-code is the bottom-left corner of the canvas, and Z0 is the lightest touch. The machine
    pauses (M0) at every dip of the brush. With --workspace, the zero is that of the workspace, and the machine
    dips, rinses and wipes by itself.
    """
    from frida_painter.render.exporter import ExportOptions, export_plan, find_exporter
    from frida_painter.strokes.palette import to_hex
    from frida_painter.strokes.plan import Plan

    kind = find_exporter(to)
    path = out or Path(f"strokes.{kind.name}")
    if path.suffix.lower() != f".{kind.name}":
        raise ConfigError(f"--out was given {str(path)!r}; with --to {kind.name} the file ends in .{kind.name}.")
    options = ExportOptions(**vars(svg), **vars(gcode), source=plan)
    loaded = Plan.load(plan)
    parts = loaded.by_paint() if per_paint else [loaded]
    for number, part in enumerate(parts, start=1):
        name = path.with_stem(f"{path.stem}-{number:0{len(str(len(parts)))}d}") if per_paint else path
        is_last = number == len(parts)
        export_plan(part, name, kind.name, options if is_last else replace(options, title="", signature=""))
        paints = to_hex(part.palette.color[part.paint[0]]) if per_paint else count_of(len(part.palette), "paint")
        typer.echo(f"{count_of(len(part), 'stroke')} in {paints}: {name}")


def tiles(
    plan: PlanFile,
    sheet: Annotated[
        str, taking("SIZE", "The canvas of your machine: what one tile may measure, like A4.", show_default=False)
    ],
    overlap: Annotated[
        float, taking("MM", "How far neighbours lie over each other at least.", parser=number_within(0, 1000))
    ] = 60,
    once: Annotated[
        bool, typer.Option("--one-canvas", help="The tiles are parts of one canvas that you move under the machine.")
    ] = False,
    out: Annotated[Path, taking("FOLDER", "The folder to make.", parser=out_folder)] = Path("tiles"),
) -> None:
    """Cut the plan of a picture that is larger than your machine into tiles, each an ordinary painting.

    Tiles are sheets that you cut and lay edge to edge, or parts of one canvas (--one-canvas). A stroke that a cut
    crosses is painted on both sheets. Colours are those of the whole. Each tile is painted with the printed command,
    and resumed as any painting; `frida-painter render FOLDER` joins them.
    """
    from frida_painter_cli.tiling import write_tiles

    for line in write_tiles(plan, CanvasSize.parse(sheet), overlap / 1000, out, once=once):
        print(line)


def check(
    plan: PlanFile,
    robot: Annotated[
        str | None,
        taking("NAME", "The robot to check, as in paint --robot. [dim]any robot in the workspace, or virtual[/]"),
    ] = None,
    workspace: Annotated[
        Path | None, taking("FILE", "The workspace file of the easel (TOML). [dim]the virtual studio's own[/]")
    ] = None,
    calibration: _Record = None,
    camera: CameraOption = "",
    out: PictureOut = Path("check.png"),
) -> None:
    """Check whether a robot can paint a whole plan on an easel, and how long it takes. Nothing moves.

    Every motion is checked: strokes, dips, rinses, wipes. A controller that answers is asked for its
    speeds, accelerations and travel. If something cannot be done, it is told, a picture shows the
    strokes in red, and the exit status is 1.
    """
    from frida_painter_cli.plan_output import check_plan

    if not check_plan(plan, robot, workspace, calibration, out, camera):
        raise typer.Exit(1)


def trace(
    robot: RobotOption,
    plan: Annotated[
        Path | None,
        typer.Argument(metavar="[PLAN]", help="A plan.json, or the folder of a painting.", show_default=False),
    ] = None,
    workspace: WorkspaceOption = None,
    calibration: _Record = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before the robot moves. For scripts.")] = False,
) -> None:
    """Trace the outline of the canvas and of a plan in the air, without paint.

    The tip goes round the canvas, from its bottom-left corner, and then round all strokes of the plan, at the
    hover height of the workspace above the canvas. Watch whether it follows the edges. Every motion is checked
    before anything moves. Ctrl-C ends it after the present side, and a second Ctrl-C stops the robot at once.
    """
    from frida_painter.system.devices import prepare_process

    prepare_process()
    if not _trace_plan(plan, robot, workspace, calibration, ask=not yes):
        raise typer.Exit(1)


def print_example() -> None:
    """Print an example of a workspace file with comments. Save it as your own file and enter your measures."""
    from frida_painter.hardware.workcell import example

    print(example(), end="")


def draw(
    workspace: Annotated[Path, typer.Argument(metavar="FILE", help="A workspace file (TOML).", show_default=False)],
    out: PictureOut = Path("workspace.png"),
) -> None:
    """Draw a workspace from above. Compare the drawing with your table."""
    from frida_painter.hardware.workcell import WorkcellConfig
    from frida_painter.report.sheets import workspace_plan
    from frida_painter.system import images

    workcell = WorkcellConfig.load(workspace)
    images.save(workspace_plan(workcell.workspace, workcell.canvas, workcell.easel), out)
    print(f"{workcell.easel}: {count_of(len(workcell.workspace.wells), 'well')}, canvas of {workcell.canvas}: {out}")


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("mix")(mix)
    app.command("export")(with_fields(export))
    app.command("tiles")(tiles)
    app.command("check")(check)
    app.command("trace")(trace)
    group = typer.Typer(
        no_args_is_help=True,
        help="Describe the workspace of a robot: where canvas, wells, water and rag stand, in metres.",
    )
    group.command("example")(print_example)
    group.command("draw")(draw)
    app.add_typer(group, name="workspace")
