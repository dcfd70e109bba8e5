"""Painting without a camera: the canvas is taken to be what the plan makes of it.

`OpenLoopMonitor` stands in for `ExecutionMonitor`, and `ExpectedFrames` for `FrameDeveloper`. Nothing is
photographed: both render the painted strokes on the last known canvas. Each picture that a plan was made for is kept
in the journal, so that a painting is resumed from exactly that picture.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from frida_painter.brush.kinds import StrokeModel
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import FrameRejected
from frida_painter.frames import PixelGrid
from frida_painter.render.painting import render_on
from frida_painter.session.events import Looked, Notify, StrokePainted, TimelapseFrame
from frida_painter.session.executor import BatchExecutor, Desk
from frida_painter.session.hand import Hand
from frida_painter.session.observer import PHOTOGRAPH_ROWS, TIMELAPSE_ROWS, CanvasObserver, FrameDeveloper
from frida_painter.session.plan_keeper import PlanKeeper
from frida_painter.session.progress import PaintingProgress
from frida_painter.session.replan_policy import CanvasSeen
from frida_painter.strokes.plan import Plan
from frida_painter.system import images

NOBODY_LOOKS = (
    "No camera: nobody looks at the canvas. The plan is painted as it is, and every picture of the painting shows what "
    "is expected. A picture that you take counts as a look: frida-painter look FOLDER PICTURE."
)
"""Sentence for a person about a painting without a camera."""


Models = Mapping[str, StrokeModel]
"""Stroke models by brush."""


def paint_on_paper(plan: Plan, models: Models, canvas: Tensor, rows: int = PHOTOGRAPH_ROWS) -> Tensor:
    """Returns the canvas [3, rows, columns] that the strokes of a plan leave on a picture of it, [3, H, W]."""
    grid = PixelGrid.of_height(plan.canvas, rows)
    paper = images.fit(canvas, grid.rows, grid.columns)
    return render_on(plan, models, paper).cpu() if len(plan) else paper


def bare_paper(size: CanvasSize, ground: tuple[float, float, float]) -> Tensor:
    """Returns the bare canvas on its ground (sRGB), [3, H, W]."""
    grid = PixelGrid.of_height(size, PHOTOGRAPH_ROWS)
    return torch.tensor(ground)[:, None, None].repeat(1, grid.rows, grid.columns)


class OpenLoopMonitor:
    """Monitor of a canvas that nobody watches.

    plans: keeper of the planner that knows the bare canvas and the marks of the brushes.
    executor: moves the arm to its home position.
    given: called between strokes, calls `look_at` if a person gave a picture; the painting's run sets it.
    """

    def __init__(
        self,
        plans: PlanKeeper,
        executor: BatchExecutor,
        hand: Hand,
        desk: Desk,
    ) -> None:
        self._plans, self._executor, self._hand = plans, executor, hand
        self.given: Callable[[], None] = lambda: None
        self._taking = False
        self._journal, self._interruptions, self._progress, self._tell = desk
        self._pictured = 0  # strokes on the canvas in the last picture of a person

    def look(self) -> Tensor:
        """Moves the arm to its home position, and returns the canvas [3, H, W] as it should be now."""
        self._interruptions.retry(self._executor.step_aside)
        return self._interruptions.retry(self._assume)

    def observe(self) -> CanvasSeen:
        """Takes the canvas to hold the painted strokes; nothing is learned from that."""
        progress = self._progress
        progress.canvas.saw(self._interruptions.retry(self._assume), progress.painted)
        return CanvasSeen(progress.painted, len(progress.rest), 0.0, progress.gain)

    def expect(self, done: int) -> Tensor:
        """Returns the canvas [3, H, W] as it should look after `done` strokes."""
        progress, planner = self._progress, self._plans.planner
        bare = bare_paper(planner.size, planner.ground)
        if progress.plan is None:
            return bare
        known, left_out = progress.canvas, progress.canvas.left_out
        before, first = (bare, 0) if known.before is None or done < known.strokes else (known.before, known.strokes)
        since = progress.plan.part([index for index in range(first, done) if index not in left_out])
        return paint_on_paper(since, planner.models, before)

    def look_at_next(self) -> None:
        """Takes a person's picture, if one waits and there are strokes to be seen."""
        if not self._taking and self._progress.painted:
            self._taking = True
            try:
                self.given()
            finally:
                self._taking = False

    def look_at(self, canvas: Tensor, done: int) -> None:
        """Takes a person's picture of the canvas [3, H, W] after `done` strokes for a look, and replans the rest.

        The strokes since then are taken to be painted. The arm goes aside meanwhile.
        Raises FrameRejected if the picture is older than the one before.
        """
        progress = self._progress
        if not self._pictured <= done <= progress.painted:
            raise FrameRejected(
                f"The picture shows the canvas after {done} strokes, and the one before it after {self._pictured}; "
                "take a new one."
            )
        expected, self._pictured = self.expect(done), done
        self._interruptions.retry(partial(self._journal.record_canvas, canvas, done, seen=True))
        self._tell(Looked(done, photograph=canvas, expected=expected))
        progress.canvas.saw(canvas, done)
        if done < progress.painted:
            self.observe()
        self._interruptions.retry(self._executor.step_aside)
        if len(progress.rest):
            self._plans.replan()
        self._hand.load = replace(self._hand.load)  # so that motions are prepared again, from the new plan

    def _assume(self) -> Tensor:
        progress = self._progress
        canvas = self.expect(progress.painted)
        self._interruptions.touched = False
        self._tell(self._journal.record_canvas(canvas, progress.painted))
        return canvas


class ExpectedFrames(FrameDeveloper):
    """Makes the frames of the film from the painted strokes, each at once."""

    def __init__(self, observer: CanvasObserver, plans: PlanKeeper, progress: PaintingProgress, notify: Notify) -> None:
        super().__init__(observer, notify)
        self._plans, self._progress = plans, progress
        self._shown: tuple[Tensor, Tensor, int] | None = None  # known canvas, frame after it, and its strokes

    def take(self, painted: StrokePainted, last_motion: float) -> None:
        """Reports a frame after a stroke."""
        progress, planner = self._progress, self._plans.planner
        known = progress.canvas.last_seen
        frame, done = known, progress.canvas.strokes
        if self._shown is not None and self._shown[0] is known:
            _, frame, done = self._shown
        plan = progress.followed_by(progress.rest)
        since = plan.part([index for index in range(done, painted.done) if index not in progress.canvas.left_out])
        frame = paint_on_paper(since, planner.models, frame, TIMELAPSE_ROWS)
        self._shown = known, frame, painted.done
        self._notify(TimelapseFrame(painted.done, painted.of, painted.color, photograph=images.to_uint8(frame)))
