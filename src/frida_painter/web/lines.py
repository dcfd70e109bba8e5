"""Files to which one process adds lines of JSON and others read them: how page and worker speak to each other.

Whoever writes does so whether anybody reads or not; whoever reads may begin at any time.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from frida_painter.errors import StorageError

_MOST_LINE = 2**20


class LineWriter:
    """Adds records to the file at `path`, each handed to the operating system in one piece. Raises StorageError."""

    def __init__(self, path: Path) -> None:
        try:
            self._file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644)
            size = os.fstat(self._file).st_size
            if size and os.pread(self._file, 1, size - 1) != b"\n":
                os.write(self._file, b"\n")  # what a killed process left half written shall not spoil the next line
        except OSError as error:
            raise _cannot(error) from error

    def add(self, record: Mapping[str, Any]) -> None:
        """Adds a record of plain, finite values. Raises StorageError."""
        line = json.dumps(record, allow_nan=False).encode() + b"\n"
        try:
            os.write(self._file, line)
        except OSError as error:
            raise _cannot(error) from error

    def close(self) -> None:
        """Flushes the lines to the disk and closes the file."""
        try:
            os.fsync(self._file)
        finally:
            os.close(self._file)


class LineReader:
    """Reads what was added to the file at `path` since it was asked last; the file need not exist yet."""

    def __init__(self, path: Path, offset: int = 0) -> None:
        self._path, self._offset = path, offset
        self._rest = b""

    def read(self) -> list[dict[str, Any]]:
        """New records, in order. A line that is not whole yet is waited for, one that is damaged left out."""
        try:
            if self._path.stat().st_size <= self._offset:
                return []
            with self._path.open("rb") as file:
                file.seek(self._offset)
                content = file.read()
        except OSError:
            return []
        self._offset += len(content)
        *lines, self._rest = (self._rest + content).split(b"\n")
        self._rest = self._rest[:_MOST_LINE]
        return [record for line in lines if (record := _understood(line)) is not None]


def _understood(line: bytes) -> dict[str, Any] | None:
    try:
        record = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) else None


def _cannot(error: OSError) -> StorageError:
    return StorageError(f"A note to the painter cannot be written ({error.strerror}); make room on the disk.")
