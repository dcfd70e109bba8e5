"""Timelapse frames: pictures for the film, taken evenly over a painting, by which nothing is decided."""

import contextlib
from dataclasses import dataclass

from frida_painter.errors import CameraError
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.canvas_observer import CanvasObserver
from frida_painter.session.events import StrokePainted, TimelapseFrame

TIMELAPSE_ROWS = 540


@dataclass(frozen=True)
class Timelapse:
    """How many frames the film gets."""

    frames: int = 0

    def wants_frame(self, done: int, of: int) -> bool:
        """Whether the film gets a picture after stroke `done` of `of`."""
        return done * self.frames // of > (done - 1) * self.frames // of

    def frame(self, painted: StrokePainted, brushwork: Brushwork, observer: CanvasObserver) -> TimelapseFrame | None:
        """The picture after a stroke, the arm being aside; None where the camera gives none."""
        with contextlib.suppress(CameraError):
            picture = observer.film(brushwork.last_motion, TIMELAPSE_ROWS)
            return TimelapseFrame(picture, painted.done, painted.of, painted.color)
        return None
