"""A cell of the table: one entrant paints one goal within one budget in the virtual studio of one seed.

Every painting is made by the same loop on the same easel. Only `ours` looks while it paints; all others hand in a plan.
"""

import hashlib
import json
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from torch import Tensor

from frida_painter import images, provenance, storage
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, HandInError, StorageError, WorkerUnfit
from frida_painter.lab.benchmark import judges
from frida_painter.lab.benchmark.fitting import fit_hand_in
from frida_painter.lab.benchmark.hand_in import MAX_BYTES, TOLERANCE, HandIn, read_csv
from frida_painter.lab.benchmark.judges import CPU, DIPS, FORECAST, LEFT, MINUTES, PAINTS, STROKES, Judges
from frida_painter.lab.benchmark.rivals import GREEDY_BRUSHES, PLAIN_BRUSH, plan_greedy, plan_hertzmann, plan_plain
from frida_painter.lab.benchmark.suite import BenchmarkGoal, Budget, find_budget, find_goal, suite_digest
from frida_painter.lab.paintings import StudioWithout
from frida_painter.lab.sweeps.runner import fix_to_plan
from frida_painter.lab.sweeps.sweep_folder import RunFolder
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.plan import Plan
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Dipped, Event, Planned, PlanningStep, StrokePainted

_KEY = 20  # hexadecimal digits
_RECORD = "frida-painter benchmark cell"
INPUTS = "inputs"
"""Folder of the files of held-out pictures and of hand-ins, in the folder of a table."""


@dataclass(frozen=True)
class Entrant:
    """Painter of the project that can be entered by name.

    words: what it is
    brushes: brushes of its plan; None for those that the project chooses
    make: makes its plan on a white canvas; None for the project's planner
    looks: number of looks with a replan; None for the project's default
    """

    name: str
    words: str
    brushes: str | None = None
    make: Callable[[PaintingRun, Tensor, Budget], Plan] | None = None
    looks: int | None = 0


ENTRANTS: Mapping[str, Entrant] = {
    each.name: each
    for each in (
        Entrant("ours", "the planner of this project, with its looks and replans", looks=None),
        Entrant("ours-blind", "its first plan, painted without a look"),
        Entrant(
            "plain", "the paper's plain algorithm: random strokes, Adam, one layer",
            PLAIN_BRUSH, plan_plain,
        ),
        Entrant(
            "greedy", "each stroke the best of 64 random ones",
            ",".join(GREEDY_BRUSHES), plan_greedy,
        ),
        Entrant(
            "hertzmann", "Hertzmann 1998: curved strokes of three sizes",
            ",".join(GREEDY_BRUSHES),
            lambda run, target, budget: plan_hertzmann(run.spec.canvas, target, budget, run.spec.seed),
        ),
    )
}  # fmt: skip


@dataclass(frozen=True)
class BenchmarkCell:
    """BenchmarkCell of the table.

    entrant: a name of ENTRANTS, or any other name with a hand-in
    goal: name of a picture or a combined goal; see suite.find_goal
    strokes: budget, by its number of strokes
    seed: of the virtual studio, and of the entrants of this project
    hand_in: file of the strokes; None for an entrant of this project
    cpu_seconds: time of the processor that the entrant says it took; None if unknown
    """

    entrant: str
    goal: str
    strokes: int
    seed: int
    hand_in: str | None = None
    cpu_seconds: float | None = None

    @property
    def budget(self) -> Budget:
        """Budget. Raises ConfigError."""
        return find_budget(self.strokes)

    def labels(self) -> dict[str, str | int]:
        """Returns what tells the cell from the others."""
        return {"entrant": self.entrant, "goal": Path(self.goal).stem, "strokes": self.strokes, "seed": self.seed}

    def key(self, goal: BenchmarkGoal, program: str) -> str:
        """Returns the hash of everything that decides its figures: suite, goal, strokes and program.

        program: line of `provenance.identify`
        """
        paths = [value for item in goal.items for value in item.values() if isinstance(value, str)]
        files = [storage.sha256(Path(path), "a goal") for path in paths if Path(path).is_file()]
        handed = None if self.hand_in is None else _content(Path(self.hand_in))
        words = [path for path in paths if not Path(path).is_file()]
        facts = [program, suite_digest(), self.labels(), files, words, handed, self.cpu_seconds]
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:_KEY]

    def check(self) -> None:
        """Raises ConfigError if the entrant, the budget or the seed is not allowed."""
        if self.hand_in is None and self.entrant not in ENTRANTS:
            raise ConfigError(
                f"{self.entrant[:40]!r} is no entrant; there are {', '.join(ENTRANTS)}, and those that hand in strokes "
                "(--hand-in NAME=FOLDER)."
            )
        if not 0 <= self.seed < 2**31:
            raise ConfigError(f"The seed {self.seed} was given; it is from 0 to {2**31 - 1}.")
        self.budget  # noqa: B018  # refuses an unknown one


@dataclass(frozen=True)
class CellAssignment:
    """Cell with the folder of its table, which every machine that works on it sees under this path.

    program: line of `provenance.identify` for the machine that asks
    """

    cell: BenchmarkCell
    folder: str
    program: str


def perform_cell(assignment: CellAssignment) -> dict[str, Any]:
    """Paints and judges a cell, and returns its record, which is also in its folder; one that is done is only read.

    The network of the perceptual distance judges a stored painting if it was fetched later.

    Raises WorkerUnfit on a machine with another program or without the folder, and the errors of reading, planning and
    painting.
    """
    here, folder = provenance.identify_here(), Path(assignment.folder)
    if here != assignment.program or not folder.is_dir():
        raise WorkerUnfit(
            f"{platform.node()} has {here} and {'sees' if folder.is_dir() else 'does not see'} "
            f"{storage.abridge(folder)}; it needs {assignment.program} and that folder."
        )
    cell = assignment.cell
    goal = find_goal(cell.goal, folder / INPUTS)
    place = RunFolder(folder, cell.key(goal, here))
    with place.lock():
        known = place.record()
        if known is None:
            return _paint(cell, goal, place)
        if goal.picture is not None and judges.lacks_network(known["figures"]):
            seen = images.load(place.path / "painting.png")
            known = {**known, "figures": {**known["figures"], **Judges.open().of_picture(seen, goal.picture)}}
            place.keep(known)
        return known


def read_cell(folder: Path, cell: BenchmarkCell, program: str) -> dict[str, Any] | None:
    """Returns the record of a cell of a table that a program painted; None if it is not done."""
    return RunFolder(folder, cell.key(find_goal(cell.goal, folder / INPUTS), program)).record()


class _Meter:
    """Meter of a painting: strokes, dips, minutes, and the time for planning again."""

    def __init__(self, budget: Budget) -> None:
        self._budget = budget
        self.strokes = self.dips = 0
        self.replanning = 0.0
        self._since: float | None = None
        self._began: float | None = None
        self.run: PaintingRun | None = None

    def hear(self, event: Event) -> None:
        """Counts an event."""
        match event:
            case StrokePainted(done=done):
                self.strokes = done
            case Dipped():
                self.dips += 1
            case PlanningStep(phase="replan") if self._since is None:
                self._since = time.process_time()
            case Planned() if self._since is not None:
                self.replanning += time.process_time() - self._since
                self._since = None
            case _:
                pass

    def is_spent(self) -> bool:
        """Returns True if the painting has to end."""
        session = None if self.run is None else self.run.session
        if session is None:
            return False
        now = session.hand.last_motion
        self._began = now if self._began is None else self._began
        return (
            self.strokes >= self._budget.strokes
            or self.dips >= self._budget.dips
            or now - self._began >= 60 * self._budget.minutes
        ) and self.strokes > 0


def _paint(cell: BenchmarkCell, goal: BenchmarkGoal, place: RunFolder) -> dict[str, Any]:
    encoders, budget = EncoderRegistry(), cell.budget
    remarks: tuple[str, ...] = ()
    entrant = ENTRANTS.get(cell.entrant) if cell.hand_in is None else None
    handed = foretold = None
    if cell.hand_in is not None:
        drawing = read_hand_in(Path(cell.hand_in), goal.canvas)
        handed, remarks = fit_hand_in(drawing, budget, cell.seed)
        if drawing.strokes and goal.picture is not None:
            foretold = drawing.picture(*goal.picture.shape[1:])
    if goal.picture is None and entrant is not None and entrant.make is not None:
        raise ConfigError(f"{cell.entrant} paints photographs alone, and {cell.goal} is a combined goal; leave it out.")
    meter = _Meter(budget)
    spec = _spec(cell, goal, entrant)
    began = time.process_time()
    first: Plan | None = handed
    if first is None and entrant is not None and entrant.make is not None:
        assert goal.picture is not None
        with PaintingRun(spec, encoders=encoders) as run:
            first = entrant.make(run, goal.picture, budget)
    spec = spec if first is None else fix_to_plan(spec, first)
    studio = StudioWithout()
    with PaintingRun(spec, listeners=[meter.hear], encoders=encoders) as run:
        run.controls = replace(run.controls, stop_asked=meter.is_spent)
        plan = run.plan() if first is None else first
        planned = time.process_time() - began
        expected = run.planner.expected(plan, run.planner.bare)
        meter.run = run
        painting = run.simulate(plan, studio.open)
        truth = studio.truth(expected.shape[1] if goal.picture is None else goal.picture.shape[1])
        figures: dict[str, float] = {}
        if goal.picture is None:
            bare = run.planner.validation_loss(run.planner.bare)
            figures[LEFT] = run.planner.validation_loss(images.fit(truth, *expected.shape[1:])) / max(bare, 1e-12)
        else:
            figures |= Judges.open().of_picture(truth, goal.picture)
    figures |= {
        FORECAST: judges.forecast_fidelity(expected if foretold is None else foretold, truth),
        MINUTES: painting.robot_seconds / 60,
        DIPS: meter.dips,
        STROKES: painting.painted,
        PAINTS: len(plan.palette),
    }
    cpu = cell.cpu_seconds if cell.hand_in is not None else planned + meter.replanning
    if cpu is not None:
        figures[CPU] = cpu
    plan.save(place.path / "plan.json")
    images.save(truth, place.path / "painting.png")
    images.save(expected if foretold is None else foretold, place.path / "foretold.png")
    record = {
        "format": _RECORD,
        "key": place.path.name,
        "suite": suite_digest(),
        "labels": cell.labels(),
        "category": goal.category,
        "budget": asdict(budget),
        "figures": judges.finite(figures),
        "remarks": list(remarks),
        "cell": asdict(cell),
        "versions": provenance.describe_here(),
        "host": platform.node(),
        "times": {
            "cpu_seconds": time.process_time() - began,
            "ended": datetime.now(UTC).isoformat(timespec="milliseconds"),
        },
    }
    place.keep(record)
    return record


def _spec(cell: BenchmarkCell, goal: BenchmarkGoal, entrant: Entrant | None) -> RunSpec:
    """Returns the description of the painting."""
    budget = cell.budget
    fields: dict[str, Any] = {
        "goal": [dict(item) for item in goal.items], "canvas": goal.canvas, "fit": "crop", "strokes": budget.strokes,
        "colors": budget.paints, "new_paints": False, "seed": cell.seed, "film": False,
    }  # fmt: skip
    if entrant is None or entrant.make is not None:
        fields |= {"ground": "white", "brushes": "medium" if entrant is None else entrant.brushes}
    if entrant is None or entrant.looks is not None:
        fields["replans"] = 0
    if entrant is not None and entrant.make is None:
        fields["minutes"] = budget.minutes
    return RunSpec.of(**fields)


def _content(path: Path) -> str:
    """Returns the hash of a hand-in: of its file, or of the plan in its folder."""
    if path.is_dir() or path.suffix == ".json":
        return Plan.load(path).digest
    try:
        return storage.sha256(path, "a hand-in")
    except StorageError as error:
        raise ConfigError(f"{storage.abridge(path)} cannot be read as a hand-in: {error}") from error


def read_hand_in(path: Path, canvas: CanvasSize) -> HandIn:
    """Reads strokes for a canvas: a plan.json, or its folder, of this project; an SVG; or a CSV file.

    Raises HandInError that names the stroke or the line, PlanError for a damaged plan, ConfigError for an unknown
    kind of file.
    """
    kind = "plan" if path.is_dir() else path.suffix.lower()
    if kind in ("plan", ".json"):
        plan = Plan.load(path)
        _require_canvas(plan.canvas, canvas, path)
        return HandIn(canvas, plan.digest, ground=plan.ground, plan=plan)
    if kind not in (".svg", ".csv"):
        raise ConfigError(
            f"{storage.abridge(path)} is no hand-in; give the plan.json of a painting, an .svg or a .csv file."
        )
    with storage.open_checked(path, "a hand-in", MAX_BYTES, HandInError) as file:
        content = file.read()
    if kind == ".svg":
        from frida_painter.lab.benchmark.svg_strokes import read_svg  # needs the extra

        return read_svg(content, path.name, canvas)
    return read_csv(content, path.name, canvas)


def _require_canvas(size: CanvasSize, canvas: CanvasSize, path: Path) -> None:
    if not max(abs(size.width - canvas.width), abs(size.height - canvas.height)) <= TOLERANCE:
        raise HandInError(
            f"{storage.abridge(path)} is a plan for a canvas of {size}, and this picture is painted on {canvas}; plan "
            "it for that canvas."
        )
