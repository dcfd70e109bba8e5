"""The studio's log: one record for everything that happened in it, so that nothing is lost when the studio ends.

Records are only ever appended, and each is handed to the operating system as soon as it is written: a
killed process loses none of them, and of a record that a power cut tore apart the rest is dropped.
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
from frida_painter.event_log import MOST_BYTES, EventLog, LogPolicy

Entry = Mapping[str, Any]
# Takes an entry, and `flush`: whether all so far must survive a power cut from now on.
Note = Callable[..., None]

_FORMAT = "frida-painter studio"
_VERSION = 1
_POLICY = LogPolicy("the diary of a virtual studio", precious=True)
_FIRST_LINE_OF_OLD = re.compile(rb"[0-9a-f]{8} \{")


class SimulationLog:
    """One studio's log. `studio` says in plain values how it was furnished; `past` is what happened before.

    A file that an earlier version wrote is converted. Raises StorageError where the file cannot be written, is
    damaged, or tells of another studio.
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
        """Puts an entry down; flush: all entries so far survive a power cut as well.

        What happened has happened: where the disk is full the entry waits for the next one, or for `close`.
        """
        self._unwritten.append((entry, flush))
        try:
            self._write()
        except StorageError:
            return  # close() tells, unless a later entry finds room for both

    def close(self) -> None:
        """Puts down what still waits, and closes the file. Raises StorageError where that cannot be done."""
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


def unnoted(entry: Entry, *, flush: bool = False) -> None:
    """Stands where a studio keeps no log."""


def _convert_old(path: Path) -> None:
    """Writes a file of earlier versions, lines of a CRC-32 and JSON, as a log. Raises StorageError."""
    content = storage.read_bytes(path, _POLICY.what, MOST_BYTES)
    if _FIRST_LINE_OF_OLD.match(content) is None:
        return
    lines = content.split(b"\n")[:-1]
    entries = [_old_entry(line) for line in lines]
    if entries and entries[-1] is None:  # torn by a power cut, with what was in the disk's block before
        entries.pop()
    if not entries or None in entries:
        raise StorageError(f"{path} is damaged; the virtual studio cannot be opened again as it was left.")
    EventLog.write(path, [entry for entry in entries if entry is not None])


def _old_entry(line: bytes) -> Entry | None:
    """What a line of earlier versions says; None where it is not whole."""
    checksum, _, text = line.partition(b" ")
    if checksum != b"%08x" % zlib.crc32(text):
        return None
    entry = json.loads(text)
    return entry if isinstance(entry, dict) else None
