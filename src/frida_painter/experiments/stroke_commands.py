"""The commands of experiments about strokes: experiments continuous-strokes, stroke-model and others."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from frida_painter.experiments.command_options import (
    HERE,
    BrushName,
    Jobs,
    Library,
    Out,
    Quick,
    Seed,
    Seeds,
    run_under_progress,
)

if TYPE_CHECKING:  # the command line lists the experiments without loading them
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.experiments.outcome import Notify, Outcome
    from frida_painter.experiments.scale import ExperimentScale


def continuous_strokes(
    library: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A stroke library to train on and to show. [dim]the brush[/]"),
    ] = None,
    brush: BrushName = "broad",
    seed: Seed = 0,
    quick: Quick = False,
    out: Out = HERE,
) -> None:
    """Sweep thickness, length and bend of a stroke, and compare the modelled with the painted strokes."""
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.experiments import continuous_strokes as it

    scale = it.QUICK if quick else it.FULL

    def run(keep: Path, notify: "Notify") -> "Outcome":
        if library is None:
            return it.run(brush=brush, seed=seed, scale=scale, notify=notify)
        strokes = StrokeLibrary.load(library)
        return it.run_on_library(strokes, library.stem, seed=seed, scale=scale, notify=notify)

    run_under_progress(it.NAME, out, run)


def stroke_model(
    library: Library = None, brush: BrushName = "broad", seed: Seed = 0, quick: Quick = False, out: Out = HERE
) -> None:
    """Compare held-out strokes with the stroke model, with paired tests against a fitted Bezier curve."""
    from frida_painter.experiments import stroke_model as it

    scale = it.QUICK if quick else it.FULL

    def run(strokes: "StrokeLibrary", name: str, keep: Path, notify: "Notify") -> "Outcome":
        return it.run(strokes, name, seed=seed, scale=scale, notify=notify)

    _conduct_on_library(it.NAME, out, library, brush, seed, scale, run)


def strokes_needed(
    library: Library = None,
    brush: BrushName = "broad",
    seed: Seed = 0,
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Measure the error on held-out strokes against the number of training strokes."""
    from frida_painter.experiments import strokes_needed as it
    from frida_painter.experiments.parallel import run_in_processes

    scale = it.QUICK if quick else it.FULL

    def run(strokes: "StrokeLibrary", name: str, keep: Path, notify: "Notify") -> "Outcome":
        return run_in_processes(partial(it.experiment, strokes, name, seed=seed, scale=scale), keep, notify, jobs)

    _conduct_on_library(it.NAME, out, library, brush, seed, scale, run)


def real_strokes(
    library: Library = None,
    brush: BrushName = "broad",
    seeds: Seeds = "0,1,2,3,4",
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Compare the errors of all stroke models over several splits of a library."""
    from frida_painter.experiments import real_strokes as it
    from frida_painter.experiments.parallel import run_in_processes

    scale = it.QUICK if quick else it.FULL

    def run(strokes: "StrokeLibrary", name: str, keep: Path, notify: "Notify") -> "Outcome":
        return run_in_processes(partial(it.experiment, strokes, name, seeds=seeds, scale=scale), keep, notify, jobs)

    _conduct_on_library(it.NAME, out, library, brush, 0, scale, run)


def robustness(brush: BrushName = "broad", seed: Seed = 0, quick: Quick = False, out: Out = HERE) -> None:
    """Test calibration with missing paint, blur, changed light, moved paper, missing dots and a rotated checker."""
    from frida_painter.experiments import robustness as it

    scale = it.QUICK if quick else it.FULL
    run_under_progress(it.NAME, out, lambda keep, notify: it.run(brush=brush, seed=seed, scale=scale, notify=notify))


def _conduct_on_library(
    name: str,
    out: Path,
    library: Path | None,
    brush: str,
    seed: int,
    scale: "ExperimentScale",
    run: "Callable[[StrokeLibrary, str, Path, Notify], Outcome]",
) -> None:
    """Runs an experiment on a library that is given, or that is painted first."""
    from frida_painter.experiments.execution import library_of

    def on_library(keep: Path, notify: "Notify") -> "Outcome":
        strokes, its_name, rest = library_of(library, brush, seed, scale, notify)
        return run(strokes, its_name, keep, rest)

    run_under_progress(name, out, on_library)
