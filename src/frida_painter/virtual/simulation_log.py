"""Log of the studio: one record of everything that happened, so that nothing is lost when the studio ends.

Records are only appended, and each one is handed to the operating system at once, so a killed process loses none.
If a power cut tears a record, its rest is dropped.
"""

import json
import re
import zlib
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from frida_painter import storage
from frida_painter.errors import StorageError
from frida_painter.event_log import MAX_BYTES, EventLog, LogPolicy

Entry = Mapping[str, Any]
# Function of an entry, and of `flush`: True if all entries so far must survive a power cut.
Note = Callable[..., None]

_FORMAT = "frida-painter studio"
_VERSION = 1
_POLICY = LogPolicy("the diary of a virtual studio", precious=True)
_FIRST_LINE_OF_OLD = re.compile(rb"[0-9a-f]{8} \{")


class SimulationLog:
    """Log of one studio.

    studio: setup of the studio, in plain values.
    past: entries of earlier sessions.
    A file of an earlier version is converted.
    Raises StorageError if the file cannot be written, is damaged, or belongs to another studio.
    """

    def __init__(self, path: Path, studio: Entry) -> None:
        self.path = path
        self._unwritten: deque[tuple[Entry, bool]] = deque()
        if path.exists():
            _convert_old(path)
        else:
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


def _convert_old(path: Path) -> None:
    """Converts a file of earlier versions, with lines of a CRC-32 and JSON, to a log. Raises StorageError."""
    content = storage.read_bytes(path, _POLICY.what, MAX_BYTES)
    if _FIRST_LINE_OF_OLD.match(content) is None:
        return
    lines = content.split(b"\n")[:-1]
    entries = [_old_entry(line) for line in lines]
    if entries and entries[-1] is None:  # torn by a power cut, with old content of the disk's block
        entries.pop()
    if not entries or None in entries:
        raise StorageError(f"{path} is damaged; the virtual studio cannot be opened again as it was left.")
    EventLog.write(path, [entry for entry in entries if entry is not None])


def _old_entry(line: bytes) -> Entry | None:
    """Returns the entry of a line of earlier versions; None if the line is damaged."""
    checksum, _, text = line.partition(b" ")
    if checksum != b"%08x" % zlib.crc32(text):
        return None
    entry = json.loads(text)
    return entry if isinstance(entry, dict) else None
