"""Folders of pipelines: what is refused before anything of them is loaded, one sentence each."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from frida_painter.errors import ConfigError
from frida_painter.objectives.weights.pipeline_folder import HalfDownload, choose_weights, read_pipeline_folder
from tiny_pipelines import INDEX, write_lookalike


def network(folder: Path) -> Path:
    return folder / "unet" / "diffusion_pytorch_model.safetensors"


def listed(**changes: Any) -> Callable[[Path], object]:
    return lambda folder: (folder / "model_index.json").write_text(json.dumps({**INDEX, **changes}))


def pickled(folder: Path) -> None:
    network(folder).rename(folder / "unet" / "diffusion_pytorch_model.bin")


def sharded(folder: Path) -> None:
    network(folder).rename(folder / "unet" / "diffusion_pytorch_model-00001-of-00002.safetensors")


def test_a_whole_one_is_read(tmp_path: Path) -> None:
    found = read_pipeline_folder(write_lookalike(tmp_path / "net"), "net")
    assert (found.pipeline, found.variant, found.steps) == ("StableDiffusionPipeline", None, 20)
    assert found.weights == (network(tmp_path / "net"),)


@pytest.mark.parametrize(
    ("name", "changes", "steps"),
    [
        ("sdxl-turbo", {}, 4),
        ("net", {"scheduler": ["diffusers", "LCMScheduler"]}, 4),
        ("net", {"_name_or_path": "somebody/SDXL-Lightning"}, 4),
        ("net", {}, 20),
        (
            "net",
            {"safety_checker": ["stable_diffusion", "StableDiffusionSafetyChecker"], "tokenizer": [None, None]},
            20,
        ),
    ],
)
def test_few_steps_are_told_by_name_or_scheduler(
    tmp_path: Path, name: str, changes: dict[str, Any], steps: int
) -> None:
    folder = write_lookalike(tmp_path / "net", {**INDEX, **changes})
    if "safety_checker" in changes:  # a class of diffusers' own pipelines
        (folder / "safety_checker").mkdir()
        (folder / "safety_checker" / "config.json").write_text("{}")
        (folder / "safety_checker" / "model.safetensors").write_bytes(network(folder).read_bytes())
    assert read_pipeline_folder(folder, name).steps == steps


@pytest.mark.parametrize(
    ("spoil", "error", "says"),
    [
        (lambda folder: (folder / "unet" / "net.py").write_text("import os"), ConfigError, "the program unet/net.py"),
        (listed(_class_name=["pipeline", "Mine"]), ConfigError, "its pipeline is a class of its own"),
        (listed(unet=["my_library", "Network"]), ConfigError, "its part 'unet' is of the library 'my_library'"),
        (listed(unet=["os.path", "Network"]), ConfigError, "its part 'unet' is"),
        (listed(unet=["diffusers", "Network", "more"]), ConfigError, "its part 'unet' is"),
        (lambda folder: (folder / "model_index.json").write_text(json.dumps({**INDEX, "../x": ["diffusers", "A"]})),
         ConfigError, "its part '../x' is"),
        (lambda folder: (folder / "unet" / "config.json").write_text('{"auto_map": {"AutoModel": "a.B"}}'), ConfigError,
         "unet/config.json names code"),
        (pickled, ConfigError, "only as a pickle, which can run code"),
        (listed(_class_name=None), ConfigError, "names no pipeline"),
        (lambda folder: (folder / "model_index.json").write_text("[]"), ConfigError, "names no pipeline"),
        (lambda folder: (folder / "model_index.json").unlink(), HalfDownload, "has no model_index.json"),
        (lambda folder: (folder / "model_index.json").write_text('{"_class'), HalfDownload,
         "net is half a download or damaged (model_index.json is cut off or not JSON)"),
        (lambda folder: (folder / "unet" / "config.json").write_text("{"), HalfDownload,
         "net is half a download or damaged (unet/config.json is cut off or not JSON)"),
        (lambda folder: network(folder).unlink(), HalfDownload, "the weights of unet are missing"),
        (lambda folder: network(folder).write_bytes(network(folder).read_bytes()[:-1]), HalfDownload, "is cut off"),
        (lambda folder: network(folder).write_bytes(b""), HalfDownload, "is cut off"),
        (lambda folder: network(folder).write_bytes(b"\xff" * 90), HalfDownload, "is cut off"),
        (sharded, HalfDownload, "1 of 2 files of unet are here"),
        (lambda folder: (folder / "unet" / "config.json").unlink(), HalfDownload, "unet/config.json is missing"),
        (lambda folder: (folder / "tokenizer" / "tokenizer.json").unlink(), HalfDownload, "tokenizer is missing"),
        (lambda folder: (folder / "unet" / "abc.incomplete").touch(), HalfDownload, "marked as incomplete"),
        (listed(vae=["diffusers", "AutoencoderKL"]), HalfDownload, "the folder vae is missing"),
        (listed(unet=[None, None]), ConfigError, "has no weights at all"),
    ],
)  # fmt: skip
def test_what_is_refused(tmp_path: Path, spoil: Callable[[Path], object], error: type[ConfigError], says: str) -> None:
    folder = write_lookalike(tmp_path / "net")
    spoil(folder)
    with pytest.raises(ConfigError) as told:
        read_pipeline_folder(folder, "net")
    assert type(told.value) is error and says in str(told.value) and "\n" not in str(told.value)


def test_a_folder_of_something_else_is_no_pipeline(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="so it is no pipeline of diffusers"):
        read_pipeline_folder(tmp_path, "holidays")


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        (["model.safetensors", "model.fp16.safetensors", "pytorch_model.bin"], ["model.safetensors"]),
        (["model.fp16.safetensors", "model.non_ema.safetensors"], ["model.fp16.safetensors"]),
        (["model-00002-of-00002.safetensors", "model-00001-of-00002.safetensors"],
         ["model-00001-of-00002.safetensors", "model-00002-of-00002.safetensors"]),
        (["openvino_model.bin", "other.safetensors"], []),
    ],
)  # fmt: skip
def test_plain_weights_are_chosen_before_variants(names: list[str], chosen: list[str]) -> None:
    assert choose_weights(names) == chosen
