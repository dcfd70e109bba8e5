"""The store of a studio: which paintings and pictures there are, in SQLite; all else is in their folders."""

import re
import secrets
import shutil
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from frida_painter.errors import StorageError
from frida_painter.web.folder import PaintingFolder

_SCHEMA = """
CREATE TABLE IF NOT EXISTS painting (
    id TEXT PRIMARY KEY, folder TEXT NOT NULL UNIQUE, title TEXT NOT NULL, begun TEXT NOT NULL
) STRICT;
CREATE TABLE IF NOT EXISTS deed (at TEXT NOT NULL, by TEXT NOT NULL, painting TEXT NOT NULL, what TEXT NOT NULL) STRICT;
CREATE TRIGGER IF NOT EXISTS deeds_stay_so BEFORE UPDATE ON deed BEGIN SELECT RAISE(ABORT, 'only added to'); END;
CREATE TRIGGER IF NOT EXISTS deeds_stay BEFORE DELETE ON deed BEGIN SELECT RAISE(ABORT, 'only added to'); END;
"""
_IDENTIFIER = re.compile(r"[0-9a-f]{16}")


@dataclass(frozen=True)
class Entry:
    """A painting of the store; begun: local time, ISO 8601."""

    id: str
    folder: PaintingFolder
    title: str
    begun: str


class PaintingStore:
    """Keeps paintings below `root`. Raises StorageError where that cannot be written to."""

    def __init__(self, root: Path) -> None:
        self.root = root
        try:
            root.mkdir(parents=True, exist_ok=True)
            self.pictures.mkdir(exist_ok=True)
            with closing(self._open()) as base, base:
                base.executescript(_SCHEMA)
        except (OSError, sqlite3.Error) as error:
            raise StorageError(
                f"{root} cannot hold paintings ({error}); choose another folder with --folder."
            ) from error

    @property
    def pictures(self) -> Path:
        """The folder of the pictures that people gave."""
        return self.root / "pictures"

    @property
    def calibration(self) -> PaintingFolder:
        """The folder in which the easel is calibrated; made as soon as it is needed."""
        folder = PaintingFolder(self.root / "calibration")
        folder.live.mkdir(parents=True, exist_ok=True)
        return folder

    def begin(self, title: str) -> Entry:
        """A new painting with an empty folder."""
        identifier, now = secrets.token_hex(8), datetime.now()
        folder = self.root / f"{now:%Y%m%d-%H%M%S}-{identifier[:6]}"
        folder.mkdir()
        begun = now.isoformat(timespec="seconds")
        with closing(self._open()) as base, base:
            base.execute("INSERT INTO painting VALUES (?, ?, ?, ?)", (identifier, folder.name, title, begun))
        return Entry(identifier, PaintingFolder(folder), title, begun)

    def all(self) -> list[Entry]:
        """All paintings, the newest first."""
        with closing(self._open()) as base:
            rows = base.execute("SELECT id, folder, title, begun FROM painting ORDER BY begun DESC, rowid DESC")
            return [self._entry(*row) for row in rows.fetchall()]

    def find(self, identifier: str) -> Entry | None:
        """The painting of that id, None where there is none."""
        if not _IDENTIFIER.fullmatch(identifier):
            return None
        with closing(self._open()) as base:
            row = base.execute("SELECT id, folder, title, begun FROM painting WHERE id = ?", (identifier,)).fetchone()
        return None if row is None else self._entry(*row)

    def rename(self, identifier: str, title: str) -> None:
        """Gives a painting another title."""
        with closing(self._open()) as base, base:
            base.execute("UPDATE painting SET title = ? WHERE id = ?", (title, identifier))

    def delete(self, entry: Entry) -> None:
        """Removes a painting with all its files, for good. Raises StorageError."""
        try:
            shutil.rmtree(entry.folder.path)
        except OSError as error:
            raise StorageError(f"The painting cannot be deleted ({error.strerror}).") from error
        with closing(self._open()) as base, base:
            base.execute("DELETE FROM painting WHERE id = ?", (entry.id,))

    def note(self, by: str, painting: str, what: str) -> None:
        """Puts down who asked for what, and when; these lines are only ever added."""
        with closing(self._open()) as base, base:
            at = datetime.now().astimezone().isoformat(timespec="milliseconds")
            base.execute("INSERT INTO deed VALUES (?, ?, ?, ?)", (at, by, painting, what))

    def _entry(self, identifier: str, folder: str, title: str, begun: str) -> Entry:
        return Entry(identifier, PaintingFolder(self.root / folder), title, begun)

    def _open(self) -> sqlite3.Connection:
        return sqlite3.connect(self.root / "studio.sqlite", timeout=5)
