"""CLIP of the ViT kind, of random weights made on the spot, through `transformers` as a real one would be."""

import json
import pickle
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from frida_painter.errors import WeightsError
from frida_painter.objectives.encoders.clip import CLIP_MEAN, CLIP_SPREAD, Clip
from frida_painter.system import images
from tiny_clip import MAX_TOKENS, PATCH, SIDE, write_clip, write_siglip
from tiny_weights import Trap, serving


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clip(tmp_path_factory.mktemp("clip"))


@pytest.fixture(scope="module")
def clip(folder: Path) -> Clip:
    return Clip.load(folder)


def test_words_and_pictures_have_places_in_one_space(clip: Clip) -> None:
    words = clip.embed_text("cat")
    pictures = clip.embed_pictures(torch.rand(3, 3, 40, 50))
    assert words.shape == (8,) and pictures.shape == (3, 8)
    assert float(words.norm()) == pytest.approx(1)
    torch.testing.assert_close(pictures.norm(dim=1), torch.ones(3))
    assert torch.equal(words, clip.embed_text("cat")) and not torch.equal(words, clip.embed_text("dog"))


def test_the_network_is_asked_as_transformers_asks_it(clip: Clip, folder: Path) -> None:
    from transformers import CLIPModel

    model = CLIPModel.from_pretrained(folder).eval()
    picture = torch.rand(1, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(0))
    normal = (picture - torch.tensor(CLIP_MEAN)[:, None, None]) / torch.tensor(CLIP_SPREAD)[:, None, None]
    with torch.no_grad():
        wanted = model.get_image_features(normal).pooler_output
        last = model.vision_model(normal).last_hidden_state
        torch.testing.assert_close(clip.embed_pictures(picture), wanted / wanted.norm())
        (seen,) = clip.features(picture)
    cells = SIDE // PATCH
    assert seen.shape == (1, 16, cells, cells)
    torch.testing.assert_close(seen[0, :, 1, 2], last[0, 1 + cells + 2])


@pytest.mark.parametrize("size", [(50, 70), (70, 50), (20, 90)])
def test_pictures_are_prepared_as_pillow_would(clip: Clip, size: tuple[int, int]) -> None:
    """Resized by the shorter side, bicubic, and the middle taken, as CLIP's own image processor does it."""
    rows, columns = size
    smooth = torch.nn.functional.interpolate(
        torch.rand(1, 3, 5, 6, generator=torch.Generator().manual_seed(0)), size, mode="bicubic"
    )[0].clamp(0, 1)
    short = min(size)
    wanted_size = (columns * SIDE // short, rows * SIDE // short)
    resized = Image.fromarray(images.to_uint8(smooth)).resize(wanted_size, Image.Resampling.BICUBIC)
    left, top = (wanted_size[0] - SIDE) // 2, (wanted_size[1] - SIDE) // 2
    middle = np.asarray(resized.crop((left, top, left + SIDE, top + SIDE)))
    wanted = (images.from_uint8(middle) - torch.tensor(CLIP_MEAN)[:, None, None]) / torch.tensor(CLIP_SPREAD)[
        :, None, None
    ]
    torch.testing.assert_close(clip._as_input(smooth[None])[0], wanted, atol=0.03, rtol=0)


def test_words_beyond_what_it_can_read_are_cut_and_it_is_known(clip: Clip) -> None:
    readable = MAX_TOKENS - 2
    assert clip.reads_all("a" * readable) and not clip.reads_all("a" * (readable + 1))
    assert torch.equal(clip.embed_text("a" * readable + "bcd"), clip.embed_text("a" * readable + "xyz"))


def test_the_statistics_of_the_folder_are_used(folder: Path, tmp_path: Path) -> None:
    other = write_clip(tmp_path / "other")
    settings = other / "preprocessor_config.json"
    settings.write_text(json.dumps({"image_mean": [0.5, 0.5, 0.5], "image_std": [0.5, 0.5, 0.5]}))
    seen = Clip.load(other)._as_input(torch.full((1, 3, SIDE, SIDE), 0.75))
    torch.testing.assert_close(seen, torch.full_like(seen, 0.5))
    settings.write_text(json.dumps({"image_mean": [0.5, 0.5, 0.5], "image_std": [0.5, 0.0, 0.5]}))
    with pytest.raises(WeightsError, match="three numbers each"):
        Clip.load(other)


@pytest.mark.parametrize("name", ["model.safetensors", "pytorch_model.bin"])
def test_a_pickle_is_never_opened(tmp_path: Path, name: str) -> None:
    hostile = write_clip(tmp_path / "hostile")
    (hostile / "model.safetensors").unlink()
    sprung = tmp_path / "sprung"
    (hostile / name).write_bytes(pickle.dumps(Trap(sprung)))
    with pytest.raises(WeightsError, match=r"cannot be loaded as CLIP .*; give a folder that holds config.json"):
        Clip.load(hostile)
    assert not sprung.exists()


def test_code_that_comes_with_weights_does_not_run(tmp_path: Path) -> None:
    hostile = write_clip(tmp_path / "hostile")
    sprung = tmp_path / "sprung"
    (hostile / "own.py").write_text(f"import pathlib\npathlib.Path({str(sprung)!r}).touch()\n")
    record = json.loads((hostile / "config.json").read_text())
    record |= {"model_type": "own", "auto_map": {"AutoConfig": "own.Config", "AutoModel": "own.Model"}}
    (hostile / "config.json").write_text(json.dumps(record))
    with pytest.raises(WeightsError):
        Clip.load(hostile)
    assert not sprung.exists()


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda folder: (folder / "config.json").unlink(), r"cannot be loaded as CLIP .it has no config.json\)"),
        (
            lambda folder: (folder / "config.json").write_text('{"model_type": "bert"}'),
            "cannot be loaded as CLIP .it is a 'bert' network",
        ),
        (lambda folder: (folder / "config.json").write_text("<html>"), "config.json is cut off, or not JSON"),
        (lambda folder: (folder / "config.json").write_text("[]"), "config.json is not the settings of a network"),
        (lambda folder: (folder / "model.safetensors").write_bytes(b"\0" * 40), "weights are cut off, or not safeten"),
        (lambda folder: (folder / "model.safetensors").unlink(), "it has no model.safetensors"),
        (lambda folder: leave_no_tokenizer(folder), "it has no tokenizer.json"),
        (lambda folder: alter(folder, lambda name, tensor: None if "text" in name else tensor), "its weights lack "),
        (lambda folder: alter(folder, lambda name, tensor: tensor[:4]), "in another size than config.json"),
        (
            lambda folder: alter(folder, lambda name, tensor: tensor * torch.nan if "visual" in name else tensor),
            "its embeddings of pictures are not finite",
        ),
        (lambda folder: alter(folder, lambda name, tensor: 0 * tensor), "all sentences are the same to it"),
        (lambda folder: give_foreign_tokenizer(folder), "its tokenizer is that of another network"),
        (lambda folder: (folder / "tokenizer.json").write_text('{"version"'), "its tokenizer is cut off, or lacks a"),
        (lambda folder: say(folder, "vision_config", num_hidden_layers=10**6), "num_hidden_layers as 1000000; it is"),
        (lambda folder: say(folder, "vision_config", image_size=[32, 32]), r"image_size as \[32, 32\]; it is a number"),
        (lambda folder: say(folder, "text_config", hidden_act=3), "config.json is not the settings of such a network"),
    ],
)
def test_folders_that_are_no_clip(
    tmp_path: Path, damage: Callable[[Path], object], says: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """None is completed by chance, which `transformers` does for weights and tokenizers that it does not find."""
    broken = write_clip(tmp_path / "broken")
    damage(broken)
    capfd.readouterr()
    with pytest.raises(WeightsError, match=says):
        Clip.load(broken)
    assert capfd.readouterr() == ("", "")


def say(folder: Path, tower: str, **values: object) -> None:
    record = json.loads((folder / "config.json").read_text())
    record[tower] |= values
    (folder / "config.json").write_text(json.dumps(record))


def leave_no_tokenizer(folder: Path) -> None:
    for name in ("tokenizer.json", "tokenizer_config.json"):
        (folder / name).unlink()


def alter(folder: Path, change: Callable[[str, torch.Tensor], torch.Tensor | None]) -> None:
    """Writes what `change` makes of each tensor; none for None."""
    from safetensors.torch import load_file, save_file

    changed = {name: change(name, tensor) for name, tensor in load_file(folder / "model.safetensors").items()
               if tensor.dim()}  # fmt: skip
    kept = {name: tensor.clone() for name, tensor in changed.items() if tensor is not None}
    save_file(kept | {"logit_scale": torch.tensor(1.0)}, folder / "model.safetensors", {"format": "pt"})


def give_foreign_tokenizer(folder: Path) -> None:
    """Its words have numbers that the network does not have."""
    tokenizer = json.loads((folder / "tokenizer.json").read_text())
    tokenizer["model"]["vocab"] = {word: 1000 + number for word, number in tokenizer["model"]["vocab"].items()}
    (folder / "tokenizer.json").write_text(json.dumps(tokenizer))


def test_a_name_that_cannot_be_reached_costs_no_retries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HF_HUB_OFFLINE", raising=False)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound and not listening: whoever calls is refused
        monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{taken.getsockname()[1]}")
        with pytest.raises(WeightsError, match=r"no-such/clip cannot be loaded as CLIP .*cannot be reached.*a folder"):
            Clip.load("no-such/clip")
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    with pytest.raises(WeightsError, match=r"cannot be loaded as CLIP .HF_HUB_OFFLINE is set"):
        Clip.load("no-such/clip")
    for name in ("/no/such/folder", "a b", "vit-b-33", "x" * 5000):
        with pytest.raises(WeightsError, match=r"there is no such folder, and a name on the hub is like openai/clip"):
            Clip.load(name)


@pytest.mark.parametrize("size", [(SIDE, SIDE), (50, 70)])
def test_siglip_is_asked_as_transformers_asks_it(tmp_path: Path, size: tuple[int, int]) -> None:
    """Its own image processor squashes pictures; its sentences are in small letters, padded, without a mask."""
    from transformers import AutoTokenizer, SiglipImageProcessorPil, SiglipModel

    folder = write_siglip(tmp_path / "siglip")
    siglip, model = Clip.load(folder), SiglipModel.from_pretrained(folder).eval()
    smooth = torch.nn.functional.interpolate(
        torch.rand(1, 3, 5, 6, generator=torch.Generator().manual_seed(0)), size, mode="bicubic"
    )[0].clamp(0, 1)
    processor = SiglipImageProcessorPil(size={"height": SIDE, "width": SIDE})
    pixels = processor(Image.fromarray(images.to_uint8(smooth)), return_tensors="pt")["pixel_values"]
    torch.testing.assert_close(siglip._as_input(smooth[None]), pixels, atol=0.03, rtol=0)
    tokens = AutoTokenizer.from_pretrained(folder)("a cat", padding="max_length", max_length=MAX_TOKENS)["input_ids"]
    with torch.no_grad():
        words = model.get_text_features(torch.tensor([tokens])).pooler_output[0]
        seen = model.get_image_features(pixels).pooler_output
        last = model.vision_model(pixels).last_hidden_state
    torch.testing.assert_close(siglip.embed_text("A cat!"), words / words.norm())
    torch.testing.assert_close(siglip.embed_pictures(smooth[None]), seen / seen.norm(), atol=0.02, rtol=0.02)
    (maps,) = siglip.features(smooth[None])
    assert maps.shape == (1, 16, SIDE // PATCH, SIDE // PATCH)
    torch.testing.assert_close(maps[0, :, 1, 2], last[0, SIDE // PATCH + 2], atol=0.05, rtol=0.05)


def test_siglip_needs_no_library_for_its_tokenizer(tmp_path: Path) -> None:
    """The hub's folders name SiglipTokenizer, which needs sentencepiece."""
    folder = write_siglip(tmp_path / "siglip")
    before = Clip.load(folder).embed_text("a cat")
    settings = folder / "tokenizer_config.json"
    settings.write_text(json.dumps({**json.loads(settings.read_text()), "tokenizer_class": "SiglipTokenizer"}))
    torch.testing.assert_close(Clip.load(folder).embed_text("a cat"), before)
    settings.unlink()
    torch.testing.assert_close(Clip.load(folder).embed_text("a cat"), before)


def test_a_home_folder_is_found(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(folder.parent))
    assert Clip.load(f"~/{folder.name}/").name == f"CLIP {folder.name}"
    with pytest.raises(WeightsError, match=r"~nobody-at-all/clip cannot be loaded as CLIP"):
        Clip.load("~nobody-at-all/clip")


def test_the_older_archive_of_tensors_gives_the_same_network(folder: Path, clip: Clip, tmp_path: Path) -> None:
    """As the hub has OpenAI's own: pytorch_model.bin, with the positions as tensors beside the weights."""
    from safetensors.torch import load_file

    older = write_clip(tmp_path / "older")
    tensors = load_file(older / "model.safetensors")
    tensors["vision_model.embeddings.position_ids"] = torch.arange(17)[None]
    (older / "model.safetensors").unlink()
    torch.save(tensors, older / "pytorch_model.bin")
    picture = torch.rand(1, 3, SIDE, SIDE)
    torch.testing.assert_close(Clip.load(older).embed_pictures(picture), clip.embed_pictures(picture))
    del tensors["text_projection.weight"]
    torch.save(tensors, older / "pytorch_model.bin")
    with pytest.raises(WeightsError, match=r"its weights lack text_projection.weight"):
        Clip.load(older)


def test_a_hub_that_has_no_such_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HF_HUB_OFFLINE", raising=False)
    with serving({}) as server:
        monkeypatch.setenv("HF_ENDPOINT", server.address)
        with pytest.raises(WeightsError, match=r"no-such/clip cannot be loaded as CLIP .*answers"):
            Clip.load("no-such/clip")


def test_nothing_brings_torchvision_in(clip: Clip) -> None:
    assert clip.name and "torchvision" not in sys.modules
