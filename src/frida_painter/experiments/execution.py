"""What experiments have the virtual robot paint: a plan as it is, without looking in between, or a stroke library."""

from collections.abc import Callable

from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.experiments.outcome import Notify, Progress
from frida_painter.frames import CanvasSize
from frida_painter.hardware.easel import Easel
from frida_painter.plan import Plan
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.canvas_observer import CanvasObserver
from frida_painter.session.events import StrokePainted
from frida_painter.session.opening import open_virtual_easel
from frida_painter.session.procedures.dialogue import lead
from frida_painter.session.procedures.strokes import StrokesProgress, strokes
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.table import PlacementError

EXACT = PlacementError((0.0, 0.0), 0.0)
"""A robot that has been calibrated perfectly."""


def open_easel(canvas: CanvasSize, brush: str, seed: int, *, error: PlacementError | None = None) -> Easel:
    """The connected easel of a new virtual studio; `error` None: one is drawn from the seed."""
    settings = StudioSettings(placement_error=error)
    easel = open_studio(canvas, brush, seed=seed, settings=settings).easel
    easel.robot.connect()
    easel.camera.connect()
    return easel


def execute(plan: Plan, easel: Easel, rows: int, notify: Callable[[int], None] = lambda done: None) -> Tensor:
    """Paints the plan on a bare easel and returns the photograph of the canvas, [3, rows, columns].

    notify: is told how many strokes are on the canvas. Raises RobotError, CameraError and their kinds.
    """
    brushwork, observer = Brushwork(easel, brush_kind(plan.brush)), CanvasObserver(easel, plan.ground)
    brushwork.step_aside()
    observer.look(brushwork.last_motion, rows)  # at the bare canvas: learns the light of the room
    easel.operator.fill_wells(plan.palette)
    for action in brushwork.prepare(plan, 0, len(plan)):
        brushwork.perform(action)
        if isinstance(action.done, StrokePainted):
            notify(action.done.done)
    brushwork.step_aside()
    return observer.look(brushwork.last_motion, rows)


def virtual_library(brush: str, count: int, seed: int, notify: Notify) -> StrokeLibrary:
    """`count` strokes of a brush that ships with the project. Raises ConfigError where there is no such brush."""

    def hear(progress: StrokesProgress) -> None:
        notify(Progress(progress.done / progress.of, "painting a stroke library"))

    painting = strokes(open_virtual_easel(brush, seed), brush_kind(brush), count=count, seed=seed, notify=hear)
    return lead(painting, lambda question: question.proposal or False).library
