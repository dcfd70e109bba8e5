"""Log of the studio: one record of everything that happened, so that nothing is lost when the studio ends.

Records are only appended, and each one is handed to the operating system at once, so a killed process loses none.
If a power cut tears a record, its rest is dropped.
"""

import json
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from frida_painter.errors import StorageError
from frida_painter.system.event_log import EventLog, LogPolicy

Entry = Mapping[str, Any]
# Function of an entry, and of `flush`: True if all entries so far must survive a power cut.
Note = Callable[..., None]

_FORMAT = "frida-painter studio"
_VERSION = 1
_POLICY = LogPolicy("the diary of a virtual studio", precious=True)


class SimulationLog:
    """Log of one studio.

    studio: setup of the studio, in plain values.
    past: entries of earlier sessions.
    Raises StorageError if the file cannot be written, is damaged, belongs to another studio, or is of another version.
    """

    def __init__(self, path: Path, studio: Entry) -> None:
        self.path = path
        self._unwritten: deque[tuple[Entry, bool]] = deque()
        if not path.exists():
            EventLog.write(path, [{"format": _FORMAT, "version": _VERSION, "studio": studio}])
        log = EventLog(path, _POLICY)
        first, *past = log.found
        try:
            self._require_same(first, json.loads(json.dumps(studio)))
        except StorageError:
            log.close()
            raise
        self.past: tuple[Entry, ...] = tuple(past)
        self._log: EventLog | None = log

    def note(self, entry: Entry, *, flush: bool = False) -> None:
        """Writes an entry; with `flush`, all entries so far survive a power cut too.

        If the disk is full, the entry waits for the next one, or for `close`.
        """
        self._unwritten.append((entry, flush))
        try:
            self._write()
        except StorageError:
            return  # close() raises it again, unless a later entry finds room for both

    def close(self) -> None:
        """Writes waiting entries and closes the file. Raises StorageError if they cannot be written."""
        if self._log is None:
            return
        try:
            self._write()
        finally:
            self._log.close()
            self._log = None

    def _write(self) -> None:
        assert self._log is not None
        while self._unwritten:
            entry, flush = self._unwritten[0]
            self._log.append(entry, flush=flush)
            self._unwritten.popleft()

    def _require_same(self, first: Entry, studio: Entry) -> None:
        if (first.get("format"), first.get("version")) != (_FORMAT, _VERSION):
            raise StorageError(
                f"{self.path} is not the diary of a virtual studio of version {_VERSION}; "
                "give the folder of a painting that this version of frida-painter began."
            )
        before = first.get("studio")
        if before != studio:
            told = before if isinstance(before, dict) else {}
            differing = sorted(name for name in {*told, *studio} if told.get(name) != studio.get(name))
            raise StorageError(
                f"{self.path} tells of a studio with another {', '.join(differing)}; open it as it was opened first."
            )


def ignore_entry(entry: Entry, *, flush: bool = False) -> None:
    """Ignores the entry, for a studio without a log."""
