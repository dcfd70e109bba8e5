"""The table of a sweep, Parquet: a row for every run that has ended, for DuckDB, pandas, polars and whatever reads it.

It is written anew as results come in, whole or not at all, so that it can be read at any moment. Columns: what differs
between runs by its own name, "set NAME" for the other settings, figures, times, versions.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from frida_painter import extras, storage
from frida_painter.sweeps.folder import TABLE

if TYPE_CHECKING:
    import pyarrow


class TableWriter:
    """Writes the table of a sweep's folder; without pyarrow it writes none, and says so."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / TABLE
        self._installed = extras.is_installed("pyarrow")

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person should know of the table."""
        return () if self._installed else (extras.advice("table", "The table of results (Parquet)") + ".",)

    def write(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Writes a row for each record. Raises StorageError."""
        if self._installed:
            write_table(self._path, [flat(record) for record in records])


def flat(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record as one row of plain values."""
    times, labels = record.get("times", {}), record["labels"]
    settings = {f"set {name}": value for name, value in record.get("settings", {}).items() if name not in labels}
    goal = settings.pop("set goal", None)
    return {
        "key": record["key"],
        "kind": record["kind"],
        "status": "failed" if "error" in record else "done",
        **labels,
        **record.get("figures", {}),
        **times,
        **({} if goal is None else {"goal": "; ".join(": ".join(map(str, fact)) for fact in goal)}),
        **settings,
        **{f"version {name}": value for name, value in record.get("versions", {}).items()},
        "host": record.get("host"),
        "error": record.get("error"),
    }


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Writes rows as Parquet; a column that mixes numbers and words holds words. Raises StorageError."""
    import pyarrow
    from pyarrow import parquet

    names = dict.fromkeys(name for row in rows for name in row)
    table = pyarrow.table({name: _column([row.get(name) for row in rows]) for name in names})
    with storage.replacing(path) as temporary:
        parquet.write_table(table, temporary)


def _column(values: Sequence[Any]) -> "pyarrow.Array[Any]":
    import pyarrow

    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} and len(kinds) == 2:
        return pyarrow.array(values, pyarrow.float64())
    if len(kinds) <= 1 and kinds <= {int, float, bool, str}:
        return pyarrow.array(values)
    return pyarrow.array([None if value is None else str(value) for value in values], pyarrow.string())
