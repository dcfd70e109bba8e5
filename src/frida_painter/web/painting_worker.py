"""The worker's part of painting: starts or resumes the run of a painting that a person asked for on the page."""

import time

from torch import Tensor

from frida_painter.errors import PaintingPaused, RobotStopped
from frida_painter.plan import Plan
from frida_painter.runs.brush_choice import brushes_of
from frida_painter.runs.fields import AUTO
from frida_painter.runs.ground_choice import ground_of
from frida_painter.runs.opening import Controls, replan_policy
from frida_painter.runs.run import PaintingRun, RunOutcome
from frida_painter.session.events import Stopped
from frida_painter.session.forecast import Forecast
from frida_painter.session.names import ARM_FILM
from frida_painter.session.page_events import PaintingKept, TakenUp
from frida_painter.session.procedures.dialogue import Confirm
from frida_painter.web.exports import export
from frida_painter.web.folder import PlanFolder
from frida_painter.web.job import Job
from frida_painter.web.pause_controller import PauseController
from frida_painter.web.telling import Reporter


def paint(job: Job, place: PlanFolder) -> None:
    """Paints the plan, and plans the rest again at every look."""
    folder, plan = job.folder.painting, Plan.load(place.plan)
    spec = job.spec(place).changed(ground=ground_of(plan))
    if spec.brushes == AUTO:
        spec = spec.changed(brushes=brushes_of(plan))
    with PaintingRun(spec, folder, state=job.state, record_may_differ=True) as run:
        run.load_easel()  # it loads while the planner does
        _lead(job, run)
        _conclude(job, run, run.start(plan))


def resume(job: Job, place: PlanFolder) -> None:
    """Goes on with a painting that was stopped, killed or broke off, from what its journal tells."""
    with PaintingRun.reopen(job.folder.painting, pace=job.easel.pace, state=job.state) as run:
        assert run.history is not None
        job.feed.tell(TakenUp(run.history.painted))
        run.load_easel()
        _lead(job, run)
        _conclude(job, run, run.resume())


def _lead(job: Job, run: PaintingRun) -> None:
    """Has the page hear of everything, and a person lead the run from there."""
    job.stop.then(run.open_easel().robot.stop)
    planner, spec = run.planner, run.spec
    again = planner.effort.of_a_look
    forecast = Forecast(spec.strokes, replan_policy(spec), time.monotonic(), planning=0, replanning=again)
    reporter = Reporter(job.feed, job.folder, planner.models, planner.size, forecast)
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
    """Tells how it ended, and keeps what other programs and machines take of it."""
    trouble = outcome.trouble
    if trouble is not None and not (isinstance(trouble, RobotStopped | PaintingPaused) and job.stop.asked):
        raise trouble
    if outcome.page is None:  # it was stopped before there was a plan
        job.feed.tell(Stopped())
        return
    export(Plan.load(outcome.folder), run.planner.models, outcome.folder, run.spec.drying)
    films = {"film": "film.mp4", "arm": ARM_FILM}
    job.feed.tell(PaintingKept(**{name: (outcome.folder / file).exists() for name, file in films.items()}))
