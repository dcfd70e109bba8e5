"""Options of the commands of calibration and setup, in the groups that these commands pass on."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.runs.options import (
    CameraOption,
    RobotOption,
    WorkspaceOption,
    out_folder,
    taking,
    whole_number_option,
)
from frida_painter.runs.spec import RunSpec


def listing_option(*declared: str, groups: tuple[str, ...], says: str, **more: Any) -> Any:
    """Returns an option for the name of a part; its help lists the registered parts."""
    known = [part for group in groups for part in registry.parts(group)]
    return typer.Option(*declared, help=f"{says} {', '.join(known)}.", **more)


_BRUSH = listing_option("--brush", metavar="NAME", groups=(registry.STROKE_MODELS,), says="The brush. Available:")
BrushOption = Annotated[str, _BRUSH]
SeedOption = Annotated[int, whole_number_option(0, 2**31 - 1, "Random seed.")]


@dataclass(frozen=True)
class EaselOptions:
    """Easel that a person names."""

    robot: RobotOption = "virtual"
    camera: CameraOption = ""
    workspace: WorkspaceOption = None
    brush: BrushOption = "broad"
    canvas: Annotated[
        str | None,
        taking("SIZE", "Canvas size, width x height, in in, cm or mm. [dim]the workspace's, else 14x11in[/]"),
    ] = None
    seed: Annotated[
        int,
        whole_number_option(
            0,
            2**31 - 1,
            "Seed of the virtual studio: its light, robot error and brush. `paint --seed N` uses the same studio.",
        ),
    ] = 0

    def describe(self, placement_error: str | None = None) -> RunSpec:
        """Returns the description of the easel. Raises ConfigError."""
        said = {**vars(self), "placement_error": placement_error}
        return RunSpec.of(**{name: value for name, value in said.items() if value is not None})


@dataclass(frozen=True)
class SurfaceOptions:
    """Way in which the surface procedure learns the heights of the canvas: it measures points unless told otherwise."""

    points: Annotated[int, whole_number_option(2, 9, "Points of the surface procedure along each side.")] = 3
    heights: Annotated[
        Path | None, taking("FILE", "Read the height map of the surface from a TOML file, and measure nothing.")
    ] = None
    marks: Annotated[
        bool, typer.Option("--marks", help="Learn the surface from painted marks: a picture tells their widths.")
    ] = False
    picture: Annotated[
        Path | None, taking("FILE", "Your picture of the canvas with the marks. Nothing is painted.")
    ] = None


@dataclass(frozen=True)
class SetupOrder:
    """Order of a setup: what a person said before the dialogue. None is asked for, or is the preset's."""

    preset: Annotated[
        str | None, taking("NAME|FILE", "The preset of the machine, by name or as a file. [dim]asked for[/]")
    ] = None
    port: Annotated[
        str | None, taking("PORT|ADDRESS", "Where the machine is: a serial port or an address. [dim]asked for[/]")
    ] = None
    name: Annotated[str | None, taking("NAME", "The name of the easel. [dim]that of the preset[/]")] = None
    canvas: Annotated[
        CanvasSize | None,
        taking(
            "SIZE",
            "Canvas size, width x height, in in, cm or mm; two corners are then marked. [dim]measured by three[/]",
            parser=CanvasSize.parse,
        ),
    ] = None
    brush: Annotated[str | None, _BRUSH] = None
    folder: Annotated[
        Path | None,
        taking("FOLDER", "The folder for the results. [dim]one per easel in your data[/]", parser=out_folder),
    ] = None
    step: Annotated[str | None, taking("STEP", "Repeat one step: canvas, touch, surface, paint, trace or strokes.")] = (
        None
    )
    anew: Annotated[bool, typer.Option("--anew", help="Begin from the start, even if a setup was left.")] = False
