"""A painting that goes on: it is reopened from its folder, and held against what it was begun with."""

from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.event_log import missing
from frida_painter.perception.frame_check import FrameCheck
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.report.doubt import doubt
from frida_painter.runs.folder import CALIBRATION, CALIBRATION_RECORD, SETTINGS, read_goal, read_spec
from frida_painter.runs.folder import rests_on as hashes
from frida_painter.runs.spec import SETTLED, RunSpec, upgraded
from frida_painter.session import resuming
from frida_painter.session.history import History
from frida_painter.session.journal import Journal
from frida_painter.session.names import DIARY
from frida_painter.session.resuming import KeptPlan


@dataclass(frozen=True)
class ReopenedPainting:
    """A painting that is resumed.

    spec: as its folder has it; journal: held until it is closed; history: read from it; plan: the one in the folder,
    None where it broke off before there was one; placement: as it was learned by then, None where it is for another
    calibration record than the one that is there now; accept_changes: whether it goes on whatever has changed.
    """

    spec: RunSpec
    journal: Journal
    history: History
    plan: KeptPlan | None
    placement: Placement | None
    accept_changes: bool

    def require_as_left(self, good: FrameCheck | None, planner: Planner, before: Tensor, now: Tensor) -> None:
        """Raises FrameRejected where the canvas `now` is not what came, by the journal, of the canvas `before`.

        Both [3, H, W]; good: what a photograph there is like, None where that is not known: then all is as it was.
        """
        if self.plan is not None and good is not None:
            good.require_explained(now, resuming.as_left(self.plan, self.history, planner, before))

    def stroke_in_doubt(self, planner: Planner, now: Tensor) -> Tensor | None:
        """A picture, on the canvas `now`, of the stroke that was begun and perhaps not painted; None without one."""
        number = self.history.in_doubt
        if number is None or self.plan is None:
            return None
        painted = planner.expected(self.plan.plan.part(slice(number - 1, number)), now)
        return doubt(self.plan.plan, number - 1, now, painted)


def reopen(folder: Path, *, accept_changes: bool, pace: float) -> ReopenedPainting:
    """The painting in a folder, and its journal, held. Raises StorageError, PlanError and ConfigError.

    The latter names all that was changed since it was begun, where that was not accepted.
    """
    journal, history = Journal.reopen(folder)
    try:
        spec = read_spec(folder) if not history.finished else RunSpec.of(**upgraded(history.settings))
        plan = resuming.kept_plan(folder, history)
        if not history.finished:
            _require_unchanged(spec, folder, history, plan, accept_changes=accept_changes)
        placement = None if plan is None or _recalibrated(spec, folder, history) else plan.planning.placement
        spec = spec.changed(pace=pace, **read_goal(folder / history.goal))
    except BaseException:
        journal.close()
        raise
    return ReopenedPainting(spec, journal, history, plan, placement, accept_changes)


def _recalibrated(spec: RunSpec, folder: Path, history: History) -> bool:
    """Whether the calibration record is another one than when the painting was begun."""
    return not history.finished and hashes(spec, folder)[CALIBRATION_RECORD] != history.rests_on.get(CALIBRATION_RECORD)


def history_of(folder: Path) -> History:
    """How far a painting came, read without taking it from whoever works on it. Raises StorageError."""
    journal, history = Journal.reopen(folder)
    journal.close()
    return history


def _require_unchanged(
    spec: RunSpec, folder: Path, history: History, plan: KeptPlan | None, *, accept_changes: bool
) -> None:
    """Raises ConfigError, showing all of them, where there are changes that nobody accepted, or cannot be."""
    begun = RunSpec.of(**upgraded(history.settings)).record()
    history.settings = begun
    diary = missing(folder / DIARY, "the diary of a virtual studio") if spec.simulated else 0
    rests_on = hashes(spec, folder)
    if CALIBRATION not in history.rests_on:  # earlier programs did not take it down
        del rests_on[CALIBRATION]
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
