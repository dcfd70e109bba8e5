"""Files that are either whole or not there: atomic writes, checksummed JSON, free space.

A write goes to a temporary file in the same folder, is flushed to the disk, takes the place of
the old file in one step, and the folder itself is flushed: after a crash or a power cut there is
the old file or the new one, never half of either.
"""

import contextlib
import errno
import hashlib
import json
import math
import os
import re
import shutil
import stat
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping
from io import BufferedReader
from pathlib import Path
from typing import Any

from frida_painter.errors import ConfigError, FridaError, StorageError

MAX_JSON_BYTES = 32 * 2**20
MAX_BYTES = 16 * 2**30
"""Of any file that is read piece by piece."""
_TEMPORARY = re.compile(r"\..+-[a-z0-9_]{8}(\.[^.]+)?")  # as tempfile names those of `replacing`


@contextlib.contextmanager
def replacing(path: Path, mode: int = 0o644) -> Iterator[Path]:
    """A temporary path beside `path` for programs that write files themselves; takes its place at the end.

    mode: who may read and write it then. If the block raises, `path` is left as it was. Raises StorageError when the
    folder cannot be written to or the disk is full.
    """
    try:
        if path.exists() and not path.is_file():  # neither a device nor a pipe is a place for a file
            raise OSError(errno.EEXIST, "it is there and is not a plain file")
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
        os.close(handle)
    except (OSError, ValueError) as error:
        raise cannot_write(path, error) from error
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(mode)
        _flush(temporary)
        temporary.replace(path)
        _flush(path.parent)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def clear_leftovers(folder: Path) -> None:
    """Removes the temporary files of writes that were killed, in a folder that nobody writes to now."""
    for path in folder.rglob(".*"):
        if _TEMPORARY.fullmatch(path.name) and path.is_file():
            path.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Writes `content` to `path` atomically. Raises StorageError."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, content: str) -> None:
    """Writes `content` as UTF-8 to `path` atomically. Raises StorageError."""
    write_bytes(path, content.encode("utf-8"))


def write_json(path: Path, record: Mapping[str, Any]) -> None:
    """Writes `record` as readable JSON, with a checksum over the rest under the key "sha256".

    Numbers must be finite. Raises StorageError; ValueError for NaN, a programming error.
    """
    body = {key: value for key, value in record.items() if key != "sha256"}
    write_text(path, json.dumps({**body, "sha256": _checksum(body)}, indent=2, allow_nan=False) + "\n")


def read_json(path: Path, what: str, error: type[FridaError] = StorageError) -> dict[str, Any]:
    """Reads a record that `write_json` wrote; `what` names it in messages ("the plan").

    Raises `error` where the file is missing, cut off, edited, too large, or holds NaN or
    infinite numbers or a key twice.
    """
    text = read_bytes(path, what, MAX_JSON_BYTES, error)
    try:
        record = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_refuse_duplicates)
    except (ValueError, RecursionError) as cause:
        raise error(f"{path} is not {what}: it is cut off or not JSON ({cause}); take an undamaged copy.") from cause
    if not isinstance(record, dict) or "sha256" not in record:
        raise error(f"{path} is not {what}: it has no checksum; give a file that frida-painter wrote.")
    checksum = record.pop("sha256")
    if not _all_finite(record) or checksum != _checksum(record):
        raise error(f"{path} was changed after it was written (its checksum does not match); take an unchanged copy.")
    return record


def read_toml(path: Path, what: str, most: int, advice: str, error: type[FridaError] = ConfigError) -> dict[str, Any]:
    """The values of a TOML file of at most `most` bytes that a person wrote; `advice` ends the messages.

    Whole numbers have 64 bits, as TOML has it: longer ones fit into nothing. Raises `error`.
    """
    content = read_bytes(path, what, most, error)
    try:
        values = tomllib.loads(content.decode("utf-8-sig"))
        _require_plain_numbers(values)
    except (ValueError, RecursionError) as cause:
        raise error(f"{shown(path)} is not TOML ({cause}); {advice}.") from cause
    return values


def read_bytes(path: Path, what: str, most: int, error: type[FridaError] = StorageError) -> bytes:
    """The content of a file of at most `most` bytes. Raises `error` otherwise."""
    with opened(path, what, most, error) as file:
        content = file.read(most + 1)
        if len(content) > most:  # it grew, or is one of those of the system that do not say how much they hold
            raise error(f"{shown(path)} has more than {most} bytes; {what} has at most {most}.")
        return content


@contextlib.contextmanager
def opened(path: Path, what: str, most: int, error: type[FridaError] = StorageError) -> Iterator[BufferedReader]:
    """A file of at most `most` bytes that somebody named, open for reading: the one door for all such files.

    what: names it in messages ("the plan"). Devices, pipes, sockets and folders, and links to them, are refused
    before they are opened, for a device does things when it is opened, and a pipe waits; and again once open,
    where another took the file's place. Raises `error`, also where the disk fails while it is read.
    """
    with _open(path, what, most, error) as file:
        try:
            yield file
        except OSError as cause:
            if cause.errno is None:  # a decoder's own complaint
                raise
            raise error(f"{shown(path)} cannot be read ({cause.strerror}); give the path of {what}.") from cause


def _open(path: Path, what: str, most: int, error: type[FridaError]) -> BufferedReader:
    try:
        _require_regular(path, what, most, path.stat(), error)
        file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")
    except FileNotFoundError as cause:
        raise error(f"{shown(path)} does not exist; give the path of {what}.") from cause
    except OSError as cause:
        raise error(f"{shown(path)} cannot be read ({cause.strerror}); give the path of {what}.") from cause
    except ValueError as cause:
        raise error(f"{shown(path)!r} cannot be a path ({cause}); give the path of {what}.") from cause
    try:
        _require_regular(path, what, most, os.fstat(file.fileno()), error)
    except FridaError:
        file.close()
        raise
    return file


def copy(source: Path, target: Path, what: str, most: int, error: type[FridaError] = StorageError) -> None:
    """Copies a file that somebody named. Raises `error` where it cannot be read, StorageError where not written."""
    with opened(source, what, most, error) as file, replacing(target) as temporary, temporary.open("wb") as made:
        shutil.copyfileobj(file, made)


def sha256(path: Path, what: str, error: type[FridaError] = StorageError) -> str:
    """The hash of a file that somebody named, in hexadecimal digits. Raises `error` where it cannot be read."""
    with opened(path, what, MAX_BYTES, error) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def exists(path: Path) -> bool:
    """Whether there is something of that name, also where it is longer than a name can be."""
    try:
        return path.exists()
    except OSError:
        return False


def shown(path: Path | str) -> str:
    """A path as it stands in messages: of one that is very long, both ends."""
    text = str(path)
    return text if len(text) <= 240 else f"{text[:120]}...{text[-100:]}"


def _require_regular(path: Path, what: str, most: int, facts: os.stat_result, error: type[FridaError]) -> None:
    if stat.S_ISDIR(facts.st_mode):
        raise error(f"{shown(path)} is a folder; give the path of {what}.")
    if not stat.S_ISREG(facts.st_mode):
        raise error(f"{shown(path)} is not a plain file (but {_kind(facts.st_mode)}); give the path of {what}.")
    if facts.st_size > most:
        raise error(f"{shown(path)} has {facts.st_size} bytes; {what} has at most {most}.")


def _kind(mode: int) -> str:
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"


def require_space(folder: Path, needed: int) -> None:
    """Raises StorageError unless the disk of `folder` (which may not exist yet) has `needed` bytes free."""
    existing = folder
    try:
        while not existing.exists():
            existing = existing.parent
        free = shutil.disk_usage(existing).free
    except (OSError, ValueError) as error:
        raise cannot_write(folder, error) from error
    if free < needed:
        raise StorageError(
            f"{shown(folder)} is on a disk with {free // 2**20} MB free; this painting needs {needed // 2**20} MB; "
            "free some space or choose another folder with --out."
        )


def require_place(path: Path, *, folder: bool = False) -> None:
    """Raises StorageError at once, before any work, where no file (or `folder`) can be written at `path`."""
    try:
        os.lstat(path.parent / f"{path.name}.part")  # which no name can be that is none, or too long
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as error:
        raise cannot_write(path, error) from error
    try:
        if path.exists() and not (path.is_dir() if folder else path.is_file()):
            raise OSError(errno.EEXIST, f"it is there and is not {'a folder' if folder else 'a plain file'}")
        nearest = path if folder else path.parent
        while not nearest.exists():
            nearest = nearest.parent
        if not nearest.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"{shown(nearest)} is not a folder")
        if not os.access(nearest, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except (OSError, ValueError) as error:
        raise cannot_write(path, error) from error


def require_unused(folder: Path) -> None:
    """Raises StorageError where `folder` could not be made, or has something in it; makes nothing."""
    require_place(folder, folder=True)
    try:
        occupied = folder.exists() and any(folder.iterdir())
    except OSError as error:
        raise cannot_write(folder, error) from error
    if occupied:
        raise StorageError(
            f"{shown(folder)} is not empty, and nothing there is overwritten; choose a new folder with --out."
        )


def new_folder(folder: Path) -> None:
    """Makes `folder`, which must not exist yet or must be empty. Raises StorageError."""
    require_unused(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"0")
    except (OSError, ValueError) as error:
        raise cannot_write(folder, error) from error


def cannot_write(path: Path, error: OSError | ValueError) -> StorageError:
    """The error to raise where the system refuses to write to `path`, or it is no path."""
    reason = getattr(error, "strerror", None) or str(error)
    full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
    remedy = "make room on its disk" if full else "choose a folder that you may write to with --out"
    return StorageError(f"{shown(path)} cannot be written ({reason}); {remedy}.")


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _checksum(record: Mapping[str, Any]) -> str:
    canonical = json.dumps(record, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(canonical.encode("utf-8")).hexdigest()


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")


def _refuse_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    record = dict(pairs)
    if len(record) != len(pairs):
        raise ValueError("a key occurs twice")
    return record


def _all_finite(value: Any) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    children: Callable[[], Any] = value.values if isinstance(value, dict) else lambda: value
    return all(_all_finite(child) for child in children()) if isinstance(value, dict | list) else True


def _require_plain_numbers(value: Any) -> None:
    """Raises ValueError where a whole number has more than 64 bits."""
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError(f"{str(value)[:12]}... is a whole number of {len(str(value))} digits, and one has at most 19")
    for child in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _require_plain_numbers(child)


# Numbers of things and sizes of files, as a person says them.


def count_of(number: int, what: str) -> str:
    """ "1 stroke", "2 strokes"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def megabytes(size: int) -> str:
    """Bytes as "12 MB"."""
    return f"{size / 1e6:.0f} MB"
