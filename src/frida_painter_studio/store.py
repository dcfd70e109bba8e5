"""Store of a studio: its paintings and pictures in SQLite; all other data is in their folders."""

import asyncio
import contextlib
import errno
import hashlib
import re
import secrets
import shutil
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from frida_painter.easel.kinds import JOURNAL
from frida_painter.errors import ImageError, Interrupted, ProcessLost, StorageError
from frida_painter.system import storage
from frida_painter_studio.reader import decode_upload
from frida_painter_studio.studio_folder import (
    FAMILIES,
    PICTURES,
    PaintingFolder,
    find_families,
    forget_lock,
    require_disk,
)

_SCHEMA = """
CREATE TABLE IF NOT EXISTS painting (
    id TEXT PRIMARY KEY, folder TEXT NOT NULL UNIQUE, title TEXT NOT NULL, begun TEXT NOT NULL
) STRICT;
CREATE TABLE IF NOT EXISTS deed (at TEXT NOT NULL, by TEXT NOT NULL, painting TEXT NOT NULL, what TEXT NOT NULL) STRICT;
CREATE TRIGGER IF NOT EXISTS deeds_stay_so BEFORE UPDATE ON deed BEGIN SELECT RAISE(ABORT, 'only added to'); END;
CREATE TRIGGER IF NOT EXISTS deeds_stay BEFORE DELETE ON deed BEGIN SELECT RAISE(ABORT, 'only added to'); END;
"""
_OURS_ALONE = 0o700
_IDENTIFIER = re.compile(r"[0-9a-f]{16}")
_FOLDER = re.compile(r"\d{8}-\d{6}-[0-9a-f]{6}")


@dataclass(frozen=True)
class Entry:
    """Painting of the store.

    begun: local time, ISO 8601.
    """

    id: str
    folder: PaintingFolder
    title: str
    begun: str


class PaintingStore:
    """Paintings in folders below `root`. Raises StorageError if the folder is not writable."""

    def __init__(self, root: Path) -> None:
        self.root = root
        try:
            root.mkdir(mode=_OURS_ALONE, parents=True, exist_ok=True)
            self.pictures.mkdir(exist_ok=True)
            self.pictures.chmod(_OURS_ALONE)
            with closing(sqlite3.connect(self._file, timeout=5)) as base, base:
                base.executescript(_SCHEMA)
            self._file.chmod(0o600)
        except (OSError, sqlite3.Error) as error:
            raise StorageError(
                f"{root} cannot hold paintings ({error}); choose another folder with --folder."
            ) from error

    @property
    def pictures(self) -> Path:
        """Folder of the uploaded pictures."""
        return self.root / PICTURES

    @property
    def families(self) -> dict[str, Path]:
        """Files of the stroke families that were taught in this studio, by name."""
        return find_families(self.root / FAMILIES)

    def job(self, name: str) -> PaintingFolder:
        """Returns the folder of a job beside the paintings, made at the first use."""
        folder = PaintingFolder(self.root / name)
        folder.path.mkdir(mode=_OURS_ALONE, exist_ok=True)
        return folder

    def begin(self, title: str) -> Entry:
        """Returns a new painting with an empty folder."""
        identifier, now = secrets.token_hex(8), datetime.now()
        folder = self.root / f"{now:%Y%m%d-%H%M%S}-{identifier[:6]}"
        folder.mkdir(mode=_OURS_ALONE)
        begun = now.isoformat(timespec="seconds")
        with self._base() as base:
            base.execute("INSERT INTO painting VALUES (?, ?, ?, ?)", (identifier, folder.name, title, begun))
        return Entry(identifier, PaintingFolder(folder), title, begun)

    def all(self) -> list[Entry]:
        """Returns all paintings, the newest first, also those that were begun at the terminal."""
        with self._base() as base:
            rows = base.execute("SELECT id, folder, title, begun FROM painting ORDER BY begun DESC, rowid DESC")
            ours = [self._entry(*row) for row in rows.fetchall()]
        return sorted([*ours, *self._find_of_terminal()], key=lambda entry: entry.begun, reverse=True)

    def _find_of_terminal(self) -> Iterator[Entry]:
        for journal in self.root.glob(f"*/{JOURNAL}"):
            folder = journal.parent
            with contextlib.suppress(OSError):
                begun = datetime.fromtimestamp((folder / "goal").stat().st_ctime).isoformat(timespec="seconds")
                identifier = hashlib.sha256(folder.name.encode()).hexdigest()[:16]
                yield Entry(identifier, PaintingFolder(folder), folder.name, begun)

    def find(self, identifier: str) -> Entry | None:
        """Returns the painting of that id, or None."""
        if not _IDENTIFIER.fullmatch(identifier):
            return None
        with self._base() as base:
            row = base.execute("SELECT id, folder, title, begun FROM painting WHERE id = ?", (identifier,)).fetchone()
        if row is not None:
            return self._entry(*row)
        return next((entry for entry in self._find_of_terminal() if entry.id == identifier), None)

    def rename(self, identifier: str, title: str) -> None:
        """Gives a painting another title."""
        with self._base() as base:
            base.execute("UPDATE painting SET title = ? WHERE id = ?", (title, identifier))

    def delete(self, entry: Entry) -> None:
        """Deletes a painting with all its files. Raises StorageError."""
        try:
            if entry.folder.path.parent != self.root or not _FOLDER.fullmatch(entry.folder.path.name):
                raise OSError(errno.EPERM, "its folder is none that the studio made")
            if entry.folder.path.exists():  # else somebody has deleted it by hand
                shutil.rmtree(entry.folder.path)
            forget_lock(entry.folder)
        except OSError as error:
            raise StorageError(f"The painting cannot be deleted ({error.strerror}).") from error
        with self._base() as base:
            base.execute("DELETE FROM painting WHERE id = ?", (entry.id,))

    def note(self, by: str, painting: str, what: str) -> None:
        """Adds a record of an action: its time, person and painting; records cannot be changed."""
        with self._base() as base:
            at = datetime.now().astimezone().isoformat(timespec="milliseconds")
            base.execute("INSERT INTO deed VALUES (?, ?, ?, ?)", (at, by, painting, what))

    def _entry(self, identifier: str, folder: str, title: str, begun: str) -> Entry:
        return Entry(identifier, PaintingFolder(self.root / folder), title, begun)

    @property
    def _file(self) -> Path:
        return self.root / "studio.sqlite"

    @contextmanager
    def _base(self) -> Iterator[sqlite3.Connection]:
        """Opens the database for one transaction. Raises StorageError if it is locked, damaged or full."""
        try:
            with closing(sqlite3.connect(self._file, timeout=5)) as base, base:
                yield base
        except sqlite3.Error as error:
            raise StorageError(f"The studio's list of paintings cannot be used ({error}); try again.") from error


# Uploaded pictures: decoded, checked and written again, so that nothing of the original file is kept.
#
# Each picture is decoded in its own process with limits of memory and time, so that a bad file harms nothing else.

_MAX_WAITING = 8
_TOO_MUCH = "The file needs more memory or time than a picture is given here; make it smaller first."


class Uploads:
    """Stores uploaded pictures in a folder, one after another."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._turn = asyncio.Lock()
        self._waiting = 0

    async def keep(self, content: bytes) -> str:
        """Stores a picture as PNG under a new id, and returns the id.

        Raises ImageError, without paths in its words, for a wrong or too large picture. Raises StorageError, and
        Interrupted if too many pictures wait.
        """
        if self._waiting >= _MAX_WAITING:
            raise Interrupted("Many pictures are being taken in at the moment; give this one again in a while.")
        self._waiting += 1
        try:
            async with self._turn:
                return await asyncio.to_thread(keep, content, self._folder)
        finally:
            self._waiting -= 1


def keep(content: bytes, folder: Path) -> str:
    """Stores one picture like `Uploads.keep`, without a queue."""
    if not content:
        raise ImageError("The file is empty; choose another picture.")
    identifier = secrets.token_hex(16)
    folder.mkdir(parents=True, exist_ok=True)
    require_disk(folder, 2**26)
    with storage.replacing(folder / f"{identifier}.png", mode=0o600) as temporary:
        try:
            temporary.write_bytes(decode_upload(content))
        except ProcessLost as lost:
            with contextlib.suppress(OSError):
                print(lost, file=sys.stderr)
            raise ImageError(_TOO_MUCH) from lost
    return identifier
