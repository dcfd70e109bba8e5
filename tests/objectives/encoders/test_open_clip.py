"""CLIPs in the layout of open_clip: a network of `transformers` is written in it, and is the same when it is read."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file

from frida_painter.errors import WeightsError
from frida_painter.objectives.encoders.clip import CLIP_MEAN, Clip
from frida_painter.objectives.encoders.loading import EncoderRegistry
from tiny_clip import MAX_TOKENS, PATCH, SIDE, write_clip

CONFIG = "open_clip_config.json"
MODEL: dict[str, Any] = {
    "embed_dim": 8, "quick_gelu": True,
    "vision_cfg": {
        "image_size": SIDE, "layers": 2, "width": 16, "head_width": 8, "patch_size": PATCH, "mlp_ratio": 2.0
    },
    "text_cfg": {
        "context_length": MAX_TOKENS, "vocab_size": 64, "width": 16, "heads": 2, "layers": 2, "mlp_ratio": 2.0
    },
}  # fmt: skip
NAMES = (
    (r"^vision_model\.encoder\.layers\.", "visual.transformer.resblocks."),
    (r"^text_model\.encoder\.layers\.", "transformer.resblocks."),
    (r"^vision_model\.embeddings\.patch_embedding\.", "visual.conv1."),
    (r"^vision_model\.embeddings\.position_embedding\.weight", "visual.positional_embedding"),
    (r"^vision_model\.embeddings\.", "visual."),
    (r"^vision_model\.pre_layrnorm", "visual.ln_pre"),
    (r"^vision_model\.post_layernorm", "visual.ln_post"),
    (r"^text_model\.embeddings\.position_embedding\.weight", "positional_embedding"),
    (r"^text_model\.embeddings\.", ""),
    (r"^text_model\.final_layer_norm", "ln_final"),
    (r"\.layer_norm", ".ln_"),
    (r"\.mlp\.fc1", ".mlp.c_fc"),
    (r"\.mlp\.fc2", ".mlp.c_proj"),
    (r"\.self_attn\.", ".attn."),
)


def write_open_clip(folder: Path, *, archive: bool = False) -> Path:
    """The network of `write_clip`, whose sentences end with their highest token, as open_clip has it."""
    tokenizer = (write_clip(folder) / "tokenizer.json").read_text()
    change = {'"<|endoftext|>":1': '"<|endoftext|>":40', '"id":1': '"id":40', '"ids":[1]': '"ids":[40]'}
    compact = json.dumps(json.loads(tokenizer), separators=(",", ":"))
    for before, after in change.items():
        compact = compact.replace(before, after)
    (folder / "tokenizer.json").write_text(compact)
    tensors: dict[str, torch.Tensor] = {}
    parts = load_file(folder / "model.safetensors")
    for name, tensor in parts.items():
        new = name
        for before, after in NAMES:
            new = re.sub(before, after, new)
        if name in ("visual_projection.weight", "text_projection.weight"):
            tensors["visual.proj" if "visual" in name else "text_projection"] = tensor.T.contiguous()
        elif "q_proj" in name:
            joined = torch.cat([parts[name.replace("q_proj", f"{part}_proj")] for part in "qkv"])
            tensors[new.replace("q_proj.", "in_proj_")] = joined
        elif not re.search("[kv]_proj", name):
            tensors[new] = tensor
    for name in ("config.json", "model.safetensors"):
        (folder / name).unlink()
    if archive:
        torch.save(tensors, folder / "open_clip_pytorch_model.bin")
    else:
        save_file(tensors, folder / "open_clip_model.safetensors")
    write_settings(folder, MODEL)
    return folder


def write_settings(folder: Path, model: object) -> None:
    settings = {"model_cfg": model, "preprocess_cfg": {"mean": CLIP_MEAN, "std": [0.3, 0.3, 0.3]}}
    (folder / CONFIG).write_text(json.dumps(settings))


@pytest.mark.parametrize("archive", [False, True])
def test_the_network_is_the_same(tmp_path: Path, *, archive: bool) -> None:
    from transformers import CLIPModel

    folder = write_open_clip(tmp_path / "open", archive=archive)
    record = json.loads((write_clip(tmp_path / "usual") / "config.json").read_text())
    record["text_config"]["eos_token_id"] = 40
    (tmp_path / "usual" / "config.json").write_text(json.dumps(record))
    model = CLIPModel.from_pretrained(tmp_path / "usual").eval()
    clip = Clip.load(folder)
    picture = torch.rand(1, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        seen = model.get_image_features((picture - torch.tensor(CLIP_MEAN)[:, None, None]) / 0.3).pooler_output
        tokens = clip._tokenizer("cat", return_tensors="pt")
        read = model.get_text_features(**{key: tokens[key] for key in ("input_ids", "attention_mask")}).pooler_output
    assert int(tokens["input_ids"][0, -1]) == 40
    torch.testing.assert_close(clip.embed_pictures(picture), seen / seen.norm())
    torch.testing.assert_close(clip.embed_text("cat"), read[0] / read.norm())


def test_the_layout_of_transformers_goes_before(tmp_path: Path) -> None:
    folder = write_clip(tmp_path / "both")
    (folder / CONFIG).write_text("[]")
    assert Clip.load(folder).name == "CLIP both"


def test_it_is_found_in_the_cache_of_the_hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path))
    write_open_clip(tmp_path / "models--some--clip" / "snapshots" / "0123")
    assert Clip.load("some/clip").name == Clip.load("models--some--clip").name == "CLIP some/clip"


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda folder: (folder / CONFIG).write_text("[]"), "is not the settings of a network"),
        (lambda folder: write_settings(folder, {}), f"{CONFIG} is not the settings of a network; fetch it again"),
        (
            lambda folder: write_settings(folder, MODEL | {"vision_cfg": {"timm_model_name": "vit_base", "layers": 2}}),
            "is of a 'vit_base'; of open_clip's only its own ViTs are read",
        ),
        (
            lambda folder: write_settings(folder, MODEL | {"vision_cfg": {"layers": [3, 4, 6, 3], "width": 64}}),
            "is of a 'ResNet'; of open_clip's only",
        ),
        (lambda folder: (folder / "open_clip_model.safetensors").unlink(), "it has no open_clip_model.safetensors"),
        (lambda folder: (folder / "open_clip_model.safetensors").write_bytes(b"\0" * 40), "damaged or not safeten"),
        (lambda folder: (folder / "tokenizer.json").unlink(), "it has no tokenizer.json"),
    ],
)
def test_folders_that_cannot_be_read(tmp_path: Path, damage: Callable[[Path], object], says: str) -> None:
    broken = write_open_clip(tmp_path / "broken")
    damage(broken)
    with pytest.raises(WeightsError, match=says):
        Clip.load(broken)


@pytest.mark.parametrize("kind", ["usual", "renamed", "archive", "open_clip", "both"])
def test_one_file_of_weights_takes_settings_and_tokenizer_beside_it(tmp_path: Path, kind: str) -> None:
    """Its tensors say which layout they are in; other weights beside it are not taken."""
    folder = tmp_path / "net"
    if kind in ("open_clip", "both"):
        write_open_clip(folder)
        if kind == "both":
            (folder / "config.json").write_text("[]")
            (folder / "model.safetensors").write_bytes(b"others")
        file = folder / "open_clip_model.safetensors"
        expected = Clip.load(write_open_clip(tmp_path / "expected"))
    else:
        write_clip(folder)
        file = folder / "model.safetensors"
        expected = Clip.load(write_clip(tmp_path / "expected"))
    if kind == "archive":
        torch.save(load_file(file), folder / "pytorch_model.bin")
        file = folder / "pytorch_model.bin"
    if kind == "renamed":
        file = file.rename(folder / "own.safetensors")
        file.with_name("model.safetensors").write_bytes(b"others")
    found = EncoderRegistry(clip=str(file)).clip()
    assert isinstance(found, Clip) and found.name == f"CLIP {file.name}"
    torch.testing.assert_close(found.embed_text("cat"), expected.embed_text("cat"))


@pytest.mark.parametrize(
    ("write", "says"),
    [
        (lambda file: file.with_name("config.json").unlink(), "no config.json lies beside it"),
        (lambda file: file.with_name("tokenizer.json").unlink(), "no tokenizer.json lies beside it"),
        (
            lambda file: file.write_bytes(b"no tensors at all"),
            "its weights are cut off, or not safetensors; fetch them again",
        ),
        (lambda file: save_file({"visual.proj": torch.zeros(2)}, file), "no open_clip_config.json lies beside it"),
        (lambda file: save_file({"unet.x": torch.zeros(2)}, file), "its weights lack logit_scale"),
    ],
)
def test_one_file_that_cannot_be_read_is_one_sentence(
    tmp_path: Path, write: Callable[[Path], object], says: str
) -> None:
    file = write_clip(tmp_path / "net") / "model.safetensors"
    write(file)
    with pytest.raises(WeightsError) as told:
        EncoderRegistry(clip=str(file)).clip()
    assert str(told.value).startswith(f"{file}"[:80]) and says in str(told.value)
    assert str(told.value).endswith("; give a folder that holds config.json, model.safetensors and tokenizer.json.")
