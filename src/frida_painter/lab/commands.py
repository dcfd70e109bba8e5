"""The commands for the experiments of the paper and more: experiments NAME, experiments list.

`ROWS` is the table of experiments. A command and the call of its experiment are made from a row. The function of an
experiment stands in the module of its name: `experiment` if its trials can run in processes, otherwise `run`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from frida_painter.options import out_folder, whole_number_within

if TYPE_CHECKING:
    from frida_painter.lab.trials import Notify, Outcome

MAX_PROMPTS = 20
"""Number of prompts in the experiment `text`."""
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


def _option(kind: Any, metavar: str, words: str, parser: Callable[[str], Any] | None = None) -> Any:
    return Annotated[kind, typer.Option(parser=parser, metavar=metavar, help=words)]


_File, _Files, _Number = Path | None, list[Path] | None, int | None
_ON = "A stroke library (.npz). [dim]200 strokes, painted in the virtual studio[/]"
_DRAWINGS = "A drawing. Its file name is the text prompt. May be repeated. [dim]four of the project's[/]"
_JOBS = "Number of trials at the same time. [dim]as many as there are cores and memory for[/]"
_QUICK = "Run a very small version as a test. Its figures mean nothing."
_OUT = "The output folder. Writes table.json, table.md and pictures into FOLDER/NAME."
# Every option of an experiment, in the order of the help: its parameter, its kind and its default.
_OPTIONS: Mapping[str, tuple[str, Any, Any]] = {
    "library": ("library", _option(_File, "FILE", _ON), None),
    "own library": (
        "library", _option(_File, "FILE", "A stroke library to train on and to show. [dim]the brush[/]"), None
    ),
    "brush": ("brush", _option(str, "NAME", "The brush: fine, medium or broad.", _brush), "broad"),
    "seed": ("seed", _option(int, "N", "Random seed.", _seed), 0),
    "seeds": ("seeds", _option(Any, "N,N,...", "Random seeds. The experiment runs once with each.", seeds_of), "0"),
    "photo": ("target", _option(_File, "PHOTO", "The picture to paint. [dim]a cup of coffee[/]"), None),
    "photos": (
        "target", _option(_Files, "PHOTO", "A picture to paint. May be repeated. [dim]some of the project's[/]"), None
    ),
    "drawings": ("target", _option(_Files, "DRAWING", _DRAWINGS), None),
    "strokes": (
        "strokes", _option(_Number, "N", "Number of strokes. [dim]200[/]", whole_number_within(13, 1000)), None
    ),
    "first": (
        "first", _option(int, "N", "Use only the first N prompts.", whole_number_within(1, MAX_PROMPTS)), MAX_PROMPTS
    ),
    "style": ("style", _option(_File, "PICTURE", "A style picture. [dim]one of the project's[/]"), None),
    "styles": (
        "style", _option(_Files, "PICTURE", "A style picture. May be repeated. [dim]two of the project's[/]"), None
    ),
    "quick": ("quick", Annotated[bool, typer.Option("--quick", help=_QUICK)], False),
    "jobs": ("jobs", _option(_Number, "N", _JOBS, whole_number_within(1, 4096)), None),
    "out": ("out", _option(Path, "FOLDER", _OUT, out_folder), Path("experiments")),
}  # fmt: skip


@dataclass(frozen=True)
class ExperimentRow:
    """Row of the table of experiments.

    name: of its command
    help: its purpose in one sentence
    takes: its options besides --brush, --quick and --out
    seeds: default of --seeds
    shipped: pictures for each of its options for pictures, if the person gives none: their names, or the name of a
        list of its module or of lab/targets
    prompts: list of prompts in its module; "" if it has none
    quick: number of its prompts, or of its shipped pictures, in a quick run
    keeps: True if its function also gets the folder of finished parts
    module: in lab/, by default named as the command
    """

    name: str
    help: str
    takes: tuple[str, ...]
    seeds: str = "0"
    shipped: tuple[str | tuple[str, ...], ...] = ()
    prompts: str = ""
    quick: int | None = None
    keeps: bool = False
    module: str = ""

    def command(self) -> Callable[..., None]:
        """Returns the command."""
        options = [_OPTIONS[name] for name in _OPTIONS if name in {*self.takes, "brush", "quick", "out"}]

        def run(**given: Any) -> None:
            from frida_painter.lab.conduct import conduct

            conduct(self.name, given["out"], lambda keep, notify: self.run(given, keep, notify))

        run.__doc__ = self.help
        run.__annotations__ = {name: kind for name, kind, _ in options}
        defaults = {name: self.seeds if name == "seeds" else default for name, _, default in options}
        run.__signature__ = Signature([  # type: ignore[attr-defined]
            Parameter(name, Parameter.KEYWORD_ONLY, default=defaults[name], annotation=kind)
            for name, kind, _ in options
        ])  # fmt: skip
        return run

    def run(self, given: Mapping[str, Any], keep: Path, notify: "Notify") -> "Outcome":
        """Runs the experiment with the given options, and returns its outcome.

        keep: folder of finished parts
        """
        from frida_painter.lab import ExperimentScale, conduct, paintings

        it = import_module(f"frida_painter.lab.{self.module or self.name.replace('-', '_')}")
        scales = it if hasattr(it, "QUICK") else paintings
        scale = scales.QUICK if given["quick"] else scales.FULL
        if not isinstance(scale, ExperimentScale):
            strokes = given.get("strokes")
            scale = scale.with_values(brush=given["brush"], **({"strokes": strokes} if strokes else {}))
        arguments = self._pictures(it, given)
        if "library" in self.takes:  # a given one, or one that is painted first
            *arguments, notify = paintings.library_of(
                given["library"], given["brush"], given.get("seed", 0), scale, notify
            )
        if self.prompts:
            arguments.append(getattr(it, self.prompts)[: self.quick if given["quick"] else given.get("first")])
        arguments += [keep] if self.keeps else []
        function = it.experiment if "jobs" in self.takes else it.run
        named = {"brush", "seed", "seeds", *(["library"] if "own library" in self.takes else [])}
        known = {name: given[name] for name in named & given.keys() & signature(function).parameters.keys()}
        bound = partial(function, *arguments, **known, scale=scale)
        if "jobs" in self.takes:
            return conduct.run_in_processes(bound, keep, notify, given["jobs"])
        found: Outcome = bound(notify=notify)
        return found

    def _pictures(self, it: Any, given: Mapping[str, Any]) -> list[Any]:
        """Returns the pictures of each option: one, or several in a tuple."""
        from frida_painter.lab import targets

        found: list[Any] = []
        options = [name for name in self.takes if name in ("photo", "photos", "drawings", "style", "styles")]
        for option, shipped in zip(options, self.shipped, strict=True):
            own = given[_OPTIONS[option][0]]
            names = getattr(it, shipped, None) or getattr(targets, shipped) if isinstance(shipped, str) else shipped
            names = names[: self.quick] if given["quick"] and not self.prompts else names
            one = option in ("photo", "style")
            own = [own] if one and own else own
            pictures = targets.load_targets(own) if own else targets.load_shipped_targets(names[:1] if one else names)
            found.append(pictures[0] if one else pictures)
        return found


ROWS = (
    ExperimentRow(
        "continuous-strokes",
        "Sweep thickness, length and bend of a stroke, and compare the modelled with the painted strokes.",
        ("own library", "seed"),
    ),
    ExperimentRow(
        "stroke-model",
        "Compare held-out strokes with the stroke model, with paired tests against a fitted Bezier curve.",
        ("library", "seed"), module="stroke_models",
    ),
    ExperimentRow(
        "taught-strokes",
        "Measure the strokes that a person taught: shape codes, stroke models, and a drawing of long lines.",
        ("seed",),
    ),
    ExperimentRow(
        "strokes-needed", "Measure the error on held-out strokes against the number of training strokes.",
        ("library", "seed", "jobs"),
    ),
    ExperimentRow(
        "real-strokes", "Compare the errors of all stroke models over several splits of a library.",
        ("library", "seeds", "jobs"), seeds="0,1,2,3,4",
    ),
    ExperimentRow(
        "sim2real", "Measure the sim2real gap of paintings for our planner and two planners like earlier work.",
        ("seeds", "photos", "jobs"), seeds="0,1,2", shipped=("SHIPPED",),
    ),
    ExperimentRow(
        "ladder",
        "Find where a painting loses quality: looks, placement, and each imperfection of robot, paint and camera.",
        ("seeds", "photos", "strokes", "jobs"), shipped=("PHOTOGRAPHS",), quick=1,
    ),
    ExperimentRow(
        "replanning",
        "Compare paintings with and without replanning: the distance to the first plan and to the target.",
        ("seeds", "photo", "jobs"), seeds="0,1,2", shipped=(("coffee",),),
    ),
    ExperimentRow(
        "disturbances",
        "Compare paintings with and without looks if strokes are lost, a paint is wrong, or somebody interferes.",
        ("seeds", "photos", "jobs"), seeds="0,1,2", shipped=(("coffee", "cat"),), quick=1,
    ),
    ExperimentRow(
        "robustness",
        "Test calibration with missing paint, blur, changed light, moved paper, missing dots and a rotated checker.",
        ("seed",),
    ),
    ExperimentRow(
        "sawyer",
        "Compare the simulated Sawyer with kinematic execution of the same plan: tracking error and its effect.",
        ("seed", "photo"), shipped=(("coffee",),),
    ),
    ExperimentRow(
        "text", "Paint text prompts and score them by a network that planning does not use, against baselines.",
        ("seeds", "first", "jobs"), prompts="PROMPTS", quick=2,
    ),
    ExperimentRow(
        "style", "Measure the style distance of paintings with features that the optimiser does not use.",
        ("seeds", "photos", "styles", "jobs"), seeds="0,1", shipped=(("cat", "astronaut"), "STYLES"),
    ),
    ExperimentRow(
        "semantic", "Compare painting by content with painting by pixels, scored by a network that no optimiser uses.",
        ("seeds", "photos", "jobs"), seeds="0,1", shipped=("PHOTOGRAPHS",),
    ),
    ExperimentRow(
        "sketch", "Paint text prompts along a drawing, with and without the sketch objective, and in a style.",
        ("seeds", "drawings", "style", "jobs"), seeds="0,1", shipped=("DRAWINGS", "STYLES"), keeps=True,
    ),
    ExperimentRow(
        "composition",
        "Paint text prompts from a style picture, and measure its composition and whether the prompt is still seen.",
        ("seeds", "styles", "jobs"), shipped=("STYLES",), prompts="SAID", quick=1,
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
        print(f"{row.name:20} {row.help}")
