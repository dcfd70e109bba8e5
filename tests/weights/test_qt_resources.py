import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.weights.archive import files_in
from qt import Tree, resource

FILES: Tree = {"animals": {"ibex.webp": b"i" * 900, "farm": {"cow.svg": b"<svg/>"}}, "notes": b""}


@pytest.mark.parametrize("version", [1, 2, 3])
@pytest.mark.parametrize("flags", [0, 1])
def test_files_come_out_by_their_paths(version: int, flags: int) -> None:
    found = dict(files_in(resource(FILES, version, flags)))
    assert found == {"animals/ibex.webp": b"i" * 900, "animals/farm/cow.svg": b"<svg/>", "notes": b""}


def test_what_is_packed_in_another_way_or_too_large_is_left_out() -> None:
    assert list(files_in(resource(FILES, flags=4))) == []
    assert list(files_in(resource({"bomb": bytes(20 * 2**20), "small": b"s"}))) == [("small", b"s")]


def test_what_is_damaged_is_refused() -> None:
    whole = resource(FILES)
    for damaged in (b"", b"qres", b"PK" + whole[2:], whole[:-9], whole[: len(whole) // 2]):
        with pytest.raises(ValueError, match="Qt resource"):
            list(files_in(damaged))
    endless = bytearray(whole)
    endless[20 + 6 : 20 + 14] = struct.pack(">II", 1, 0)  # the first folder is in itself
    with pytest.raises(ValueError, match="never end"):
        list(files_in(bytes(endless)))


@given(st.binary(max_size=80), st.integers(0, 200))
def test_any_bytes_are_read_or_refused(noise: bytes, at: int) -> None:
    spoiled = bytearray(resource(FILES))
    spoiled[4 + at : 4 + at + len(noise)] = noise
    try:
        list(files_in(bytes(spoiled)))
    except ValueError as error:
        assert "Qt resource" in str(error)
