"""What a journal tells: how far a painting came, by which plan, and which stroke is in doubt."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from frida_painter.errors import StorageError
from frida_painter.planning.placement import Placement

FORMAT = "frida-painter journal"
VERSION = 1


@dataclass(frozen=True)
class Planning:
    """A plan that was made: its digest, how many strokes were painted then, from which photograph, and placement."""

    digest: str
    done: int
    photograph: str | None
    placement: Placement


@dataclass
class History:
    """How far a painting came.

    settings, rests_on: as it was begun; plannings: the plans that were made, in order; painted: strokes
    that are done or were given up; in_doubt: the number of the stroke that was begun and not ended;
    light: of the last look, [3, terms]; looks, dips, cleanings, sittings: how many there were; given_up:
    numbers of strokes in doubt that were skipped, and of those that a person left out; region: the file of
    what a person drew over the canvas, and whether only there it may be painted, None where nothing is
    protected; goal: the folder of the goal that it is painted towards since it was changed, "" before;
    finished: whether nothing is left to do; seconds: that were spent on it, pauses between sittings left
    out; last: when the last record was written.
    """

    settings: dict[str, Any]
    rests_on: dict[str, str]
    plannings: list[Planning] = field(default_factory=list)
    painted: int = 0
    in_doubt: int | None = None
    light: list[list[float]] | None = None
    looks: int = 0
    last_photograph: str | None = None
    region: tuple[str, bool] | None = None
    goal: str = ""
    dips: int = 0
    cleanings: int = 0
    sittings: int = 0
    given_up: list[int] = field(default_factory=list)
    finished: bool = False
    seconds: float = 0.0
    last: datetime | None = None

    @classmethod
    def of(cls, records: Iterable[dict[str, Any]], folder: Path) -> "History":
        """The history that the records of a journal in `folder` tell. Raises StorageError where they tell none."""
        first, *others = records
        if first.get("format") != FORMAT:
            raise StorageError(f"{folder} holds a journal that is not a painting's; give the folder of a painting.")
        if first.get("version") != VERSION:
            raise StorageError(
                f"{folder} holds a journal of version {first.get('version')}; this program reads version {VERSION}; "
                "resume it with the program that it was begun with, or a newer one."
            )
        try:
            history = cls(first["settings"], first["rests_on"])
            for record in (first, *others):
                history._hear(record)
        except (KeyError, TypeError, ValueError) as cause:
            raise StorageError(
                f"The journal in {folder} lacks something ({cause!r}); take an undamaged copy."
            ) from cause
        return history

    def _hear(self, record: dict[str, Any]) -> None:
        at = datetime.fromisoformat(record["at"])
        kind = record["kind"]
        if kind in ("begun", "resumed"):
            self.sittings += 1
        elif self.last is not None:
            # The clock of the machine may have been set back in between.
            self.seconds += max(0.0, (at - self.last).total_seconds())
        self.last = at
        match kind:
            case "resumed":
                self.decide(repaint=record.get("decision") == "repaint")
            case "planned":
                placement = record["placement"]
                known = Placement(tuple(placement["error"]), tuple(map(tuple, placement["information"])))
                self.plannings.append(Planning(record["plan"], record["done"], record["photograph"], known))
            case "looked":
                self.looks += 1
                self.light = record["light"]
                self.last_photograph = record["photograph"] or self.last_photograph
            case "began" if "stroke" in record:
                self.in_doubt = record["stroke"]
            case "ended" if "stroke" in record:
                self.painted, self.in_doubt = record["stroke"], None
                if record.get("left_out", False):
                    self.given_up.append(record["stroke"])
            case "ended":
                self.dips += 1
                self.cleanings += int(record["cleaned"])
            case "protected":
                self.region = (str(record["region"]), bool(record["only"])) if record["region"] else None
            case "redirected":
                self.goal = str(record["goal"])
            case "finished":
                self.finished = True
            case _:
                pass

    def decide(self, *, repaint: bool) -> None:
        """Settles the stroke in doubt, if there is one: it is painted again, or given up."""
        if self.in_doubt is not None and not repaint:
            self.painted = self.in_doubt
            self.given_up.append(self.in_doubt)
        self.in_doubt = None
