"""Watches what comes of the plan: looks at the canvas, and compares it with what the strokes were to make of it."""

from torch import Tensor

from frida_painter.errors import CameraError, FrameDoubtful, PaintingPaused
from frida_painter.planning.placement import Placement
from frida_painter.session.batch_executor import BatchExecutor
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.canvas_observer import PHOTOGRAPH_ROWS, CanvasObserver
from frida_painter.session.events import LastLookDoubted, Looked, Notify, TouchCorrected
from frida_painter.session.interruptions import Interruptions
from frida_painter.session.journal import Journal
from frida_painter.session.painting import PaintingProgress, difference
from frida_painter.session.plan_keeper import PlanKeeper
from frida_painter.session.replan_policy import CanvasSeen

_TOLD = 0.0004  # metres; less changes a mark by less than two marks of one stroke differ


class ExecutionMonitor:
    """Looks through `observer`, the arm being aside, at the canvas of `progress`.

    plans: whose planner tells what should be seen; executor: that moves the arm aside. Where the camera or the disk
    fails, the painting pauses and looks again afterwards. Where all strokes are on the canvas nothing is decided by a
    look any more: then whatever can be seen is taken, with a remark.
    """

    def __init__(
        self,
        plans: PlanKeeper,
        executor: BatchExecutor,
        brushwork: Brushwork,
        observer: CanvasObserver,
        journal: Journal,
        interruptions: Interruptions,
        progress: PaintingProgress,
        tell: Notify,
    ) -> None:
        self._plans, self._executor = plans, executor
        self._brushwork, self._observer = brushwork, observer
        self._journal, self._interruptions = journal, interruptions
        self._progress, self._tell = progress, tell
        self._person_looked = False  # since it could not be told whether the canvas was moved

    def look(self) -> Tensor:
        """The canvas [3, H, W] as it is now, never from a photograph older than the last motion; it is journalled.

        Only a painting whose strokes are all on the canvas may get one that is not as it should be, or the one before.
        """
        if self._progress.remark:
            return self._interruptions.retry(self._glance)
        try:
            return self._interruptions.retry(self._last_look if self._is_last_and_simulated else self._look)
        except PaintingPaused as nobody:
            if not (self._progress.is_complete and isinstance(nobody.__cause__, CameraError)):
                raise
            self._doubt(nobody.__cause__)
            return self._interruptions.retry(self._glance)

    def observe(self) -> CanvasSeen:
        """Looks, tells what was seen and what was expected, and learns where strokes really land."""
        canvas, progress, planner = self.look(), self._progress, self._plans.planner
        batch, last = progress.batch, progress.canvas.last_seen
        expected = planner.expected(batch, last)
        self._tell(Looked(canvas, expected, progress.painted))
        if len(batch) and not progress.remark:  # where they landed tells where the robot is to be sent
            self._learn(planner.locate(batch, self._brushwork.placement, last, canvas))
        progress.canvas.saw(canvas, progress.painted)
        return CanvasSeen(progress.painted, len(progress.rest), difference(canvas, expected), progress.gain)

    def _learn(self, placement: Placement) -> None:
        """The robot is sent by what is known now; a person is told where a brush is sent lower or higher."""
        before = self._brushwork.placement.touch
        self._brushwork.learn(placement)
        now = self._brushwork.placement.touch
        for brush in now.depths:
            lower = now.correction(brush)
            if abs(lower - before.correction(brush)) >= _TOLD:
                self._tell(TouchCorrected(brush, lower, self._progress.painted))

    def _look(self) -> Tensor:
        self._executor.step_aside()
        expected, progress = None, self._progress
        if progress.plan is not None and not self._interruptions.touched:  # else a person may have touched the canvas
            expected = progress.canvas.expectation(self._plans.planner, progress.plan, progress.painted)
        try:
            frame, canvas = self._observer.examine(
                self._brushwork.last_motion, PHOTOGRAPH_ROWS, expected, doubtful=self._person_looked
            )
        except FrameDoubtful:
            self._person_looked = True  # whoever has the painting go on now
            raise
        self._person_looked = False
        self._journal.looked(frame, self._observer.light)
        self._interruptions.touched = False
        return canvas

    @property
    def _is_last_and_simulated(self) -> bool:
        return self._progress.is_complete and self._brushwork.easel.simulated

    def _last_look(self) -> Tensor:
        """A look after the last stroke, where there is nobody to ask."""
        try:
            return self._look()
        except CameraError as trouble:
            self._doubt(trouble)
            return self._glance()

    def _doubt(self, trouble: CameraError) -> None:
        doubted = LastLookDoubted(str(trouble), self._progress.painted)
        self._progress.remark = doubted.sentence
        self._tell(doubted)

    def _glance(self) -> Tensor:
        """The canvas [3, H, W] as it can be seen now, and else as it was last seen; nothing is decided by it."""
        self._executor.step_aside()
        try:
            frame = self._observer.photograph(self._brushwork.last_motion)
            canvas = self._observer.see(frame.image, PHOTOGRAPH_ROWS)
        except CameraError:
            return self._progress.canvas.last_seen
        self._journal.looked(frame, self._observer.light)
        return canvas
