"""What an experiment gives: tables of plain values, sentences that say what they show, and pictures."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from torch import Tensor

from frida_painter import images, storage

Value = str | int | float | bool | None
Row = Mapping[str, Value]
Task = TypeVar("Task")


@dataclass(frozen=True)
class Progress:
    """How far an experiment has come: `share` in [0, 1] of its work, and what it is `doing`."""

    share: float
    doing: str


Notify = Callable[[Progress], None]


def silent(progress: Progress) -> None:
    """Hears progress and tells nobody."""


def within(notify: Notify, first: float, last: float) -> Notify:
    """Tells the progress of a part that takes an experiment from share `first` to share `last`."""
    return lambda progress: notify(Progress(first + (last - first) * progress.share, progress.doing))


def each(tasks: Sequence[Task], notify: Notify) -> Iterator[tuple[Task, Notify]]:
    """The tasks, which take equally long, each with whom to tell its own progress."""
    for number, task in enumerate(tasks):
        yield task, within(notify, number / len(tasks), (number + 1) / len(tasks))


@dataclass(frozen=True)
class ResultTable:
    """Rows with the same columns. `title` stands above it, `columns` are those of the first row."""

    title: str
    rows: tuple[Row, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(self.rows[0]) if self.rows else ()

    def markdown(self) -> str:
        """The table in Markdown, numbers to the right and to four significant digits."""
        numeric = {name: all(_is_number(row[name]) for row in self.rows) for name in self.columns}
        lines = [
            _line(self.columns),
            _line(["---:" if numeric[name] else "---" for name in self.columns]),
            *(_line([_shown(row[name]) for name in self.columns]) for row in self.rows),
        ]
        return f"**{self.title}**\n\n" + "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Outcome:
    """What came out.

    name: of the command; title: one line for people; settings: all that it was run with, seeds
    included; notes: sentences that say what the tables show; pictures: sRGB [3, H, W] in [0, 1] by
    name of the file to be, without its ending.
    """

    name: str
    title: str
    settings: Mapping[str, Value | Sequence[Value]]
    tables: tuple[ResultTable, ...]
    notes: tuple[str, ...] = ()
    pictures: Mapping[str, Tensor] = field(default_factory=dict)

    def markdown(self) -> str:
        """The outcome as a page."""
        parts = [f"# {self.title}\n", *(f"{note}\n" for note in self.notes)]
        parts += [f"![{name.replace('-', ' ')}]({name}.png)\n" for name in self.pictures]
        parts += [table.markdown() for table in self.tables]
        parts.append("Settings: " + "; ".join(f"{name} {_listed(value)}" for name, value in self.settings.items()))
        return "\n".join(parts) + "\n"

    def record(self) -> dict[str, object]:
        """The outcome as plain values; numbers that are not finite become null."""
        return {
            "format": "frida-painter experiment",
            "experiment": self.name,
            "title": self.title,
            "settings": {name: value if _plain(value) else list(value) for name, value in self.settings.items()},  # type: ignore[arg-type]
            "notes": list(self.notes),
            "tables": [
                {"title": table.title, "rows": [{name: _finite(row[name]) for name in row} for row in table.rows]}
                for table in self.tables
            ],
            "pictures": [f"{name}.png" for name in self.pictures],
        }

    def save(self, folder: Path) -> None:
        """Writes table.json, table.md and the pictures into `folder`. Raises StorageError."""
        for name, picture in self.pictures.items():
            images.save(picture, folder / f"{name}.png")
        storage.write_text(folder / "table.md", self.markdown())
        storage.write_json(folder / "table.json", self.record())


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _is_number(value: Value) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def _shown(value: Value) -> str:
    """A value as people read it."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value).replace("|", r"\|")


def _listed(value: Value | Sequence[Value]) -> str:
    return _shown(value) if _plain(value) else ", ".join(_shown(part) for part in value)  # type: ignore[union-attr, arg-type]


def _plain(value: Value | Sequence[Value]) -> bool:
    return value is None or isinstance(value, str | int | float)


def _finite(value: Value) -> Value:
    return None if isinstance(value, float) and not math.isfinite(value) else value
