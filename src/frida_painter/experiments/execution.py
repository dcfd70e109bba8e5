"""What experiments about strokes and arms have the virtual robot paint: strokes as they are, or a stroke library.

No painting is made here; those go through PaintingRun (paintings.py).
"""

from pathlib import Path

from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.experiments.outcome import Notify, Progress, within
from frida_painter.experiments.scale import ExperimentScale
from frida_painter.hardware.easel import Easel
from frida_painter.plan import Plan
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.canvas_observer import CanvasObserver
from frida_painter.session.opening import open_virtual_easel
from frida_painter.session.procedures.dialogue import lead
from frida_painter.session.procedures.strokes import StrokesProgress, strokes
from frida_painter.virtual.studio import VirtualStudio
from frida_painter.virtual.table import PlacementError

EXACT = PlacementError((0.0, 0.0), 0.0)
"""A robot that has been calibrated perfectly."""
_PAINTING = 0.2  # share of the time that painting a library takes


def connected(studio: VirtualStudio) -> VirtualStudio:
    """The studio with its robot and camera connected."""
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return studio


def execute(plan: Plan, easel: Easel, rows: int) -> Tensor:
    """Paints the plan on a bare easel and returns the photograph of the canvas, [3, rows, columns].

    Raises RobotError, CameraError and their kinds.
    """
    brushwork, observer = Brushwork(easel, brush_kind(plan.layers[0].brush).for_any_order), CanvasObserver(easel)
    brushwork.step_aside()
    observer.look(brushwork.last_motion, rows)  # at the bare canvas: learns the light of the room
    easel.operator.fill_wells(plan.palette)
    for action in brushwork.prepare(plan, 0, len(plan)):
        brushwork.perform(action)
    brushwork.step_aside()
    return observer.look(brushwork.last_motion, rows)


def library_of(
    path: Path | None, brush: str, seed: int, scale: ExperimentScale, notify: Notify
) -> tuple[StrokeLibrary, str, Notify]:
    """The library to learn from, from a file or painted now; what it is called, and whom to tell of the rest."""
    if path is not None:
        return StrokeLibrary.load(path), path.stem, notify
    painted = virtual_library(brush, scale.strokes, seed, within(notify, 0.0, _PAINTING))
    return painted, f"virtual {brush} brush", within(notify, _PAINTING, 1.0)


def virtual_library(brush: str, count: int, seed: int, notify: Notify) -> StrokeLibrary:
    """`count` strokes of a brush that ships with the project. Raises ConfigError where there is no such brush."""

    def hear(progress: StrokesProgress) -> None:
        notify(Progress(progress.done / progress.of, "painting a stroke library"))

    painting = strokes(open_virtual_easel(brush, seed), brush_kind(brush), count=count, seed=seed, notify=hear)
    return lead(painting, lambda question: question.proposal or False).library
