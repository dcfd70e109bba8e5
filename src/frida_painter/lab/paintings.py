"""Experiments about paintings: a trial is a RunSpec that is planned and painted, and a judge measures the painting.

Every painting is planned on a bare canvas and painted in the virtual studio by PaintingRun. A scale is a RunSpec
too: the common settings of all paintings of an experiment.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from torch import Tensor

from frida_painter import images, storage
from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.easel.dialogue import lead
from frida_painter.easel.kinds import OpenEasel
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.virtual_easel import assemble_easel, open_virtual_easel
from frida_painter.hardware.easel import Easel, Operator
from frida_painter.hardware.faults import PlacementError
from frida_painter.lab import ExperimentScale
from frida_painter.lab.trials import (
    Experiment,
    ExperimentTrial,
    Labels,
    Measurement,
    Notify,
    Outcome,
    Progress,
    Results,
    Value,
    within,
)
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.procedures.strokes import StrokesProgress, strokes
from frida_painter.runs.goal_item import GoalItem
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Event, Looked, Paused, Planned, StrokePainted, TimelapseFrame
from frida_painter.session.hand import Hand
from frida_painter.session.observer import CanvasObserver
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import FREE, VirtualStudio
from frida_painter.virtual.tabletop import HandNoise, Table

# Direct work with the virtual robot, for experiments about strokes and arms: given strokes, or a stroke library.
# Paintings do not use this; they go through PaintingRun.

EXACT = PlacementError((0.0, 0.0), 0.0)
"""Placement of a perfectly calibrated robot."""
_PAINTING = 0.2  # share of the time for painting a library


def connect_studio(studio: VirtualStudio) -> VirtualStudio:
    """Connects robot and camera of a studio, and returns the studio."""
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return studio


def execute(plan: Plan, easel: Easel, rows: int) -> Tensor:
    """Paints the plan on a bare easel and returns the photograph of the canvas, [3, rows, columns].

    Raises RobotError, CameraError and their subclasses.
    """
    hand, observer = Hand(easel, brush_kind(plan.layers[0].brush).for_any_order), CanvasObserver(easel)
    hand.step_aside()
    observer.look(hand.last_motion, rows)  # at the bare canvas: learns the light of the room
    easel.operator.fill_wells(plan.palette)
    for action in hand.prepare(plan, 0, len(plan)):
        hand.perform(action)
    hand.step_aside()
    return observer.look(hand.last_motion, rows)


def library_of(
    path: Path | None, brush: str, seed: int, scale: ExperimentScale, notify: Notify
) -> tuple[StrokeLibrary, str, Notify]:
    """Returns the library to learn from (loaded, or painted now), its name, and a listener for the remaining work."""
    if path is not None:
        return StrokeLibrary.load(path), path.stem, notify
    painted = virtual_library(brush, scale.strokes, seed, within(notify, 0.0, _PAINTING))
    return painted, f"virtual {brush} brush", within(notify, _PAINTING, 1.0)


def virtual_library(brush: str, count: int, seed: int, notify: Notify) -> StrokeLibrary:
    """Paints a library of `count` strokes of a brush of the project. Raises ConfigError if there is no such brush."""

    def hear(progress: StrokesProgress) -> None:
        notify(Progress(progress.done / progress.of, "painting a stroke library"))

    painting = strokes(open_virtual_easel(brush, seed), brush_kind(brush), count=count, seed=seed, notify=hear)
    return lead(painting, lambda question: question.proposal or False).library


# Imperfections of the virtual studio that can be removed, to measure the effect of each.
# Some are switched off by the studio's settings. The others are removed from the open studio.

_ENDLESS = 1000.0  # times the paint that a brush holds
_COVERING = 100.0  # times the absorption and the scattering of a paint
_AT_ONCE = 1e-3  # seconds in which paint dries


@dataclass(frozen=True)
class Imperfection:
    """Imperfection of the virtual studio.

    name: in tables
    furniture: fields of StudioSettings that switch it off
    remove: removes it from an open studio
    """

    name: str
    furniture: Mapping[str, Any] = field(default_factory=dict)
    remove: Callable[[VirtualStudio], None] = lambda studio: None


def _never_runs_out(studio: VirtualStudio) -> None:
    """Multiplies the capacity of each brush: the mark depends on the remaining share, which then stays near full."""
    for tuft in studio.tufts.values():
        tuft.capacity *= _ENDLESS


def _lies_flat(studio: VirtualStudio) -> None:
    studio.canvas.tooth[...] = 0.0


def _covers(studio: VirtualStudio) -> None:
    """Makes the paint opaque: a film with more absorption and scattering, by the same factor, keeps its colour."""
    studio.easel = replace(studio.easel, operator=OtherPaint(studio.easel.operator, studio.table, covering=_COVERING))


PLACEMENT = Imperfection("placement error", {"placement_error": EXACT})
HAND = Imperfection("hand noise", {"noise": HandNoise(0.0, 0.0)})
LOAD = Imperfection("running out", remove=_never_runs_out)
WETNESS = Imperfection("wet mixing", {"drying_time": _AT_ONCE})
TRANSLUCENCY = Imperfection("translucency", remove=_covers)
TOOTH = Imperfection("canvas tooth", remove=_lies_flat)
CAMERA = Imperfection("camera error", {"camera": CameraSpec.ideal()})
IMPERFECTIONS = (PLACEMENT, HAND, LOAD, WETNESS, TRANSLUCENCY, TOOTH, CAMERA)


@dataclass(frozen=True)
class Disturbance:
    """Something that goes wrong while the virtual studio paints, and what a person does about it.

    name: in tables
    begin: arranges it in an open studio
    answer: called with the studio and the pause when the painting pauses because of it; does what a person would do,
        and returns True to go on
    """

    name: str
    begin: Callable[[VirtualStudio], None] = lambda studio: None
    answer: Callable[[VirtualStudio, Paused], bool] = lambda studio, paused: False


UNDISTURBED = Disturbance("nothing")


class StudioWithout:
    """Virtual studio without some imperfections, or with a disturbance, with access to its true canvas."""

    def __init__(self, imperfections: Sequence[Imperfection] = (), disturbance: Disturbance = UNDISTURBED) -> None:
        self._without, self._disturbance = imperfections, disturbance
        self._studio: VirtualStudio | None = None

    def open(self, order: EaselOrder) -> OpenEasel:
        """Opens the ordered studio. Raises ConfigError if it has no such brush."""
        furniture = {name: value for one in self._without for name, value in one.furniture.items()}
        studio, easel = assemble_easel(order, FREE, **furniture)
        for one in self._without:
            one.remove(studio)
        self._disturbance.begin(studio)
        self._studio = studio
        return OpenEasel(replace(easel, operator=studio.easel.operator), studio.close)

    def answer(self, paused: Paused) -> bool:
        """Answers a pause as a person would who knows of the disturbance; returns True to go on."""
        assert self._studio is not None, "open comes first"
        return self._disturbance.answer(self._studio, paused)

    def truth(self, rows: int) -> Tensor:
        """Returns the true canvas, sRGB [3, rows, columns], from the front and in even light; not for the painter."""
        assert self._studio is not None, "open comes first"
        return self._studio.truth(rows)


@dataclass(frozen=True)
class OtherPaint:
    """Operator of the studio who fills the wells with other paint than asked. Implements hardware.easel.Operator.

    mix: returns the paints that are mixed for the wanted ones
    covering: factor of absorption and scattering
    """

    usual: Operator
    table: Table
    mix: Callable[[Palette], Palette] = lambda wanted: wanted
    covering: float = 1.0

    def fill_wells(self, palette: Palette) -> None:
        """Fills well i with the paint that is mixed for paint i."""
        self.usual.fill_wells(self.mix(palette))
        self.table.paints = tuple(self.covering * paint for paint in self.table.paints)

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Tones the canvas as usual."""
        self.usual.tone(ground)

    def change_brush(self, brush: str) -> None:
        """Changes the brush as usual."""
        self.usual.change_brush(brush)

    def let_dry(self, seconds: float) -> None:
        """Lets the paint dry as usual."""
        self.usual.let_dry(seconds)

    def lay_paper(self) -> bool:
        """Returns True if a fresh paper is on the easel."""
        return self.usual.lay_paper()

    def lay_checker(self) -> bool:
        """Returns True if the colour checker is in view."""
        return self.usual.lay_checker()

    def take_checker_away(self) -> bool:
        """Returns True if the colour checker is gone."""
        return self.usual.take_checker_away()


FULL = RunSpec.of(strokes=100, layers=1, colors=12, effort=0.3, replans=0)
QUICK = RunSpec.of(strokes=6, colors=3, render_height=64, effort=0.05, replans=0)
"""Scale of experiments with goals that networks judge, for a test."""
_PLANNING = 0.7  # share of the time of a painting

Tell = Callable[[float], None]
"""Hears the share, in [0, 1], of a part of the work that is done."""
MakePlan = Callable[[PaintingRun, Tell], tuple[Plan, Tensor]]
"""Makes the plan of a run, and its simulated picture [3, rows, columns]."""


@dataclass(frozen=True, kw_only=True)
class PaintingTrial(ExperimentTrial):
    """Trial of one painting.

    spec: its run
    make_plan: makes the plan; by default the planner of the run
    without: imperfections that the studio lacks
    disturbance: what goes wrong
    """

    spec: RunSpec
    make_plan: MakePlan
    without: tuple[Imperfection, ...] = ()
    disturbance: Disturbance = UNDISTURBED

    @classmethod
    def of(
        cls,
        labels: Labels,
        spec: RunSpec,
        make_plan: MakePlan | None = None,
        without: tuple[Imperfection, ...] = (),
        disturbance: Disturbance = UNDISTURBED,
    ) -> Self:
        """Returns the trial of a painting, which depends on its spec and on the content of its goal's files.

        Raises StorageError if a file cannot be read.
        """
        files = {part: [_content(item) for item in getattr(spec, part)] for part in ("goal", "initial")}
        depends_on = {"spec": spec.record(), **files, "without": [one.name for one in without]}
        depends_on |= {} if disturbance is UNDISTURBED else {"disturbance": disturbance.name}
        plan = make_plan or make_first_plan
        return cls(labels, depends_on, spec=spec, make_plan=plan, without=without, disturbance=disturbance)


@dataclass(frozen=True)
class Painted:
    """Painting of a trial. Pictures are [3, rows, columns] of the planning image.

    run: that made it
    plan: the first plan
    planned: picture of that plan
    photograph: of the finished canvas
    truth: true canvas, which no camera sees
    seconds: of the CPU, for planning
    expected: expected picture (the canvas with the remaining plan) whenever the canvas was seen, by number of
        strokes
    """

    run: PaintingRun
    plan: Plan
    planned: Tensor
    photograph: Tensor
    truth: Tensor
    seconds: float
    expected: Mapping[int, Tensor] = field(default_factory=dict)


Judge = Callable[[PaintingTrial, Painted], Measurement]


def like(scale: RunSpec, picture: Tensor, goal: Sequence[Any], seed: int, **changes: Any) -> RunSpec:
    """Returns the run that paints a goal at a scale, on a canvas with the orientation of a picture [3, H, W].

    goal: as in a TOML file, such as {"image": "photo.jpg"}
    changes: other fields of the spec
    """
    canvas = scale.canvas.orient_like(*picture.shape[1:])
    return scale.with_values(**{"goal": goal, "seed": seed, "canvas": canvas, "fit": "crop", "film": False, **changes})


def settings(scale: RunSpec) -> dict[str, Value]:
    """Returns the common settings of all paintings of an experiment, for its outcome."""
    return {
        "brush": ", ".join(scale.brush_names),
        "canvas": str(scale.canvas),
        "strokes": scale.strokes,
        "colors": scale.colors,
        "rows": scale.render_height,
        "effort": scale.effort,
        "looks": scale.replans,
        "robot": "off by about 2 mm and 0.4 degrees as drawn from the seed",
    }


def experiment(
    trials: Sequence[PaintingTrial],
    judge: Judge,
    report: Callable[[Results], Outcome],
    encoders: EncoderRegistry | None = None,
) -> Experiment[PaintingTrial]:
    """Returns the experiment that paints all trials.

    judge: measures a painting
    report: makes the outcome
    encoders: networks of the goals
    """

    def measure(trial: PaintingTrial, notify: Notify) -> Measurement:
        measured = judge(trial, paint(trial, notify, encoders))
        notify(Progress(1.0, f"{_words(trial)}: measured"))
        return measured

    return Experiment(trials, measure, report)


def paint(trial: PaintingTrial, notify: Notify, encoders: EncoderRegistry | None = None) -> Painted:
    """Plans and paints a trial. Raises WeightsError if a network is missing."""
    expected: dict[int, Tensor] = {}
    doing = _words(trial)

    def planning(share: float) -> None:
        notify(Progress(_PLANNING * share, f"{doing}: planning"))

    def hear(event: Event) -> None:
        match event:
            case StrokePainted(done, of):
                notify(Progress(_PLANNING + (0.99 - _PLANNING) * done / of, f"{doing}: painting"))
            case Planned(done=done, expected=picture):
                expected[done] = picture
            case TimelapseFrame(photograph=photograph, done=done, of=of) if done < of:
                expected[done] = run.planner.expected(plan.part(slice(done, None)), photograph)
            case Looked(photograph=photograph, done=done) if done == len(plan):
                expected[done] = images.fit(photograph, *picture_of_plan.shape[1:])
            case _:
                pass

    studio = StudioWithout(trial.without, trial.disturbance)
    with PaintingRun(trial.spec, listeners=[hear], encoders=encoders) as run:
        run.controls = replace(run.controls, go_on=studio.answer)
        began = time.process_time()
        plan, picture_of_plan = trial.make_plan(run, planning)
        seconds = time.process_time() - began
        photograph = run.simulate(plan, studio.open).photograph
    rows, columns = picture_of_plan.shape[1:]
    truth = images.fit(studio.truth(rows), rows, columns)
    return Painted(run, plan, picture_of_plan, images.fit(photograph, rows, columns), truth, seconds, expected)


def make_first_plan(run: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
    """Returns the plan of the run's own planner, and its picture."""
    plan = run.plan(lambda step: tell(step.iteration / step.of))
    return plan, run.planner.expected(plan, run.planner.bare)


def _content(item: GoalItem) -> list[str | float]:
    """Returns a goal as its kind, its content (words, or the hash of a file) and its weight."""
    content = item.value if item.path is None else storage.sha256(item.path, "a picture of the goal")
    return [item.kind, content, item.weight]


def _words(trial: PaintingTrial) -> str:
    """Returns a description of the trial."""
    return ", ".join(f"seed {value}" if label == "seed" else str(value) for label, value in trial.labels.items())
