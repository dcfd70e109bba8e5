"""PaintingRun: one painting from its description to its folder; everything that plans or paints one goes through here.

Command line, page and notebooks give it a RunSpec, listen to its events, and lead it by its Controls. It alone puts
planner, easel process, journal and recorder together.
"""

import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import torch
from torch import Tensor

from frida_painter import images, storage
from frida_painter.calibration import Calibration
from frida_painter.compiled import LoopCompiler
from frida_painter.devices import prepare_process
from frida_painter.easel.kinds import OpenEasel
from frida_painter.easel.launch import EaselLaunch
from frida_painter.easel.open import open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.errors import (
    CalibrationError,
    CameraError,
    ConfigError,
    FrameRejected,
    FridaError,
    Interrupted,
    PaintingPaused,
    RobotError,
    StorageError,
)
from frida_painter.hardware.easel import Easel
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.palette import Palette, load_clustering
from frida_painter.perception.color import read_palette
from frida_painter.plan import Plan
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Planner
from frida_painter.report.recorder import Recorder
from frida_painter.runs.easel import needed_calibrations, order, require_sensible, with_operator
from frida_painter.runs.folder import (
    CALIBRATION,
    NOW,
    ReopenedPainting,
    keep_goal,
    keep_learned,
    keep_spec,
    new_folder,
    reopen,
)
from frida_painter.runs.folder import input_hashes as hashes
from frida_painter.runs.settle import Controls, SettledRun, fitted, open_goal, open_recorder, open_session, settle
from frida_painter.runs.spec import RunSpec
from frida_painter.session import resuming
from frida_painter.session.events import Event, Finishing, Looked, Notify, Resumed, Stopped, TimelapseFrame
from frida_painter.session.journal import History, Journal
from frida_painter.session.loop import PaintingSession
from frida_painter.session.opening import on_record
from frida_painter.session.painting import Painting, ResumeState

_ROOM = 200 * 2**20  # bytes


@dataclass(frozen=True)
class RunOutcome:
    """How a run ended.

    painting: the result, None where no photograph was taken yet; page: its report; trouble: the fault that ended the
    run, if any; calibration: the record that was renewed by what was learned of the easel.
    """

    folder: Path
    painting: Painting | None
    page: Path | None
    trouble: FridaError | None = None
    calibration: Path | None = None


class PaintingRun:
    """One painting, used in a `with` block: `plan`, `start`, `simulate`, or, for one that was reopened, `resume`.

    spec: its description, with the final canvas; goal: what is to be painted, with pictures as they fill the canvas;
    target [3, H, W]: the first of them; folder: where everything goes, made when painting begins; listeners: hear all
    events; controls: by what it is led; state: where stops are latched; record_may_differ: whether a simulated easel
    is painted on as it is delivered where the calibration record is of another one; encoders: the networks that the
    goal is seen through, by default those that were fetched; mixed: the paints that the description says were mixed,
    None where those of the plan are, and read when the block is entered; remarks: sentences for the person;
    choosing: hears at every step of quick plans what they choose, "brushes" or "ground", and may raise to end them;
    tell: hears in a sentence what is waited for before planning begins.
    Raises ConfigError and ImageError where the description makes no painting.
    """

    def __init__(
        self,
        spec: RunSpec,
        folder: str | Path | None = None,
        *,
        listeners: Iterable[Notify] = (),
        controls: Controls | None = None,
        state: Path | None = None,
        record_may_differ: bool = False,
        encoders: EncoderRegistry | None = None,
        _reopened: ReopenedPainting | None = None,
    ) -> None:
        if _reopened is None:
            require_sensible(spec)
        self._reopened = _reopened
        self._fitted = fitted(spec, open_goal(spec), canvas_is_fixed=_reopened is not None)
        self._settled: SettledRun | None = None
        self.goal, self.target = self._fitted.goal, self._fitted.target
        self.choosing: Callable[[str], None] = lambda what: None
        self.tell: Callable[[str], None] = lambda sentence: None
        self.mixed: Palette | None = None
        self._folder = None if folder is None else Path(folder)
        self.listeners: list[Notify] = list(listeners)
        self.controls = controls or Controls()
        self._state = state
        self._record_may_differ = record_may_differ
        self._encoders = encoders
        self._stack = ExitStack()
        self._process: EaselProcess | None = None
        self._easel: Easel | None = None
        self._record: Calibration | None = None  # as its file has it
        self._seen: Tensor | None = None  # the canvas as it was photographed last
        self.session: PaintingSession | None = None

    @classmethod
    def reopen(
        cls, folder: str | Path, *, accept_changes: bool = False, pace: float = 0.0, state: Path | None = None
    ) -> Self:
        """A painting that was stopped, killed or has paused; its journal is held until the `with` block ends.

        pace: of a simulated robot, 1 as a real one, 0 as fast as can be computed. Raises StorageError where the folder
        is no painting's or another process works on it, ConfigError, naming all of them, where something was changed
        since and that was not accepted.
        """
        reopened = reopen(Path(folder), accept_changes=accept_changes, pace=pace)
        try:
            return cls(reopened.spec, folder, state=state, _reopened=reopened)
        except BaseException:
            reopened.journal.close()
            raise

    def __enter__(self) -> Self:
        self._stack.enter_context(LoopCompiler())
        if self._reopened is None and self.spec.palette is not None:
            self.mixed = read_palette(self.spec.palette, self.spec.colors)
        threads = torch.get_num_threads()
        prepare_process()
        self._stack.callback(torch.set_num_threads, threads)
        if self._reopened is not None:
            self._stack.callback(self._reopened.journal.close)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    @property
    def history(self) -> History | None:
        """What the journal of a reopened painting tells; None for a new one."""
        return None if self._reopened is None else self._reopened.history

    @property
    def folder(self) -> Path:
        """The folder of the painting. Raises ConfigError before there is one."""
        if self._folder is None:
            raise ConfigError("This painting has no folder yet; it gets one when painting begins.")
        return self._folder

    @property
    def planner(self) -> Planner:
        """The planner, opened when it is first asked for; nothing of the painting is left open from then on.

        Raises WeightsError if a network is missing, and what `choosing` raises: then nothing is settled.
        """
        if self._settled is None:
            region = None if self._reopened is None else resuming.region(self.folder, self._reopened.history)
            self._settled = settle(
                self._fitted, self._encoders, region=region, choosing=lambda what: self.choosing(what), tell=self.tell
            )
        return self._settled.planner

    @property
    def spec(self) -> RunSpec:
        """Its description: with its final canvas, and, once there is a planner, with the brushes and the ground."""
        return self._fitted.spec if self._settled is None else self._settled.spec

    @property
    def remarks(self) -> list[str]:
        """Sentences for the person, on what a picture lost and on what was chosen."""
        chosen = () if self._settled is None else self._settled.remarks
        return [*([self._fitted.remark] if self._fitted.remark else []), *chosen]

    @property
    def easel(self) -> Easel:
        """The easel, once it is open. Raises ConfigError before."""
        if self._easel is None:
            raise ConfigError("The easel is not open yet; call open_easel first.")
        return self._easel

    def plan(self, notify: Callable[[Step], None] = lambda step: None) -> Plan:
        """A plan for a bare canvas on its ground; nothing is painted, and nothing is written. Raises PlanError."""
        planner, spec = self.planner, self.spec
        bare = planner.bare
        made = planner.plan(bare, spec.strokes, spec.colors, notify)
        return made if self.mixed is None else planner.bind_to_palette(made, bare, self.mixed, notify)

    def open_easel(self, *, hear_signals: bool = False) -> Easel:
        """Opens and connects the easel, and makes the folder; where the easel cannot be had, there is none.

        hear_signals: whether the easel's process hears the signals of this one, whose main thread this must be.
        """
        if self._process is None:
            self.load_easel()
        assert self._process is not None
        planner = self.planner  # before the folder: what cannot be planned leaves no traces
        fresh = self._reopened is None
        if fresh:
            self._folder = new_folder(self._folder, self.spec.name, _ROOM)
        load_clustering()  # while the easel's process loads
        with _taken_back(self.folder) if fresh else nullcontext():
            easel = self._process.open(order(self.spec, tuple(planner.models), self.folder, self._state))
            self._easel = self._on_record(easel)
            if hear_signals:
                self._stack.enter_context(self._process.hearing_signals())
            self._easel.robot.connect()
            self._easel.camera.connect()
        return self._easel

    def load_easel(self, launch: EaselLaunch | None = None) -> None:
        """Starts the easel's process, which loads while the planner does; or takes over one that was started before."""
        self._process = self._stack.enter_context(EaselProcess(launch or EaselLaunch(self.spec.robot)))

    def start(self, plan: Plan | None = None) -> RunOutcome:
        """Paints it: plan, paint some strokes, look, plan the rest again.

        plan: one of as many strokes that was made before, and is painted instead of a new one. Raises what keeps it
        from beginning; what ends it later is the outcome's trouble, and what was made by then is kept.
        """
        if self._easel is None:
            self.open_easel()
        keep_goal(self.spec, self.folder)
        keep_spec(self.spec, self.folder)
        self.easel.calibration.save(self.folder / CALIBRATION)
        journal = Journal.begin(self.folder, self.spec.record(), hashes(self.spec, self.folder))
        self._stack.callback(journal.close)
        recorder = self._recorder()
        self._stack.enter_context(recorder)
        session = self._open_session(self.easel, journal, recorder.hear)
        spec = self.spec
        return self._to_its_end(session, recorder, lambda: session.run(spec.strokes, spec.colors, plan))

    def simulate(self, plan: Plan | None = None, opener: Callable[[EaselOrder], OpenEasel] | None = None) -> Painting:
        """Paints it on its simulated easel inside this process and writes nothing: for experiments and sweeps.

        The picture is the one that `start` paints. plan: as for `start`; opener: opens another simulated easel than
        the usual one of that name. Raises ConfigError where a real robot would move, or where the painting was begun
        before.
        """
        if not self.spec.simulated or self._reopened is not None:
            raise ConfigError(
                f"Only a new painting on a simulated easel is painted without a folder, and this one is for "
                f"{self.spec.robot!r}; use start, or resume."
            )
        opened = (opener or open_easel)(order(self.spec, tuple(self.planner.models), None, self._state))
        try:
            easel = self._on_record(opened.easel)
            easel.robot.connect()
            easel.camera.connect()
            session = self._open_session(easel, Journal.nowhere())
            return session.run(self.spec.strokes, self.spec.colors, plan)
        finally:
            opened.close()

    def resume(self) -> RunOutcome:
        """Paints what is left: photographs the canvas, asks about the stroke in doubt, cleans the brush, goes on.

        Of a painting that is finished, only its results are made again. Raises FrameRejected where the canvas is not as
        it was left and nobody wants it painted on.
        """
        if self._reopened is None:
            raise ConfigError("This painting was not begun yet; give its folder to PaintingRun.reopen to resume it.")
        storage.clear_leftovers(self.folder)
        if self._reopened.history.finished:
            return self._make_results(self._reopened.history, self._reopened.plan)
        if self._easel is None:
            self.open_easel()
        journal, history, kept = self._reopened.journal, self._reopened.history, self._reopened.plan
        recorder = self._recorder()
        session = self._open_session(self.easel, journal, recorder.hear)
        if (bare := resuming.bare_photograph(self.folder)) is not None:
            session.observer.learn_good(bare, resuming.last_photograph(self.folder, history))
        resuming.recall_brush(session.brushwork, history, self.controls.answer)
        now = session.look()
        images.save(now, self.folder / NOW)
        before = resuming.seen_before(self.folder, kept, session.observer) if kept else None
        if before is not None and not self._is_as_left(session, before, now):
            before = None
        journal.resumed(history, repaint=self._repaints(now))
        self._stack.enter_context(recorder)
        if kept is None:
            return self._to_its_end(session, recorder, lambda: session.run(self.spec.strokes, self.spec.colors))
        wet = history.wet(None if self.easel.simulated else datetime.now(UTC))
        where = ResumeState(kept.plan, history.painted, kept.planning.done, before, now, wet)
        return self._to_its_end(session, recorder, lambda: session.resume(where))

    def _make_results(self, history: History, kept: resuming.KeptPlan | None) -> RunOutcome:
        """Picture, film, page and figures of a finished painting, from what its folder holds; nothing is moved."""
        if kept is None:
            raise StorageError(f"{self.folder} holds no plan, and without it there is nothing to tell; bring it back.")
        canvas = resuming.last_canvas(self.folder, history, self.spec.canvas, self.folder / CALIBRATION)
        before = resuming.first_canvas(self.folder, history, self.spec.canvas, self.folder / CALIBRATION)
        with self._recorder() as recorder:
            expected = self.planner.expected(kept.plan, self.planner.bare if before is None else before)
            recorder.hear(Resumed(kept.plan, history.painted, expected))
            painting = Painting(canvas, history.painted, None, history.robot_seconds)
            return RunOutcome(self.folder, painting, recorder.finish(painting))

    def _on_record(self, easel: Easel) -> Easel:
        """The easel by its calibration record; one of another simulated easel is as it is delivered."""
        try:
            self._record = None if self.spec.calibration is None else Calibration.load(self.spec.calibration)
            return on_record(easel, self.spec.calibration, needed_calibrations(self.spec))
        except CalibrationError:
            if not (easel.simulated and self._record_may_differ):
                raise
        self._fitted = replace(self._fitted, spec=self.spec.model_copy(update={"calibration": None}))
        self._settled = None
        return easel

    def _recorder(self) -> Recorder:
        return open_recorder(self.spec, self.target, self.planner, self.folder, self.history)

    def _open_session(self, easel: Easel, journal: Journal, record: Notify = lambda event: None) -> PaintingSession:
        easel = with_operator(easel, self.spec, self.controls.answer)

        def hear(event: Event) -> None:
            if isinstance(event, TimelapseFrame | Looked):
                self._seen = event.photograph
            record(event)
            for listener in self.listeners:
                listener(event)

        self.session = open_session(
            self.spec,
            self.planner,
            easel,
            replace(self.controls, stop_asked=self._stop_asked),
            mixed=self.controls.mixed or (lambda wanted: self.mixed),
            paint_on=self._paint_on,
            notify=hear,
            journal=journal,
            light=resuming.light(self.history) if self.history else None,
            placement=self._reopened.placement if self._reopened else None,
        )
        return self.session

    def _stop_asked(self) -> bool:
        """Whether it ends after this stroke or planning iteration: a person wants that, or the robot was stopped."""
        return self.controls.stop_asked() or (self._process is not None and self._process.stopped)

    def _paint_on(self, sentence: str, canvas: Tensor) -> bool:
        """Whether a canvas that is not bare at first is painted on; it is shown to whoever is asked."""
        if self._folder is not None:
            images.save(canvas, self.folder / NOW)
        accepted = self._reopened is not None and self._reopened.accept_changes
        return accepted or self.controls.paint_on(sentence, canvas)

    def _to_its_end(self, session: PaintingSession, recorder: Recorder, paint: Callable[[], Painting]) -> RunOutcome:
        """Paints; where robot, camera or person give up on the way, what there is by then is kept as after a stop."""
        trouble: FridaError | None = None
        painting: Painting | None
        try:
            painting = paint()
        except (RobotError, CameraError, PaintingPaused, Interrupted) as fault:
            trouble, painting = fault, session.so_far
            if painting is not None:
                painting = replace(painting, photograph=painting.photograph if self._seen is None else self._seen)
                for hear in (recorder.hear, *self.listeners):
                    hear(Stopped(painting.painted))
        if painting is not None and painting.rest is not None:  # else there is no plan, and nothing to finish
            for listener in self.listeners:
                listener(Finishing())
        with suppress(FridaError):  # whatever is wrong with it was told before
            session.brushwork.easel.robot.close()  # a film of it ends here
        page = None
        try:
            page = None if painting is None else recorder.finish(painting)
        except StorageError as full:
            if trouble is None:  # else the trouble that ended it is what a person has to know
                raise StorageError(
                    f"{full} What was painted is noted: `frida-painter resume {self.folder}` writes the rest later."
                ) from full
        learned = session.brushwork.placement
        kept = None if trouble or painting is None else keep_learned(self.spec, self._record, learned, painting)
        return RunOutcome(self.folder, painting, page, trouble, kept)

    def _is_as_left(self, session: PaintingSession, before: Tensor, now: Tensor) -> bool:
        """Whether the canvas is as it was left; where it is not, somebody has to want it painted on all the same."""
        assert self._reopened is not None
        if self._reopened.accept_changes:
            return False
        try:
            self._reopened.require_as_left(session.observer.good, self.planner, before, now)
        except FrameRejected as difference:
            if self.controls.paint_on(str(difference), now):
                return False
            raise FrameRejected(
                f"{difference} Look at {self.folder / NOW}; if it is to be painted on as it is, say --accept-changes"
            ) from difference
        return True

    def _repaints(self, now: Tensor) -> bool:
        """Whether the stroke in doubt, if there is one, is painted again; a picture of it is kept."""
        assert self._reopened is not None
        picture = self._reopened.stroke_in_doubt(self.planner, now)
        number = self._reopened.history.in_doubt
        if picture is None or number is None:
            return False
        images.save(picture, self.folder / NOW)
        return self.controls.repaint(number, picture)


@contextmanager
def _taken_back(folder: Path) -> Iterator[None]:
    """Where the easel cannot be had, nothing was begun: the new folder goes away again."""
    try:
        yield
    except FridaError:
        shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):  # "paintings", where this would have been the first
            folder.parent.rmdir()
        raise


def paint(
    photo: str | Path | None = None, *, text: str | None = None, folder: str | Path | None = None, **settings: Any
) -> RunOutcome:
    """Paints a photograph, words, or both in the virtual studio, or where the settings say; returns how it ended.

    settings: fields of RunSpec, such as strokes=50 or style, sketch and others through goal=[{"style": "waves.jpg"}];
    folder: where everything goes, by default one below "paintings". Raises ConfigError for what makes no painting.
    """
    asked = [*([{"image": str(photo)}] if photo is not None else []), *([{"text": text}] if text is not None else [])]
    spec = RunSpec.of(**{**settings, "goal": [*asked, *settings.get("goal", [])]})
    with PaintingRun(spec, folder) as run:
        return run.start()
