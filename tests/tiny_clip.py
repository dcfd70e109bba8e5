"""CLIPs of random weights, made on the spot: the ViT kind as a folder that `transformers` loads, the ResNet kind."""

import json
from pathlib import Path

import torch

SIDE, PATCH, MAX_TOKENS = 32, 8, 12


def write_clip(folder: Path) -> Path:
    """A folder with config.json, model.safetensors and a tokenizer of letters."""
    from tokenizers import Tokenizer, models, pre_tokenizers, processors  # some seconds to load
    from transformers import CLIPConfig, CLIPModel

    text = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2,
            "vocab_size": 64, "max_position_embeddings": MAX_TOKENS, "eos_token_id": 1, "bos_token_id": 0}  # fmt: skip
    vision = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2,
              "image_size": SIDE, "patch_size": PATCH}  # fmt: skip
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = CLIPModel(CLIPConfig(text_config=text, vision_config=vision, projection_dim=8))
    folder.mkdir(parents=True, exist_ok=True)
    model.save_pretrained(folder)
    words = ["<|startoftext|>", "<|endoftext|>", "<unk>", *"abcdefghijklmnopqrstuvwxyz"]
    tokenizer = Tokenizer(models.WordLevel({word: number for number, word in enumerate(words)}, unk_token="<unk>"))
    tokenizer.pre_tokenizer = pre_tokenizers.Split("", "isolated")
    tokenizer.post_processor = processors.TemplateProcessing(
        single="<|startoftext|> $A <|endoftext|>", special_tokens=[("<|startoftext|>", 0), ("<|endoftext|>", 1)]
    )
    tokenizer.save(str(folder / "tokenizer.json"))
    settings = {"tokenizer_class": "PreTrainedTokenizerFast", "bos_token": words[0], "eos_token": words[1]}
    settings |= {"pad_token": words[1], "unk_token": words[2]}
    (folder / "tokenizer_config.json").write_text(json.dumps(settings))
    return folder


def write_siglip(folder: Path) -> Path:
    """A SigLIP of the same size, as its authors' folder is: sentences padded to the full length."""
    from transformers import SiglipConfig, SiglipModel

    write_clip(folder)
    (folder / "model.safetensors").unlink()
    text = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2,
            "vocab_size": 64, "max_position_embeddings": MAX_TOKENS, "projection_size": 16}  # fmt: skip
    vision = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2,
              "image_size": SIDE, "patch_size": PATCH}  # fmt: skip
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = SiglipModel(SiglipConfig(text_config=text, vision_config=vision))
    model.save_pretrained(folder)
    return folder


def resnet_tensors(width: int = 16, depths: tuple[int, ...] = (2, 1, 1, 1), side: int = 64) -> dict[str, torch.Tensor]:
    """Random tensors under the published names, of a tower that many channels wide; RN50 is 64, (3, 4, 6, 3), 224."""
    chance = torch.Generator().manual_seed(0)
    tensors: dict[str, torch.Tensor] = {}

    def convolution(name: str, norm: str, out: int, before: int, kernel: int) -> None:
        spread = (2 / (before * kernel**2)) ** 0.5
        tensors[f"visual.{name}.weight"] = torch.randn(out, before, kernel, kernel, generator=chance) * spread
        tensors[f"visual.{norm}.weight"] = 0.5 + torch.rand(out, generator=chance)
        tensors[f"visual.{norm}.bias"] = 0.1 * torch.randn(out, generator=chance)
        tensors[f"visual.{norm}.running_mean"] = 0.1 * torch.randn(out, generator=chance)
        tensors[f"visual.{norm}.running_var"] = 0.5 + torch.rand(out, generator=chance)
        tensors[f"visual.{norm}.num_batches_tracked"] = torch.tensor(0)

    for number, (out, before) in enumerate([(width // 2, 3), (width // 2, width // 2), (width, width // 2)], 1):
        convolution(f"conv{number}", f"bn{number}", out, before, 3)
    channels = width
    for stage, depth in enumerate(depths, 1):
        inner = width * 2 ** (stage - 1)
        for block in range(depth):
            name = f"layer{stage}.{block}"
            for number, (out, before, kernel) in enumerate(
                [(inner, channels, 1), (inner, inner, 3), (4 * inner, inner, 1)], 1
            ):
                convolution(f"{name}.conv{number}", f"{name}.bn{number}", out, before, kernel)
            if block == 0:
                convolution(f"{name}.downsample.0", f"{name}.downsample.1", 4 * inner, channels, 1)
            channels = 4 * inner
    tensors["visual.attnpool.positional_embedding"] = torch.randn((side // 32) ** 2 + 1, channels, generator=chance)
    for part, out in (("q_proj", channels), ("k_proj", channels), ("v_proj", channels), ("c_proj", channels // 2)):
        tensors[f"visual.attnpool.{part}.weight"] = torch.randn(out, channels, generator=chance) / channels**0.5
        tensors[f"visual.attnpool.{part}.bias"] = 0.1 * torch.randn(out, generator=chance)
    return tensors
