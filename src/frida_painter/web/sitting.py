"""A sitting at the easel, led from the page: a painting is begun, or one that broke off is gone on with."""

import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path

from torch import Tensor

from frida_painter import storage
from frida_painter.cli import kept
from frida_painter.cli.painting import fit_to_canvas
from frida_painter.cli.progress import Forecast
from frida_painter.cli.real import attended_by
from frida_painter.cli.resume import Begun, require_as_left
from frida_painter.cli.sitting import occasion
from frida_painter.config import PaintingSettings
from frida_painter.errors import CalibrationError, FrameRejected, FridaError, PaintingPaused, RobotStopped
from frida_painter.goal import Goal
from frida_painter.hardware.easel import Easel
from frida_painter.plan import Plan
from frida_painter.planning.planner import Planner
from frida_painter.report.doubt import doubt
from frida_painter.report.recorder import Occasion, Recorder
from frida_painter.runs import goals
from frida_painter.session import resuming
from frida_painter.session.easel_process import EaselProcess
from frida_painter.session.easels import ARM_FILM
from frida_painter.session.events import Event, Stopped
from frida_painter.session.history import History
from frida_painter.session.journal import Journal
from frida_painter.session.loop import Painting, PaintingSession, ResumeState
from frida_painter.session.names import HUMAN
from frida_painter.session.opening import on_record, open_planner, open_session
from frida_painter.session.page_events import Finishing, PaintingKept, TakenUp
from frida_painter.session.procedures.dialogue import Confirm
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.session.resuming import KeptPlan
from frida_painter.web.exports import export
from frida_painter.web.folder import PlanFolder
from frida_painter.web.job import Job
from frida_painter.web.painting_settings import to_paint
from frida_painter.web.pause_controller import PauseController
from frida_painter.web.telling import Reporter

_TIMELAPSE_FRAMES = 400


def paint(job: Job, place: PlanFolder) -> None:
    """Paints the plan, and plans the rest again at every look."""
    folder = job.folder.painting
    storage.new_folder(folder)
    settings, plan = settings_of(place), Plan.load(place.plan)
    wanted, target = wanted_of(place)
    with ExitStack() as stack:
        process = stack.enter_context(EaselProcess())  # it loads while the planner does
        planner, easel, record = _at_the_easel(process, job, settings, wanted.goal, job.station.known)
        how = kept.Kept(settings, record, None, film=True, site=job.site)
        journal = _begin_journal(folder, wanted, how)
        stack.callback(journal.close)
        what = _occasion(job, place, how, wanted, target, planner)
        sitting = _Sitting(job, planner, what, stack.enter_context(_recorder(job, planner, what)))
        sitting.begin(how, easel, journal)
        sitting.to_its_end(lambda session: session.run(settings.strokes, settings.colors, plan))


def resume(job: Job, place: PlanFolder) -> None:
    """Goes on with a painting that was stopped, killed or broke off, from what its journal tells."""
    folder = job.folder.painting
    with ExitStack() as stack:
        journal, history = Journal.reopen(folder)
        stack.callback(journal.close)
        begun = Begun.read(folder, history, accept_changes=False)
        storage.clear_leftovers(folder)
        how, plan = begun.how, begun.plan
        job.feed.tell(TakenUp(history.painted))
        process = stack.enter_context(EaselProcess())
        planner, easel, _ = _at_the_easel(process, job, how.settings, begun.wanted.goal, how.calibration)
        planner.region = resuming.region(folder, history)
        what = _occasion(job, place, how, begun.wanted, begun.target, planner)
        sitting = _Sitting(job, planner, what, stack.enter_context(_recorder(job, planner, what, history)))
        session = sitting.begin(how, easel, journal, history, plan)
        if (bare := resuming.bare_photograph(folder)) is not None:
            session.observer.learn_good(bare)
        now = session.look()
        before = resuming.seen_before(folder, plan, session.observer) if plan else None
        if before is not None and not sitting.is_as_left(begun, history, before, now):
            before = None
        journal.resumed(history, repaint=sitting.repaints(plan, history, now))
        if plan is None:
            sitting.to_its_end(lambda session: session.run(how.settings.strokes, how.settings.colors))
        else:
            where = ResumeState(plan.plan, history.painted, plan.planning.done, before, now)
            sitting.to_its_end(lambda session: session.resume(where))


def settings_of(place: PlanFolder) -> PaintingSettings:
    """How a plan is painted, to the last digit as it will be read again when it is gone on with."""
    return kept.as_read_again(to_paint(place.wish()))


def wanted_of(place: PlanFolder) -> tuple[goals.Wanted, Tensor | None]:
    """The goal of a plan, and its first picture if it has one, as they will fill the canvas."""
    return fit_to_canvas(goals.read_goal(None, {"goal": place.goal}), settings_of(place))


def _at_the_easel(
    process: EaselProcess, job: Job, settings: PaintingSettings, goal: Goal, record: Path | None
) -> tuple[Planner, Easel, Path | None]:
    """The planner, the easel, and the calibration record by which both work; None where a simulated one has none."""
    planner = open_planner(settings, goal, record)
    easel = process.open(job.order(settings, planner.model.brush))
    try:
        return planner, on_record(easel, record, job.site.needed), record
    except CalibrationError:
        if not easel.simulated:
            raise
    # The record is of another simulated easel: this one is as it is delivered.
    return open_planner(settings, goal), easel, None


def _occasion(
    job: Job, place: PlanFolder, how: kept.Kept, wanted: goals.Wanted, target: Tensor | None, planner: Planner
) -> Occasion:
    """What page and record of the painting tell of it."""
    told = occasion(wanted, target, how.settings, planner.encoders, job.site)
    return replace(told, title=place.wish().title or "Untitled")


def _recorder(job: Job, planner: Planner, what: Occasion, history: History | None = None) -> Recorder:
    return Recorder(job.folder.painting, what, planner.model, _timelapse_frames(job, what), history)


def _timelapse_frames(job: Job, what: Occasion) -> int:
    """How many pictures the film gets: none by hand, for nobody wants to step aside after every stroke."""
    return 0 if job.site.robot == HUMAN else min(int(what.settings["strokes"]), _TIMELAPSE_FRAMES)


class _Sitting:
    """One sitting: whoever listens to it, how it ends, and what is asked on the way."""

    def __init__(self, job: Job, planner: Planner, what: Occasion, recorder: Recorder) -> None:
        self._job, self._planner, self._recorder = job, planner, recorder
        self._timelapse_frames = _timelapse_frames(job, what)
        self.session: PaintingSession
        self._reporter: Reporter

    def begin(
        self,
        how: kept.Kept,
        easel: Easel,
        journal: Journal,
        history: History | None = None,
        plan: KeptPlan | None = None,
    ) -> PaintingSession:
        """Connects robot and camera, and opens the session, whose events are recorded and told."""
        job, planner = self._job, self._planner
        easel = attended_by(easel, job.site, job.asker.answer)
        forecast = _forecast(planner, how.settings)
        self._reporter = Reporter(job.feed, job.folder, planner.model, planner.size, forecast)
        together = PauseController(job.folder, job.feed, job.stop)
        easel.robot.connect()
        easel.camera.connect()

        def hear(event: Event) -> None:
            self._recorder.hear(event)
            self._reporter.hear(event)
            together.hear(event)

        together.session = self.session = open_session(
            how.settings,
            planner,
            easel,
            timelapse_frames=self._timelapse_frames,
            stop_asked=lambda: job.stop.asked,
            pause_asked=together.pause_asked,
            go_on=together.go_on,
            notify=hear,
            journal=journal,
            light=resuming.light(history) if history else None,
            placement=plan.planning.placement if plan else None,
        )
        return self.session

    def to_its_end(self, painting: Callable[[PaintingSession], Painting]) -> None:
        """Paints; whatever ends it, what there is by then is kept and told."""
        try:
            made = painting(self.session)
        except (RobotStopped, PaintingPaused):
            if not self._job.stop.asked:
                raise
            so_far = self.session.so_far
            made = Painting(self._reporter.seen, self._reporter.done, so_far.rest if so_far else None)
            self._job.feed.tell(Stopped(self._reporter.done))
        self._job.feed.tell(Finishing())
        with suppress(FridaError):  # whatever is wrong with it was told before
            self.session.brushwork.easel.robot.close()  # a film of the arm ends here
        self._recorder.finish(made)
        whole = Plan.load(self._job.folder.painting)
        export(whole, self._planner.model, self._job.folder.painting)
        films = {"film": "film.mp4", "arm": ARM_FILM}
        there = {name: (self._job.folder.painting / file).exists() for name, file in films.items()}
        self._job.feed.tell(PaintingKept(**there))

    def is_as_left(self, begun: Begun, history: History, before: Tensor, now: Tensor) -> bool:
        """Whether the canvas is as it was left; where it is not, a person has to want it painted on all the same."""
        try:
            require_as_left(begun, history, self._planner, self.session.observer, before, now)
        except FrameRejected as difference:
            question = f"{str(difference).split(' Look at ')[0]} Shall it be painted on as it is?"
            if self._job.asker.answer(Confirm(question, now, proposal=False)) is not True:
                raise
            return False
        return True

    def repaints(self, kept_plan: KeptPlan | None, history: History, now: Tensor) -> bool:
        """Whether the stroke in doubt, if there is one, is painted again."""
        if history.in_doubt is None or kept_plan is None:
            return False
        number, plan = history.in_doubt, kept_plan.plan
        painted = self._planner.expected(plan.part(slice(number - 1, number)), now)
        question = f"Stroke {number} was begun, and nothing tells whether it was painted. Paint it again?"
        return self._job.asker.answer(Confirm(question, doubt(plan, number - 1, now, painted), proposal=False)) is True


def _forecast(planner: Planner, settings: PaintingSettings) -> Forecast:
    again = planner.effort.refining + planner.effort.replanning
    policy = EvenlySpaced(settings.replans)
    return Forecast(settings.strokes, policy, time.monotonic(), planning=0, replanning=again)


def _begin_journal(folder: Path, wanted: goals.Wanted, how: kept.Kept) -> Journal:
    """Keeps in the folder what the command line keeps, so that it can resume the painting."""
    kept.keep_goal(wanted, folder)
    how.write(folder)
    return Journal.begin(folder, how.plain(), how.rests_on(folder))
