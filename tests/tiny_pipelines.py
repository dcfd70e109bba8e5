"""Diffusion pipelines that are tiny: real ones of random weights, and folders that only look like one."""

import json
import warnings
from pathlib import Path
from typing import Any

INDEX = {
    "_class_name": "StableDiffusionPipeline",
    "scheduler": ["diffusers", "DDIMScheduler"],
    "tokenizer": ["transformers", "CLIPTokenizer"],
    "safety_checker": [None, None],
    "requires_safety_checker": False,
    "unet": ["diffusers", "UNet2DConditionModel"],
}


def write_lookalike(folder: Path, index: dict[str, Any] | None = None) -> Path:
    """A folder with all that a pipeline's has, whose one network is four numbers."""
    import torch
    from safetensors.torch import save_file

    for part, file in (("scheduler", "scheduler_config"), ("tokenizer", "tokenizer"), ("unet", "config")):
        (folder / part).mkdir(parents=True)
        (folder / part / f"{file}.json").write_text('{"a": 1}')
    save_file({"x": torch.zeros(4)}, folder / "unet" / "diffusion_pytorch_model.safetensors")
    (folder / "model_index.json").write_text(json.dumps(INDEX if index is None else index))
    return folder


def write_pipeline(folder: Path, *, bias: float = 0.0) -> Path:
    """A Stable Diffusion of random weights that makes pictures of about 64 x 64 pixels in few steps (LCM).

    bias: added to every pixel of its pictures, whose values lie around 0 in -1 to 1
    """
    import torch
    from diffusers import AutoencoderKL, LCMScheduler, StableDiffusionPipeline, UNet2DConditionModel
    from transformers import CLIPTextConfig, CLIPTextModel, CLIPTokenizer

    with torch.random.fork_rng(devices=()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.manual_seed(0)
        unet = UNet2DConditionModel(
            sample_size=32, layers_per_block=1, block_out_channels=(8, 16), norm_num_groups=4,
            down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
            up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
            cross_attention_dim=8, attention_head_dim=4,
        )  # fmt: skip
        vae = AutoencoderKL(
            block_out_channels=(8, 8), norm_num_groups=4, down_block_types=("DownEncoderBlock2D",) * 2,
            up_block_types=("UpDecoderBlock2D",) * 2,
        )  # fmt: skip
        with torch.no_grad():
            vae.decoder.conv_out.bias.add_(bias)
        letters = [chr(number) for number in range(ord("a"), ord("z") + 1)]
        marks = [*letters, *(f"{letter}</w>" for letter in letters), "<|startoftext|>", "<|endoftext|>"]
        text = CLIPTextConfig(
            vocab_size=len(marks), hidden_size=8, intermediate_size=8, num_hidden_layers=1, num_attention_heads=2,
            bos_token_id=len(marks) - 2, eos_token_id=len(marks) - 1, pad_token_id=len(marks) - 1,
        )  # fmt: skip
        pipeline = StableDiffusionPipeline(
            vae=vae, unet=unet, text_encoder=CLIPTextModel(text), scheduler=LCMScheduler(steps_offset=1),
            tokenizer=CLIPTokenizer(
                vocab={mark: number for number, mark in enumerate(marks)}, merges=[], model_max_length=77
            ),
            safety_checker=None, feature_extractor=None, requires_safety_checker=False,
        )  # fmt: skip
        pipeline.save_pretrained(folder)
    return folder
