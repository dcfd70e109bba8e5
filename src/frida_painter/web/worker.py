"""Worker process of the studio: it plans, paints or calibrates; it may outlive the page's process.

Run it with `python -m frida_painter.web.worker JOB FOLDER NUMBER LOCK EASEL`. JOB is the work. FOLDER is the
painting's folder. NUMBER is one of its plans. LOCK is the open lock file of the painting, held until the work is
done. EASEL is the studio's easel as JSON.
"""

import json
import os
import secrets
import shutil
import sys
import time
import traceback
from dataclasses import dataclass, field, replace
from pathlib import Path

from torch import Tensor

from frida_painter import images, storage
from frida_painter.brush.kinds import brush_kind
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.devices import prepare_process
from frida_painter.easel.dialogue import Confirm, Finding, lead
from frida_painter.easel.kinds import ARM_FILM
from frida_painter.errors import ConfigError, FridaError, PaintingPaused, RobotStopped
from frida_painter.hardware.easel import Easel
from frida_painter.plan import Plan
from frida_painter.planning.optimize import Step
from frida_painter.procedures.strokes import StrokesFinding
from frida_painter.runs.goal_item import GoalItem
from frida_painter.runs.painting_easel import (
    CalibrationSetup,
    begin_procedure,
    easel_of,
    learn_from,
    record_to_renew,
    with_operator,
)
from frida_painter.runs.run import PaintingRun, RunOutcome
from frida_painter.runs.settle import Controls, brushes_of, ground_of, replan_policy
from frida_painter.runs.spec import AUTO, RunSpec
from frida_painter.session.events import (
    CalibrationStatus,
    Failed,
    PaintingKept,
    PlanMade,
    PlanPreview,
    ProcedureBegan,
    ProcedureFound,
    ProcedureProgress,
    Rests,
    Stopped,
    TakenUp,
)
from frida_painter.session.opening import require_basis, statuses
from frida_painter.session.time_left import RemainingTime
from frida_painter.web.painter import Asker, PauseController
from frida_painter.web.stop import StopPressed, StopWatch
from frida_painter.web.studio_folder import CalibrationRequest, Feed, GoalRequest, PaintingFolder, PlanFolder
from frida_painter.web.telling import Growing, Reporter, export, illustrate, mixtures
from frida_painter.web.web_app_easel import WebAppEasel

# Job of a worker: its painting, its easel and its feed.


@dataclass(frozen=True)
class Job:
    """Data of a job.

    began: start of the job, seconds since 1970.
    """

    folder: PaintingFolder
    easel: WebAppEasel
    feed: Feed
    stop: StopWatch
    asker: Asker
    began: float = field(default_factory=time.time, kw_only=True)

    @property
    def state(self) -> Path | None:
        """Folder of robot locks: the painting's own folder for a simulated robot, None for the common one."""
        return self.folder.easel if self.easel.simulated else None

    def spec(self, place: PlanFolder) -> RunSpec:
        """Returns the description of the requested painting at this studio's easel.

        Raises ConfigError and StorageError.
        """
        request = place.request()
        return RunSpec.of(
            title=request.title or "Untitled",
            goal=tuple(_item(term, place.path) for term in request.terms),
            initial=tuple(_item(term, place.path) for term in request.initial),
            strokes=request.strokes,
            colors=min(request.colors, request.strokes),
            canvas=CanvasSize(request.width / 1000, request.height / 1000),
            fit="crop",  # the page chose the canvas in the picture's proportions, or the person chose another one
            brushes=request.brushes or None,
            replans=min(request.replans, request.strokes - 1),
            ground=request.ground,
            on_canvas=request.on_canvas,
            focus=request.focus,
            sharpness=request.sharpness,
            drying=request.drying,
            minutes=request.minutes,
            effort=request.effort,
            seed=request.seed,
            **self._easel_fields,
            calibration=self.easel.known,
        )

    def spec_to_calibrate(self, request: CalibrationRequest) -> RunSpec:
        """Returns the description of the easel to calibrate.

        Its canvas is that of the workspace file, if there is one.
        """
        size = {} if self.easel.workspace else {"canvas": CanvasSize(request.width / 1000, request.height / 1000)}
        return RunSpec.of(brush=request.brush, seed=request.seed, **size, **self._easel_fields)

    @property
    def _easel_fields(self) -> dict[str, object]:
        easel = self.easel
        return {
            "robot": easel.robot,
            "camera": easel.camera,
            "workspace": easel.workspace,
            "pace": easel.pace if easel.simulated else 0.0,
        }


def _item(term: GoalRequest, folder: Path) -> GoalItem:
    value = term.words if term.words is not None else str(folder / f"{term.picture}.png")
    return GoalItem(kind=term.kind, value=value, weight=term.weight)


# Calibration by a worker: it leads the procedures, asks on the page, and saves the easel's record.


def calibrate(job: Job) -> None:
    """Runs the requested procedures in order; saves each result at once."""
    request, folder = CalibrationRequest.load(job.folder), job.folder.painting
    shutil.rmtree(folder, ignore_errors=True)  # the simulated studio of the last calibration
    storage.new_folder(folder)
    spec = job.spec_to_calibrate(request)
    with easel_of(spec, folder, job.state) as easel:
        here = with_operator(easel, spec, job.asker.answer)
        try:
            job.stop.then(here.robot.stop)
            here.robot.connect()
            here.camera.connect()
            _lead_all(job, request, here)
        finally:
            here.camera.close()
            here.robot.close()


def _lead_all(job: Job, request: CalibrationRequest, here: Easel) -> None:
    path, feed = job.easel.record, job.feed
    known = record_to_renew(path, here.calibration, anew=request.whole)
    _tell_status(feed, known, here.calibration)

    def say(words: str) -> None:
        feed.tell(ProcedureProgress(words))
        job.stop.heed()

    for name in request.what:
        require_basis(name, known, here.calibration, defaults_hold=here.simulated)
        feed.tell(ProcedureBegan(name))
        easel = replace(here, calibration=known)
        setup = CalibrationSetup(easel, brush_kind(request.brush), path, request.seed, request.count, say)
        finding = lead(begin_procedure(name, setup), job.asker.answer)
        known = finding.enter(known)
        if isinstance(finding, StrokesFinding):
            known = learn_from(finding, setup, known)
        known.save(path)
        feed.tell(ProcedureFound(name, _sentence(finding), _show_finding(name, finding, setup, job)))
        _tell_status(feed, known, here.calibration)


def _sentence(finding: Finding) -> str:
    """Returns the sentence of a result, without file paths."""
    file = getattr(finding, "file", None)
    return finding.sentence if file is None else finding.sentence.replace(f": {file.path}", "")


def _show_finding(name: str, finding: Finding, setup: CalibrationSetup, job: Job) -> str | None:
    """Saves the result's picture beside the record and for the page; returns its name for the page."""
    if finding.picture is None:
        return None
    images.save(finding.picture, setup.beside(name, "png"))
    for before in job.folder.live.glob(f"found-{name}-*.png"):
        before.unlink()
    shown = f"found-{name}-{secrets.token_hex(12)}.png"  # random, because everybody who knows the name may see it
    images.save(finding.picture, job.folder.live / shown)
    return shown


def _tell_status(feed: Feed, record: Calibration, easel: Calibration) -> None:
    """Reports the status of every procedure."""
    procedures = [
        {
            "name": status.procedure,
            "dated": None if status.done is None else status.done.dated[:10],
            "fault": status.fault,
            "old": status.is_old,
        }
        for status in statuses(record, easel)
    ]
    feed.tell(CalibrationStatus(easel.easel, procedures))


# Painting by a worker: it starts or resumes the run of a requested painting.


def paint(job: Job, place: PlanFolder) -> None:
    """Paints the plan, with replans as the description says."""
    folder, plan = job.folder.painting, Plan.load(place.plan)
    spec = job.spec(place).with_values(ground=ground_of(plan))
    if spec.brushes == AUTO:
        spec = spec.with_values(brushes=brushes_of(plan))
    with PaintingRun(spec, folder, state=job.state, record_may_differ=True) as run:
        run.load_easel()  # loads in parallel with the planner
        _lead(job, run)
        _conclude(job, run, run.start(plan))


def resume(job: Job, place: PlanFolder) -> None:
    """Resumes a painting that was stopped, killed or failed, from its journal."""
    with PaintingRun.reopen(job.folder.painting, pace=job.easel.pace, state=job.state) as run:
        assert run.history is not None
        job.feed.tell(TakenUp(run.history.painted))
        run.load_easel()
        _lead(job, run)
        _conclude(job, run, run.resume())


def _lead(job: Job, run: PaintingRun) -> None:
    """Connects the run to the page: reports, questions and controls."""
    job.stop.then(run.open_easel().robot.stop)
    planner, spec = run.planner, run.spec
    again = planner.effort.of_a_look
    time_left = RemainingTime(spec.strokes, replan_policy(spec), time.monotonic(), planning=0, replanning=again)
    reporter = Reporter(job.feed, job.folder, planner.models, planner.size, time_left)
    pauses = PauseController(job.folder, job.feed, job.stop, job.began, lambda: run.session)

    def paint_on(difference: str, photograph: Tensor) -> bool:
        question = f"{difference.split(' Look at ')[0]} Shall it be painted on as it is?"
        return job.asker.answer(Confirm(question, photograph, proposal=False)) is True

    def repaint(number: int, picture: Tensor) -> bool:
        question = f"Stroke {number} was begun, and nothing tells whether it was painted. Paint it again?"
        return job.asker.answer(Confirm(question, picture, proposal=False)) is True

    run.listeners += [reporter.hear, pauses.hear]
    run.controls = Controls(
        stop_asked=lambda: job.stop.asked,
        pause_asked=pauses.pause_asked,
        go_on=pauses.go_on,
        answer=job.asker.answer,
        paint_on=paint_on,
        repaint=repaint,
    )


def _conclude(job: Job, run: PaintingRun, outcome: RunOutcome) -> None:
    """Reports the end of a run, and exports its plan for other programs and machines."""
    trouble = outcome.trouble
    if trouble is not None and not (isinstance(trouble, RobotStopped | PaintingPaused) and job.stop.asked):
        raise trouble
    if outcome.page is None:  # it was stopped before the first plan
        job.feed.tell(Stopped())
        return
    export(Plan.load(outcome.folder), run.planner.models, outcome.folder, run.spec.drying)
    films = {"film": "film.mp4", "arm": ARM_FILM}
    job.feed.tell(PaintingKept(**{name: (outcome.folder / file).exists() for name, file in films.items()}))


_GROWING_COST = 1.4  # later iterations, with all strokes placed, take longer than the first


def main() -> None:
    """Does the job; errors are reported on the page as a sentence."""
    what, path, number, lock, easel = sys.argv[1:]
    folder = PaintingFolder(Path(path))
    folder.live.mkdir(exist_ok=True)
    feed = Feed(folder)
    stop = StopWatch(folder.stop, folder.path.parent)
    prepare_process()
    try:
        job = Job(folder, WebAppEasel.take(json.loads(easel)), feed, stop, Asker(folder, feed, stop))
        work(what, job, folder.plan(int(number)))
    except StopPressed:
        feed.tell(Stopped())
    except FridaError as trouble:
        if stop.asked and isinstance(trouble, RobotStopped):
            feed.tell(Stopped())
        else:
            feed.tell(Failed(str(trouble).replace(str(folder.path), "its folder")))
    except BaseException:
        mark = secrets.token_hex(4)
        print(mark, traceback.format_exc(), file=sys.stderr)
        feed.tell(Failed(f"Something went wrong that should not have; its number in the log is {mark}."))
        raise
    finally:
        os.close(int(lock))
        feed.tell(Rests())
        feed.close()


def work(what: str, job: Job, place: PlanFolder) -> None:
    """Runs a job by name. Raises ConfigError for an unknown one."""
    match what:
        case "plan":
            make_plan(job, place)
        case "paint":
            paint(job, place)
        case "resume":
            resume(job, place)
        case "calibrate":
            calibrate(job)
        case _:
            raise ConfigError(f"There is no job {what[:40]!r}; it is plan, paint, resume or calibrate.")


def make_plan(job: Job, place: PlanFolder) -> None:
    """Makes the requested plan and its pictures."""
    feed = job.feed
    with PaintingRun(job.spec(place)) as run:
        run.choosing = lambda what: job.stop.heed()
        planner = run.planner
        bare = planner.bare
        started = time.monotonic()

        def grown(name: str) -> None:
            feed.tell(PlanPreview(name, place.number))

        growing = Growing(place.path, bare, planner.models, planner.size, grown)

        def hear(step: Step) -> None:
            job.stop.heed()
            share = (step.iteration / step.of) ** _GROWING_COST
            feed.step(share, (time.monotonic() - started) * (1 - share) / share, place.number)
            growing.hear(step.parts)

        made = run.plan(hear)
        made.save(place.plan)
        export(made, planner.models, place.path, run.spec.drying)
        expected = planner.expected(made, bare)
        nearer = 1 - planner.validation_loss(expected) / max(planner.validation_loss(bare), 1e-9)
        told = illustrate(made, planner.models, bare, place.path)
        mixed, took = mixtures(made), round(time.monotonic() - started, 1)
    feed.tell(PlanMade(place.number, round(nearer, 4), took, mixtures=mixed, **told))


if __name__ == "__main__":
    main()
