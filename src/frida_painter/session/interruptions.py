"""What interrupts a painting: a person who stops it or wants a pause, a disk that is full, a camera that fails."""

from collections.abc import Callable
from typing import TypeVar

from frida_painter.errors import CameraError, FridaError, PaintingPaused, StorageError
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.events import Notify, Paused

_T = TypeVar("_T")


class Interruptions:
    """Asks after every stroke and every planning step whether a person stops the painting or pauses it, and pauses.

    stop_asked, pause_asked: whether they do; go_on: asked in a pause, and waits for the answer; painted: how many
    strokes are done. `touched`: whether a person may have painted on the canvas since it was last seen.
    """

    def __init__(
        self,
        brushwork: Brushwork,
        notify: Notify,
        *,
        stop_asked: Callable[[], bool],
        pause_asked: Callable[[], bool],
        go_on: Callable[[Paused], bool],
        painted: Callable[[], int],
    ) -> None:
        self.touched = False
        self.pause_asked = pause_asked
        self._brushwork, self._notify = brushwork, notify
        self._stop_asked, self._go_on, self._painted = stop_asked, go_on, painted
        self._stopping = False

    def check(self, before_pause: Callable[[], None] = lambda: None) -> None:
        """Raises StopAsked, once, where a person stops the painting; where they want a pause, `before_pause` and it."""
        if not self._stopping and self._stop_asked():
            self._stopping = True
            raise StopAsked
        if self.pause_asked():
            before_pause()
            self.pause("You asked for a pause.")

    def retry(self, work: Callable[[], _T]) -> _T:
        """Does what needs the disk or the camera; where they fail, pauses and, when told to go on, tries again."""
        while True:
            try:
                return work()
            except (StorageError, CameraError) as trouble:
                self.pause(str(trouble), trouble)

    def pause(self, reason: str, cause: FridaError | None = None) -> None:
        """Lifts the brush, cleans it, moves the arm aside and waits until a person has the painting go on.

        Raises PaintingPaused where they do not.
        """
        if self._brushwork.load.paint is not None:
            self._brushwork.clean()
        self._brushwork.step_aside()
        self.touched = True  # whoever is asked may paint along, now or while answering
        paused = Paused(reason, self._painted())
        self._notify(paused)
        if not self._go_on(paused):
            raise PaintingPaused(f"{reason} The painting has paused after {paused.done} strokes.") from cause
        self.touched = True


class StopAsked(Exception):
    """A person has asked to stop; the session ends the painting in order."""
