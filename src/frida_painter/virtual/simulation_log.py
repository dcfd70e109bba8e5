"""The studio's diary: a file with one line for everything that happened, so that nothing is lost when the studio ends.

A line is the CRC-32 of what follows, a space, and one JSON object. Lines are only ever appended, and
each is handed to the operating system as soon as it is written: a killed process loses none of them,
and of a line that a power cut tore apart the rest is dropped.
"""

import json
import os
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from frida_painter import storage
from frida_painter.errors import StorageError

Entry = Mapping[str, Any]
# Takes an entry, and `flush`: whether all so far must survive a power cut from now on.
Note = Callable[..., None]

_FORMAT = "frida-painter studio"
_VERSION = 1
_MOST_BYTES = 2**30


class SimulationLog:
    """One studio's diary. `studio` says in plain values how it was furnished; `past` is what happened before.

    Raises StorageError where the file cannot be written, is damaged, or tells of another studio.
    """

    def __init__(self, path: Path, studio: Entry) -> None:
        self.path = path
        self.past: tuple[Entry, ...] = ()
        self._unwritten = b""
        if not path.exists():
            storage.write_bytes(path, _line({"format": _FORMAT, "version": _VERSION, "studio": studio}))
        first, *past = self._read()
        self._require_same(first, json.loads(json.dumps(studio)))
        self.past = tuple(past)
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_APPEND)
        except OSError as error:
            raise storage.cannot_write(path, error) from error

    def note(self, entry: Entry, *, flush: bool = False) -> None:
        """Puts an entry down; flush: all entries so far survive a power cut as well.

        What happened has happened: where the disk is full the entry waits for the next one, or for `close`.
        """
        self._unwritten += _line(entry)
        try:
            self._write(flush)
        except OSError:
            return  # close() tells, unless a later entry finds room for both

    def close(self) -> None:
        """Puts down what still waits, and closes the file. Raises StorageError where that cannot be done."""
        if self._file < 0:
            return
        try:
            self._write(flush=True)
        except OSError as error:
            raise storage.cannot_write(self.path, error) from error
        finally:
            os.close(self._file)
            self._file = -1

    def _write(self, flush: bool) -> None:
        while self._unwritten:
            self._unwritten = self._unwritten[os.write(self._file, self._unwritten) :]
        if flush:
            os.fsync(self._file)

    def _read(self) -> list[Entry]:
        """All whole lines; a torn one at the end is cut off the file."""
        content = storage.read_bytes(self.path, "the diary of a virtual studio", _MOST_BYTES)
        lines = content.split(b"\n")
        whole = content.rfind(b"\n") + 1
        entries = [_entry(line) for line in lines[:-1]]
        if entries and entries[-1] is None:  # torn by a power cut, with what was in the disk's block before
            whole -= len(lines[-2]) + 1
            entries.pop()
        if not entries or any(entry is None for entry in entries):
            raise StorageError(f"{self.path} is damaged; the virtual studio cannot be opened again as it was left.")
        if whole < len(content):
            with self.path.open("r+b") as file:
                file.truncate(whole)
        return [entry for entry in entries if entry is not None]

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
    """Stands where a studio keeps no diary."""


def _line(entry: Entry) -> bytes:
    text = json.dumps(entry, separators=(",", ":"), allow_nan=False).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _entry(line: bytes) -> Entry | None:
    """What a line says; None where it is not whole."""
    checksum, _, text = line.partition(b" ")
    if checksum != b"%08x" % zlib.crc32(text):
        return None
    entry = json.loads(text)
    return entry if isinstance(entry, dict) else None
