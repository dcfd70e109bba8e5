"""A file of records that only grows: each is on the disk before it counts, and none can be half there.

A record is one line: a checksum, the length of the rest, JSON. The checksum is over that of the line
before as well, so that no line can be changed, left out or moved without being noticed. What a crash
leaves of the one line that was being written is dropped when the file is opened again.
"""

import errno
import fcntl
import hashlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from frida_painter import storage
from frida_painter.errors import StorageError

_CHECKSUM = 16  # hexadecimal digits
_START = b"0" * _CHECKSUM
_LINE = re.compile(rb"([0-9a-f]{16}) (\d{1,9}) (\{.*\})\n")
_LENGTH = re.compile(rb"[0-9a-f]{16} (\d{1,9}) ")
_RESERVE = 2**20
MOST_BYTES = 512 * 2**20


class EventLog:
    """A file of records, open to be added to by one process at a time; `found` are those it held when opened.

    Beside the file lies a reserve of a megabyte, given up when the disk is full, so that a logbook can
    be written when nothing else can. Raises StorageError where the file is damaged in its middle,
    cannot be read or written, or another process has it open.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError as error:
            raise self._failure(error) from error
        try:
            self._lock()
            content = storage.read_bytes(path, "a journal", MOST_BYTES)
            self.found, self._last, self._length = _parsed(content, path)
            self.torn = len(content) - self._length
            if self.torn:
                os.ftruncate(self._descriptor, self._length)
                os.fsync(self._descriptor)
            self._lay_reserve()
        except OSError as error:
            os.close(self._descriptor)
            raise self._failure(error) from error
        except StorageError:
            os.close(self._descriptor)
            raise

    @classmethod
    def begin(cls, path: Path, record: Mapping[str, Any]) -> Self:
        """A new logbook with one record; the file appears with the record in it. Raises StorageError."""
        if path.exists():
            raise StorageError(f"{path} exists already, and a journal is never overwritten; choose a new folder.")
        storage.write_bytes(path, _line(_START, record))
        return cls(path)

    @classmethod
    def read(cls, path: Path) -> list[dict[str, Any]]:
        """The whole records of a file, which is left as it is, whoever writes it. Raises StorageError."""
        return _parsed(storage.read_bytes(path, "a journal", MOST_BYTES), path)[0]

    def append(self, record: Mapping[str, Any]) -> None:
        """Adds a record of plain, finite values; when this returns, it is on the disk.

        Raises StorageError where it cannot be, and the file holds what it held before.
        """
        line = _line(self._last, record)
        try:
            self._write(line)
        except OSError as error:
            raise self._failure(error) from error
        self._last = line[:_CHECKSUM]
        self._length += len(line)

    def close(self) -> None:
        """Lets another process have the file, and the disk its reserve; twice is as good as once."""
        if self._descriptor >= 0:
            self._reserve.unlink(missing_ok=True)
            os.close(self._descriptor)
            self._descriptor = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def _reserve(self) -> Path:
        return self.path.with_name(f".{self.path.name}-reserve")

    def _write(self, line: bytes) -> None:
        self._require_there()
        try:
            self._put(line)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT) or not self._reserve.exists():
                raise
            self._reserve.unlink()
            self._put(line)
        os.fsync(self._descriptor)

    def _put(self, line: bytes) -> None:
        """Writes the line at the end of what is whole, or over what failed to be written there."""
        done = 0
        while done < len(line):
            done += os.pwrite(self._descriptor, line[done:], self._length + done)

    def _require_there(self) -> None:
        """A file that was removed, or lies on a disk that was taken away, would swallow what is written."""
        here, there = os.fstat(self._descriptor), self.path.stat()
        if (here.st_dev, here.st_ino) != (there.st_dev, there.st_ino):
            raise OSError(errno.ENOENT, "another file took its place")

    def _lock(self) -> None:
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise StorageError(
                f"{self.path} is being written by another process; wait until that painting has ended, or stop it."
            ) from error

    def _lay_reserve(self) -> None:
        if not self._reserve.exists():
            with self._reserve.open("wb") as file:
                os.posix_fallocate(file.fileno(), 0, _RESERVE)

    def _failure(self, error: OSError) -> StorageError:
        reason = error.strerror or str(error)
        return StorageError(
            f"{self.path} cannot be written ({reason}); nothing is painted that is not in the journal. "
            "Make room on its disk, or bring the folder back, then resume the painting."
        )


def _line(before: bytes, record: Mapping[str, Any]) -> bytes:
    content = json.dumps(record, allow_nan=False, separators=(", ", ": ")).encode()
    return b"%s %d %s\n" % (_checksum(before, content), len(content), content)


def _checksum(before: bytes, content: bytes) -> bytes:
    return hashlib.sha256(before + content).hexdigest()[:_CHECKSUM].encode()


def _parsed(content: bytes, path: Path) -> tuple[list[dict[str, Any]], bytes, int]:
    """The whole records, the checksum of the last one, and how many bytes they take."""
    last, length = _START, 0
    records: list[dict[str, Any]] = []
    while length < len(content):
        end = content.find(b"\n", length) + 1 or len(content)
        match = _LINE.fullmatch(content[length:end])
        if match is None or match[1] != _checksum(last, match[3]) or int(match[2]) != len(match[3]):
            break
        records.append(json.loads(match[3]))
        last, length = match[1], end
    if not records:
        raise StorageError(f"{path} is not a journal: not even its first record is whole; take an undamaged copy.")
    if not _may_be_torn(content[length:]):
        raise StorageError(
            f"{path} was changed after it was written: its record {len(records) + 1} is damaged, and it is not the "
            "last; take an unchanged copy."
        )
    return records, last, length


def _may_be_torn(tail: bytes) -> bool:
    """Whether this is what a crash left of one line, rather than several of which the first is damaged."""
    length = _LENGTH.match(tail)
    return b"\n" not in tail[:-1] and (length is None or len(tail) <= length.end() + int(length[1]) + 1)
