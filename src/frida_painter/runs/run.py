"""PaintingRun: one painting from its description to its folder; all interfaces plan and paint through it.

Command line, page and notebooks give it a RunSpec, listen to its events, and steer it with Controls. Only this
module connects planner, easel process, journal and recorder.
"""

import gc
import json
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Literal, Self, Unpack

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.calibration import Calibration
from frida_painter.easel.connecting import connect_easel
from frida_painter.easel.dialogue import Answer, Question
from frida_painter.easel.kinds import ARM_FILM, JOURNAL, SIMULATION_LOG, STOP_FILE, OpenEasel
from frida_painter.easel.open import open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.errors import (
    CalibrationError,
    CameraError,
    ConfigError,
    FridaError,
    ImageError,
    Interrupted,
    PaintingPaused,
    RobotError,
    StorageError,
)
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.kinds import MachineName
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.perception.color import read_palette
from frida_painter.planning.forecast import SimilarityForecast
from frida_painter.planning.optimize import Step
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.registry import Later
from frida_painter.report.film import SKETCHBOOK
from frida_painter.report.recorder import Recorder
from frida_painter.runs.goals import open_goal
from frida_painter.runs.painting_easel import needed_calibrations, order, with_operator
from frida_painter.runs.painting_folder import (
    CALIBRATION,
    NOW,
    PAINTINGS,
    RECORD,
    SETTINGS,
    RunRecord,
    hash_files,
    hash_picture,
    input_hashes,
    keep_goal,
    keep_learned,
    new_folder,
)
from frida_painter.runs.reopening import ReopenedPainting, reopen
from frida_painter.runs.settle import (
    fit_canvas,
    name_families,
    open_networks,
    open_planner,
    open_recorder,
    replan_policy,
    settle,
)
from frida_painter.runs.spec import RunSpec
from frida_painter.session import events, resuming
from frida_painter.session.controls import Controls
from frida_painter.session.fold import PaintingState
from frida_painter.session.hand import Hand, with_measured_dip
from frida_painter.session.journal import PHOTOGRAPHS, Journal
from frida_painter.session.loop import Extent, PaintingSession
from frida_painter.session.observer import CanvasObserver, CanvasStart
from frida_painter.session.open_loop import NOBODY_LOOKS
from frida_painter.session.opening import on_record
from frida_painter.session.progress import Painting
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.system import event_log, images, storage
from frida_painter.system.devices import prepare_process
from frida_painter.system.images import AnyPicture

if TYPE_CHECKING:
    from frida_painter.runs.look_folder import GivenPicture
    from frida_painter.runs.setting_types import Settings

_begin_together = Later("frida_painter_together.turns:begin_together")
_open_looks = Later("frida_painter.runs.look_folder:LookFolder")

_ROOM = 200 * 2**20  # bytes


@dataclass(frozen=True)
class RunOutcome:
    """Result of a run.

    painting: result, None if no photograph was taken.
    page: its report.
    trouble: error that ended the run, if any.
    calibration: calibration record that was updated, if any.
    similarity: of the painting to its photograph, or else to its first plan, in words.
    """

    folder: Path
    painting: Painting | None
    page: Path | None
    trouble: FridaError | None = None
    calibration: Path | None = None
    similarity: str = ""


class PaintingRun:
    """One painting, used in a `with` block: `plan`, `start` or `simulate`; `resume` for a reopened one.

    spec: description, with the final canvas.
    goal: goal, with pictures that fill the canvas.
    target [3, H, W]: first picture of the goal.
    folder: folder of the painting, made when painting begins.
    listeners: receive all events.
    controls: steer the painting.
    state: folder for latched stops.

    keepers: keep more pictures of an event, and return the event with their files, before listeners hear it.
    record_may_differ: True if a simulated easel ignores a calibration record of another easel.
    encoders: networks that judge the goal. None: the fetched ones.
    mixed: mixed paints of the description's palette file, read at the start of the block; None: those of the plan.
    remarks: sentences for the person.
    tell: receives a sentence about each wait before planning.
    heed: called often in these waits; may raise to end them.
    finish: adds results of its own to those of a painting, before it counts as finished.
    Raises ConfigError and ImageError if the description makes no painting.

        >>> import frida_painter as fp
        >>> spec = fp.RunSpec.of(goal=[{"image": "photo.jpg"}], canvas="12x9cm", strokes=3, replans=0, render_height=64)
        >>> with fp.PaintingRun(spec) as run:
        ...     painting = run.simulate()
        >>> painting.painted
        3
    """

    def __init__(
        self,
        spec: RunSpec,
        folder: str | Path | None = None,
        *,
        listeners: Iterable[events.Notify] = (),
        controls: Controls | None = None,
        state: str | Path | None = None,
        record_may_differ: bool = False,
        encoders: EncoderRegistry | None = None,
        _reopened: ReopenedPainting | None = None,
    ) -> None:
        if _reopened is None:
            spec.require_sensible()
        self._reopened = _reopened
        self._fitted = fit_canvas(spec, open_goal(spec), canvas_is_fixed=_reopened is not None)
        self._settled: tuple[RunSpec, Planner, str] | None = None
        self.goal, self.target = self._fitted.goal, self._fitted.target
        self.tell: Callable[[str], None] = lambda sentence: None
        self.heed: Callable[[], None] = lambda: None
        self.finish: Callable[[RunOutcome], None] = lambda outcome: None
        self.mixed: Palette | None = None
        self._folder = None if folder is None else Path(folder)
        self.listeners: list[events.Notify] = list(listeners)
        self.controls = controls or Controls()
        self._state = None if state is None else Path(state)
        self._record_may_differ = record_may_differ
        self._journal = Journal(None) if _reopened is None else _reopened.journal
        self.keepers: list[Callable[[events.Event], events.Event]] = []
        self._encoders = encoders
        self._stack = ExitStack()
        self._process: EaselProcess | None = None
        self._easel: Easel | None = None
        self._record: Calibration | None = None  # as in its file
        self._seen: AnyPicture | None = None  # last photographed canvas
        self.session: PaintingSession | None = None
        self._run_record: RunRecord | None = None
        self._before: dict[str, str] = {}  # hashes of the files of a finished painting
        self._results: dict[str, str] = {}  # hashes for the record; empty until it is finished

    @classmethod
    def reopen(
        cls,
        folder: str | Path,
        *,
        accept_changes: bool = False,
        pace: float = 0.0,
        state: str | Path | None = None,
        forget_stop: bool = True,
        robot: str | None = None,
    ) -> Self:
        """Opens a painting that was stopped, killed or paused; locks its journal until the `with` block ends.

        pace: speed of a simulated robot: 1 as a real one, 0 as fast as possible.
        forget_stop: True to remove the stop file of another sitting.
        robot: the same kind of robot at another port or address.
        Raises StorageError if the folder holds no painting or another process works on it. Raises ConfigError, with
        all changes, if something has changed and that is not accepted.
        """
        reopened = reopen(Path(folder), accept_changes=accept_changes, pace=pace)
        if forget_stop:
            _forget_stop(Path(folder))
        try:
            spec = reopened.spec
            if robot is not None:
                if MachineName.of(robot).kind != MachineName.of(spec.robot).kind:
                    raise ConfigError(f"{spec.robot} paints this; --robot only says where that robot is now.")
                spec = spec.with_values(robot=robot)
            return cls(spec, folder, state=state, _reopened=reopened)
        except BaseException:
            reopened.journal.close()
            raise

    def __enter__(self) -> Self:
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
        if self._easel is not None or self._reopened is not None:
            _forget_stop(self.folder)
        if self._run_record is not None and self._results:  # nobody writes into the folder any more
            with suppress(StorageError) if kind is not None else nullcontext():  # the first error matters more
                self._run_record.finish(self.painting, self._before, **self._results)

    @property
    def history(self) -> PaintingState | None:
        """State of a reopened painting, which goes on with it; None for a new one."""
        return None if self._reopened is None else self.painting

    @property
    def painting(self) -> PaintingState:
        """State of the painting, which goes on with it."""
        return self._journal.state

    @property
    def folder(self) -> Path:
        """Folder of the painting. Raises ConfigError before it exists."""
        if self._folder is None:
            raise ConfigError("This painting has no folder yet; it gets one when painting begins.")
        return self._folder

    @property
    def planner(self) -> Planner:
        """Planner, opened at the first access; brushes and ground are then fixed.

        Raises WeightsError if a network is missing, and the errors of `heed`; then nothing is fixed.
        """
        if self._settled is None:
            region = resuming.region(self._folder or PAINTINGS, self.painting)
            networks = self._encoders or open_networks(self.spec, self.tell, self.heed)
            spec, planner, chosen = settle(self._fitted, networks)
            self._settled = spec, planner if region is None else planner.keeping_clear(region), chosen
        return self._settled[1]

    @property
    def spec(self) -> RunSpec:
        """Description with its final canvas, and, once there is a planner, with the brushes and the ground."""
        return self._fitted.spec if self._settled is None else self._settled[0]

    @property
    def remarks(self) -> list[str]:
        """Sentences for the person about a lost part of a picture, a chosen ground, no camera, and a journal."""
        chosen = "" if self._settled is None else self._settled[2]
        told = (self._fitted.remark, chosen, "" if self.spec.has_camera else NOBODY_LOOKS)
        return [remark for remark in (*told, self.painting.sittings.unknown_sentence) if remark]

    @property
    def easel(self) -> Easel:
        """Open easel. Raises ConfigError before it is open."""
        if self._easel is None:
            raise ConfigError("The easel is not open yet; call open_easel first.")
        return self._easel

    @property
    def is_stopped(self) -> bool:
        """True if the robot was stopped, by whomever."""
        return self._process is not None and self._process.stopped

    def check(self, *, paints: bool) -> None:
        """Raises what a plan of this description would raise, and a painting if it `paints`.

        Plans nothing, connects no robot and makes no folder.
        """
        if self.spec.palette is not None:
            read_palette(self.spec.palette, self.spec.colors)
        planner = open_planner(name_families(self.spec), self.goal, self._encoders)
        planner.layer_sizes(self.spec.strokes)
        if paints:
            storage.require_space(self._folder or PAINTINGS, _ROOM, "this painting")
            with closing(open_easel(order(self.spec, planner.brushes, None, self._state))) as opened:
                self._on_record(opened.easel)

    def plan(self, notify: Callable[[Step], None] = lambda step: None) -> Plan:
        """Returns a plan for a bare canvas on its ground; paints and writes nothing. Raises PlanError."""
        planner, spec = self.planner, self.spec
        if spec.together:
            begun: Plan = _begin_together(planner, spec.colors, self.mixed)
            return begun
        bare = planner.bare
        made = planner.plan(bare, spec.strokes, spec.colors, notify)
        return made if self.mixed is None else planner.bind_to_palette(made, bare, self.mixed, notify)

    def open_easel(self, *, hear_signals: bool = False, answer: Callable[[Question], Answer] | None = None) -> Easel:
        """Opens and connects the easel, and makes the folder; the folder is removed if the easel cannot be opened.

        hear_signals: True if the easel's process also gets the signals of this process; call it in the main thread
        then.
        answer: asks a person for the zero of a machine that lost it; None for that of the controls.
        """
        if self._process is None:
            self.load_easel()
        assert self._process is not None
        planner = self.planner  # before the folder is made, so that a failed planner leaves no traces
        fresh = self._reopened is None
        given = self._folder is not None and self._folder.exists()
        if fresh:
            self._folder = new_folder(self._folder, self.spec.name, _ROOM)
        with _take_back_on_failure(self.folder, made=not given) if fresh else nullcontext():
            ordered = order(self.spec, planner.brushes, self.folder, self._state)
            easel = self._process.open(ordered, lambda sentence: self.tell(sentence))
            known = self._on_record(easel)
            if hear_signals:
                self._stack.enter_context(self._process.hearing_signals())
            self._easel = connect_easel(known, answer or self.controls.answer, lambda sentence: self.tell(sentence))
        return self._easel

    def load_easel(self, process: EaselProcess | None = None) -> None:
        """Starts the easel's process, or uses one that was started before; it loads in parallel with the planner."""
        self._process = self._stack.enter_context(process or EaselProcess(self.spec.robot))

    def require_fitting(self, plan: Plan) -> None:
        """Raises ConfigError if a plan is for another canvas (by over 0.1 mm), number of strokes, or brushes."""
        brushes, spec = self.planner.brushes, self.spec
        size, strokes = spec.canvas, 0 if spec.together else spec.strokes
        off = max(abs(plan.canvas.width - size.width), abs(plan.canvas.height - size.height))
        if len(plan) == strokes and set(plan.brushes) == set(brushes) and off <= 1e-4:
            return
        given, wanted = (
            f"{storage.count_of(count, 'stroke')} by {' and '.join(names)} on a canvas of "
            f"{1000 * canvas.width:.1f} x {1000 * canvas.height:.1f} mm"
            for canvas, count, names in ((plan.canvas, len(plan), plan.brushes), (size, strokes, brushes))
        )
        raise ConfigError(
            f"The plan is for {given}, and this painting has {wanted}; give --canvas, --strokes and --brushes of the "
            "plan and the picture that it was made for, or leave --plan out."
        )

    def start(self, plan: Plan | None = None) -> RunOutcome:
        """Paints the painting: plan, paint some strokes, look, replan the rest.

        plan: plan with the same number of strokes, painted instead of a new one.
        Raises an error if it cannot begin, or the plan is not for it. A later one is in the outcome; results are kept.
        """
        if plan is not None:
            self.require_fitting(plan)
        if self._easel is None:
            self.open_easel()
        keep_goal(self.spec, self.folder)
        storage.write_text(self.folder / SETTINGS, json.dumps(self.spec.record(), indent=2) + "\n")
        self.easel.calibration.save(self.folder / CALIBRATION)
        self._run_record = self._begin_record("painting", given=plan is not None)
        self._journal = Journal.begin(self.folder, self.spec.record(), input_hashes(self.spec, self.folder))
        self._stack.callback(self._journal.close)
        recorder = self._stack.enter_context(self._recorder())
        session = self._open_session(self.easel)
        return self._to_its_end(session, recorder, lambda: self._paint_all(session, plan))

    def _paint_all(self, session: PaintingSession, plan: Plan | None = None) -> Painting:
        first = plan or (self.plan() if self.spec.together else None)
        return session.run(self.spec.strokes, self.spec.colors, first)

    def _begin_record(self, kind: Literal["painting", "plan"], *, given: bool = False) -> RunRecord:
        """Writes the record of how this run is made into its folder, which holds its goal. Raises StorageError."""
        made = self._fitted.spec  # before brushes and ground were chosen, so that they are chosen again
        return RunRecord.begin(self.folder, kind, made, self.spec.brush_names, self.planner.device.type, given=given)

    def forecast(self, plan: Plan) -> SimilarityForecast | None:
        """Forecasts the similarity of the plan's painting to its photograph, with the looks of the description."""
        unseen = replan_policy(self.spec).next_look(0, len(plan)) if len(plan) else 0
        return self.planner.forecast(plan, self.planner.bare, unseen=unseen)

    def plan_into(self, folder: str | Path, plan: Plan) -> None:
        """Writes a plan of this run into a folder, with its goal and the record of how it was made."""
        self._folder = folder = Path(folder)
        plan.save(folder / "plan.json")
        keep_goal(self.spec, folder)
        self._begin_record("plan").finish(plan=plan.digest)

    def simulate(self, plan: Plan | None = None, opener: Callable[[EaselOrder], OpenEasel] | None = None) -> Painting:
        """Paints, as `start` does, on the simulated easel in this process and writes nothing: for experiments.

        plan: as for `start`.
        opener: opens another simulated easel. None: the usual one of that name.
        Raises ConfigError for a real robot, and for a reopened painting.
        """
        if not self.spec.simulated or self._reopened is not None:
            raise ConfigError(
                f"Only a new painting on a simulated easel is painted without a folder, and this one is for "
                f"{self.spec.robot!r}; use start, or resume."
            )
        try:
            with closing((opener or open_easel)(order(self.spec, self.planner.brushes, None, self._state))) as opened:
                easel = connect_easel(self._on_record(opened.easel), None, self.tell)
                return self._paint_all(self._open_session(easel), plan)
        finally:
            gc.collect()  # the session and the studio refer to themselves: of many paintings, each would keep 60 MB

    def resume(self) -> RunOutcome:
        """Paints the rest: photographs the canvas, asks about the stroke in doubt, cleans the brush, goes on.

        Of a finished painting, it only makes the results again. Raises FrameRejected if the canvas has changed and
        nobody accepts that.
        """
        if self._reopened is None:
            raise ConfigError("This painting was not begun yet; give its folder to PaintingRun.reopen to resume it.")
        storage.clear_leftovers(self.folder, self.folder / SKETCHBOOK, self.folder / PHOTOGRAPHS)
        self._take_up_record()
        if self.painting.end.finished:
            return self._conclude(self._make_results(self._reopened.plan))
        if self._easel is None:
            self.open_easel()
        recorder, session = self._recorder(), self._open_session(self.easel)
        where, resumed = self._reopened.take_up(session, self.controls)
        self._stack.enter_context(recorder)
        if where is not None:
            self.report(resumed)
        return self._to_its_end(session, recorder, lambda: session.resume(where) if where else self._paint_all(session))

    def show_picture(self, canvas: AnyPicture) -> RunOutcome:
        """Makes the results of a finished painting again, with a person's picture of its canvas."""
        canvas = images.as_picture(canvas)
        assert self._reopened is not None and self.painting.end.finished
        self._take_up_record()
        self._journal.record_canvas(canvas, self.painting.progress.painted, seen=True)
        images.save(canvas, self.folder / "canvas.png")
        return self._make_results(self._reopened.plan)

    def _take_up_record(self) -> None:
        """Reads the record of a reopened painting, if it has one; an older one without hashes of files stays."""
        if (self.folder / RECORD).exists():
            known = RunRecord.load(self.folder)
            self._before = hash_files(self.folder) if known.results else {}
            self._run_record = None if known.results and not known.files else known

    def _make_results(self, kept: resuming.KeptPlan | None) -> RunOutcome:
        """Makes picture, film, page and figures of a finished painting from its folder; nothing moves."""
        if kept is None:
            raise StorageError(f"{self.folder} holds no plan, and without it there is nothing to tell; bring it back.")
        state, seen_by = self.painting, (self.spec.canvas, self.folder / CALIBRATION)
        canvas = resuming.last_canvas(self.folder, state, *seen_by)
        begun = next((planning.photograph for planning in state.planning.adopted if planning.done == 0), None)
        before = resuming.load_canvas(self.folder, begun, state, *seen_by)
        with self._recorder() as recorder:
            expected = self.planner.expected(kept.plan, before)
            recorder.hear(events.SessionResumed(state.progress.painted, plan=kept.plan, expected=expected))
            painting = Painting(canvas, state.progress.painted, None, state.end.robot_seconds)
            if self._run_record is not None:
                self._results = {"painting": hash_picture(canvas), **self._run_record.results}
            page = recorder.finish(painting, self._print_again())
            return RunOutcome(self.folder, painting, page, similarity=recorder.similarity)

    def _print_again(self) -> NDArray[np.uint8] | None:
        """Returns the print of a finished painting from the simulated easel, else from its file; None without one."""
        if not (self.spec.simulated and self.spec.has_camera):
            return None
        log = self.folder / SIMULATION_LOG
        with suppress(StorageError), tempfile.TemporaryDirectory() as place:  # whoever opens a log adds to it
            if log.exists():
                storage.copy(log, Path(place, log.name), "the diary of a virtual studio", storage.MAX_BYTES)
                ordered = order(self.spec, self.planner.brushes, Path(place), self._state)
                with closing(open_easel(ordered)) as opened:
                    return opened.easel.operator.print_canvas()
        with suppress(ImageError):  # the second choice, because an earlier sitting may have left it
            return images.load_exactly(self.folder / "painting.png")
        return None

    def _on_record(self, easel: Easel) -> Easel:
        """Returns the easel with its calibration record; a simulated easel may ignore the record of another easel."""
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
        mixed = not self.spec.simulated or self.controls.mixed is not None
        recorder = open_recorder(self.spec, self.target, self.planner, self.folder, self.painting, is_mixed=mixed)
        self.keepers.insert(0, recorder.hear)
        return recorder

    def report(self, event: events.Event) -> None:
        """Keeps the pictures of an event, shows it in the journal, and tells the listeners."""
        if isinstance(event, events.TimelapseFrame | events.Looked):
            self._seen = event.photograph
        elif isinstance(event, events.CanvasPicture):  # a live one, of a canvas that no camera sees
            self._seen = event.canvas
        for keep in self.keepers:
            event = keep(event)
        self._journal.show(event)
        for listener in self.listeners:
            listener(event)

    def _open_session(self, easel: Easel) -> PaintingSession:
        """Opens a session on an easel with connected robot and camera. Raises LibraryError."""
        spec, planner = self.spec, self.planner
        easel = with_operator(easel, spec, self.controls.answer)

        def paint_on(sentence: str, canvas: Tensor) -> bool:
            if self._folder is not None:
                images.save(canvas, self.folder / NOW)
            accepted = self._reopened is not None and self._reopened.accept_changes
            return accepted or self.controls.paint_on(sentence, canvas)

        first, *others = (
            with_measured_dip(brush_kind(name), easel.calibration, simulated=easel.simulated, refill=spec.refill)
            for name in planner.brushes
        )
        learned = self._reopened.placement if self._reopened else None
        # A person's hand has no heights to correct.
        where = learned or Placement.unknown({} if spec.by_hand else easel.calibration.depths)
        self.session = PaintingSession(
            planner,
            Hand(easel, first, where, others=tuple(others), drying=60 * spec.drying),
            CanvasObserver(easel, CanvasStart(planner.ground, spec.on_canvas, paint_on), resuming.light(self.painting)),
            replan_policy(spec, planner.layer_sizes(spec.strokes)),
            notify=self.report,
            journal=self._journal,
            controls=replace(
                self.controls,
                stop_asked=lambda: self.controls.stop_asked() or self.is_stopped,
                mixed=self.controls.mixed or (lambda wanted: self.mixed),
            ),
            extent=Extent(
                None if spec.minutes is None else 60 * spec.minutes,
                spec.strokes if spec.together else None,
                spec.film_length,
            ),
        )
        if self.session.open_loop is not None and self._folder is not None:
            self.session.open_loop.given = partial(_open_looks(self.folder).take, self.look_at_picture, self.report)
        self.session.expect(0 if spec.together else spec.strokes)  # nobody knows how many a person will ask for
        return self.session

    def look_at_picture(self, given: "GivenPicture") -> None:
        """Takes a person's picture of the canvas for a look, between strokes or in a pause, and replans the rest.

        Raises ConfigError before the first plan, and the errors of `GivenPicture.look`.
        """
        if self.session is None:
            raise ConfigError("Nothing is painted yet; give a picture when there is something to see on the canvas.")
        given.look(self.session, self.folder / JOURNAL)

    def _to_its_end(self, session: PaintingSession, recorder: Recorder, paint: Callable[[], Painting]) -> RunOutcome:
        """Paints; if robot, camera or person give up, the results so far are kept as after a stop."""
        trouble: FridaError | None = None
        painting: Painting | None
        try:
            painting = paint()
        except (RobotError, CameraError, PaintingPaused, Interrupted) as fault:
            trouble, painting, seen = fault, session.so_far, self._seen
            if painting is not None:
                if seen is not None:
                    painting = replace(painting, photograph=images.as_picture(seen))
                self.report(events.Stopped())
        if painting is not None and painting.rest is not None:  # else there is no plan, and nothing to finish
            self.report(events.Began("results"))
        printed: NDArray[np.uint8] | None = None
        with suppress(FridaError):  # its faults were reported before
            if painting is not None and self.spec.has_camera:  # else nobody sees what is on the canvas
                printed = session.hand.easel.operator.print_canvas()
            session.hand.easel.robot.close()  # ends a film of the robot
        page = None
        try:
            page = None if painting is None else recorder.finish(painting, printed)
        except StorageError as full:
            if trouble is None:  # else the first error matters more
                raise StorageError(
                    f"{full} What was painted is noted: `frida-painter resume {self.folder}` writes the rest later."
                ) from full
        if painting is not None and painting.rest is not None and not len(painting.rest) and trouble is None:
            self._results = {"painting": hash_picture(painting.photograph)}
        kept = None
        if not trouble and painting is not None:
            kept = keep_learned(self.spec, self._record, session.hand.placement, painting, session.learn_wet_paint)
        return self._conclude(RunOutcome(self.folder, painting, page, trouble, kept, recorder.similarity))

    def _conclude(self, outcome: RunOutcome) -> RunOutcome:
        """Adds further results, tells which results there are, and returns the outcome."""
        if outcome.page is not None:
            self.finish(outcome)
            files = ("film.mp4", ARM_FILM, "painters.png", "canvas.png", "card.jpg")
            there = {Path(file).stem: (self.folder / file).exists() for file in files}
            self.report(events.ResultFound("results", detail=there))
        return outcome


def _forget_stop(folder: Path) -> None:
    """Removes a stop of another sitting, pressed when there was no robot, or no more."""
    with suppress(OSError):
        (folder / STOP_FILE).unlink()


@contextmanager
def _take_back_on_failure(folder: Path, *, made: bool) -> Iterator[None]:
    """Removes what the easel wrote into a new folder if it cannot be opened, and the folder if it was `made` for it."""
    try:
        yield
    except FridaError:
        with suppress(OSError):
            event_log.remove(folder / SIMULATION_LOG)
            if made:
                folder.rmdir()  # if nothing else is in it
                PAINTINGS.rmdir()
        raise


def paint(
    photo: str | Path | None = None,
    *,
    text: str | None = None,
    folder: str | Path | None = None,
    **settings: "Unpack[Settings]",
) -> RunOutcome:
    """Paints a photograph, words, or both, in the virtual studio by default; returns the outcome.

    settings: fields of RunSpec, such as strokes=50. Style, sketch and other goals: goal=[{"style": "waves.jpg"}].
    folder: folder of the painting. None: a new one under "paintings".
    Raises ConfigError if the settings make no painting, ImageError if a picture cannot be read, WeightsError if a
    network is missing, and the errors of `PaintingRun.start`.

        >>> import frida_painter as fp
        >>> if __name__ == "__main__":  # painting starts processes
        ...     outcome = fp.paint("photo.jpg", folder="lemon", canvas="12x9cm", strokes=3, replans=0, render_height=64)
        ...     print(outcome.page.name)
        index.html
    """
    if not isinstance(photo, str | Path | None):
        raise ConfigError(
            f"A photo was given as {type(photo).__name__}, and a painting's folder keeps its file; write it with "
            "save_picture, and give that file."
        )
    asked = [*([{"image": str(photo)}] if photo is not None else []), *([{"text": text}] if text is not None else [])]
    settings["goal"] = [*asked, *settings.get("goal", [])]
    with PaintingRun(RunSpec.of(**settings), folder) as run:
        return run.start()
