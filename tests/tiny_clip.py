"""CLIPs and SigLIPs of random weights, made on the spot as folders that `transformers` loads."""

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
