"""The table of a sweep: readable at any moment, whatever the runs were."""

from pathlib import Path
from typing import Any

import pytest

from frida_painter.lab.sweeps.report import TableWriter, flat, write_table

parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed; say: pip install '.[table]'")


def record(seed: int, **more: Any) -> dict[str, Any]:
    return {
        "key": f"k{seed}",
        "kind": "plan",
        "labels": {"seed": seed},
        "settings": {"seed": seed, "strokes": 5, "palette": None, "goal": [["Photograph", "cat.jpg"]]},
        "figures": {"plan dB": 20.5 + seed},
        "times": {"wall_seconds": 2.0, "ended": "2026-11-22"},
        "versions": {"torch": "2"},
        "host": "here",
        **more,
    }


def test_a_row_holds_settings_figures_times_and_versions(tmp_path: Path) -> None:
    failure = {"key": "k2", "kind": "plan", "labels": {"seed": 2}, "error": "It exploded.", "host": "here"}
    write_table(tmp_path / "t.parquet", [flat(record(0)), flat(record(1)), flat(failure)])
    table = parquet.read_table(tmp_path / "t.parquet")
    assert table["seed"].to_pylist() == [0, 1, 2] and table["plan dB"].to_pylist() == [20.5, 21.5, None]
    assert table["status"].to_pylist() == ["done", "done", "failed"] and table["error"].to_pylist()[2] == "It exploded."
    assert table["set strokes"].to_pylist() == [5, 5, None] and "set seed" not in table.column_names
    assert table["goal"].to_pylist()[0] == "Photograph: cat.jpg" and table["version torch"].to_pylist()[0] == "2"
    assert str(table.schema.field("seed").type) == "int64" and str(table.schema.field("plan dB").type) == "double"


def test_columns_that_mix_kinds_are_kept(tmp_path: Path) -> None:
    write_table(tmp_path / "t.parquet", [{"a": 1, "b": 1, "c": None}, {"a": 0.5, "b": "every:75", "c": None}])
    table = parquet.read_table(tmp_path / "t.parquet")
    assert table["a"].to_pylist() == [1.0, 0.5] and table["b"].to_pylist() == ["1", "every:75"]
    write_table(tmp_path / "t.parquet", [])
    assert parquet.read_table(tmp_path / "t.parquet").num_rows == 0


def test_without_pyarrow_there_is_no_table_and_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    TableWriter(tmp_path).write([record(0)])
    assert (tmp_path / "table.parquet").exists() and TableWriter(tmp_path).remarks == ()
    (tmp_path / "table.parquet").unlink()
    monkeypatch.setattr("frida_painter.registry.is_installed", lambda package: False)
    writer = TableWriter(tmp_path)
    writer.write([record(0)])
    assert list(tmp_path.iterdir()) == [] and 'the extra "table"' in writer.remarks[0]
