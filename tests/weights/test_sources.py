import contextlib
import socket
import threading
import time

import pytest

from frida_painter import transfer
from frida_painter.errors import WeightsError
from frida_painter.weights import sources
from frida_painter.weights.sources import DownloadSite, Hub, download
from tiny_weights import original, serving

CONTENT = bytes(range(256)) * 4000


@pytest.fixture
def server():
    with serving({"net.bin": CONTENT}) as server:
        yield server


def test_a_file_comes_whole_and_the_count_goes_up_to_its_size(server, tmp_path):
    counts = []
    download(f"{server.address}/net.bin", tmp_path / "part", len(CONTENT), counts.append)
    assert (tmp_path / "part").read_bytes() == CONTENT
    assert counts == sorted(counts) and counts[-1] == len(CONTENT) and len(counts) > 2


def test_a_broken_download_goes_on_where_it_broke(server, tmp_path):
    server.breaks = 300_000
    with pytest.raises(WeightsError, match="the connection broke after 300000 of 1024000 bytes"):
        download(f"{server.address}/net.bin", tmp_path / "part", len(CONTENT), print)
    download(f"{server.address}/net.bin", tmp_path / "part", len(CONTENT), print)
    assert server.asked == [None, "bytes=300000-"]
    assert (tmp_path / "part").read_bytes() == CONTENT
    download(f"{server.address}/net.bin", tmp_path / "part", len(CONTENT), print)
    assert len(server.asked) == 2, "what is whole is not asked for"


def test_a_server_that_sends_no_parts_sends_all(server, tmp_path):
    server.ranges = False
    (tmp_path / "part").write_bytes(b"the beginning of something else")
    download(f"{server.address}/net.bin", tmp_path / "part", len(CONTENT), print)
    assert (tmp_path / "part").read_bytes() == CONTENT


def test_no_more_is_written_than_the_file_is_known_to_have(server, tmp_path):
    with pytest.raises(WeightsError, match="sends more than the 1000 bytes"):
        download(f"{server.address}/net.bin", tmp_path / "part", 1000, print)
    assert not (tmp_path / "part").exists() or (tmp_path / "part").stat().st_size <= 1000


def test_a_part_that_the_server_cannot_continue_is_given_up(server, tmp_path):
    (tmp_path / "part").write_bytes(CONTENT)
    with pytest.raises(WeightsError, match="it answers 416"):
        download(f"{server.address}/net.bin", tmp_path / "part", len(CONTENT) + 5, print)
    assert not (tmp_path / "part").exists()


def test_a_file_that_is_not_there_is_told(server, tmp_path):
    with pytest.raises(WeightsError, match="it answers 404 Not Found"):
        download(f"{server.address}/other.bin", tmp_path / "part", 5, print)


def test_a_silent_server_is_not_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "_PATIENCE", 0.2)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        with pytest.raises(WeightsError, match=r"it cannot be reached .*timed out"):
            download(f"http://127.0.0.1:{silent.getsockname()[1]}/net.bin", tmp_path / "part", 5, print)


def test_the_hub_gives_the_files_of_one_revision(tmp_path, monkeypatch):
    monkeypatch.delenv("HF_HUB_OFFLINE", raising=False)
    files = {"someone/net/resolve/abc/config.json": b"{}", "someone/net/resolve/abc/deep/vocab.txt": b"words"}
    wanted = [original("config.json", b"{}"), original("deep/vocab.txt", b"words")]
    with serving(files) as server:
        monkeypatch.setenv("HF_ENDPOINT", f"{server.address}/")
        hub, counts = Hub("someone/net", "abc"), []
        assert hub.words == f"{server.address} (someone/net)" and hub.transfer(wanted) == 7
        hub.bring(wanted, tmp_path, counts.append)
    assert [file.in_folder(tmp_path).read_bytes() for file in wanted] == [b"{}", b"words"]
    assert counts == [2, 7]


def test_the_hub_is_not_asked_where_transformers_would_not(tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    with pytest.raises(WeightsError, match="HF_HUB_OFFLINE is set"):
        Hub("someone/net", "abc").bring([original("config.json", b"{}")], tmp_path, print)


def test_a_site_counts_over_all_its_files(server, tmp_path):
    server.files["more.bin"] = b"12345"
    wanted, counts = [original("net.bin", CONTENT), original("more.bin", b"12345")], []
    site = DownloadSite(server.address)
    site.bring(wanted, tmp_path, counts.append)
    assert counts[-1] == site.transfer(wanted) == len(CONTENT) + 5


def test_a_site_that_drips_or_never_answers_is_left_and_the_rest_is_asked_for_next_time(tmp_path, monkeypatch):
    """One byte now and then comes before every timeout of a socket."""
    listener = socket.create_server(("127.0.0.1", 0))
    head = b"HTTP/1.1 200 OK\r\nContent-Length: 1000\r\n\r\n"

    def drip(first):
        caller, _ = listener.accept()
        with caller, contextlib.suppress(OSError):
            caller.recv(4096)
            caller.sendall(first)
            while True:
                caller.sendall(b"x")
                time.sleep(0.02)

    address = f"http://127.0.0.1:{listener.getsockname()[1]}/net.bin"
    monkeypatch.setattr(transfer, "_WINDOW", 0.2)
    with listener:
        for first, says in ((head, "less than 2 kB a second came"), (head[:20], "it does not answer within 0 s")):
            dripping = threading.Thread(target=drip, args=(first,), daemon=True)
            dripping.start()
            with pytest.raises(WeightsError, match=says):
                download(address, tmp_path / "part", 1000, lambda done: None)
            monkeypatch.setattr(sources, "_FIRST_ANSWER", 0.2)
    assert 0 < (tmp_path / "part").stat().st_size < 1000
