"""Folders of networks by any of their names; the hub is huggingface_hub's own cache, or a server that answers as it."""

import json
import shutil
import time
from collections.abc import Iterator, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest

from frida_painter.errors import Interrupted, WeightsError
from frida_painter.objectives.weights import hub_folder as module
from frida_painter.objectives.weights.hub_folder import hub_folder

COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of what the hub's own library has fetched; the hub itself is not asked."""
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    return tmp_path / "hub"


def keep(hub: Path, repository: str, *files: str) -> Path:
    """An earlier download, in the layout of the hub's library."""
    home = hub / f"models--{repository.replace('/', '--')}"
    folder = home / "snapshots" / COMMIT
    folder.mkdir(parents=True)
    (home / "refs").mkdir()
    (home / "refs" / "main").write_text(COMMIT)
    for file in files:
        (folder / file).write_text("{}")
    return folder


@pytest.mark.parametrize(
    "name",
    [
        "clip-vit-b-32",
        "openai/clip-vit-base-patch32",
        "OpenAI/CLIP-ViT-base-patch32",
        "clip-vit-base-patch32",
        "ViT-B/32",
        "ViT-B-32",
        "https://huggingface.co/openai/clip-vit-base-patch32",
        "hf-hub:openai/clip-vit-base-patch32/",
    ],
)
def test_a_fetched_network_is_found_by_each_of_its_names(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "find", lambda known, cache: cache / known if known == "clip-vit-b-32" else None)
    assert hub_folder(name, tmp_path) == tmp_path / "clip-vit-b-32"


@pytest.mark.parametrize(
    ("name", "repository"),
    [
        ("laion/CLIP-ViT-B-32-laion2B-s34B-b79K", "laion/CLIP-ViT-B-32-laion2B-s34B-b79K"),
        ("ViT-L/14", "openai/clip-vit-large-patch14"),
        ("ViT-L/14@336px", "openai/clip-vit-large-patch14-336"),
        ("clip-vit-b-32", "openai/clip-vit-base-patch32"),
        ("models--openai--clip-vit-base-patch32", "openai/clip-vit-base-patch32"),
        ("https://huggingface.co/openai/clip-vit-base-patch32/tree/main", "openai/clip-vit-base-patch32"),
    ],
)
@pytest.mark.parametrize("weights", ["model.safetensors", "pytorch_model.bin"])
def test_an_earlier_download_of_others_is_used(
    hub: Path, tmp_path: Path, name: str, repository: str, weights: str
) -> None:
    folder = keep(hub, repository, "config.json", "tokenizer.json", weights)
    assert hub_folder(name, tmp_path / "none") == folder


def test_a_copied_folder_of_the_cache_needs_no_note_of_the_newest(hub: Path, tmp_path: Path) -> None:
    folder = keep(hub, "some/clip", "config.json", "tokenizer.json", "model.safetensors")
    shutil.rmtree(hub / "models--some--clip" / "refs")
    assert hub_folder("some/clip", tmp_path) == folder


@pytest.mark.parametrize(
    ("files", "missing"),
    [
        (("config.json", "tokenizer.json"), "model.safetensors"),
        (("config.json", "model.safetensors"), "tokenizer.json"),
        (("tokenizer.json", "model.safetensors"), "config.json"),
        (("config.json", "tokenizer.json", "model.safetensors.index.json", "part-1.safetensors"), "part-2.safetensors"),
    ],
)
def test_half_a_download_is_not_used(hub: Path, tmp_path: Path, files: tuple[str, ...], missing: str) -> None:
    folder = keep(hub, "some/clip", *files)
    if (index := folder / "model.safetensors.index.json").exists():
        index.write_text(json.dumps({"weight_map": {"a": "part-1.safetensors", "b": "part-2.safetensors"}}))
    assert module.missing_file(folder) == missing
    with pytest.raises(WeightsError, match="HF_HUB_OFFLINE is set"):
        hub_folder("some/clip", tmp_path)


@pytest.mark.parametrize("name", ["", "no such", "/no/such/folder", "../up", "a/b/c"])
def test_what_is_no_name_is_said(name: str, tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="there is no such folder, and a name on the hub is like"):
        hub_folder(name, tmp_path)


FILES = {
    "config.json": b"{}",
    "tokenizer.json": b"{}",
    "model.safetensors": b"S" * 100,
    "pytorch_model.bin": b"P" * 100,
    "open_clip_model.safetensors": b"T" * 100,
    "own.py": b"raise SystemExit",
    "onnx/model.onnx": b"O",
}


class Answers(BaseHTTPRequestHandler):
    """What the hub answers to its own library, for one repository."""

    asked: list[str]
    files: Mapping[str, bytes] = FILES
    drips: str = ""  # file that comes a byte at a time

    def log_message(self, *_: object) -> None:
        pass

    def _answer(self, *, with_content: bool) -> None:
        path = self.path.split("?")[0]
        name = path.rpartition(f"/resolve/{COMMIT}/")[2] if COMMIT in path else path.rpartition("/resolve/main/")[2]
        if "/tree/" in path:
            content = json.dumps(
                [{"type": "file", "path": file, "size": len(some), "oid": file} for file, some in self.files.items()]
            ).encode()
        elif path.startswith("/api/models/some/clip"):
            content = json.dumps(
                {
                    "id": "some/clip",
                    "sha": COMMIT,
                    "siblings": [{"rfilename": file, "size": len(some)} for file, some in self.files.items()],
                }
            ).encode()
        elif path.startswith("/some/clip/") and name in self.files:
            content = self.files[name]
            if with_content:
                self.asked.append(name)
        else:
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("ETag", f'"{name.replace("/", "-")}"')
        self.send_header("X-Repo-Commit", COMMIT)
        self.end_headers()
        for byte in content if with_content and name == self.drips else ():
            self.wfile.write(bytes([byte]))
            time.sleep(0.1)
        if with_content and name != self.drips:
            self.wfile.write(content)

    def do_GET(self) -> None:
        self._answer(with_content=True)

    def do_HEAD(self) -> None:
        self._answer(with_content=False)


@pytest.fixture
def drips() -> str:
    return ""


@pytest.fixture
def files() -> Mapping[str, bytes]:
    return FILES


@pytest.fixture
def online(hub: Path, monkeypatch: pytest.MonkeyPatch, drips: str, files: Mapping[str, bytes]) -> Iterator[list[str]]:
    monkeypatch.delenv("HF_HUB_OFFLINE")
    asked: list[str] = []
    handler = type("Hub", (Answers,), {"asked": asked, "drips": drips, "files": files})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{server.server_address[1]}")
    Thread(target=server.serve_forever, daemon=True).start()
    yield asked
    server.shutdown()
    server.server_close()


def test_settings_and_tensors_are_fetched_and_nothing_else(online: list[str], hub: Path, tmp_path: Path) -> None:
    """The hub's own library fetches; code and copies in other formats stay where they are."""
    folder = hub_folder("some/clip", tmp_path)
    assert sorted(online) == ["config.json", "model.safetensors", "tokenizer.json"]
    assert (folder / "model.safetensors").read_bytes() == FILES["model.safetensors"]
    online.clear()
    assert hub_folder("some/clip", tmp_path) == folder and online == []
    shutil.rmtree(hub)


@pytest.mark.parametrize("files", [{**FILES, "--revision=other.json": b"{}", "-h.json": b"{}"}])
def test_a_name_that_looks_like_an_option_is_no_option(online: list[str], tmp_path: Path) -> None:
    hub_folder("some/clip", tmp_path)
    assert sorted(online) == ["config.json", "model.safetensors", "tokenizer.json"]


OPEN_CLIP = {
    "open_clip_config.json": b"{}",
    "tokenizer.json": b"{}",
    "open_clip_model.safetensors": b"S" * 100,
    "open_clip_pytorch_model.bin": b"P" * 100,
    "own.py": b"raise SystemExit",
}


@pytest.mark.parametrize(
    ("files", "fetched"),
    [
        (OPEN_CLIP, ["open_clip_config.json", "open_clip_model.safetensors", "tokenizer.json"]),
        (
            {name: some for name, some in OPEN_CLIP.items() if "safetensors" not in name} | {"config.json": b"{}"},
            ["config.json", "open_clip_config.json", "open_clip_pytorch_model.bin", "tokenizer.json"],
        ),
    ],
    ids=["alone", "beside settings without weights"],
)
def test_a_repository_in_the_layout_of_open_clip_is_fetched(
    online: list[str], tmp_path: Path, fetched: list[str]
) -> None:
    folder = hub_folder("some/clip", tmp_path)
    assert sorted(online) == fetched and module.is_of_open_clip(folder) and module.missing_file(folder) is None
    online.clear()
    assert hub_folder("some/clip", tmp_path) == folder and online == []


@pytest.mark.parametrize("files", [{name: some for name, some in OPEN_CLIP.items() if name != "tokenizer.json"}])
def test_a_repository_that_lacks_a_file_is_refused_before_anything_comes(online: list[str], tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match=r"^it has no tokenizer\.json$"):
        hub_folder("some/clip", tmp_path)
    assert not online


@pytest.mark.parametrize("drips", ["model.safetensors"])
def test_a_download_ends_at_a_stop(online: list[str], tmp_path: Path) -> None:
    """The process that fetches is ended too, so that nothing more comes."""
    told: list[str] = []

    def heed() -> None:
        if "model.safetensors" in online:
            raise Interrupted("You stopped.")

    with pytest.raises(Interrupted, match=r"^You stopped\.$"):
        hub_folder("some/clip", tmp_path, told.append, heed)
    assert told[0].startswith("Fetching some/clip from http://127.0.0.1") and told[0].endswith(" once, 0 MB.")
    assert not list((tmp_path / "hub").rglob("snapshots/*/model.safetensors"))


def test_a_name_that_the_hub_does_not_know(online: list[str], tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="404"):
        hub_folder("no/such", tmp_path)
