"""Durable log: a file of records that only grows, survives crashes, and can be read while others write.

Each record is one line: a checksum, the length of the JSON text, the JSON text. The checksum also covers the
checksum of the line before. So a changed, missing or moved line is noticed. A line that a crash left incomplete
is dropped when the file is opened again.
"""

import contextlib
import errno
import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from frida_painter.errors import StorageError
from frida_painter.system import locks, operating_system, storage

_CHECKSUM = 16  # hexadecimal digits
_START = b"0" * _CHECKSUM
_LENGTH = re.compile(rb"[0-9a-f]{16} (\d{1,9}) ")
_RESERVE = 2**20
_LONGEST_SIGN = 400  # bytes
_PATIENCE = 2.0  # seconds; a writer holds the lock for milliseconds
_A_MOMENT = 0.2  # seconds after which a process that only tries the lock has released it
_TALLY = re.compile(rb"((\d{10}) (\d{12}) ([0-9a-f]{16})) ([0-9a-f]{16})\n")
_TALLY_BYTES = 58
MAX_BYTES = 2**30


@dataclass(frozen=True)
class LogPolicy:
    """Rules for one kind of log.

    what: name in messages
    owned: one process holds the log while it is open. Otherwise several processes may add records in turn.
    precious: a reserve file and a tally file lie beside the log
    forgiving: damaged lines are skipped, and a missing file is made
    """

    what: str
    owned: bool = False
    precious: bool = False
    forgiving: bool = False


JOURNAL = LogPolicy("a journal", owned=True, precious=True)
FEED = LogPolicy("a feed", forgiving=True)


class EventLog:
    """File of records, open for appending. `found` holds the records that it had when it was opened.

    A precious log has a reserve file of one megabyte, which is deleted when the disk is full, so that the log
    can still be written. It also has a tally of the flushed records (`missing`). Raises StorageError if the
    file is damaged in the middle, cannot be read or written, or is owned by another process.
    """

    def __init__(self, path: Path, policy: LogPolicy = JOURNAL) -> None:
        self.path, self.policy = path, policy
        self._descriptor = -1
        self._patience, self._is_mine = _PATIENCE, False
        make = os.O_CREAT if policy.forgiving else 0
        try:
            if path.exists():
                with storage.open_checked(path, policy.what, MAX_BYTES):  # refuses files that block, such as pipes
                    pass
            self._descriptor = operating_system.open_file(path, os.O_RDWR | make)
            with self._lock():
                content = storage.read_bytes(path, policy.what, MAX_BYTES)
                read = _forgiving(content) if policy.forgiving else _strict(content, path, policy.what)
                self.found, self._last, self._length = read.records, read.last, read.length
                self._count = len(read.records)
                self.missing = _missing(path, content, self._count)
                self.torn = len(content) - self._length
                if self.torn:
                    os.ftruncate(self._descriptor, self._length)
                    os.fsync(self._descriptor)
            if policy.precious:
                self._lay_reserve(anew=True)  # a process that was killed has left its own
        except OSError as error:
            self._let_go()
            raise self._failure(error) from error
        except StorageError:
            self._let_go()
            raise

    @classmethod
    def begin(cls, path: Path, record: Mapping[str, Any], policy: LogPolicy = JOURNAL) -> Self:
        """Makes a new log with one record, in one step. Raises StorageError."""
        if path.exists():
            raise StorageError(f"{path} exists already, and {policy.what} is never overwritten; choose a new folder.")
        cls.write(path, [record])
        return cls(path, policy)

    @classmethod
    def write(cls, path: Path, records: Iterable[Mapping[str, Any]]) -> None:
        """Replaces the file by a log of these records, in one step. Raises StorageError."""
        last, lines = _START, []
        for record in records:
            lines.append(_line(last, record))
            last = lines[-1][:_CHECKSUM]
        storage.write_bytes(path, b"".join(lines))

    @classmethod
    def read(cls, path: Path, policy: LogPolicy = JOURNAL) -> list[dict[str, Any]]:
        """Returns the intact records of a file without changing it; others may write it. Raises StorageError."""
        content = storage.read_bytes(path, policy.what, MAX_BYTES)
        return (_forgiving(content) if policy.forgiving else _strict(content, path, policy.what)).records

    def append(self, record: Mapping[str, Any], *, flush: bool | None = None) -> None:
        """Adds a record of plain, finite values.

        When this returns, other processes can read the record. With `flush`, which is the default of an owned log, it
        and all earlier records are on the disk.
        Raises StorageError if the write fails; the file then keeps its old content.
        """
        try:
            with self._lock():
                self._catch_up()
                line = _line(self._last, record)
                self._write(line)
                if flush := self.policy.owned if flush is None else flush:
                    self.flush()
                self._last = line[:_CHECKSUM]
                self._length += len(line)
                self._count += 1
                if self.policy.precious and flush:
                    _write_tally(self.path, self._count, self._length, self._last)
        except OSError as error:
            raise self._failure(error) from error

    def flush(self) -> None:
        """Flushes all records to the disk. Raises OSError."""
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Closes the file and removes its reserve. A second call does nothing."""
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                self.flush()
            if self.policy.precious:
                _reserve_path(self.path).unlink(missing_ok=True)
            self._let_go()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _let_go(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    @contextlib.contextmanager
    def _lock(self) -> Iterator[None]:
        """Locks out other writers: in the block, or while the log is open if it is owned.

        Who waited once in vain does not wait again, so that a reader who locks a feed does not slow a painting down.
        """
        if self.policy.owned:
            if not (self._is_mine or locks.take(self._descriptor, _A_MOMENT)):
                holder = _find_holder(self.path)
                raise StorageError(
                    f"{self.path} is being written by {holder}; wait until that painting has ended, or stop it."
                )
            self._is_mine = True
            yield
            return
        if not locks.take(self._descriptor, self._patience):
            self._patience = 0.0
            raise StorageError(f"{self.path} is locked by another process, which does not let go; end that process.")
        self._patience = _PATIENCE
        try:
            yield
        finally:
            locks.release(self._descriptor)

    def _catch_up(self) -> None:
        """Moves to the end of the records that others added; cuts off a line that one of them left incomplete."""
        size = os.fstat(self._descriptor).st_size
        if self.policy.owned or size == self._length:
            return
        added = operating_system.read_at(self._descriptor, size - self._length, self._length)
        whole = added.rfind(b"\n") + 1
        if whole:
            last = added[added.rfind(b"\n", 0, whole - 1) + 1 :][:_CHECKSUM]
            self._last, self._length = last, self._length + whole
            self._count += added.count(b"\n")
        if whole < len(added):
            os.ftruncate(self._descriptor, self._length)

    def _write(self, line: bytes) -> None:
        if self.policy.owned:
            self._require_there()
        try:
            self._put(line)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT) or not _reserve_path(self.path).exists():
                raise
            _reserve_path(self.path).unlink()
            self._put(line)

    def _put(self, line: bytes) -> None:
        """Writes the line after the last complete record, over the remains of a failed write."""
        done = 0
        while done < len(line):
            done += operating_system.write_at(self._descriptor, line[done:], self._length + done)

    def _require_there(self) -> None:
        """Raises OSError if the path names another file: writes would be lost."""
        here, there = os.fstat(self._descriptor), self.path.stat()
        if (here.st_dev, here.st_ino) != (there.st_dev, there.st_ino):
            raise OSError(errno.ENOENT, "another file took its place")

    def require_reserve(self) -> None:
        """Raises StorageError if the reserve cannot be made or the disk has less free space than its size."""
        try:
            self._lay_reserve()
            if shutil.disk_usage(self.path.parent).free < _RESERVE:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            raise self._failure(error) from error

    def _lay_reserve(self, *, anew: bool = False) -> None:
        if anew or not _reserve_path(self.path).exists():
            try:
                with _reserve_path(self.path).open("wb", buffering=0) as file:
                    file.write(
                        f"{locks.who()}, in process {os.getpid()}, since {datetime.now():%Y-%m-%d %H:%M}\n".encode()
                    )
                    operating_system.allocate(file.fileno(), _RESERVE)
            except OSError:
                _reserve_path(self.path).unlink(missing_ok=True)  # an incomplete reserve would count as a complete one
                raise

    def _failure(self, error: OSError) -> StorageError:
        reason = error.strerror or str(error)
        if not self.policy.owned:
            return StorageError(f"{self.path} cannot be written ({reason}); make room on its disk, or bring it back.")
        return StorageError(
            f"{self.path} cannot be written ({reason}); nothing is painted that is not in the journal. "
            "Make room on its disk, or bring the folder back, then resume the painting."
        )


def missing(path: Path, what: str) -> int:
    """Returns how many flushed records a precious log has lost, by its tally; all of them if the file is gone.

    Returns 0 if there is no tally. Raises StorageError if the log cannot be read.
    """
    content = storage.read_bytes(path, what, MAX_BYTES) if path.exists() else b""
    return _missing(path, content, content.count(b"\n"))


def _read_tally(path: Path) -> tuple[int, int, bytes]:
    """Returns number, bytes and last checksum of the flushed records; zeros if there is no whole tally."""
    tally = None
    with contextlib.suppress(StorageError):
        tally = _TALLY.fullmatch(storage.read_bytes(_tally_path(path), "a tally", 2 * _TALLY_BYTES))
    if tally is None or _line_checksum(b"", tally[1]) != tally[5]:  # incomplete after a power cut
        return 0, 0, _START
    return int(tally[2]), int(tally[3]), tally[4]


def _missing(path: Path, content: bytes, count: int) -> int:
    counted, length, last = _read_tally(path)
    line = content[content.rfind(b"\n", 0, length - 1) + 1 : length]
    return 0 if not length or (line.endswith(b"\n") and line.startswith(last)) else max(1, counted - count)


def remove(path: Path) -> None:
    """Removes a precious log, if it is there, with its tally and its reserve. Raises OSError."""
    for file in (path, _tally_path(path), _reserve_path(path)):
        file.unlink(missing_ok=True)


def _write_tally(path: Path, count: int, length: int, last: bytes) -> None:
    """Overwrites the tally in its own disk block, which needs no free space; ignores errors.

    The tally is not flushed. After a power cut it may count too few records, but never too many.
    """
    told = b"%010d %012d %s" % (count, length, last)
    with contextlib.suppress(OSError):
        descriptor = operating_system.open_file(_tally_path(path), os.O_WRONLY | os.O_CREAT)
        try:
            operating_system.write_at(descriptor, b"%s %s\n" % (told, _line_checksum(b"", told)), 0)
        finally:
            os.close(descriptor)


def _tally_path(path: Path) -> Path:
    return path.with_name(f".{path.name}-tally")


def _reserve_path(path: Path) -> Path:
    return path.with_name(f".{path.name}-reserve")


def _find_holder(path: Path) -> str:
    """Returns who has laid the reserve of a log; without one, as on a full disk, that is another process."""
    with contextlib.suppress(StorageError):
        signed = storage.read_bytes(_reserve_path(path), "a reserve", _RESERVE)[:_LONGEST_SIGN]
        if (name := signed.partition(b"\n")[0].decode(errors="replace")).isprintable():
            return name or "another process"
    return "another process"


class LogReader:
    """Reader of the new records of a forgiving log, while others write it; a line of over `most` bytes is skipped.

    The file may be missing at first. No record is returned twice, even if another file takes its place.
    """

    def __init__(self, path: Path, most: int = MAX_BYTES) -> None:
        self._path, self._most = path, most
        self._file = (0, 0)  # device and inode
        self._last, self._offset, self._read = _START, 0, 0
        self._skipped = b""  # checksum of a line that is too long, until its end

    def read(self) -> list[dict[str, Any]]:
        """Returns new records in order. Waits for incomplete lines and skips damaged ones."""
        return list(self.stream())

    def stream(self) -> Iterator[dict[str, Any]]:
        """Yields the records that `read` would return, one after another, so that a long log needs no memory."""
        try:
            with storage.open_checked(self._path, FEED.what, MAX_BYTES) as file:
                stat, again = os.fstat(file.fileno()), 0
                if (stat.st_dev, stat.st_ino) != self._file or stat.st_size < self._offset:
                    self._file, again = (stat.st_dev, stat.st_ino), self._read
                    self._last, self._offset, self._read, self._skipped = _START, 0, 0, b""
                file.seek(self._offset)
                content = file.read(self._most)
        except (OSError, StorageError):
            return
        if self._skipped and (end := content.find(b"\n") + 1):
            self._last, self._skipped, content = self._skipped, b"", content[end:]
            self._offset += end
        for line, record in _intact(content, self._last):
            self._last, self._offset = line[:_CHECKSUM], self._offset + len(line)
            if record is not None:
                self._read += 1
                if self._read > again:
                    yield record
        if b"\n" not in content and (self._skipped or len(content) == self._most):
            self._skipped, self._offset = self._skipped or content[:_CHECKSUM], self._offset + len(content)


@dataclass(frozen=True)
class _Parsed:
    """Intact records, the checksum of the last one, and their length in bytes."""

    records: list[dict[str, Any]]
    last: bytes
    length: int


def _line(before: bytes, record: Mapping[str, Any]) -> bytes:
    return _format(before, json.dumps(record, allow_nan=False, separators=(", ", ": ")).encode())


def _format(before: bytes, content: bytes) -> bytes:
    return b"%s %d %s\n" % (_line_checksum(before, content), len(content), content)


def _line_checksum(before: bytes, content: bytes) -> bytes:
    return hashlib.sha256(before + content).hexdigest()[:_CHECKSUM].encode()


def _record(line: bytes, before: bytes) -> dict[str, Any] | None:
    """Returns the record of a line; None if it is damaged.

    before: checksum of the line before
    Raises ValueError if it is whole, and holds no record.
    """
    content = line[line.find(b"{") : -1]
    if not line.endswith(b"}\n") or line != _format(before, content):
        return None
    record: dict[str, Any] = storage.parse_json(content)  # an object, by its first character
    return record


def _strict(content: bytes, path: Path, what: str) -> _Parsed:
    """Returns all records. Raises StorageError if more is damaged than a last line, or lines that were not flushed."""
    last, length = _START, 0
    records: list[dict[str, Any]] = []
    while length < len(content):
        end = content.find(b"\n", length) + 1 or len(content)
        try:
            record = _record(content[length:end], last)
        except ValueError as cause:
            raise StorageError(
                f"{path} is not {what}: its record {len(records) + 1} is not JSON ({cause}); take an undamaged copy."
            ) from cause
        if record is None:
            break
        records.append(record)
        last, length = content[length : length + _CHECKSUM], end
    if not records:
        raise StorageError(
            f"{path} is damaged, or is not {what}: not even its first record is whole; take an undamaged copy."
        )
    if not _may_be_torn(content[length:]) and not 0 < _read_tally(path)[1] <= length:  # as a power cut leaves it
        raise StorageError(
            f"{path} was changed after it was written: its record {len(records) + 1} is damaged, and it is not the "
            "last; take an unchanged copy."
        )
    return _Parsed(records, last, length)


def _may_be_torn(tail: bytes) -> bool:
    """Returns True if the bytes may be the start of one line that a crash cut off.

    Returns False for several lines of which the first is damaged.
    """
    length = _LENGTH.match(tail)
    return b"\n" not in tail[:-1] and (length is None or len(tail) <= length.end() + int(length[1]) + 1)


def _forgiving(content: bytes) -> _Parsed:
    """Returns all intact records."""
    lines = list(_intact(content))
    last = lines[-1][0][:_CHECKSUM] if lines else _START
    return _Parsed([record for _, record in lines if record is not None], last, sum(len(line) for line, _ in lines))


def _intact(content: bytes, last: bytes = _START) -> Iterator[tuple[bytes, dict[str, Any] | None]]:
    """Yields each complete line with its record, None if it is damaged."""
    start = 0
    while end := content.find(b"\n", start) + 1:
        line = content[start:end]
        try:
            record = _record(line, last)
        except ValueError:  # `suppress` costs more for each of many lines
            record = None
        yield line, record
        last, start = line[:_CHECKSUM], end
