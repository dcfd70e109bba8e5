"""A piece of work that a worker does for the page: for which painting, where, and who hears of it."""

from dataclasses import dataclass
from pathlib import Path

from frida_painter.frames import CanvasSize
from frida_painter.runs.spec import GoalItem, RunSpec
from frida_painter.web.asking import Asker
from frida_painter.web.calibrate import Calibrate
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PaintingFolder, PlanFolder
from frida_painter.web.station import Station
from frida_painter.web.stop_file import Stop
from frida_painter.web.wish import Term


@dataclass(frozen=True)
class Job:
    """What every piece of work has."""

    folder: PaintingFolder
    station: Station
    feed: Feed
    stop: Stop
    asker: Asker

    @property
    def state(self) -> Path | None:
        """Where the robot is locked: a simulated one in the world of its painting alone, else where all are."""
        return self.folder.easel if self.station.simulated else None

    def spec(self, place: PlanFolder) -> RunSpec:
        """The painting that a person asked for, at this studio's easel. Raises ConfigError and StorageError."""
        wish = place.wish()
        return RunSpec.of(
            title=wish.title or "Untitled",
            goal=tuple(_item(term, place.path) for term in wish.terms),
            initial=tuple(_item(term, place.path) for term in wish.initial),
            strokes=wish.strokes,
            colors=min(wish.colors, wish.strokes),
            canvas=CanvasSize(wish.width / 1000, wish.height / 1000),
            fit="crop",  # the page chose a canvas in the picture's proportions, or the person another
            brush=wish.brush,
            replans=min(wish.replans, wish.strokes - 1),
            effort=wish.effort,
            seed=wish.seed,
            **self._easel,
            calibration=self.station.known,
        )

    def spec_to_calibrate(self, wish: Calibrate) -> RunSpec:
        """The easel that is calibrated; its canvas is that of the workspace file, where there is one."""
        from frida_painter.runs.easel import workspace_canvas

        size = {} if self.station.workspace else {"canvas": CanvasSize(wish.width / 1000, wish.height / 1000)}
        return workspace_canvas(RunSpec.of(brush=wish.brush, seed=wish.seed, **size, **self._easel))

    @property
    def _easel(self) -> dict[str, object]:
        station = self.station
        return {
            "robot": station.robot,
            "camera": station.camera,
            "workspace": station.workspace,
            "pace": station.pace if station.simulated else 0.0,
        }


def _item(term: Term, folder: Path) -> GoalItem:
    value = term.words if term.words is not None else str(folder / f"{term.picture}.png")
    return GoalItem(kind=term.kind, value=value, weight=term.weight)
