"""Which rows of the canvas an iteration looks at: what a stroke does to one row, it does to the next one as well.

Rendering takes time in proportion to the rows that strokes cross. The mean squared error of some rows estimates that of
all, and the mean over the turns is the whole, with its gradient. docs/planner.md says what is lost and won.
"""

from dataclasses import replace

from frida_painter.frames import PixelGrid, Rows
from frida_painter.planning.scene import Scene

_ROWS_TO_A_MARK = 32  # in the rectangle that holds every mark of the brush


def interlaced(scene: Scene) -> tuple[Scene, ...]:
    """The scenes that iterations see in turn, which together have all rows; the scene alone where all rows are needed.

    In each, rows are at most a 32nd of the height of the rectangle that holds the brush's marks apart, or of the
    canvas's where that is less. So how many turns there are follows from the brush and from the resolution.
    """
    judge = scene.objective_on_rows
    if judge is None:
        return (scene,)
    _, pitch = PixelGrid(scene.size, *scene.canvas.shape[1:]).pitch
    mark = scene.model.frame.top - scene.model.frame.bottom
    every = max(1, int(min(mark, scene.size.height) / _ROWS_TO_A_MARK / pitch))
    if every == 1:
        return (scene,)
    turns = (Rows(every, first) for first in range(every))
    return tuple(replace(scene, objective=judge(rows), rows=rows) for rows in turns)
