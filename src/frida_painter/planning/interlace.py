"""Which rows of the canvas an iteration looks at: what a stroke does to one row, it does to the next one as well.

Rendering takes time in proportion to the rows that strokes cross. The mean squared error of some rows estimates that of
all, and the mean over the turns is the whole, with its gradient. docs/lab/planning.md says what is lost and won.
"""

from dataclasses import replace

from frida_painter.frames import PixelGrid, Rows
from frida_painter.planning.scene import Scene

_ROWS_TO_A_MARK = 32  # in the rectangle that holds every mark of the brush


def interlaced(scenes: list[Scene]) -> list[list[Scene]]:
    """What iterations see in turn, each time the scenes of all parts with the same rows; together they have all rows.

    Where all rows are needed, that is the scenes alone. Rows are at most a 32nd of the height of the rectangle that
    holds the marks of any of the brushes apart, or of the canvas's where that is less. So how many turns there are
    follows from the brushes and from the resolution.
    """
    every = min(_rows_apart(scene) for scene in scenes)
    if every == 1:
        return [scenes]
    turns = (Rows(every, first) for first in range(every))
    return [[_on_rows(scene, rows) for scene in scenes] for rows in turns]


def _on_rows(scene: Scene, rows: Rows) -> Scene:
    """The scene with those rows only."""
    assert scene.objective_on_rows is not None
    return replace(scene, objective=scene.objective_on_rows(rows), rows=rows)


def _rows_apart(scene: Scene) -> int:
    """How many rows farther the next one is that has to be looked at."""
    if scene.objective_on_rows is None:
        return 1
    _, pitch = PixelGrid(scene.size, *scene.canvas.shape[1:]).pitch
    mark = scene.model.frame.top - scene.model.frame.bottom
    return max(1, int(min(mark, scene.size.height) / _ROWS_TO_A_MARK / pitch))
