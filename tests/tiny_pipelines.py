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


_INPUTS = {"StableDiffusionInstructPix2PixPipeline": 8, "StableDiffusionInpaintPipeline": 9}
"""Channels of a network's input, if they are not the four of a picture."""


def write_pipeline(folder: Path, *, bias: float = 0.0, kind: str = "StableDiffusionPipeline") -> Path:
    """A Stable Diffusion of random weights that makes pictures of about 64 x 64 pixels in few steps (LCM).

    bias: added to every pixel of its pictures, whose values lie around 0 in -1 to 1
    kind: class of its pipeline
    """
    import diffusers
    import torch
    from diffusers import AutoencoderKL, LCMScheduler, UNet2DConditionModel
    from transformers import CLIPTextModel

    with torch.random.fork_rng(devices=()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.manual_seed(0)
        unet = UNet2DConditionModel(
            sample_size=32, layers_per_block=1, block_out_channels=(8, 16), norm_num_groups=4,
            down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
            up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
            cross_attention_dim=8, attention_head_dim=4, in_channels=_INPUTS.get(kind, 4),
        )  # fmt: skip
        vae = AutoencoderKL(
            block_out_channels=(8, 8), norm_num_groups=4, down_block_types=("DownEncoderBlock2D",) * 2,
            up_block_types=("UpDecoderBlock2D",) * 2,
        )  # fmt: skip
        with torch.no_grad():
            vae.decoder.conv_out.bias.add_(bias)
        text_encoder, tokenizer = _clip(CLIPTextModel)
        pipeline = getattr(diffusers, kind)(
            vae=vae, unet=unet, text_encoder=text_encoder, tokenizer=tokenizer, scheduler=LCMScheduler(steps_offset=1),
            safety_checker=None, feature_extractor=None, requires_safety_checker=False,
        )  # fmt: skip
        pipeline.save_pretrained(folder)
    return folder


def fetch_imagine(cache: Path, *, bias: float = 0.0) -> Path:
    """The tiny pipeline where `models fetch imagine` puts the generator, with its record; returns its folder."""
    from frida_painter.objectives.weights import find_weights
    from frida_painter.system import storage

    folder = write_pipeline(cache / "imagine", bias=bias)
    files = [path for path in folder.rglob("*") if path.is_file()]
    hashes = {path.relative_to(folder).as_posix(): storage.sha256(path, "a file") for path in files}
    record = {"version": 1, "name": "imagine", "originals": find_weights("imagine").pins, "files": hashes}
    storage.write_json(folder / "record.json", record)
    return folder


def write_stable_diffusion_xl(folder: Path) -> Path:
    """A Stable Diffusion XL of random weights that makes pictures of about 64 x 64 pixels."""
    import torch
    from diffusers import EulerDiscreteScheduler, StableDiffusionXLPipeline, UNet2DConditionModel
    from transformers import CLIPTextModel, CLIPTextModelWithProjection

    with torch.random.fork_rng(devices=()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.manual_seed(0)
        (one, first), (two, second) = _clip(CLIPTextModel), _clip(CLIPTextModelWithProjection)
        unet = UNet2DConditionModel(
            sample_size=8, layers_per_block=1, block_out_channels=(8, 16), norm_num_groups=4,
            down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
            up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
            cross_attention_dim=16, attention_head_dim=4, addition_embed_type="text_time", addition_time_embed_dim=2,
            projection_class_embeddings_input_dim=6 * 2 + 8,
        )  # fmt: skip
        pipeline = StableDiffusionXLPipeline(
            vae=_vae(latent_channels=4), unet=unet, text_encoder=one, tokenizer=first, text_encoder_2=two,
            tokenizer_2=second, scheduler=EulerDiscreteScheduler(beta_schedule="scaled_linear"),
            add_watermarker=False,
        )  # fmt: skip
        pipeline.save_pretrained(folder)
    return folder


def write_flux(folder: Path, *, guided: bool = True) -> Path:
    """A Flux of random weights; with `guided`, of the kind of dev, else of schnell."""
    import torch
    from diffusers import FlowMatchEulerDiscreteScheduler, FluxPipeline, FluxTransformer2DModel
    from transformers import CLIPTextModel

    with torch.random.fork_rng(devices=()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.manual_seed(0)
        text_encoder, tokenizer = _clip(CLIPTextModel)
        text_encoder_2, tokenizer_2 = _t5(8)
        transformer = FluxTransformer2DModel(
            in_channels=8, num_layers=1, num_single_layers=1, attention_head_dim=16, num_attention_heads=1,
            joint_attention_dim=8, pooled_projection_dim=8, axes_dims_rope=(4, 4, 8), guidance_embeds=guided,
        )  # fmt: skip
        pipeline = FluxPipeline(
            scheduler=FlowMatchEulerDiscreteScheduler(), vae=_vae(latent_channels=2), transformer=transformer,
            text_encoder=text_encoder, tokenizer=tokenizer, text_encoder_2=text_encoder_2, tokenizer_2=tokenizer_2,
        )  # fmt: skip
        pipeline.save_pretrained(folder)
    return folder


def write_stable_diffusion_3(folder: Path) -> Path:
    """A Stable Diffusion 3 of random weights that makes pictures of about 256 x 256 pixels."""
    import torch
    from diffusers import FlowMatchEulerDiscreteScheduler, SD3Transformer2DModel, StableDiffusion3Pipeline
    from transformers import CLIPTextModelWithProjection

    with torch.random.fork_rng(devices=()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.manual_seed(0)
        (one, first), (two, second), (three, third) = (
            _clip(CLIPTextModelWithProjection), _clip(CLIPTextModelWithProjection), _t5(16),
        )  # fmt: skip
        transformer = SD3Transformer2DModel(
            sample_size=32, patch_size=2, in_channels=4, out_channels=4, num_layers=1, attention_head_dim=8,
            num_attention_heads=2, joint_attention_dim=16, caption_projection_dim=16, pooled_projection_dim=16,
        )  # fmt: skip
        pipeline = StableDiffusion3Pipeline(
            scheduler=FlowMatchEulerDiscreteScheduler(), vae=_vae(latent_channels=4), transformer=transformer,
            text_encoder=one, tokenizer=first, text_encoder_2=two, tokenizer_2=second,
            text_encoder_3=three, tokenizer_3=third,
        )  # fmt: skip
        pipeline.save_pretrained(folder)
    return folder


def _vae(latent_channels: int) -> Any:
    """The part that makes pictures of 8 x 8 pixels for each of its inputs."""
    from diffusers import AutoencoderKL

    return AutoencoderKL(
        block_out_channels=(4,) * 4, norm_num_groups=2, latent_channels=latent_channels,
        down_block_types=("DownEncoderBlock2D",) * 4, up_block_types=("UpDecoderBlock2D",) * 4,
        use_quant_conv=False, use_post_quant_conv=False, shift_factor=0.1, scaling_factor=1.5,
    )  # fmt: skip


_LETTERS = [chr(number) for number in range(ord("a"), ord("z") + 1)]


def _clip(kind: Any) -> tuple[Any, Any]:
    """A text encoder of CLIP's, and its tokenizer, which knows letters."""
    from transformers import CLIPTextConfig, CLIPTokenizer

    marks = [*_LETTERS, *(f"{letter}</w>" for letter in _LETTERS), "<|startoftext|>", "<|endoftext|>"]
    text = CLIPTextConfig(
        vocab_size=len(marks), hidden_size=8, intermediate_size=8, num_hidden_layers=1, num_attention_heads=2,
        projection_dim=8, bos_token_id=len(marks) - 2, eos_token_id=len(marks) - 1, pad_token_id=len(marks) - 1,
    )  # fmt: skip
    vocabulary = {mark: number for number, mark in enumerate(marks)}
    return kind(text), CLIPTokenizer(vocab=vocabulary, merges=[], model_max_length=77)


def _t5(width: int) -> tuple[Any, Any]:
    """A T5 that many numbers wide, and its tokenizer, which knows letters."""
    from transformers import T5Config, T5EncoderModel, T5Tokenizer

    marks = [("<pad>", 0.0), ("</s>", 0.0), ("<unk>", 0.0), *((mark, -2.0) for mark in ("\u2581", *_LETTERS))]
    text = T5Config(vocab_size=len(marks), d_model=width, d_kv=4, d_ff=8, num_layers=1, num_heads=2)
    return T5EncoderModel(text), T5Tokenizer(vocab=marks, extra_ids=0, model_max_length=64)
