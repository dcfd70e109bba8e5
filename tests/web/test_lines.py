from pathlib import Path

import pytest

from frida_painter.errors import StorageError
from frida_painter.web.lines import LineReader, LineWriter


def test_whoever_reads_hears_each_line_once(tmp_path: Path) -> None:
    reader = LineReader(tmp_path / "lines")
    assert reader.read() == []
    writer = LineWriter(tmp_path / "lines")
    writer.add({"a": 1})
    assert reader.read() == [{"a": 1}] and reader.read() == []
    writer.add({"b": "ü\n"})
    assert LineReader(tmp_path / "lines").read() == [{"a": 1}, {"b": "ü\n"}]
    assert reader.read() == [{"b": "ü\n"}]
    writer.close()


def test_half_a_line_is_waited_for_and_what_a_killed_process_left_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    reader = LineReader(path)
    path.write_bytes(b'{"a": 1}\n{"b"')
    assert reader.read() == [{"a": 1}] and reader.read() == []
    writer = LineWriter(path)
    writer.add({"c": 3})
    assert reader.read() == [{"c": 3}]
    writer.close()


@pytest.mark.parametrize("damaged", [b"nonsense", b"[1]", b'"text"', b"\xff\xfe", b"{" * 100_000, b""])
def test_damaged_lines_are_left_out(tmp_path: Path, damaged: bytes) -> None:
    (tmp_path / "lines").write_bytes(damaged + b'\n{"a": 1}\n')
    assert LineReader(tmp_path / "lines").read() == [{"a": 1}]


def test_a_folder_that_is_gone_is_told(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="make room"):
        LineWriter(tmp_path / "nowhere" / "lines")
