"""What a journal tells: how far a painting came, by which plan, and which stroke is in doubt."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from frida_painter.errors import StorageError
from frida_painter.planning.placement import Placement
from frida_painter.planning.touch_heights import TouchHeights
from frida_painter.session.events import (
    BrushInHand,
    Dipped,
    Drying,
    Finished,
    GoalChanged,
    MotionBegan,
    PaintingBegun,
    Photographed,
    PlanAdopted,
    RegionProtected,
    SessionResumed,
    StrokeLeftOut,
    StrokePainted,
    Written,
    events_of,
    time_of,
)
from frida_painter.session.old_events import renewed

FORMAT = "frida-painter journal"
VERSION = 2


@dataclass(frozen=True)
class Planning:
    """A plan that was adopted, or kept after a look: its digest, strokes painted then, photograph and placement."""

    digest: str
    done: int
    photograph: str | None
    placement: Placement


@dataclass
class History:
    """How far a painting came.

    settings, rests_on: as it was begun; plannings: the plans that were adopted or kept, in order; painted: strokes
    that are done or were given up; in_doubt: the number of the stroke that was begun and not ended;
    drying: the last word of a layer that dries on the canvas, and when it was written; light: of the last look,
    [3, terms]; held: the brush that a robot with a rack holds, "" for none, None where it broke off while it changed
    it; looks, dips, cleanings, runs: how many there were; photographs: the sha256 of those
    that were kept, by file, None where an earlier program took them; given_up:
    numbers of strokes in doubt that were skipped, and of those that a person left out; region: the file of
    what a person drew over the canvas, and whether only there it may be painted, None where nothing is
    protected; goal: the folder of the goal that it is painted towards since it was changed, "" before;
    finished: whether nothing is left to do, and robot_seconds: how long the robot took then; seconds: that were
    spent on it, pauses between runs left out; last: when the last record was written; missing: how many records
    the journal has lost at its end.
    """

    settings: dict[str, Any]
    rests_on: dict[str, str]
    plannings: list[Planning] = field(default_factory=list)
    painted: int = 0
    in_doubt: int | None = None
    drying: tuple[Drying, datetime] | None = None
    light: list[list[float]] | None = None
    held: str | None = ""
    looks: int = 0
    last_photograph: str | None = None
    photographs: dict[str, str | None] = field(default_factory=dict)
    region: tuple[str, bool] | None = None
    goal: str = ""
    dips: int = 0
    cleanings: int = 0
    runs: int = 0
    given_up: list[int] = field(default_factory=list)
    finished: bool = False
    seconds: float = 0.0
    last: datetime | None = None
    missing: int = 0
    robot_seconds: float = 0.0

    @classmethod
    def of(cls, records: Iterable[dict[str, Any]], folder: Path) -> "History":
        """The history that the records of a journal in `folder` tell. Raises StorageError where they tell none."""
        first, *others = records
        if first.get("format") != FORMAT:
            raise StorageError(f"{folder} holds a journal that is not a painting's; give the folder of a painting.")
        if first.get("version") not in range(1, VERSION + 1):
            raise StorageError(
                f"{folder} holds a journal of version {first.get('version')!r}; this program reads versions up to "
                f"{VERSION}; resume it with the program that it was begun with, or a newer one."
            )
        try:
            (begun,) = events_of(first)
            if not isinstance(begun, PaintingBegun):
                raise ValueError("the painting's beginning")
            history = cls(begun.settings, begun.rests_on)
            for record in (first, *others):
                for event in events_of(record):
                    history._hear(event, time_of(record))
        except (KeyError, TypeError, ValueError) as cause:
            raise StorageError(
                f"The journal in {folder} lacks something ({cause!r}); take an undamaged copy."
            ) from cause
        return history

    def _hear(self, event: Written, at: datetime) -> None:
        if isinstance(event, PaintingBegun | SessionResumed):
            self.runs += 1
        elif self.last is not None:
            # The clock of the machine may have been set back in between.
            self.seconds += max(0.0, (at - self.last).total_seconds())
        self.last = at
        match event:
            case SessionResumed(decision=decision):
                self.decide(repaint=decision == "repaint")
            case PlanAdopted(plan, done, photograph, error, information):
                touch = TouchHeights(event.depths, event.lower, event.touch_information)
                self.plannings.append(Planning(plan, done, photograph, Placement(error, information, touch)))
            case Photographed(photograph=photograph, light=light, content=content):
                self.looks += 1
                self.light = light
                if photograph is not None:
                    self.last_photograph = photograph
                    self.photographs[photograph] = content
            case MotionBegan(stroke=int(stroke)):
                self.in_doubt = stroke
            case StrokePainted(done=done):
                self.painted, self.in_doubt = done, None
            case StrokeLeftOut(done=done):
                self.painted, self.in_doubt = done, None
                self.given_up.append(done)
            case Drying():
                self.drying = event, at
            case BrushInHand(brush):
                self.held = brush
            case Dipped(cleaned=cleaned):
                self.dips += 1
                self.cleanings += int(cleaned)
            case RegionProtected(region=region, only=only):
                self.region = None if region is None else (region, only)
            case GoalChanged(goal=goal):
                self.goal = goal
            case Finished(robot_seconds=robot_seconds):
                self.finished, self.robot_seconds = True, robot_seconds
            case _:
                pass

    def wet(self, now: datetime | None = None) -> float | None:
        """Seconds that the last layer still dries; None where it did not begin to.

        now: the time, None where nothing has dried since the painting broke off, as in a simulated studio.
        """
        if self.drying is None or self.drying[0].done != self.painted:
            return None
        drying, noted = self.drying
        passed = 0.0 if now is None else max(0.0, (now - noted).total_seconds())
        return max(0.0, drying.left - passed)

    def decide(self, *, repaint: bool) -> None:
        """Settles the stroke in doubt, if there is one: it is painted again, or given up."""
        if self.in_doubt is not None and not repaint:
            self.painted = self.in_doubt
            self.given_up.append(self.in_doubt)
        self.in_doubt = None


def renewed_journal(records: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """The records of a journal of an earlier version in the words of this one."""
    first, *others = [each for record in records for each in renewed(record)]
    return [{**first, "version": VERSION}, *others]
