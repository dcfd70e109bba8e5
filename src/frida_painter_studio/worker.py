"""Jobs of a worker process: it plans, calibrates, teaches; worker_process.py starts them."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from frida_painter.brush.kinds import brush_kind
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.connecting import connect_easel
from frida_painter.easel.dialogue import Answer, SetupQuestion
from frida_painter.easel.kinds import SIMULATION_LOG, STOP_FILE
from frida_painter.errors import ConfigError, Interrupted
from frida_painter.hardware.easel import Easel
from frida_painter.mixing.shopping import BrushPaints, supplies
from frida_painter.planning.mixable import mixing_changes
from frida_painter.planning.optimize import Step
from frida_painter.report.sheets import RecipeSheets, format_amount
from frida_painter.runs.painting_easel import with_operator
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.settle import paints_for_recipes
from frida_painter.runs.spec import RunSpec
from frida_painter.runs.variant_settings import VARIANT
from frida_painter.session import events
from frida_painter.session.opening import adopt_camera, statuses
from frida_painter.session.time_left import PlanTime, share_of_plan
from frida_painter.strokes.palette import to_hex
from frida_painter.system import event_log, images, storage
from frida_painter.system.devices import prepare_process
from frida_painter_calibration.calibrating import CalibrationSetup, calibrate_one, easel_of, record_to_renew
from frida_painter_calibration.machine_setup import SetupEvent, lead_setup
from frida_painter_calibration.options import SetupOrder
from frida_painter_studio.at_page import Feed, StopWatch
from frida_painter_studio.jobs import PROCEDURES, CalibrationRequest, SetupRequest, TeachingRequest
from frida_painter_studio.side_jobs import imagine, teach
from frida_painter_studio.studio_folder import PLAN_JOB, PaintingFolder, PlanFolder
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_together.asking import Asker
from frida_painter_together.inbox import make_live_path
from frida_painter_together.plan_pictures import GrowingPlan, draw_plan, export

_BETWEEN_WORDS = 0.5  # seconds

# Job of a worker: its painting, its easel and its feed.


@dataclass(frozen=True)
class Job:
    """Data of a job."""

    folder: PaintingFolder
    easel: WebAppEasel
    feed: Feed
    stop: StopWatch

    @property
    def state(self) -> Path | None:
        """Folder of robot locks: the painting's own folder for a simulated robot, None for the common one."""
        return self.folder.easel if self.easel.simulated else None


# Calibration by a worker: it leads the procedures, asks on the page, and saves the easel's record.


def _make_ready(folder: Path) -> None:
    """Makes the folder in which a machine's process finds a stop file, without the last simulated studio."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        event_log.remove(folder / SIMULATION_LOG)
        (folder / STOP_FILE).unlink(missing_ok=True)
    except OSError as error:
        raise storage.cannot_write(folder, error) from error


def calibrate(job: Job) -> None:
    """Runs the requested procedures in order; saves each result at once."""
    request, folder = CalibrationRequest.load(job.folder.path), job.folder.painting
    answer = Asker(job.folder.path, job.feed.tell, job.stop.heed).answer
    _make_ready(folder)
    size: dict[str, Any] = {} if job.easel.workspace else {"canvas": request.size}
    spec = RunSpec.of(brush=request.brush, seed=request.seed, **size, **job.easel.settings)
    with easel_of(spec, folder, job.state) as easel:
        here = with_operator(easel, spec, answer)
        try:
            job.stop.then(here.robot.stop)
            here = connect_easel(here, answer, job.feed.say)
            _lead_all(job, request, here, answer)
        finally:
            here.camera.close()
            here.robot.close()


def _lead_all(job: Job, request: CalibrationRequest, here: Easel, answer: Callable[[SetupQuestion], Answer]) -> None:
    path, feed = job.easel.record, job.feed
    known = record_to_renew(path, here.calibration, anew=request.what == PROCEDURES)
    _tell_status(feed, known, here.calibration)

    def say(words: str) -> None:
        feed.say(words)
        job.stop.heed()

    for name in request.what:
        feed.tell(events.Began("procedure", name))
        setup = CalibrationSetup(here, brush_kind(request.brush), path, request.seed, request.count, say)
        finding, known = calibrate_one(name, setup, known, answer)
        told: dict[str, Any] = {"sentence": finding.sentence, "picture": None}
        if finding.picture is not None:
            shown = make_live_path(job.folder.path, f"found-{name}", ".png", alone=True)
            images.save(finding.picture, shown)
            told["picture"] = shown.name
        feed.tell(events.ResultFound("procedure", name, detail=told))
        _tell_status(feed, known, here.calibration)


def _tell_status(feed: Feed, record: Calibration, easel: Calibration) -> None:
    """Reports the status of every procedure."""
    for status in statuses(adopt_camera(record, easel), easel):
        dated = None if status.done is None else status.done.dated[:10]
        stands = {"easel": easel.easel, "dated": dated, "fault": status.fault, "old": status.is_old}
        feed.tell(events.ResultFound("status", status.procedure, detail=stands))


# Teaching of a stroke by a worker.


def teach_stroke(job: Job) -> None:
    """Learns a stroke family from a person's marks."""
    request = TeachingRequest.load(job.folder.path)

    def say(words: str) -> None:
        job.stop.heed()
        if time.monotonic() - told[0] >= _BETWEEN_WORDS:
            told[0] = time.monotonic()
            job.feed.say(words)

    told = [0.0]
    job.feed.tell(teach(request, job.folder, job.folder.families, say))


# Setup of a machine by a worker: the same dialogue as in the terminal.


def set_up(job: Job) -> None:
    """Sets a machine up, or goes on with a setup that was left."""
    request, folder = SetupRequest.load(job.folder.path), job.folder.painting
    _make_ready(folder)
    asker = Asker(job.folder.path, job.feed.tell, job.stop.heed, may_leave=True)

    def tell(event: SetupEvent) -> None:
        if isinstance(event, events.ResultFound) and event.what == "setup":
            event = _show_sheet(event, job.folder)
        job.feed.tell(event)
        job.stop.heed()

    size = None if request.width is None else CanvasSize(request.width / 1000, (request.height or 0.0) / 1000)
    order = SetupOrder(name=request.easel, canvas=size, brush=request.brush, step=request.step, anew=request.anew)
    try:
        lead_setup(order, asker.answer, tell, stops=folder, opened=lambda robot: job.stop.then(robot.stop))
    except Interrupted as left:
        job.feed.tell(events.ResultFound("left", str(left)))


def _show_sheet(written: events.ResultFound, folder: PaintingFolder) -> events.ResultFound:
    """Copies the picture of a finished setup for the page; returns the event with the copy's name."""
    shown = make_live_path(folder.path, "setup", ".png", alone=True)
    storage.copy(Path(written.detail["sheet"]), shown, "the picture of the setup", storage.MAX_BYTES)
    return replace(written, detail=written.detail | {"sheet": shown.name})


# Plans.


def work(what: str, job: Job, place: PlanFolder) -> None:
    """Runs a job by name. Raises ConfigError for an unknown one."""
    prepare_process()
    job.stop.heed()
    jobs: dict[str, Callable[[Job], None]] = {
        PLAN_JOB: lambda job: make_plans(job, place),
        "calibration": calibrate,
        "setup": set_up,
        "teaching": teach_stroke,
        "imagining": lambda job: imagine(job.folder, job.feed, job.stop),
    }
    if what not in jobs:
        raise ConfigError(f"There is no job {what[:40]!r}; it is {', '.join(jobs)}.")
    jobs[what](job)


def make_plans(job: Job, first: PlanFolder) -> None:
    """Makes the first of the requested plans, and those ordered with it, one after the other, with their pictures."""
    for place in job.folder.plans():
        if place.number >= first.number:
            _make_plan(job, place)


def _make_plan(job: Job, place: PlanFolder) -> None:
    feed, request = job.feed, place.request()
    spec = request.spec(job.easel, place.path, job.folder.families)
    with PaintingRun(spec) as run:
        run.tell, run.heed = feed.say, job.stop.heed
        planner = run.planner
        bare, models = planner.bare, planner.models
        started = time.monotonic()
        growing = GrowingPlan(place.path, bare, models, planner.size)
        expected_time = planner.measure_plan(run.spec.strokes)
        if expected_time is not None:
            feed.step(0.0, expected_time)
        plan_time = PlanTime(expected_time)

        def hear(step: Step) -> None:
            job.stop.heed()
            share = share_of_plan(step.iteration, step.of)
            feed.step(share, plan_time.find_remaining(share), growing.draw(step.parts))

        made = run.plan(hear)
        if request.variant:
            made = replace(made, about=(*made.about, (VARIANT, request.variant)))
        made.save(place.plan)
        if len(made):
            export(made, models, place.path, run.spec.drying)
        expected = planner.expected(made, bare)
        nearer = 1 - planner.validation_loss(expected) / max(planner.validation_loss(bare), 1e-9)
        paints = RecipeSheets(place.path, paints_for_recipes(run.spec)).write(made)
        told = {
            **draw_plan(made, models, bare, place.path),
            "nearer": round(nearer, 4),
            "seconds": round(time.monotonic() - started, 1),
            "brushes": [{"title": brush.title, "mixtures": _tell_mixtures(brush)} for brush in paints],
            "shopping": [f"{supply.in_tubes} {supply.paint.title}" for supply in supplies(paints)],
            "mixing": mixing_changes(made),
            "remarks": list(planner.encoders.remarks),
        }
    feed.tell(events.ResultFound("plan", plan=place.number, detail=told))


def _tell_mixtures(brush: BrushPaints) -> list[dict[str, Any]]:
    """Returns the paints of one brush for the page."""
    return [
        {
            "well": mixture.wells[0][1],
            "hex": to_hex(mixture.recipe.target),
            "recipe": mixture.recipe.words,
            "amount": "" if mixture.volume is None else format_amount(mixture.volume),
            "also": mixture.also,
            "near": mixture.recipe.within_reach,
        }
        for mixture in brush.mixtures
    ]
