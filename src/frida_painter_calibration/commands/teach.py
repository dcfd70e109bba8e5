"""Command `teach`: marks of a person's hand become a stroke family, and the virtual studio paints it."""

import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from frida_painter.brush import FIELD, MAX_STROKES
from frida_painter.errors import ConfigError, FridaError
from frida_painter.runs.options import WorkspaceOption, out_file, taking, whole_number_option, with_fields
from frida_painter.system.operating_system import is_typed
from frida_painter_calibration.commands.strokes import learn_on, paint_library, work_bar
from frida_painter_calibration.options import BrushOption, SeedOption

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def _sizes(text: str) -> tuple[float, float]:
    """Parses "20-60" (millimetres) to metres. Raises typer.BadParameter."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?)(?:mm)?", text.strip())
    if found is None:
        raise typer.BadParameter(f"{text[:40]!r} is no range of sizes; write 20-60, in millimetres")
    return float(found[1]) / 1000, float(found[2]) / 1000


@dataclass(frozen=True)
class FamilyOptions:
    """Family of strokes to learn."""

    name: Annotated[str, taking("NAME", "The name of the family.")]
    brush: BrushOption = "fine"
    size: Annotated[
        str,
        taking(
            "A-B",
            "Smallest and largest size of its strokes in millimetres. [dim]those of the marks, with room[/]",
            show_default=False,
        ),
    ] = ""


@dataclass(frozen=True)
class ArmOptions:
    """Arm that a person guides."""

    robot: Annotated[
        str,
        taking(
            "NAME",
            "An arm that you guide by hand over its canvas, to draw the marks with it: xarm or franka.",
            show_default=False,
        ),
    ] = ""
    workspace: WorkspaceOption = None


def teach(
    *,
    marks: Annotated[
        Path | None,
        typer.Argument(
            metavar="[MARKS]",
            help="A file of marks (.json or .csv), or a folder of such files. A mark has the columns x, y and pressure "
            "(0 to 1) or height (below 0 on the canvas), and may have time. With --robot, the file to write them to.",
            show_default=False,
        ),
    ] = None,
    of: FamilyOptions,
    unit: Annotated[str, taking("m|cm|mm", "The unit of x, y and height.")] = "mm",
    count: Annotated[
        int,
        whole_number_option(
            0,
            MAX_STROKES,
            "Number of strokes that the virtual studio paints to learn from. 0 for none: the planner then expects "
            "a plain ribbon.",
        ),
    ] = 40,
    library: Annotated[
        Path | None,
        taking(
            "FILE",
            "A library of the family's strokes, to learn from instead of the virtual studio (.npz).",
            show_default=False,
        ),
    ] = None,
    arm: ArmOptions,
    seed: SeedOption = 0,
    out: Annotated[
        Path | None,
        taking(
            "FILE",
            "The family to write (.safetensors), for --strokes-of. [dim]NAME.safetensors[/]",
            parser=out_file,
            show_default=False,
        ),
    ] = None,
) -> None:
    """Teach a stroke: ten or more marks of one kind become a family of strokes for the planner.

    The marks are laid over each other, and their shapes become one or two numbers, the shape code. The
    virtual studio then paints the family, and a stroke model is learned from the photographs. A sheet beside
    the family shows the marks and what was learned. If the command was interrupted, run it again to continue.

    With --robot and --workspace, you guide the arm by hand: down to the canvas for each mark. It stays stopped
    afterwards, until you arm it.
    """
    from frida_painter.brush.kinds import brush_kind
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.system import images
    from frida_painter.system.devices import prepare_process
    from frida_painter_calibration.teaching.families import write_family
    from frida_painter_calibration.teaching.learned_pages import family_sheet
    from frida_painter_calibration.teaching.marks import learn_family, read_marks

    out = out or Path(f"{of.name}.safetensors")
    if out.suffix != ".safetensors":
        raise ConfigError(f"--out was given {str(out)!r}; a family goes into a file that ends in .safetensors.")
    if arm.robot:
        marks = marks or Path(f"{of.name}-marks.json")
        guide(arm.robot, arm.workspace, of.brush, marks)
        unit = "mm"
    elif arm.workspace is not None:
        raise ConfigError("--workspace was given without --robot; name the arm that you guide, or leave it out.")
    elif marks is None:
        raise ConfigError("No marks were given; give a file of MARKS, or an arm to guide by hand: --robot.")
    taught = read_marks(marks, unit)
    family = learn_family(taught, of.name, _sizes(of.size) if of.size else None)
    kind = brush_kind(of.brush).of_family(family)
    prepare_process()
    codes = "one shape code" if family.codes == 1 else f"{family.codes} shape codes"
    said = f"{len(taught)} marks make the family {of.name}, with {codes}."
    if count == 0 and library is None:
        write_family(out, family)
        images.save(family_sheet(family, taught), out.with_suffix(".png"))
        print(f"{said} Its strokes were not painted: {out}\nSheet: {out.with_suffix('.png')}")
        return
    if library is not None:
        strokes = StrokeLibrary.load(library)
    else:
        strokes = paint_library(kind, out.with_suffix(".npz"), count, seed).library
    with work_bar() as bar:
        learned = learn_on(bar, FIELD, strokes, kind, seed)
    learned.model.save(out)
    images.save(family_sheet(family, taught, learned.model), out.with_suffix(".png"))
    print(
        f"{said} Learned from {len(learned.library)} clean strokes of {len(strokes)} for the {of.brush} brush; on "
        f"{len(learned.report.held_out)} others the mean error of the magnitude is "
        f"{learned.report.validation_error:.4f}: {out}\nSheet: {out.with_suffix('.png')}\n"
        f"Paint with it: frida-painter paint PICTURE --brushes {of.brush} --strokes-of {out}"
    )


def guide(robot: str, workspace: Path | None, brush: str, path: Path) -> None:
    """Records marks that a person draws with a named arm, and writes them to a file.

    Raises ConfigError if there is no workspace file, the file of marks exists, or nobody is at the terminal.
    Raises the errors of `guide_arm` after the marks were written, if there are any, and FamilyError without marks.
    """
    from frida_painter.calibration import Calibration
    from frida_painter.easel.connecting import guide_arm
    from frida_painter.hardware.workcell import WorkcellConfig
    from frida_painter_calibration.calibrating import default_record
    from frida_painter_calibration.teaching.marks import MarkCutter

    if workspace is None:
        raise ConfigError(f"Where the canvas of {robot[:60]!r} is, is not known; say it with --workspace FILE.")
    if path.suffix != ".json" or path.exists():
        raise ConfigError(
            f"Marks of a guided arm go into a new .json file, and not into {str(path)!r}; give another one. A folder "
            "of several can be taught together."
        )
    if not sys.stdin.isatty():
        raise ConfigError("You end the recording with Enter; run this in a terminal beside the arm.")
    workcell = WorkcellConfig.load(workspace)
    record = default_record(workcell.easel)
    known = Calibration.load(record).of_brush(brush) if record.exists() else workcell.calibration(brush)
    cutter = MarkCutter(known.touch_height - known.press_height)

    def hear(tip: "NDArray[np.float64]", at: float) -> None:
        place, before = workcell.workspace.to_canvas(tip[None]), len(cutter.marks)
        cutter.add(place[0], float(tip[2] - known.touch_height - known.unevenness(place)[0]), at)
        if len(cutter.marks) > before:
            print(f"\r{len(cutter.marks)} marks", end="", flush=True)

    print(
        "The arm is released now: hold it, and support its weight. Guide the tip down to the canvas for each mark, and "
        "lift it in between. A Franka follows while you press the buttons at its hand. Enter ends it."
    )
    fault: FridaError | KeyboardInterrupt | None = None
    try:
        guide_arm(robot, workcell, hear, lambda: is_typed(sys.stdin.fileno(), 0))
    except (FridaError, KeyboardInterrupt) as error:
        fault = error
    cutter.finish()
    if cutter.marks or fault is None:
        for sentence in cutter.save(path):
            print(f"\n{sentence}", end="")
        print(f"\nMarks: {path}")
    if fault is not None:
        raise fault
    sys.stdin.readline()
    print("The arm holds its place and stays stopped. Look at it, then let it paint again: frida-painter arm")


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("teach")(with_fields(teach))
