"""The feed of a painting: whatever happens to it, event by event, for whoever watches."""

import time
from dataclasses import dataclass, field
from pathlib import Path

from frida_painter.errors import StorageError
from frida_painter.event_log import FEED, EventLog, LogReader
from frida_painter.session.events import Written, events_of, record
from frida_painter.session.page_events import PlanningProgress
from frida_painter.web.folder import PaintingFolder

_BETWEEN_STEPS = 0.25  # seconds; nobody sees more of a plan's progress


@dataclass
class Feed:
    """Tells the page what happens. A full disk is the journal's concern: what cannot be told is left out."""

    folder: PaintingFolder
    _log: EventLog = field(init=False)
    _told: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self._log = EventLog(self.folder.feed, FEED)

    def tell(self, event: Written) -> None:
        """Something happened."""
        try:
            self._log.append(record(event))
        except StorageError:
            return

    def step(self, share: float, left: float, plan: int | None = None) -> None:
        """How far planning is, in [0, 1], and how many seconds are left; told now and then."""
        now = time.monotonic()
        if now - self._told >= _BETWEEN_STEPS or share >= 1:
            self._told = now
            self.tell(PlanningProgress(round(share, 4), round(left, 1), plan))

    def close(self) -> None:
        """Closes the feed."""
        self._log.close()


class FeedReader:
    """Reads the events that were added to a feed since it was asked last; the file need not exist yet."""

    def __init__(self, path: Path) -> None:
        self._reader = LogReader(path)

    def read(self) -> list[Written]:
        """New events, in order; what is not understood is left out."""
        found: list[Written] = []
        for line in self._reader.read():
            try:
                found += events_of(line)
            except (ValueError, KeyError, TypeError):
                continue
        return found
