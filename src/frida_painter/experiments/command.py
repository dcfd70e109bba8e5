"""The commands that print the paper's figures and tables: experiments NAME, experiments list."""

from pathlib import Path
from typing import Annotated

import typer

from frida_painter.options import out_folder, whole_number_within

BrushName = Annotated[str, typer.Option(metavar="NAME", help="The brush: fine, medium or broad.")]
Seed = Annotated[int, typer.Option(parser=whole_number_within(0, 2**31 - 1), metavar="N", help="Random seed.")]
Seeds = Annotated[
    str, typer.Option(metavar="N,N,...", help="Random seeds. The experiment runs once with each.", show_default=True)
]
Targets = Annotated[
    list[Path] | None,
    typer.Option(
        "--target", metavar="PHOTO", help="A picture to paint. May be repeated. [dim]five of the project's[/]"
    ),
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
HERE = Path("experiments")
_PROMPTS = 20  # that the experiment `text` has


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        no_args_is_help=True,
        help="Run the experiments of the paper and more. Each command measures anew and writes tables and pictures.",
    )
    group.command("list")(list_all)
    group.command("continuous-strokes")(sweep)
    group.command("stroke-model")(beside)
    group.command("strokes-needed")(needed)
    group.command("real-strokes")(splits)
    group.command("sim2real")(gap)
    group.command("replanning")(looking)
    group.command("robustness")(dirt)
    group.command("sawyer")(arms)
    group.command("text")(words)
    group.command("style")(styles)
    group.command("semantic")(meanings)
    group.command("sketch")(drawings)
    group.command("composition")(compositions)
    app.add_typer(group, name="experiments")


def list_all(context: typer.Context) -> None:
    """List the experiments."""
    assert context.parent is not None
    for name, command in context.parent.command.commands.items():  # type: ignore[attr-defined]
        if name != "list":
            print(f"{name:20} {command.get_short_help_str(100)}")


def sweep(
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
    from frida_painter.experiments import continuous_strokes
    from frida_painter.experiments.conduct import conduct
    from frida_painter.experiments.outcome import Notify, Outcome

    scale = continuous_strokes.QUICK if quick else continuous_strokes.FULL

    def experiment(keep: Path, notify: Notify) -> Outcome:
        if library is None:
            return continuous_strokes.run(brush=brush, seed=seed, scale=scale, notify=notify)
        strokes = StrokeLibrary.load(library)
        return continuous_strokes.run_on_library(strokes, library.stem, seed=seed, scale=scale, notify=notify)

    conduct(continuous_strokes.NAME, out, experiment)


def beside(
    library: Library = None, brush: BrushName = "broad", seed: Seed = 0, quick: Quick = False, out: Out = HERE
) -> None:
    """Compare held-out strokes with the stroke model, with paired tests against a fitted Bezier curve."""
    from frida_painter.experiments import stroke_model
    from frida_painter.experiments.conduct import conduct, painted_or_given
    from frida_painter.experiments.outcome import Notify, Outcome

    scale = stroke_model.QUICK if quick else stroke_model.FULL

    def experiment(keep: Path, notify: Notify) -> Outcome:
        strokes, name, rest = painted_or_given(library, brush, seed, scale, notify)
        return stroke_model.run(strokes, name, seed=seed, scale=scale, notify=rest)

    conduct(stroke_model.NAME, out, experiment)


def needed(
    library: Library = None, brush: BrushName = "broad", seed: Seed = 0, quick: Quick = False, out: Out = HERE
) -> None:
    """Measure the error on held-out strokes against the number of training strokes."""
    from frida_painter.experiments import strokes_needed
    from frida_painter.experiments.conduct import conduct, painted_or_given
    from frida_painter.experiments.outcome import Notify, Outcome

    scale = strokes_needed.QUICK if quick else strokes_needed.FULL

    def experiment(keep: Path, notify: Notify) -> Outcome:
        strokes, name, rest = painted_or_given(library, brush, seed, scale, notify)
        return strokes_needed.run(strokes, name, seed=seed, scale=scale, keep=keep, notify=rest)

    conduct(strokes_needed.NAME, out, experiment)


def splits(
    library: Library = None,
    brush: BrushName = "broad",
    seeds: Seeds = "0,1,2,3,4",
    quick: Quick = False,
    out: Out = HERE,
) -> None:
    """Compare the errors of all stroke models over several splits of a library."""
    from frida_painter.experiments import real_strokes
    from frida_painter.experiments.conduct import conduct, painted_or_given
    from frida_painter.experiments.outcome import Notify, Outcome

    scale = real_strokes.QUICK if quick else real_strokes.FULL
    chosen = seeds_of(seeds)

    def experiment(keep: Path, notify: Notify) -> Outcome:
        strokes, name, rest = painted_or_given(library, brush, 0, scale, notify)
        return real_strokes.run(strokes, name, seeds=chosen, scale=scale, keep=keep, notify=rest)

    conduct(real_strokes.NAME, out, experiment)


def gap(
    brush: BrushName = "broad", seeds: Seeds = "0,1,2", target: Targets = None, quick: Quick = False, out: Out = HERE
) -> None:
    """Measure the sim2real gap of paintings for our planner and two planners like earlier work."""
    from frida_painter.experiments import sim2real, targets
    from frida_painter.experiments.conduct import conduct

    scale = sim2real.QUICK if quick else sim2real.FULL
    pictures = targets.given(target) if target else targets.shipped()
    chosen = seeds_of(seeds)
    conduct(
        sim2real.NAME,
        out,
        lambda keep, notify: sim2real.run(pictures, brush=brush, seeds=chosen, scale=scale, keep=keep, notify=notify),
    )


def looking(
    brush: BrushName = "broad",
    seeds: Seeds = "0,1,2",
    target: Annotated[
        Path | None, typer.Option(metavar="PHOTO", help="The picture to paint. [dim]a cup of coffee[/]")
    ] = None,
    quick: Quick = False,
    out: Out = HERE,
) -> None:
    """Compare paintings with and without replanning: the distance to the first plan and to the target."""
    from frida_painter.experiments import replanning, targets
    from frida_painter.experiments.conduct import conduct

    scale = replanning.QUICK if quick else replanning.FULL
    (picture,) = targets.given([target]) if target else targets.shipped(["coffee"])
    chosen = seeds_of(seeds)
    conduct(
        replanning.NAME,
        out,
        lambda keep, notify: replanning.run(picture, brush=brush, seeds=chosen, scale=scale, notify=notify),
    )


def dirt(brush: BrushName = "broad", seed: Seed = 0, quick: Quick = False, out: Out = HERE) -> None:
    """Test calibration with missing paint, blur, changed light, moved paper, missing dots and a rotated checker."""
    from frida_painter.experiments import robustness
    from frida_painter.experiments.conduct import conduct

    scale = robustness.QUICK if quick else robustness.FULL
    conduct(
        robustness.NAME, out, lambda keep, notify: robustness.run(brush=brush, seed=seed, scale=scale, notify=notify)
    )


def arms(
    brush: BrushName = "broad",
    seed: Seed = 0,
    target: Annotated[
        Path | None, typer.Option(metavar="PHOTO", help="The picture to paint. [dim]a cup of coffee[/]")
    ] = None,
    quick: Quick = False,
    out: Out = HERE,
) -> None:
    """Compare the simulated Sawyer with kinematic execution of the same plan: tracking error and its effect."""
    from frida_painter.experiments import sawyer, targets
    from frida_painter.experiments.conduct import conduct

    scale = sawyer.QUICK if quick else sawyer.FULL
    (picture,) = targets.given([target]) if target else targets.shipped(["coffee"])
    conduct(
        sawyer.NAME, out, lambda keep, notify: sawyer.run(picture, brush=brush, seed=seed, scale=scale, notify=notify)
    )


def words(
    brush: BrushName = "broad",
    seeds: Seeds = "0",
    first: Annotated[
        int,
        typer.Option(parser=whole_number_within(1, _PROMPTS), metavar="N", help="Use only the first N prompts."),
    ] = _PROMPTS,
    quick: Quick = False,
    out: Out = HERE,
) -> None:
    """Paint text prompts and score them by a network that planning does not use, against baselines."""
    from frida_painter import weights
    from frida_painter.experiments import text
    from frida_painter.experiments.conduct import conduct
    from frida_painter.experiments.outcome import Notify, Outcome
    from frida_painter.objectives.encoders.efficientnet import EfficientNetLite
    from frida_painter.session.opening import planning_device

    scale, prompts = text.QUICK if quick else text.FULL, text.PROMPTS[: 2 if quick else first]
    chosen = seeds_of(seeds)
    encoders = text.Unjudged(device=planning_device())
    judge = EfficientNetLite(weights.tensors("efficientnet-lite2"))

    def experiment(keep: Path, notify: Notify) -> Outcome:
        return text.run(
            encoders=encoders, judge=judge, prompts=prompts, brush=brush, seeds=chosen, scale=scale, keep=keep,
            notify=notify,
        )  # fmt: skip

    conduct(text.NAME, out, experiment)


def styles(
    brush: BrushName = "broad",
    seeds: Seeds = "0,1",
    target: Targets = None,
    image: Annotated[
        list[Path] | None,
        typer.Option(
            "--style", metavar="PICTURE", help="A style picture. May be repeated. [dim]two of the project's[/]"
        ),
    ] = None,
    quick: Quick = False,
    out: Out = HERE,
) -> None:
    """Measure the style distance of paintings with features that the optimiser does not use."""
    from frida_painter.experiments import goal_paintings, style, targets
    from frida_painter.experiments.conduct import conduct

    scale = goal_paintings.QUICK if quick else goal_paintings.FULL
    pictures = targets.given(target) if target else targets.shipped(["cat", "astronaut"])
    wanted, chosen = targets.given(image) if image else targets.shipped(targets.STYLES), seeds_of(seeds)
    conduct(
        style.NAME,
        out,
        lambda keep, notify: style.run(
            pictures, wanted, brush=brush, seeds=chosen, scale=scale, keep=keep, notify=notify
        ),
    )


def meanings(
    brush: BrushName = "broad", seeds: Seeds = "0,1", target: Targets = None, quick: Quick = False, out: Out = HERE
) -> None:
    """Compare painting by content with painting by pixels, scored by a network that no optimiser uses."""
    from frida_painter.experiments import goal_paintings, semantic, targets
    from frida_painter.experiments.conduct import conduct

    scale = goal_paintings.QUICK if quick else goal_paintings.FULL
    pictures = targets.given(target) if target else targets.shipped(targets.PHOTOGRAPHS)
    chosen = seeds_of(seeds)
    conduct(
        semantic.NAME,
        out,
        lambda keep, notify: semantic.run(pictures, brush=brush, seeds=chosen, scale=scale, keep=keep, notify=notify),
    )


def drawings(
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
    quick: Quick = False,
    out: Out = HERE,
) -> None:
    """Paint text prompts along a drawing, with and without the sketch objective."""
    from frida_painter.experiments import goal_paintings, sketch, targets
    from frida_painter.experiments.conduct import conduct

    scale = goal_paintings.QUICK if quick else goal_paintings.FULL
    pictures = targets.given(target) if target else targets.shipped(targets.DRAWINGS)
    chosen = seeds_of(seeds)
    conduct(
        sketch.NAME,
        out,
        lambda keep, notify: sketch.run(pictures, brush=brush, seeds=chosen, scale=scale, keep=keep, notify=notify),
    )


def compositions(
    brush: BrushName = "broad",
    seeds: Seeds = "0",
    image: Annotated[
        list[Path] | None,
        typer.Option(
            "--style", metavar="PICTURE", help="A style picture. May be repeated. [dim]two of the project's[/]"
        ),
    ] = None,
    quick: Quick = False,
    out: Out = HERE,
) -> None:
    """Paint text prompts from a style picture, and measure its composition and whether the prompt is still seen."""
    from frida_painter import weights
    from frida_painter.experiments import composition, goal_paintings, targets, text
    from frida_painter.experiments.conduct import conduct
    from frida_painter.experiments.outcome import Notify, Outcome
    from frida_painter.objectives.encoders.efficientnet import EfficientNetLite
    from frida_painter.session.opening import planning_device

    scale = goal_paintings.QUICK if quick else goal_paintings.FULL
    wanted, chosen = targets.given(image) if image else targets.shipped(targets.STYLES), seeds_of(seeds)
    judge, prompts = EfficientNetLite(weights.tensors("efficientnet-lite2")), composition.SAID[: 1 if quick else None]
    encoders = text.Unjudged(device=planning_device())

    def experiment(keep: Path, notify: Notify) -> Outcome:
        return composition.run(
            wanted, encoders=encoders, judge=judge, prompts=prompts, brush=brush, seeds=chosen, scale=scale,
            keep=keep, notify=notify,
        )  # fmt: skip

    conduct(composition.NAME, out, experiment)


def seeds_of(text: str) -> tuple[int, ...]:
    """ "0,1,2" as numbers. Raises typer.BadParameter."""
    read = whole_number_within(0, 2**31 - 1)
    seeds = tuple(read(part) for part in text.split(","))
    if len(set(seeds)) < len(seeds):
        raise typer.BadParameter(f"{text[:40]!r} names a seed twice")
    return seeds
