"""Files that are either whole or not there: atomic writes, checksummed JSON, free space.

A write goes to a temporary file in the same folder, is flushed to the disk, takes the place of
the old file in one step, and the folder itself is flushed: after a crash or a power cut there is
the old file or the new one, never half of either.
"""

import contextlib
import hashlib
import json
import math
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from frida_painter.errors import FridaError, StorageError

MAX_JSON_BYTES = 32 * 2**20
_TEMPORARY = re.compile(r"\..+-[a-z0-9_]{8}(\.[^.]+)?")  # as tempfile names those of `replacing`


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` for programs that write files themselves; takes its place at the end.

    If the block raises, `path` is left as it was. Raises StorageError when the folder cannot be
    written to or the disk is full.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
        os.close(handle)
    except OSError as error:
        raise cannot_write(path, error) from error
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
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


def read_bytes(path: Path, what: str, most: int, error: type[FridaError] = StorageError) -> bytes:
    """The content of a file of at most `most` bytes. Raises `error` otherwise."""
    try:
        size = path.stat().st_size
        if size > most:
            raise error(f"{path} has {size} bytes; {what} has at most {most}.")
        return path.read_bytes()
    except FileNotFoundError as cause:
        raise error(f"{path} does not exist; give the path of {what}.") from cause
    except OSError as cause:
        raise error(f"{path} cannot be read ({cause.strerror}); give the path of {what}.") from cause


def require_space(folder: Path, needed: int) -> None:
    """Raises StorageError unless the disk of `folder` (which may not exist yet) has `needed` bytes free."""
    existing = folder
    try:
        while not existing.exists():
            existing = existing.parent
        free = shutil.disk_usage(existing).free
    except OSError as error:
        raise cannot_write(folder, error) from error
    if free < needed:
        raise StorageError(
            f"{folder} is on a disk with {free // 2**20} MB free; this painting needs {needed // 2**20} MB; "
            "free some space or choose another folder with --out."
        )


def new_folder(folder: Path) -> None:
    """Makes `folder`, which must not exist yet or must be empty. Raises StorageError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        occupied = any(folder.iterdir())
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"0")
    except OSError as error:
        raise cannot_write(folder, error) from error
    if occupied:
        raise StorageError(f"{folder} is not empty, and nothing there is overwritten; choose a new folder with --out.")


def cannot_write(path: Path, error: OSError) -> StorageError:
    """The error to raise where the system refuses to write to `path`."""
    reason = error.strerror or str(error)
    return StorageError(f"{path} cannot be written ({reason}); choose a folder that you may write to with --out.")


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
