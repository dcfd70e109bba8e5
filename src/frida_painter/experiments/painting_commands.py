"""The commands of experiments about paintings: experiments ladder, replanning, text and others."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from frida_painter.experiments.command_options import (
    HERE,
    BrushName,
    Jobs,
    Out,
    Photo,
    Photos,
    Quick,
    Seed,
    Seeds,
    Style,
    Styles,
    pictures_of,
    run_trials,
    run_under_progress,
)
from frida_painter.options import whole_number_within

_PROMPTS = 20  # that the experiment `text` has


def sim2real(
    brush: BrushName = "broad",
    seeds: Seeds = "0,1,2",
    target: Photos = None,
    quick: Quick = False,
    jobs: Jobs = None,
    out: Out = HERE,
) -> None:
    """Measure the sim2real gap of paintings for our planner and two planners like earlier work."""
    from frida_painter.experiments import sim2real as it
    from frida_painter.experiments import targets

    scale = (it.QUICK if quick else it.FULL).changed(brush=brush)
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
    from frida_painter.experiments import ladder as it

    scale = (it.QUICK if quick else it.FULL).changed(brush=brush, **({"strokes": strokes} if strokes else {}))
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
    from frida_painter.experiments import replanning as it

    (picture,) = pictures_of([target] if target else None, ["coffee"])
    scale = (it.QUICK if quick else it.FULL).changed(brush=brush)
    run_trials(it.NAME, out, partial(it.experiment, picture, seeds=seeds, scale=scale), jobs)


def sawyer(
    brush: BrushName = "broad", seed: Seed = 0, target: Photo = None, quick: Quick = False, out: Out = HERE
) -> None:
    """Compare the simulated Sawyer with kinematic execution of the same plan: tracking error and its effect."""
    from frida_painter.experiments import sawyer as it

    (picture,) = pictures_of([target] if target else None, ["coffee"])
    scale = (it.QUICK if quick else it.FULL).changed(brush=brush)
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
    from frida_painter.experiments import text as it

    scale = (it.QUICK if quick else it.FULL).changed(brush=brush)
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
    from frida_painter.experiments import paintings, targets
    from frida_painter.experiments import style as it

    photos, styles = pictures_of(target, ["cat", "astronaut"]), pictures_of(image, targets.STYLES)
    scale = (paintings.QUICK if quick else paintings.FULL).changed(brush=brush)
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
    from frida_painter.experiments import paintings, targets
    from frida_painter.experiments import semantic as it

    scale = (paintings.QUICK if quick else paintings.FULL).changed(brush=brush)
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
    from frida_painter.experiments import paintings, targets
    from frida_painter.experiments import sketch as it
    from frida_painter.experiments.conduct import UNFINISHED

    drawings = pictures_of(target, targets.DRAWINGS)
    (style,) = pictures_of([image] if image else None, targets.STYLES[:1])
    scale = (paintings.QUICK if quick else paintings.FULL).changed(brush=brush)

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
    from frida_painter.experiments import composition as it
    from frida_painter.experiments import paintings, targets

    styles, prompts = pictures_of(image, targets.STYLES), it.SAID[: 1 if quick else None]
    scale = (paintings.QUICK if quick else paintings.FULL).changed(brush=brush)
    run_trials(it.NAME, out, partial(it.experiment, styles, prompts, seeds=seeds, scale=scale), jobs)
