import pytest
import torch

from frida_painter.brush import table_cache
from frida_painter.brush.table import StrokeTable, TableDetail
from frida_painter.brush.table_cache import cached_table
from marks import ribbon, shapes

DETAIL = TableDetail(spans=(2, 3, 3), rank=12)


def same(one, other):
    return all(torch.equal(part, other.get_buffer(name)) for name, part in one.named_buffers())


def test_a_table_is_made_once_and_read_again_to_the_bit(tmp_path, monkeypatch):
    made = cached_table(ribbon(), DETAIL, tmp_path)
    assert same(made, StrokeTable.of(ribbon(), detail=DETAIL))
    monkeypatch.setattr(StrokeTable, "of", None)
    again = cached_table(ribbon(), DETAIL, tmp_path)
    assert same(again, made) and torch.equal(again(*shapes(5)), made(*shapes(5)))
    assert (again.brush, again.frame, again.limits, again.detail) == (made.brush, made.frame, made.limits, DETAIL)


def test_another_model_or_detail_has_another_table(tmp_path):
    cached_table(ribbon(), DETAIL, tmp_path)
    wider = ribbon()
    with torch.no_grad():
        next(wider.parameters()).add_(0.01)
    cached_table(wider, DETAIL, tmp_path)
    cached_table(ribbon(12, 20), DETAIL, tmp_path)
    cached_table(ribbon(), TableDetail(spans=(2, 3, 4), rank=12), tmp_path)
    assert len(list(tmp_path.iterdir())) == 4


@pytest.mark.parametrize("content", [b"", b"nonsense", "cut", "another's"])
def test_a_damaged_one_is_made_anew(tmp_path, content):
    made = cached_table(ribbon(), DETAIL, tmp_path)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    if content == "cut":
        content = whole[: len(whole) // 2]
    elif content == "another's":
        cached_table(ribbon(12, 20), DETAIL, tmp_path)
        content = next(one for one in tmp_path.iterdir() if one != path).read_bytes()
    path.write_bytes(content)
    assert same(cached_table(ribbon(), DETAIL, tmp_path), made)
    assert path.read_bytes() == whole


def test_without_a_folder_to_write_to_it_is_made_every_time(tmp_path):
    (tmp_path / "file").touch()
    assert same(cached_table(ribbon(), DETAIL, tmp_path / "file"), StrokeTable.of(ribbon(), detail=DETAIL))


def test_only_so_many_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(table_cache, "_MOST_KEPT", 2)
    for columns in (14, 16, 18):
        cached_table(ribbon(8, columns), TableDetail(spans=(1, 1, 1), rank=2), tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
