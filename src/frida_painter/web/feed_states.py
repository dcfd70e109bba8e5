"""What feeds have told, folded once and kept in memory: nobody reads a whole feed for every question."""

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Any, Protocol, TypeVar

from frida_painter.session.events import Written
from frida_painter.web.feed import FeedReader
from frida_painter.web.folder import PaintingFolder, working

_MOST_KEPT = 500  # states


class Shown(Protocol):
    """A state that is folded from a feed; version: it grows with every event."""

    version: int

    def hear(self, event: Written) -> None:
        """Takes note of an event."""

    def shown(self, working: bool) -> dict[str, Any]:
        """All of it as plain values."""


Seen = TypeVar("Seen")


class FeedStates:
    """The states of paintings and of the calibration, each folded from its feed once, then from what is added to it."""

    def __init__(self) -> None:
        self._kept: OrderedDict[str, tuple[FeedReader, Any, Lock]] = OrderedDict()
        self._turn = Lock()

    def current(self, folder: PaintingFolder, fresh: Callable[[], Shown]) -> dict[str, Any]:
        """The state now, as the page shows it; `fresh` gives one that heard nothing yet."""
        return self.seen(folder, fresh, lambda state: state.shown(working(folder)))

    def seen(self, folder: PaintingFolder, fresh: Callable[[], Any], look: Callable[[Any], Seen]) -> Seen:
        """What `look` sees of the state now."""
        name = str(folder.path)
        with self._turn:
            if name not in self._kept:
                self._kept[name] = (FeedReader(folder.feed), fresh(), Lock())
            reader, state, turn = self._kept[name]
            self._kept.move_to_end(name)
            if len(self._kept) > _MOST_KEPT:
                self._kept.popitem(last=False)
        with turn:
            for event in reader.read():
                state.hear(event)
            return look(state)
