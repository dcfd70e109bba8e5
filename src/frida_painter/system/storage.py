"""Safe file access: atomic writes, checksummed JSON, checks before a read, free space.

A write goes to a temporary file in the same folder. It is flushed to the disk and then replaces the old file in
one step. Then the folder is flushed. After a crash or a power cut, either the old file or the new one is there,
never a part of one.
"""

import contextlib
import errno
import hashlib
import itertools
import json
import math
import os
import re
import shutil
import stat
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from io import BufferedReader
from pathlib import Path
from typing import Any

from frida_painter.errors import ConfigError, FridaError, StorageError
from frida_painter.system import operating_system

MAX_JSON_BYTES = 32 * 2**20
MAX_BYTES = 16 * 2**30
"""Size limit of files that are read in pieces."""
PART = ".frida-painter-part-"
"""Beginning of the names of temporary files and folders. No other program gives it, so that they may be removed."""


@contextlib.contextmanager
def replacing(path: Path, mode: int = 0o644) -> Iterator[Path]:
    """Gives a temporary path beside `path` for programs that write files themselves; moves it to `path` at the end.

    mode: permissions of the new file
    If the block raises an error, `path` stays unchanged. Raises StorageError if the folder cannot be written to
    or the disk is full.
    """
    try:
        with contextlib.suppress(FileNotFoundError):  # a device or a pipe must not be replaced
            if not stat.S_ISREG(path.stat().st_mode):
                raise OSError(errno.EEXIST, "it is there and is not a plain file")
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=PART, suffix=path.suffix)
        os.close(handle)
    except (OSError, ValueError) as error:
        raise cannot_write(path, error) from error
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(mode)
        operating_system.flush(temporary)
        operating_system.replace(temporary, path)
        operating_system.flush(path.parent)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def list_files(folder: Path, pattern: str) -> list[Path]:
    """Returns the files in a folder that match a pattern, by name, without those that `replacing` is still writing."""
    return sorted(path for path in folder.glob(pattern) if not path.name.startswith(PART))


def clear_leftovers(*folders: Path) -> None:
    """Removes temporary files of interrupted writes from folders that no process writes to, not from those inside."""
    for path in (path for folder in folders for path in folder.glob(f"{PART}*") if path.is_file()):
        path.unlink(missing_ok=True)


def find_unused(path: Path) -> Path:
    """Returns the path; if something is there, the first unused one of NAME-2, NAME-3 and so on."""
    numbered = (path.with_stem(f"{path.stem}-{number}") for number in itertools.count(2))
    return next(one for one in itertools.chain((path,), numbered) if not os.path.lexists(one))


_RESERVED = re.compile(r"(con|prn|aux|nul|con(in|out)\$|(com|lpt)[0-9¹²³]) *(\.|$)", re.IGNORECASE)


def file_name(text: str) -> str:
    """Returns a text as a name that a file or folder may have on every system, also on Windows; a good name stays."""
    plain = re.sub(r'[\x00-\x1f<>:"/\\|?*]+', "-", text).rstrip(". ")
    return f"_{plain}" if not plain or _RESERVED.match(plain) else plain


def next_number(folder: Path, beginning: str, first: int = 1) -> int:
    """Returns the number after the largest one that follows `beginning` in the names of a folder's files."""
    named = (re.match(rf"{re.escape(beginning)}(\d+)", path.name) for path in folder.glob("*"))
    return max((int(name[1]) + 1 for name in named if name), default=first)


def write_bytes(path: Path, content: bytes) -> None:
    """Writes `content` to `path` atomically. Raises StorageError."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, content: str) -> None:
    """Writes `content` as UTF-8 to `path` atomically. Raises StorageError."""
    write_bytes(path, content.encode("utf-8"))


def write_json(path: Path, record: Mapping[str, Any]) -> None:
    """Writes `record` as readable JSON, with a checksum of the other keys under "sha256".

    Raises StorageError. Raises ValueError for NaN or infinity, which is a programming error.
    """
    body = {key: value for key, value in record.items() if key != "sha256"}
    write_text(path, json.dumps({**body, "sha256": _checksum(body)}, indent=2, allow_nan=False) + "\n")


def read_json(path: Path, what: str, error: type[FridaError] = StorageError) -> dict[str, Any]:
    """Reads a record that `write_json` wrote.

    what: name of the file in messages ("the plan")
    Raises `error` if the file is missing, cut off, edited or too large, or holds what `parse_json` refuses.
    """
    text = read_bytes(path, what, MAX_JSON_BYTES, error)
    try:
        record = parse_json(text)
    except ValueError as cause:
        raise error(f"{path} is not {what}: it is cut off or not JSON ({cause}); take an undamaged copy.") from cause
    if not isinstance(record, dict) or "sha256" not in record:
        raise error(f"{path} is not {what}: it has no checksum; give a file that frida-painter wrote.")
    checksum = record.pop("sha256")
    if checksum != _checksum(record):
        raise error(f"{path} was changed after it was written (its checksum does not match); take an unchanged copy.")
    return record


def read_toml(path: Path, what: str, most: int, advice: str, error: type[FridaError] = ConfigError) -> dict[str, Any]:
    """Reads a TOML file of at most `most` bytes that a person wrote.

    what: name of the file in messages
    advice: end of the messages
    Raises `error`, also for integers of more than 64 bits and for more than 50 values within one another.
    """
    content = read_bytes(path, what, most, error)
    try:
        values = tomllib.loads(content.decode("utf-8-sig"))
        _require_plain(values)  # each reader says what its numbers may be
    except (ValueError, RecursionError) as cause:
        raise error(f"{abridge(path)} is not TOML ({cause}); {advice}.") from cause
    return values


def read_bytes(path: Path, what: str, most: int, error: type[FridaError] = StorageError) -> bytes:
    """Returns the content of a file of at most `most` bytes. Raises `error` otherwise."""
    with open_checked(path, what, most, error) as file:
        usual = min(most, os.fstat(file.fileno()).st_size + 2**16) + 1  # memory for all of `most` may not be there
        content = file.read(usual)
        if len(content) == usual <= most:  # it grew, or is a system file without a size
            content += file.read(most + 1 - usual)
        if len(content) > most:
            raise error(f"{abridge(path)} has more than {most} bytes; {what} has at most {most}.")
        return content


@contextlib.contextmanager
def open_checked(path: Path, what: str, most: int, error: type[FridaError] = StorageError) -> Iterator[BufferedReader]:
    """Opens a file of at most `most` bytes that a person named. All such files are opened here.

    what: name of the file in messages ("the plan")
    Devices, pipes, sockets, folders and links to them are refused before they are opened: a device may act when
    it is opened, and a pipe blocks. The open file is checked again, because another file may have replaced it.
    Raises `error`, also if a read fails later.
    """
    with _open(path, what, most, error) as file:
        try:
            yield file
        except OSError as cause:
            if cause.errno is None:  # an error of a decoder, not of the disk
                raise
            raise error(f"{abridge(path)} cannot be read ({cause.strerror}); give the path of {what}.") from cause


def _open(path: Path, what: str, most: int, error: type[FridaError]) -> BufferedReader:
    try:
        _require_regular(path, what, most, path.stat(), error)
        file = os.fdopen(operating_system.open_file(path, os.O_RDONLY), "rb")
    except FileNotFoundError as cause:
        raise error(f"{abridge(path)} does not exist; give the path of {what}.") from cause
    except OSError as cause:
        raise error(f"{abridge(path)} cannot be read ({cause.strerror}); give the path of {what}.") from cause
    except ValueError as cause:
        raise error(f"{abridge(path)!r} cannot be a path ({cause}); give the path of {what}.") from cause
    try:
        _require_regular(path, what, most, os.fstat(file.fileno()), error)
    except FridaError:
        file.close()
        raise
    return file


def copy(source: Path, target: Path, what: str, most: int, error: type[FridaError] = StorageError) -> None:
    """Copies a file that a person named. Raises `error` if it cannot be read, StorageError if it cannot be written."""
    with open_checked(source, what, most, error) as file, replacing(target) as temporary, temporary.open("wb") as made:
        shutil.copyfileobj(file, made)


def sha256(path: Path, what: str, error: type[FridaError] = StorageError) -> str:
    """Returns the hexadecimal hash of a file that a person named. Raises `error` if it cannot be read."""
    with open_checked(path, what, MAX_BYTES, error) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def exists(path: Path) -> bool:
    """Returns True if the path exists; False also if it cannot be a path."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def path_fault(path: Path | str) -> str:
    """Returns the reason why no file can have this path, such as a zero byte or a long name; "" if one can."""
    try:
        os.lstat(path)
    except ValueError as error:
        return str(error)
    except OSError as error:
        return os.strerror(error.errno) if error.errno == errno.ENAMETOOLONG else ""
    return ""


def in_home(path: str) -> Path:
    """Returns a path with the home folder in place of ~; unchanged if that is the home of nobody."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)


def abridge(path: Path | str) -> str:
    """Returns a path for messages; the middle of a very long path is left out."""
    text = str(path)
    return text if len(text) <= 240 else f"{text[:120]}...{text[-100:]}"


def _require_regular(path: Path, what: str, most: int, facts: os.stat_result, error: type[FridaError]) -> None:
    if stat.S_ISDIR(facts.st_mode):
        raise error(f"{abridge(path)} is a folder; give the path of {what}.")
    if not stat.S_ISREG(facts.st_mode):
        raise error(f"{abridge(path)} is not a plain file (but {_kind(facts.st_mode)}); give the path of {what}.")
    if facts.st_size > most:
        raise error(f"{abridge(path)} has {facts.st_size} bytes; {what} has at most {most}.")


def _kind(mode: int) -> str:
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"


def require_space(folder: Path, needed: int, what: str) -> None:
    """Raises StorageError unless the disk of `folder` has `needed` bytes free; the folder need not exist.

    what: user of the space in the message, such as "this painting"
    """
    existing = folder
    try:
        while not existing.exists():
            existing = existing.parent
        free = shutil.disk_usage(existing).free
    except (OSError, ValueError) as error:
        raise cannot_write(folder, error) from error
    if free < needed:
        raise StorageError(
            f"{abridge(folder)} is on a disk with {free // 2**20} MB free; {what} needs {needed // 2**20} MB; "
            "free some space or choose another folder with --out."
        )


def require_place(path: Path, *, folder: bool = False) -> None:
    """Raises StorageError if no file (or `folder`) can be written at `path`; for checks before the work."""
    try:
        os.lstat(path.parent / f"{path.name}.part")  # fails if the name is invalid or too long
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
            raise NotADirectoryError(errno.ENOTDIR, f"{abridge(nearest)} is not a folder")
        if not os.access(nearest, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except (OSError, ValueError) as error:
        raise cannot_write(path, error) from error


def require_unused(folder: Path) -> None:
    """Raises StorageError if `folder` cannot be made or is not empty; makes nothing."""
    require_place(folder, folder=True)
    try:
        occupied = folder.exists() and any(folder.iterdir())
    except OSError as error:
        raise cannot_write(folder, error) from error
    if occupied:
        raise StorageError(
            f"{abridge(folder)} is not empty, and nothing there is overwritten; choose a new folder with --out."
        )


def new_folder(folder: Path) -> bool:
    """Makes `folder`, which must be missing or empty; returns True if it was missing. Raises StorageError."""
    require_unused(folder)
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"0")
    except (OSError, ValueError) as error:
        raise cannot_write(folder, error) from error
    return made


def cannot_write(path: Path, error: OSError | ValueError) -> StorageError:
    """Returns the error for a path that the system refuses to write or that is invalid."""
    reason = getattr(error, "strerror", None) or str(error)
    full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
    remedy = "make room on its disk" if full else "choose a folder that you may write to with --out"
    return StorageError(f"{abridge(path)} cannot be written ({reason}); {remedy}.")


def _checksum(record: Mapping[str, Any]) -> str:
    canonical = json.dumps(record, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(canonical.encode("utf-8")).hexdigest()


def parse_json(text: str | bytes) -> Any:
    """Returns the value of a JSON text. All records are read here.

    No record of this program holds NaN, infinity, a key that occurs twice, an integer of more than 64 bits, or more
    than 50 values within one another. Raises ValueError for these too, so that readers need not expect them.
    """
    try:
        plain = (text if isinstance(text, str) else text.decode()).strip(" \t\r\n")
        value, end = _DECODER.raw_decode(plain)
    except RecursionError as cause:
        raise ValueError(_TOO_DEEP) from cause
    if end < len(plain):
        raise ValueError(f"more follows after its end at character {end}")
    if plain.count("[") + plain.count("{") > _MAX_DEPTH:
        _require_plain(value)
    return value


_TOO_DEEP = "its values lie more than 50 deep within one another"
_MAX_DEPTH = 50


@contextlib.contextmanager
def understanding(path: Path, what: str, error: type[FridaError] = StorageError) -> Iterator[None]:
    """Turns each error of a block that makes sense of a file's values into one sentence that names the file.

    what: name of the file in messages ("the plan")
    FridaErrors pass through, because they say what is wrong. Raises `error` for all others.
    """
    try:
        yield
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, AssertionError, RuntimeError) as cause:
        why = " ".join(f"{type(cause).__name__}: {cause}".split())[:200]
        raise error(
            f"{abridge(path)} is not {what} as this program writes it ({why}); take an undamaged copy."
        ) from cause


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")


def _refuse_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    record = dict(pairs)
    if len(record) != len(pairs):
        raise ValueError("a key occurs twice")
    return record


def _require_whole(value: int) -> int:
    if not -(2**63) <= value < 2**63:
        raise ValueError(f"{str(value)[:12]}... is a whole number of {len(str(value))} digits, and one has at most 19")
    return value


def _read_float(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _refuse_constant(text)


_DECODER = json.JSONDecoder(
    parse_constant=_refuse_constant,
    object_pairs_hook=_refuse_duplicates,
    parse_int=lambda digits: _require_whole(int(digits)),
    parse_float=_read_float,
)


def _require_plain(value: Any) -> None:
    """Raises ValueError for whole numbers and depths that `parse_json` refuses."""
    values = [(value, 1)]
    while values:
        one, depth = values.pop()
        if isinstance(one, int):
            _require_whole(one)
        elif isinstance(one, dict | list):
            if depth > _MAX_DEPTH:
                raise ValueError(_TOO_DEEP)
            values += [(part, depth + 1) for part in (one.values() if isinstance(one, dict) else one)]


# Counts and file sizes as text


def count_of(number: int, what: str) -> str:
    """Returns a count with its noun: "1 stroke", "2 strokes"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def megabytes(size: int) -> str:
    """Returns bytes as "12 MB"."""
    return f"{size / 1e6:.0f} MB"
