"""The commands for the experiments of the paper and more: experiments NAME, experiments list."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from frida_painter.options import out_folder, whole_number_within

if TYPE_CHECKING:
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.lab import ExperimentScale
    from frida_painter.lab.conduct import MakeExperiment
    from frida_painter.lab.targets import Target
    from frida_painter.lab.trials import Notify, Outcome


# Common options of the commands (brush, seeds, pictures, library, folder, jobs), and how they run an experiment.

_seed = whole_number_within(0, 2**31 - 1)


def seeds_of(text: str) -> tuple[int, ...]:
    """Parses "0,1,2" to numbers. Raises typer.BadParameter."""
    seeds = tuple(_seed(part) for part in text.split(","))
    if len(set(seeds)) < len(seeds):
        raise typer.BadParameter(f"{text[:40]!r} names a seed twice")
    return seeds


def _brush(name: str) -> str:
    """Returns the name of a brush after a check for its stroke model. Raises WeightsError."""
    from frida_painter.brush.weights import load_stroke_model  # imported late: help loads no networks

    load_stroke_model(name)
    return name


BrushName = Annotated[str, typer.Option(parser=_brush, metavar="NAME", help="The brush: fine, medium or broad.")]
Seed = Annotated[int, typer.Option(parser=_seed, metavar="N", help="Random seed.")]
Seeds = Annotated[
    Any,
    typer.Option(parser=seeds_of, metavar="N,N,...", help="Random seeds. The experiment runs once with each."),
]
Photo = Annotated[
    Path | None, typer.Option("--target", metavar="PHOTO", help="The picture to paint. [dim]a cup of coffee[/]")
]
Photos = Annotated[
    list[Path] | None,
    typer.Option(
        "--target", metavar="PHOTO", help="A picture to paint. May be repeated. [dim]some of the project's[/]"
    ),
]
Styles = Annotated[
    list[Path] | None,
    typer.Option("--style", metavar="PICTURE", help="A style picture. May be repeated. [dim]two of the project's[/]"),
]
Style = Annotated[
    Path | None, typer.Option("--style", metavar="PICTURE", help="A style picture. [dim]one of the project's[/]")
]
Quick = Annotated[bool, typer.Option("--quick", help="Run a very small version as a test. Its figures mean nothing.")]
Out = Annotated[
    Path,
    typer.Option(
        parser=out_folder,
        metavar="FOLDER",
        help="The output folder. Writes table.json, table.md and pictures into FOLDER/NAME.",
    ),
]
Library = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="A stroke library (.npz). [dim]200 strokes, painted in the virtual studio[/]"),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        parser=whole_number_within(1, 4096),
        metavar="N",
        help="Number of trials at the same time. [dim]as many as there are cores and memory for[/]",
    ),
]
HERE = Path("experiments")


def pictures_of(given: Sequence[Path] | None, shipped: Sequence[str]) -> "tuple[Target, ...]":
    """Returns the user's own pictures, or some of the project's by their names."""
    from frida_painter.lab import targets

    return targets.load_targets(given) if given else targets.load_shipped_targets(shipped)


def run_under_progress(name: str, out: Path, run: "Callable[[Path, Notify], Outcome]") -> None:
    """Runs an experiment under a progress bar, and writes its outcome to out/NAME."""
    from frida_painter.lab.conduct import conduct

    conduct(name, out, run)


def run_trials(name: str, out: Path, make: "MakeExperiment", jobs: int | None) -> None:
    """Runs the trials of the experiment that `make` makes, in several processes at once, under a progress bar."""
    from frida_painter.lab.conduct import run_in_processes

    run_under_progress(name, out, lambda keep, notify: run_in_processes(make, keep, notify, jobs))


# The commands of experiments about paintings: experiments ladder, replanning, text and others.

_PROMPTS = 20  # number of prompts in the experiment `text`


def sim2real(
    brush: BrushName = "broad",
    seeds: Seeds = "0,1,2",
    target: Photos = None,
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Measure the sim2real gap of paintings for our planner and two planners like earlier work."""
    from frida_painter.lab import sim2real as it
    from frida_painter.lab import targets

    scale = (it.QUICK if quick else it.FULL).with_values(brush=brush)
    run_trials(
        it.NAME, out, partial(it.experiment, pictures_of(target, targets.SHIPPED), seeds=seeds, scale=scale), jobs
    )


def ladder(
    brush: BrushName = "broad",
    seeds: Seeds = "0",
    target: Photos = None,
    strokes: Annotated[
        int | None,
        typer.Option(parser=whole_number_within(13, 1000), metavar="N", help="Number of strokes. [dim]200[/]"),
    ] = None,
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Find where a painting loses quality: looks, placement, and each imperfection of robot, paint and camera."""
    from frida_painter.lab import ladder as it

    scale = (it.QUICK if quick else it.FULL).with_values(brush=brush, **({"strokes": strokes} if strokes else {}))
    photographs = pictures_of(target, it.PHOTOGRAPHS[: 1 if quick else None])
    run_trials(it.NAME, out, partial(it.experiment, photographs, seeds=seeds, scale=scale), jobs)


def replanning(
    brush: BrushName = "broad",
    seeds: Seeds = "0,1,2",
    target: Photo = None,
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Compare paintings with and without replanning: the distance to the first plan and to the target."""
    from frida_painter.lab import replanning as it

    (picture,) = pictures_of([target] if target else None, ["coffee"])
    scale = (it.QUICK if quick else it.FULL).with_values(brush=brush)
    run_trials(it.NAME, out, partial(it.experiment, picture, seeds=seeds, scale=scale), jobs)


def sawyer(
    brush: BrushName = "broad", seed: Seed = 0, target: Photo = None, quick: Quick = False, out: Out = HERE
) -> None:
    """Compare the simulated Sawyer with kinematic execution of the same plan: tracking error and its effect."""
    from frida_painter.lab import sawyer as it

    (picture,) = pictures_of([target] if target else None, ["coffee"])
    scale = (it.QUICK if quick else it.FULL).with_values(brush=brush)
    run_under_progress(it.NAME, out, lambda keep, notify: it.run(picture, seed=seed, scale=scale, notify=notify))


def text(
    brush: BrushName = "broad",
    seeds: Seeds = "0",
    first: Annotated[
        int,
        typer.Option(parser=whole_number_within(1, _PROMPTS), metavar="N", help="Use only the first N prompts."),
    ] = _PROMPTS,
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Paint text prompts and score them by a network that planning does not use, against baselines."""
    from frida_painter.lab import text as it

    scale = (it.QUICK if quick else it.FULL).with_values(brush=brush)
    run_trials(
        it.NAME, out, partial(it.experiment, it.PROMPTS[: 2 if quick else first], seeds=seeds, scale=scale), jobs
    )


def style(
    brush: BrushName = "broad",
    seeds: Seeds = "0,1",
    target: Photos = None,
    image: Styles = None,
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Measure the style distance of paintings with features that the optimiser does not use."""
    from frida_painter.lab import paintings, targets
    from frida_painter.lab import style as it

    photos, styles = pictures_of(target, ["cat", "astronaut"]), pictures_of(image, targets.STYLES)
    scale = (paintings.QUICK if quick else paintings.FULL).with_values(brush=brush)
    run_trials(it.NAME, out, partial(it.experiment, photos, styles, seeds=seeds, scale=scale), jobs)


def semantic(
    brush: BrushName = "broad",
    seeds: Seeds = "0,1",
    target: Photos = None,
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Compare painting by content with painting by pixels, scored by a network that no optimiser uses."""
    from frida_painter.lab import paintings, targets
    from frida_painter.lab import semantic as it

    scale = (paintings.QUICK if quick else paintings.FULL).with_values(brush=brush)
    run_trials(
        it.NAME, out, partial(it.experiment, pictures_of(target, targets.PHOTOGRAPHS), seeds=seeds, scale=scale), jobs
    )


def sketch(
    brush: BrushName = "broad",
    seeds: Seeds = "0,1",
    target: Annotated[
        list[Path] | None,
        typer.Option(
            "--target",
            metavar="DRAWING",
            help="A drawing. Its file name is the text prompt. May be repeated. [dim]four of the project's[/]",
        ),
    ] = None,
    image: Style = None,
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Paint text prompts along a drawing, with and without the sketch objective, and in a style."""
    from frida_painter.lab import paintings, targets
    from frida_painter.lab import sketch as it
    from frida_painter.lab.conduct import UNFINISHED

    drawings = pictures_of(target, targets.DRAWINGS)
    (style,) = pictures_of([image] if image else None, targets.STYLES[:1])
    scale = (paintings.QUICK if quick else paintings.FULL).with_values(brush=brush)

    lines = out / it.NAME / UNFINISHED
    run_trials(it.NAME, out, partial(it.experiment, drawings, style, lines, seeds=seeds, scale=scale), jobs)


def composition(
    brush: BrushName = "broad",
    seeds: Seeds = "0",
    image: Styles = None,
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Paint text prompts from a style picture, and measure its composition and whether the prompt is still seen."""
    from frida_painter.lab import composition as it
    from frida_painter.lab import paintings, targets

    styles, prompts = pictures_of(image, targets.STYLES), it.SAID[: 1 if quick else None]
    scale = (paintings.QUICK if quick else paintings.FULL).with_values(brush=brush)
    run_trials(it.NAME, out, partial(it.experiment, styles, prompts, seeds=seeds, scale=scale), jobs)


# The commands of experiments about strokes: experiments continuous-strokes, stroke-model and others.


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
    from frida_painter.lab import continuous_strokes as it

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
    from frida_painter.lab import stroke_models as it

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
    from frida_painter.lab import strokes_needed as it
    from frida_painter.lab.conduct import run_in_processes

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
    from frida_painter.lab import real_strokes as it
    from frida_painter.lab.conduct import run_in_processes

    scale = it.QUICK if quick else it.FULL

    def run(strokes: "StrokeLibrary", name: str, keep: Path, notify: "Notify") -> "Outcome":
        return run_in_processes(partial(it.experiment, strokes, name, seeds=seeds, scale=scale), keep, notify, jobs)

    _conduct_on_library(it.NAME, out, library, brush, 0, scale, run)


def robustness(brush: BrushName = "broad", seed: Seed = 0, quick: Quick = False, out: Out = HERE) -> None:
    """Test calibration with missing paint, blur, changed light, moved paper, missing dots and a rotated checker."""
    from frida_painter.lab import robustness as it

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
    """Runs an experiment on a given library, or on one that is painted first."""
    from frida_painter.lab.paintings import library_of

    def on_library(keep: Path, notify: "Notify") -> "Outcome":
        strokes, its_name, rest = library_of(library, brush, seed, scale, notify)
        return run(strokes, its_name, keep, rest)

    run_under_progress(name, out, on_library)


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        no_args_is_help=True,
        help="Run the experiments of the paper and more. Each command measures anew and writes tables and pictures.",
    )
    group.command("list")(list_all)
    for command in (
        continuous_strokes, stroke_model, strokes_needed, real_strokes, sim2real, ladder, replanning, robustness,
        sawyer, text, style, semantic, sketch, composition,
    ):  # fmt: skip
        group.command(command.__name__.replace("_", "-"))(command)
    app.add_typer(group, name="experiments")


def list_all(context: typer.Context) -> None:
    """List the experiments."""
    assert context.parent is not None
    for name, command in context.parent.command.commands.items():  # type: ignore[attr-defined]
        if name != "list":
            print(f"{name:20} {command.get_short_help_str(100)}")
