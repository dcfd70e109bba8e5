"""The feed of a painting: whatever happens to it, line by line, for whoever watches."""

import time
from dataclasses import dataclass, field
from typing import Any

from frida_painter.errors import StorageError
from frida_painter.web.folder import PaintingFolder
from frida_painter.event_log import FEED, EventLog

_BETWEEN_STEPS = 0.25  # seconds; nobody sees more of a plan's progress


@dataclass
class Feed:
    """Tells the page what happens. A full disk is the journal's concern: what cannot be told is left out."""

    folder: PaintingFolder
    _writer: EventLog = field(init=False)
    _told: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self._writer = EventLog(self.folder.feed, FEED)

    def tell(self, kind: str, **facts: Any) -> None:
        """Something happened; facts are plain, finite values."""
        try:
            self._writer.append({"kind": kind, "at": round(time.time(), 3), **facts})
        except StorageError:
            return

    def step(self, kind: str, share: float, left: float, **facts: Any) -> None:
        """How far something is, in [0, 1], and how many seconds are left; told now and then."""
        now = time.monotonic()
        if now - self._told >= _BETWEEN_STEPS or share >= 1:
            self._told = now
            self.tell(kind, share=round(share, 4), left=round(left, 1), **facts)

    def close(self) -> None:
        """Closes the feed."""
        self._writer.close()
