"""Networks of a latent diffusion pipeline that judge pictures: the encoder of pictures, and the one that knows noise.

Rombach et al. 2022; Stable Diffusion 1 and 2, Stable Diffusion XL, and what was made of them.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from frida_painter import devices, storage
from frida_painter.errors import ConfigError
from frida_painter.objectives.encoders.clip import quietly
from frida_painter.weights.pipeline_folder import INDEX, PipelineFolder, parse_index, read_settings

_KINDS = {"vae": "AutoencoderKL", "unet": "UNet2DConditionModel", "text_encoder": "CLIPTextModel"}
_SECOND, _SECOND_KIND = "text_encoder_2", "CLIPTextModelWithProjection"  # of Stable Diffusion XL
_UNUSED = ("class_embed_type", "num_class_embeds", "encoder_hid_dim_type", "addition_embed_type")
_ENCODING = 27  # tensors as large as the first layer's that the encoder of pictures keeps for its gradient: measured
_NOISE = 0.2  # of that, for the other network at the same size


class Words(NamedTuple):
    """Words as the network reads them: [1, n, d], and for Stable Diffusion XL their summary [1, d]."""

    tokens: Tensor
    summary: Tensor | None


class LatentDiffusion:
    """Frozen networks of a pipeline on one device.

    name: name of the pipeline
    hashes: SHA-256 of each file of weights that is used
    kept [n]: share of a picture's variance that is left at each timestep, from the least noise to the most
    """

    def __init__(self, folder: PipelineFolder, noise: Any, vae: Any, unet: Any, hashes: str) -> None:
        self.name, self.hashes = folder.name, hashes
        self._folder, self._vae, self._unet, self._kind = folder, vae, unet, noise.config.prediction_type
        self.kept: Tensor = noise.alphas_cumprod

    @classmethod
    def load(cls, folder: PipelineFolder, device: torch.device, tell: Callable[[str], None]) -> "LatentDiffusion":
        """Loads the networks for pictures; those for words are loaded whenever words are read.

        tell: receives a sentence about the memory.
        Raises ConfigError if the pipeline is of another kind, too large or damaged.
        """
        name = folder.name
        _, parts = parse_index(read_settings(folder.folder / INDEX, name), name)
        wide = _SECOND in parts
        if {**_KINDS, **({_SECOND: _SECOND_KIND} if wide else {})}.items() - parts.items():
            raise ConfigError(
                f"{name} is a {folder.pipeline}, which cannot guide; Stable Diffusion 1, 2 or XL and what was made of "
                f"them can: they have {', '.join(_KINDS.values())}."
            )
        noise = _noise_schedule(folder.folder, name)
        settings = {part: read_settings(folder.folder / part / "config.json", name) for part in ("vae", "unet")}
        _require_latents(settings["unet"], settings["vae"], name, wide=wide)
        files = [file for file in folder.weights if file.parent.name in (*_KINDS, _SECOND)]
        _require_memory(name, files, settings, device, tell)
        tell(f"Loading {name} on {device.type}.")
        import diffusers
        from diffusers.utils import logging

        logging.set_verbosity_error()
        hashes = " ".join(storage.sha256(file, "the weights of a pipeline", ConfigError) for file in files)
        vae = _load(diffusers.AutoencoderKL, folder, "vae", device)
        del vae.decoder
        return cls(folder, noise, vae, _load(diffusers.UNet2DConditionModel, folder, "unet", device), hashes)

    @property
    def device(self) -> torch.device:
        """Device of the networks."""
        return torch.device(self._unet.device)

    def read(self, prompts: list[str]) -> list[Words]:
        """Returns prompts as the network reads them. Raises ConfigError if what reads them is damaged."""
        import transformers

        name, folder = self.name, self._folder.folder
        index = read_settings(folder / INDEX, name)
        wide = _SECOND in index
        with quietly():
            read = [self._read(prompts, transformers.CLIPTextModel, "text_encoder", "tokenizer", inner=wide)]
            if wide:
                kind = transformers.CLIPTextModelWithProjection
                read.append(self._read(prompts, kind, _SECOND, "tokenizer_2", inner=True))
        found = []
        for number, prompt in enumerate(prompts):
            tokens = torch.cat([states[number] for states, _ in read], -1)
            summary = read[-1][1][number] if wide else None
            if not prompt and summary is not None and index.get("force_zeros_for_empty_prompt", True):
                tokens, summary = 0 * tokens, 0 * summary
            found.append(Words(tokens, summary))
        return found

    @torch.no_grad()
    def _read(
        self, prompts: list[str], kind: Any, part: str, tokens: str, *, inner: bool
    ) -> tuple[list[Tensor], list[Tensor]]:
        """Returns the tokens [1, n, d] of each prompt, of the last layer but one if `inner`, and summaries [1, d]."""
        from transformers import AutoTokenizer

        network = _load(kind, self._folder, part, self.device)
        try:
            tokenizer: Any = AutoTokenizer.from_pretrained(self._folder.folder / tokens, local_files_only=True)
            most = min(tokenizer.model_max_length, network.config.max_position_embeddings)  # some say 10**30
            how = {"padding": "max_length", "truncation": True, "max_length": most, "return_tensors": "pt"}
            given = [tokenizer(prompt, **how)["input_ids"].to(network.device) for prompt in prompts]
            seen = [network(each, output_hidden_states=True) for each in given]
        except Exception as cause:  # `transformers` raises anything for foreign files
            raise _damaged(tokens, self.name, cause) from cause
        states = [each.hidden_states[-2] if inner else each.last_hidden_state for each in seen]
        return states, [each.text_embeds for each in seen if hasattr(each, "text_embeds")]

    def size(self, rows: int, columns: int) -> tuple[int, int]:
        """Returns rows and columns in these proportions, in about as many pixels as the network was made for."""
        return _size(self._unet.config, self._vae.config, rows, columns)

    def encode(self, picture: Tensor) -> Tensor:
        """Returns the latents [1, c, h / 8, w / 8] of a picture [3, h, w], sRGB in [0, 1]. Differentiable."""
        settings = self._vae.config
        seen = (2 * picture[None] - 1).to(self._vae.device, self._vae.dtype)
        found = self._vae.encode(seen).latent_dist.mean.float()
        return (found - (settings.shift_factor or 0.0)) * settings.scaling_factor

    @torch.no_grad()
    def noise_in(self, noisy: Tensor, timestep: int, words: list[Words]) -> Tensor:
        """Returns the noise [n, c, h, w] that the network sees in latents [1, c, h, w], once for each of n words."""
        tokens = torch.cat([each.tokens for each in words])
        more: dict[str, Any] = {}
        if words[0].summary is not None:
            scale = 2 ** (len(self._vae.config.block_out_channels) - 1)
            rows, columns = (scale * side for side in noisy.shape[-2:])
            sizes = tokens.new_tensor([[rows, columns, 0, 0, rows, columns]]).expand(len(words), -1)
            more = {"text_embeds": torch.cat([each.summary for each in words if each.summary is not None]),
                    "time_ids": sizes}  # fmt: skip
        given = noisy.to(tokens).expand(len(words), -1, -1, -1)
        found = self._unet(given, timestep, encoder_hidden_states=tokens, added_cond_kwargs=more).sample.to(noisy)
        clear, rest = self.kept[timestep].sqrt().item(), (1 - self.kept[timestep]).sqrt().item()
        match self._kind:
            case "epsilon":
                return found
            case "v_prediction":
                return clear * found + rest * noisy
            case _:
                return (noisy - clear * found) / rest


def _noise_schedule(folder: Path, name: str) -> Any:
    """Returns the scheduler with the noise that the network was trained with. Raises ConfigError if it has none."""
    from diffusers import DDPMScheduler

    file = folder / "scheduler" / "scheduler_config.json"
    settings = read_settings(file, name) if file.is_file() else {}
    try:
        if not {"beta_schedule", "trained_betas"} & {key for key, value in settings.items() if value}:
            raise ValueError("it says no betas")
        kind: Any = DDPMScheduler  # has no types
        made = kind.from_config(dict(settings))
        kept = made.alphas_cumprod
        if made.config.prediction_type not in ("epsilon", "v_prediction", "sample"):
            raise ValueError(f"it predicts {str(made.config.prediction_type)[:40]}")
        if not bool(((kept[:-1] > 0) & (kept[:-1] < 1) & (kept.diff() < 0)).all()) or len(kept) < 2:
            raise ValueError("its noise does not grow")
    except (ValueError, TypeError, RuntimeError, ArithmeticError) as cause:
        raise ConfigError(
            f"The scheduler of {name} does not tell with which noise the network was trained ({cause}); name a "
            "pipeline of Stable Diffusion 1, 2 or XL."
        ) from cause
    return made


def _require_latents(unet: Any, vae: Any, name: str, *, wide: bool) -> None:
    """Raises ConfigError unless the network of noise takes the latents of the encoder, words and nothing else."""
    seen, latents = (unet.get("in_channels", 4), unet.get("out_channels", 4)), vae.get("latent_channels", 4)
    if seen != (latents, latents):
        raise ConfigError(
            f"The network of {name} takes {seen[0]} channels and returns {seen[1]}, and its encoder makes {latents}; "
            "name a pipeline that makes pictures from words alone."
        )
    asked = next((key for key in _UNUSED if unet.get(key) and not (wide and unet[key] == "text_time")), None)
    if asked is not None:
        raise ConfigError(
            f"The network of {name} wants more than words ({asked} {str(unet[asked])[:40]}); name a pipeline that "
            "makes pictures from words alone."
        )


def _size(unet: Any, vae: Any, rows: int, columns: int) -> tuple[int, int]:
    cells, scale = unet["sample_size"] or 64, 2 ** (len(vae["block_out_channels"]) - 1)
    across = math.prod(cells) ** 0.5 if isinstance(cells, list | tuple) else cells
    step = scale * 2 ** (len(unet["block_out_channels"]) - 1)
    larger = across * scale / (rows * columns) ** 0.5
    return step * max(1, round(rows * larger / step)), step * max(1, round(columns * larger / step))


def _precision(device: torch.device) -> torch.dtype:
    bfloat16 = device.type == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False)
    return torch.bfloat16 if bfloat16 else torch.float32


def _require_memory(
    name: str, files: list[Path], settings: Any, device: torch.device, tell: Callable[[str], None]
) -> None:
    """Tells how much memory the networks need, for their weights and a step. Raises ConfigError if it is not free."""
    from safetensors import safe_open

    numbers = 0
    for file in files:
        with safe_open(file, "pt") as tensors:
            numbers += sum(math.prod(tensors.get_slice(key).get_shape()) for key in tensors.keys())  # noqa: SIM118
    try:
        rows, columns = _size(settings["unet"], settings["vae"], 1, 1)
        step = (1 + _NOISE) * _ENCODING * rows * columns * settings["vae"]["block_out_channels"][0]
    except (KeyError, TypeError, IndexError) as cause:
        raise ConfigError(f"The settings of {name} lack {cause}; fetch it again.") from cause
    needed = round((numbers + step) * _precision(device).itemsize)
    free = devices.free_memory(device)
    if free is not None and needed > free:
        raise ConfigError(
            f"{name} needs about {storage.megabytes(needed)} of memory on {device.type}, and {storage.megabytes(free)} "
            "are free; name a smaller pipeline, or end what else runs."
        )
    tell(f"{name} takes about {storage.megabytes(needed)} of memory on {device.type}.")


def _load(kind: Any, folder: PipelineFolder, part: str, device: torch.device) -> Any:
    """Returns a network, frozen. Raises ConfigError if tensors are missing, no numbers, or of another network."""
    name = folder.name
    try:
        network, told = kind.from_pretrained(
            folder.folder / part, variant=folder.variant, torch_dtype=_precision(device), use_safetensors=True,
            local_files_only=True, output_loading_info=True,
        )  # fmt: skip
    except Exception as cause:  # both libraries raise anything for foreign files
        raise _damaged(part, name, cause) from cause
    wrong = len(told["missing_keys"]) + len(told["mismatched_keys"])
    if wrong:
        raise ConfigError(f"{name} lacks {wrong} tensors of its {part}; take an undamaged copy.")
    if not all(bool(tensor.isfinite().all()) for tensor in network.state_dict().values()):
        raise ConfigError(f"The {part} of {name} holds values that are no numbers (NaN); take an undamaged copy.")
    return network.eval().requires_grad_(False).to(device)


def _damaged(part: str, name: str, cause: Exception) -> ConfigError:
    why = " ".join(f"{type(cause).__name__}: {cause}".split())[:160].rstrip(".")
    return ConfigError(f"The {part} of {name} cannot be used ({why}); take an undamaged copy.")
