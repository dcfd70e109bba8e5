"""Reopening of a painting: it is read from its folder, compared with its beginning, and taken up where it broke off."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from torch import Tensor

from frida_painter.easel.kinds import SIMULATION_LOG
from frida_painter.errors import ConfigError, FrameRejected
from frida_painter.planning.placement import Placement
from frida_painter.report.sheets import doubt
from frida_painter.runs.painting_folder import (
    CALIBRATION,
    CALIBRATION_RECORD,
    NOW,
    SETTINGS,
    input_hashes,
    read_goal,
    read_spec,
)
from frida_painter.runs.spec import SETTLED, RunSpec, upgrade_record
from frida_painter.session import resuming
from frida_painter.session.controls import Controls
from frida_painter.session.events import SessionResumed
from frida_painter.session.fold import PaintingState
from frida_painter.session.journal import Journal, placement_of
from frida_painter.session.loop import PaintingSession
from frida_painter.session.progress import PaintingProgress
from frida_painter.session.resuming import KeptPlan
from frida_painter.system import images
from frida_painter.system.event_log import missing


@dataclass(frozen=True)
class ReopenedPainting:
    """Painting to be resumed.

    folder: its folder.
    spec: description from its folder.
    journal: its journal, locked until it is closed.
    plan: plan from the folder, None if the painting broke off before the first plan.
    placement: learned placement, None if the calibration record has changed.
    accept_changes: True if the painting goes on in spite of changes.
    """

    folder: Path
    spec: RunSpec
    journal: Journal
    plan: KeptPlan | None
    placement: Placement | None
    accept_changes: bool

    @property
    def history(self) -> PaintingState:
        """State from the journal, which goes on with it."""
        return self.journal.state

    def take_up(self, session: PaintingSession, controls: Controls) -> tuple[PaintingProgress | None, SessionResumed]:
        """Recalls the brush, looks at the canvas, asks about the stroke in doubt, and notes that painting goes on.

        Returns the state to resume from, None if the painting broke off before the first plan, and the event that
        tells of it. Raises FrameRejected if the canvas has changed, and nobody accepts that.
        """
        history, kept, sees = self.history, self.plan, session.hand.easel.has_camera
        if (bare := resuming.load_photograph(self.folder, resuming.BARE)) is not None:
            session.observer.learn_good(bare, resuming.load_photograph(self.folder, history.pictures.last))
        resuming.recall_brush(session.hand, history, controls.answer)
        if (begun := history.people.in_doubt) is not None:
            session.person.finish(begun)
        seen = history.people.seen  # the state goes on with the look
        unseen = len(history.people.strokes) > seen  # of a person who painted in the pause that broke off
        before, now = self._find_canvas(session, controls, unseen=unseen)
        if history.people.strokes:
            session.person.remember(history.people.strokes, seen, history.people.released)
        number, repaint = history.progress.in_doubt, False
        if now is not None and kept is not None and number is not None:
            painted = session.planner.expected(kept.plan.part(slice(number - 1, number)), now)
            picture = doubt(kept.plan, number - 1, now, painted)
            images.save(picture, self.folder / NOW)
            repaint = controls.repaint(number, picture)
        resumed = self.journal.record_resume(repaint=repaint)
        if kept is None or now is None:
            return None, resumed
        if number is not None and not sees:  # the answer may have changed what is on the canvas
            before, now = self._expect_canvas(kept, session)
        elif any(stroke >= kept.planning.done for stroke in history.progress.left_out) and sees:
            before = None  # a stroke that was given up is there, in part or not at all: only this look tells
        wet = history.progress.wet(None if session.hand.easel.simulated else datetime.now(UTC))
        canvas, done = (before, now, wet, history.progress.left_out), history.progress.painted
        where = PaintingProgress.resume(kept.plan, done, kept.planning.done, *canvas)
        where.person, where.person_unseen, where.answers = len(history.people.strokes), unseen, kept.planning.answers
        expected = session.planner.expected(kept.plan.part(slice(done, None)), now)
        return where, replace(resumed, plan=kept.plan, expected=expected)

    def _find_canvas(
        self, session: PaintingSession, controls: Controls, *, unseen: bool
    ) -> tuple[Tensor | None, Tensor | None]:
        """Returns the canvas that the plan was made for, if it is known, and the canvas now; saves the latter.

        Without a camera, both are taken to be as the journal tells; without a plan either, neither is known.
        unseen: True if a person painted after the last look.
        """
        kept, observer, before = self.plan, session.observer, None
        if not session.hand.easel.has_camera:
            if kept is None:
                return None, None
            before, now = self._expect_canvas(kept, session)
            images.save(now, self.folder / NOW)
            return before, now
        now = session.look()
        images.save(now, self.folder / NOW)
        seen = None if kept is None else resuming.load_seen_canvas(self.folder, kept, observer)
        if kept is None or seen is None or unseen:
            return seen, now
        if self.accept_changes:
            return None, now
        try:
            if observer.good is not None:
                observer.good.require_explained(now, resuming.expect_canvas(kept, self.history, session.planner, seen))
        except FrameRejected as difference:
            if controls.paint_on(str(difference), now):
                return None, now
            raise FrameRejected(
                f"{difference} Look at {self.folder / NOW}; if it is to be painted on as it is, say --accept-changes"
            ) from difference
        return seen, now

    def _expect_canvas(self, kept: KeptPlan, session: PaintingSession) -> tuple[Tensor, Tensor]:
        """Returns the canvas that the plan was made for, and the canvas now, as the journal tells them."""
        done = self.history.progress
        return resuming.resume_open_loop(self.folder, kept, done.painted, done.left_out, session.planner.models)


def reopen(folder: Path, *, accept_changes: bool, pace: float) -> ReopenedPainting:
    """Opens the painting in a folder, and locks its journal. Raises StorageError, PlanError and ConfigError.

    The ConfigError names all changes since the beginning, if they are not accepted.
    """
    journal, history = Journal.reopen(folder)
    try:
        spec = RunSpec.of(**upgrade_record(history.sittings.settings)) if history.end.finished else read_spec(folder)
        plan = resuming.load_kept_plan(folder, history)
        placement = None if plan is None else placement_of(plan.planning)
        if not history.end.finished:
            rests_on = input_hashes(spec, folder)
            _require_unchanged(spec, folder, history, plan, rests_on, accept_changes=accept_changes)
            if rests_on[CALIBRATION_RECORD] != history.sittings.rests_on.get(CALIBRATION_RECORD):
                placement = None
        spec = spec.with_values(pace=pace, **read_goal(folder / history.wishes.goal))
    except BaseException:
        journal.close()
        raise
    return ReopenedPainting(folder, spec, journal, plan, placement, accept_changes)


def _require_unchanged(
    spec: RunSpec,
    folder: Path,
    history: PaintingState,
    plan: KeptPlan | None,
    rests_on: dict[str, str],
    *,
    accept_changes: bool,
) -> None:
    """Raises ConfigError, with all changes, if there are changes that are not accepted or not possible."""
    sittings = history.sittings
    sittings.settings = begun = RunSpec.of(**upgrade_record(sittings.settings)).record()
    diary = missing(folder / SIMULATION_LOG, "the diary of a virtual studio") if spec.simulated else 0
    rests_on = {name: found for name, found in rests_on.items() if name != CALIBRATION or name in sittings.rests_on}
    changes = resuming.changes(folder, history, spec.record(), rests_on, plan, diary)
    settled = [name for name in SETTLED if begun[name] != spec.record()[name]]
    if not changes or (accept_changes and not settled):
        return
    told = "\n".join(f"  {line}" for line in changes)
    remedy = (
        f"{', '.join(settled)} cannot be changed any more; change it back in {folder / SETTINGS}."
        if settled
        else "Change it back, or go on with what is there now: --accept-changes"
    )
    raise ConfigError(f"Since this painting was begun, something was changed:\n{told}\n{remedy}")
