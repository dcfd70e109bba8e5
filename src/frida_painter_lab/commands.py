"""The commands for the experiments of the paper and more: experiments NAME, experiments list.

`ROWS` is the table of experiments. A row names the class of an experiment; its options are fields of that class, and
the command is made from them.
"""

import math
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from inspect import Parameter, Signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from frida_painter.runs.options import out_folder, whole_number_within
from frida_painter.system.storage import PART, count_of

if TYPE_CHECKING:
    from frida_painter_lab.experiment import Experiment, Notify, Outcome, Progress

MAX_PROMPTS = 20
"""Number of prompts in the experiment `text`."""
UNFINISHED = f"{PART}unfinished"
"""Name of the folder for finished runs, inside the experiment's folder, until all are done."""
_PREPARING = 0.2  # share of the time for what all runs share, such as a stroke library
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


def _option(
    kind: Any, metavar: str, words: str, default: Any, parser: Callable[[str], Any] | None = None, flag: str = ""
) -> tuple[Any, Any]:
    names = [f"--{flag}"] if flag else []
    return Annotated[kind, typer.Option(*names, parser=parser, metavar=metavar, help=words)], default


_File, _Files, _Number = Path | None, list[Path] | None, int | None
_DRAWINGS = "A drawing. Its file name is the text prompt. May be repeated. [dim]four of the project's[/]"
_JOBS = "Number of runs at the same time. [dim]as many as there are cores and memory for[/]"
_OUT = "The output folder. Writes table.json, table.md and pictures into FOLDER/NAME."
# Every option of an experiment by the name of its field, in the order of the help.
_OPTIONS: Mapping[str, tuple[Any, Any]] = {
    "library": _option(_File, "FILE", "A stroke library (.npz). [dim]the brush in the virtual studio[/]", None),
    "brush": _option(str, "NAME", "The brush: fine, medium or broad.", "broad", _brush),
    "seed": _option(int, "N", "Random seed.", 0, _seed),
    "seeds": _option(Any, "N,N,...", "Random seeds. The experiment runs once with each.", "0", seeds_of),
    "photo": _option(_File, "PHOTO", "The picture to paint. [dim]a cup of coffee[/]", None, flag="target"),
    "photos": _option(
        _Files, "PHOTO", "A picture to paint. May be repeated. [dim]some of the project's[/]", None, flag="target"
    ),
    "drawings": _option(_Files, "DRAWING", _DRAWINGS, None, flag="target"),
    "strokes": _option(_Number, "N", "Number of strokes. [dim]200[/]", None, whole_number_within(13, 1000)),
    "first": _option(int, "N", "Use only the first N prompts.", MAX_PROMPTS, whole_number_within(1, MAX_PROMPTS)),
    "style": _option(_File, "PICTURE", "A style picture. [dim]one of the project's[/]", None),
    "styles": _option(
        _Files, "PICTURE", "A style picture. May be repeated. [dim]two of the project's[/]", None, flag="style"
    ),
    "quick": (
        Annotated[bool, typer.Option("--quick", help="Run a very small version as a test. Its figures mean nothing.")],
        False,
    ),
    "jobs": _option(_Number, "N", _JOBS, None, whole_number_within(1, 4096)),
    "out": _option(Path, "FOLDER", _OUT, Path("experiments"), out_folder),
}
_ALWAYS = {"brush", "quick", "jobs", "out"}


@dataclass(frozen=True)
class ExperimentRow:
    """Row of the table of experiments.

    name: of its command
    question: its purpose in one sentence
    place: module of frida_painter_lab and class
    takes: its options besides those of all experiments
    seeds: default of --seeds
    shipped: pictures for each of its options for pictures, if the person gives none: their names, or the name of a
        list in targets/
    quick: number of these pictures in a quick run; None for all
    """

    name: str
    question: str
    place: str
    takes: tuple[str, ...]
    seeds: str = "0"
    shipped: Mapping[str, str | tuple[str, ...]] = field(default_factory=dict)
    quick: int | None = None

    def command(self) -> Callable[..., None]:
        """Returns the command."""
        options = {name: each for name, each in _OPTIONS.items() if name in _ALWAYS | set(self.takes)}

        def run(**given: Any) -> None:
            conduct(self.open(given), given["out"] / self.name, given["jobs"])

        run.__doc__ = self.question
        run.__annotations__ = {name: kind for name, (kind, _) in options.items()}
        run.__signature__ = Signature([  # type: ignore[attr-defined]
            Parameter(
                name, Parameter.KEYWORD_ONLY, default=self.seeds if name == "seeds" else default, annotation=kind
            )
            for name, (kind, default) in options.items()
        ])  # fmt: skip
        return run

    def open(self, given: Mapping[str, Any]) -> "Experiment":
        """Returns the experiment with the given options."""
        module, _, name = self.place.partition(":")
        kind: type[Experiment] = getattr(import_module(f"frida_painter_lab.{module}"), name)
        values = {name: given[name] for name in {"brush", "quick", *self.takes}}
        values |= {option: self._pictures(option, given) for option in self.shipped}
        return kind(**values)

    def _pictures(self, option: str, given: Mapping[str, Any]) -> Any:
        """Returns the pictures of an option: one, or several in a tuple."""
        from frida_painter_lab import targets

        own, shipped, one = given[option], self.shipped[option], option in ("photo", "style")
        if own:
            found = targets.load_targets([own] if one else own)
        else:
            names = getattr(targets, shipped) if isinstance(shipped, str) else shipped
            count = 1 if one else self.quick if given["quick"] else None
            found = targets.load_shipped_targets(names[:count])
        return found[0] if one else found


ROWS = (
    ExperimentRow(
        "continuous-strokes",
        "Sweep thickness, length and bend of a stroke, and compare the modelled with the painted strokes.",
        "continuous_strokes:ContinuousStrokes", ("seed",),
    ),
    ExperimentRow(
        "stroke-model",
        "Compare held-out strokes with the stroke model, with paired tests against a fitted Bezier curve.",
        "stroke_models:StrokeModels", ("library", "seed"),
    ),
    ExperimentRow(
        "strokes-needed",
        "Measure the error on held-out strokes against the number of training strokes, and compare all stroke models.",
        "stroke_models:StrokesNeeded", ("library", "seeds"), "0,1,2,3,4",
    ),
    ExperimentRow(
        "sim2real", "Measure the sim2real gap of paintings for our planner and two planners like earlier work.",
        "simulation_gap:Sim2Real", ("seeds", "photos"), "0,1,2", {"photos": "SHIPPED"},
    ),
    ExperimentRow(
        "ladder",
        "Find where a painting loses quality: looks, placement, and each imperfection of robot, paint and camera.",
        "simulation_gap:Ladder", ("seeds", "photos", "strokes"),
        shipped={"photos": ("rocket", "astronaut", "coffee", "cat")}, quick=1,
    ),
    ExperimentRow(
        "replanning",
        "Compare paintings with and without replanning: the distance to the first plan and to the target.",
        "simulation_gap:Replanning", ("seeds", "photo"), "0,1,2", {"photo": ("coffee",)},
    ),
    ExperimentRow(
        "text", "Paint text prompts and score them by a network that planning does not use, against baselines.",
        "goals:TextExperiment", ("seeds", "first"),
    ),
    ExperimentRow(
        "style", "Measure the style distance of paintings with features that the optimiser does not use.",
        "goals:StyleExperiment", ("seeds", "photos", "styles"), "0,1",
        {"photos": ("cat", "astronaut"), "styles": "STYLES"},
    ),
    ExperimentRow(
        "semantic", "Compare painting by content with painting by pixels, scored by a network that no optimiser uses.",
        "goals:SemanticExperiment", ("seeds", "photos"), "0,1", {"photos": "PHOTOGRAPHS"},
    ),
    ExperimentRow(
        "sketch", "Paint text prompts along a drawing, with and without the sketch objective, and in a style.",
        "goals:SketchExperiment", ("seeds", "drawings", "style"), "0,1", {"drawings": "DRAWINGS", "style": "STYLES"},
    ),
)  # fmt: skip


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        no_args_is_help=True,
        help="Run the experiments of the paper and more. Each command measures anew and writes tables and pictures.",
    )
    group.command("list")(list_all)
    for row in ROWS:
        group.command(row.name)(row.command())
    app.add_typer(group, name="experiments")


def list_all() -> None:
    """List the experiments."""
    for row in ROWS:
        print(f"{row.name:20} {row.question}")


def conduct(experiment: "Experiment", folder: Path, jobs: int | None = None, *, stays: bool = False) -> "Outcome":
    """Runs an experiment under a progress bar, writes its outcome, and prints where it is.

    folder: takes the outcome, and meanwhile the finished runs
    jobs: greatest number of runs at the same time
    stays: True if the finished runs stay, so that more of them can be done later

    Raises the errors of the experiment, and StorageError.
    """
    from frida_painter.session.time_left import duration
    from frida_painter.system.devices import prepare_process
    from frida_painter_lab.experiment import within

    prepare_process()
    started, keep = time.monotonic(), folder if stays else folder / UNFINISHED
    with show_progress() as hear:
        ready = experiment.prepare(within(hear, 0.0, _PREPARING))
        first = _PREPARING if ready is not experiment else 0.0
        found = ready.run_in_processes(keep, within(hear, first, 1.0), jobs)
    found.save(folder)
    if not stays:
        shutil.rmtree(keep, ignore_errors=True)
    print("\n".join([found.title, *(f"  {note}" for note in found.notes)]))
    print(f"In {duration(time.monotonic() - started)}: {folder / 'table.md'}, table.json and", end=" ")
    print(f"{count_of(len(found.pictures), 'picture')}.")
    return found


@contextmanager
def show_progress() -> "Iterator[Notify]":
    """Shows a bar on the terminal within a `with` block, and yields what hears the progress."""
    from rich.console import Console

    from frida_painter.session.time_left import remaining_seconds
    from frida_painter_cli.terminal import Line

    bar, started, done_before = Line(Console(stderr=True, highlight=False)), time.monotonic(), math.inf

    def hear(progress: "Progress") -> None:
        nonlocal done_before
        done_before = min(done_before, progress.share)
        share = (progress.share - done_before) / max(1 - done_before, 1e-9)
        left = remaining_seconds(time.monotonic() - started, share)
        bar.update(bar.task, description=progress.doing, completed=progress.share, left=left)

    with bar:
        yield hear
