"""A piece of work that a worker does for the page: for which painting, where, and who hears of it."""

import time
from dataclasses import dataclass, field
from pathlib import Path

from frida_painter.frames import CanvasSize
from frida_painter.runs.goal_item import GoalItem
from frida_painter.runs.spec import RunSpec
from frida_painter.web.asking import Asker
from frida_painter.web.calibration_request import CalibrationRequest
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PaintingFolder, PlanFolder
from frida_painter.web.painting_request import GoalRequest
from frida_painter.web.stop_line import StopWatch
from frida_painter.web.studio_easel import StudioEasel


@dataclass(frozen=True)
class Job:
    """What every piece of work has; began: when it was taken up, seconds since 1970."""

    folder: PaintingFolder
    easel: StudioEasel
    feed: Feed
    stop: StopWatch
    asker: Asker
    began: float = field(default_factory=time.time, kw_only=True)

    @property
    def state(self) -> Path | None:
        """Where the robot is locked: a simulated one in the world of its painting alone, else where all are."""
        return self.folder.easel if self.easel.simulated else None

    def spec(self, place: PlanFolder) -> RunSpec:
        """The painting that a person asked for, at this studio's easel. Raises ConfigError and StorageError."""
        request = place.request()
        return RunSpec.of(
            title=request.title or "Untitled",
            goal=tuple(_item(term, place.path) for term in request.terms),
            initial=tuple(_item(term, place.path) for term in request.initial),
            strokes=request.strokes,
            colors=min(request.colors, request.strokes),
            canvas=CanvasSize(request.width / 1000, request.height / 1000),
            fit="crop",  # the page chose a canvas in the picture's proportions, or the person another
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
        """The easel that is calibrated; its canvas is that of the workspace file, where there is one."""
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
