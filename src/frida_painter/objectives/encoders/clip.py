"""CLIP and SigLIP: words and pictures in one space, loaded by `transformers` without foreign code.

Radford et al., "Learning transferable visual models from natural language supervision", ICML 2021; Zhai et al.,
"Sigmoid loss for language image pre-training", ICCV 2023.
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import registry
from frida_painter.errors import StorageError, WeightsError
from frida_painter.objectives.weights.catalogue import state_dict
from frida_painter.objectives.weights.hub_folder import (
    OPEN_CLIP,
    folder_of_file,
    hub_folder,
    is_of_open_clip,
    local_folder,
    missing_file,
    plain_name,
)
from frida_painter.system import storage, tensor_file
from frida_painter.system.devices import Constant, half_precision

# Layout of open_clip (Ilharco et al. 2021): its settings and tensors, told as `transformers` tells those of a CLIP

_TOWERS = (  # part of the name, name in the layout of transformers
    (r"visual\.class_embedding", "vision_model.embeddings.class_embedding"),
    (r"visual\.positional_embedding", "vision_model.embeddings.position_embedding.weight"),
    (r"visual\.conv1\.", "vision_model.embeddings.patch_embedding."),
    (r"visual\.ln_pre\.", "vision_model.pre_layrnorm."),
    (r"visual\.ln_post\.", "vision_model.post_layernorm."),
    (r"visual\.proj$", "visual_projection.weight"),
    (r"visual\.transformer\.resblocks\.", "vision_model.encoder.layers."),
    (r"transformer\.resblocks\.", "text_model.encoder.layers."),
    (r"positional_embedding", "text_model.embeddings.position_embedding.weight"),
    (r"token_embedding\.", "text_model.embeddings.token_embedding."),
    (r"ln_final\.", "text_model.final_layer_norm."),
    (r"text_projection$", "text_projection.weight"),
)
_LAYERS = (
    (r"\.ln_([12])\.", r".layer_norm\1."),
    (r"\.mlp\.c_fc\.", ".mlp.fc1."),
    (r"\.mlp\.c_proj\.", ".mlp.fc2."),
    (r"\.attn\.", ".self_attn."),
)
_TURNED = ("visual.proj", "text_projection")  # are multiplied from the other side
_JOINED = "self_attn.in_proj_"
_HIGHEST = 2  # transformers' sign for a sentence whose end is its highest token


def clip_settings(record: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the settings of a CLIP from those of open_clip. Raises WeightsError for another kind of network."""
    try:
        model = record["model_cfg"]
        vision, text = model["vision_cfg"], model["text_cfg"]
        foreign = sorted({"timm_model_name", "hf_model_name"} & {*vision, *text})
        if foreign or isinstance(vision["layers"], list):
            kind = (vision | text)[foreign[0]] if foreign else "ResNet"
            raise WeightsError(f"its {OPEN_CLIP} is of a {str(kind)[:40]!r}; of open_clip's only its own ViTs are read")
        act = "quick_gelu" if model.get("quick_gelu") else "gelu"
        towers = [
            {
                "hidden_size": tower["width"], "num_hidden_layers": tower["layers"], "num_attention_heads": heads,
                "intermediate_size": int(tower["width"] * tower.get("mlp_ratio", 4)), "hidden_act": act,
            }
            for tower, heads in ((vision, vision["width"] // vision.get("head_width", 64)), (text, text["heads"]))
        ]  # fmt: skip
        return {
            "model_type": "clip", "projection_dim": model["embed_dim"],
            "vision_config": towers[0] | {"image_size": vision["image_size"], "patch_size": vision["patch_size"]},
            "text_config": towers[1] | {
                "vocab_size": text.get("vocab_size", 49408), "eos_token_id": _HIGHEST,
                "max_position_embeddings": text.get("context_length", 77),
            },
        }  # fmt: skip
    except (KeyError, TypeError, AttributeError, ZeroDivisionError) as cause:
        raise WeightsError(f"{OPEN_CLIP} is not the settings of a network; fetch it again") from cause


def clip_tensors(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Returns tensors of open_clip under the names of `transformers`; unknown ones keep their names."""
    found: dict[str, Tensor] = {}
    for name, tensor in tensors.items():
        new = next((after + name[match.end() :] for place, after in _TOWERS if (match := re.match(place, name))), name)
        for place, after in _LAYERS:
            new = re.sub(place, after, new)
        if _JOINED in new:
            stem, _, end = new.partition(_JOINED)
            for part, piece in zip("qkv", tensor.chunk(3), strict=True):
                found[f"{stem}self_attn.{part}_proj.{end}"] = piece.contiguous()
        else:
            found[new] = tensor.T.contiguous() if name in _TURNED else tensor
    return found


CLIP_MEAN, CLIP_SPREAD = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
"""Statistics of the sRGB channels in the training of all variants of CLIP."""
_MAX_BYTES = 2**20  # size of a settings file
_FILES = "config.json, model.safetensors and tokenizer.json"
_SIZES = {
    "projection_dim": 2**14, "hidden_size": 2**14, "intermediate_size": 2**17, "num_hidden_layers": 2**8,
    "num_attention_heads": 2**10, "image_size": 2**12, "patch_size": 2**8, "vocab_size": 2**20,
    "max_position_embeddings": 2**16,
}  # fmt: skip
"""Largest number of each kind in the settings of a network."""
_WORK = 4.25e9  # weights times tokens of a ViT-B/32
_TRIED = ("a red apple", "the sea at night")  # sentences that mean different things to every network


@dataclass(frozen=True)
class _Family:
    """Differences between networks of two towers.

    pads: sentences are in small letters without punctuation, and padded to the full length
    squashes: pictures are resized to a square, instead of cropped to one
    skips: tokens of the last layer before those of the patches
    """

    model: str
    pads: bool
    squashes: bool
    skips: int
    mean: tuple[float, ...]
    spread: tuple[float, ...]


_FAMILIES = {
    "clip": _Family("CLIPModel", pads=False, squashes=False, skips=1, mean=CLIP_MEAN, spread=CLIP_SPREAD),
    "siglip": _Family("SiglipModel", pads=True, squashes=True, skips=0, mean=(0.5,) * 3, spread=(0.5,) * 3),
}


class Clip:
    """CLIP of the ViT variant, or SigLIP, with frozen weights.

    model, tokenizer: objects of `transformers`
    name: name in messages
    mean, spread: statistics of the sRGB channels in training. None: those that were published.
    work: work of a view, relative to a ViT-B/32
    """

    def __init__(
        self,
        model: Any,
        tokenizer: Any,
        name: str,
        mean: tuple[float, ...] | None = None,
        spread: tuple[float, ...] | None = None,
    ) -> None:
        self._model = model.eval().requires_grad_(False)
        self._tokenizer = tokenizer
        self._family = _FAMILIES[model.config.model_type]
        self.name = name
        self._most_tokens = int(model.config.text_config.max_position_embeddings)
        vision = model.config.vision_config
        self.side = int(vision.image_size)
        weights = sum(weight.numel() for weight in model.vision_model.encoder.parameters())
        self.work = weights * ((self.side // vision.patch_size) ** 2 + 1) / _WORK
        statistics = mean or self._family.mean, spread or self._family.spread
        self._mean, self._spread = (Constant(torch.tensor(part)[:, None, None]) for part in statistics)

    @classmethod
    def load(
        cls,
        source: str | Path,
        name: str | None = None,
        cache: Path | None = None,
        tell: Callable[[str], None] = lambda sentence: None,
        heed: Callable[[], None] = lambda: None,
    ) -> Self:
        """Loads the network in a local folder, or of any of its names (`hub_folder`), or of a file in such a folder.

        Weights are read as safetensors, or from PyTorch's older archive as tensors and nothing else; no code beside
        them is run.
        cache: folder of fetched weights; by default the usual one
        tell, heed: hear of a download; see `hub_folder`
        Raises WeightsError if that fails, ConfigError if transformers is not installed, and what `heed` raises.
        """
        registry.require("words", "transformers", "Seeing through CLIP")
        given, folder = str(source).strip(), None
        file = storage.in_home(given)
        is_file = storage.exists(file) and file.is_file()
        with ExitStack() as stack:
            try:
                folder = stack.enter_context(folder_of_file(file)) if is_file else local_folder(given)
                whole = hub_folder(given, cache, tell, heed) if folder is None else folder
            except (WeightsError, StorageError, OSError, ValueError) as cause:
                raise _refuse(given, cause, here=is_file or folder is not None) from cause
            try:
                if (missing := missing_file(whole)) is not None:
                    raise WeightsError(f"it has no {missing}")
                with quietly():
                    model = _read_model(whole)
                    try:
                        tokenizer = _read_tokenizer(whole, model.config)
                    except Exception as cause:  # `transformers` raises anything
                        raise WeightsError("its tokenizer is cut off, or lacks a file; fetch it again") from cause
                mean, spread = _statistics(whole)
                called = file.name if folder is not None else plain_name(given).removeprefix("openai/")
                clip = cls(model, tokenizer, name or f"CLIP {called}", mean, spread)
                clip._require_sense()
            except Exception as cause:  # `transformers` raises anything for foreign files
                raise _refuse(given, cause, whole, here=folder is not None) from cause
        return clip

    def reads_all(self, prompt: str) -> bool:
        """Returns True if all words fit in the network's tokens: 77 of CLIP, 64 of SigLIP."""
        return len(self._tokenizer(self._plain(prompt), verbose=False)["input_ids"]) <= self._most_tokens

    @torch.no_grad()
    def embed_text(self, prompt: str) -> Tensor:
        """Returns the embedding of words: [d], of unit length. Cuts off words beyond the network's tokens."""
        padding = "max_length" if self._family.pads else False
        tokens = self._tokenizer(
            self._plain(prompt), truncation=True, padding=padding, max_length=self._most_tokens, return_tensors="pt"
        ).to(self._model.device)
        mask = None if self._family.pads else tokens["attention_mask"]  # SigLIP was trained on padded sentences
        found = self._model.get_text_features(tokens["input_ids"], attention_mask=mask)
        return functional.normalize(found.pooler_output[0], dim=0)

    def embed_pictures(self, pictures: Tensor) -> Tensor:
        """Returns embeddings of pictures [n, 3, h, w], sRGB in [0, 1]: [n, d], each of unit length. Differentiable."""
        with half_precision(pictures.device):
            found = self._model.get_image_features(self._as_input(pictures))
        return functional.normalize(found.pooler_output.to(pictures), dim=1)

    def features(self, views: Tensor) -> tuple[Tensor]:
        """Returns the last layer's patches of views [n, 3, h, w], sRGB in [0, 1]: [n, d, g, g]; g = 7 for ViT-B/32.

        Differentiable.
        """
        with half_precision(views.device):
            every = self._model.vision_model(self._as_input(views)).last_hidden_state
        seen = every[:, self._family.skips :]
        cells = round(seen.shape[1] ** 0.5)
        return (seen.transpose(1, 2).reshape(len(seen), -1, cells, cells).to(views),)

    @torch.no_grad()
    def _require_sense(self) -> None:
        """Raises WeightsError unless different sentences, and different pictures, mean different things."""
        try:
            words = torch.stack([self.embed_text(sentence) for sentence in _TRIED])
        except IndexError as cause:
            raise WeightsError("its tokenizer is that of another network") from cause
        noise = torch.rand(2, 3, self.side, self.side, generator=torch.Generator().manual_seed(0))
        for what, found in (("sentences", words), ("pictures", self.embed_pictures(noise))):
            if not bool(found.isfinite().all()):
                raise WeightsError(f"its embeddings of {what} are not finite; take an undamaged copy")
            if bool(torch.equal(found[0], found[1])):
                raise WeightsError(f"all {what} are the same to it; take an undamaged copy")

    def _plain(self, prompt: str) -> str:
        """Returns the prompt as the network's training had it."""
        return " ".join(re.sub(r"[^\w\s]", "", prompt.lower()).split()) if self._family.pads else prompt

    def _as_input(self, pictures: Tensor) -> Tensor:
        """Prepares pictures like the image processor of `transformers`: resize, centre crop, normalisation."""
        _, _, rows, columns = pictures.shape
        scale = self.side / min(rows, columns)
        size = [max(self.side, int(rows * scale)), max(self.side, int(columns * scale))]
        if self._family.squashes:
            size = [self.side, self.side]
        if size != [rows, columns]:
            pictures = functional.interpolate(pictures, size, mode="bicubic", antialias=True).clamp(0, 1)
        top, left = (size[0] - self.side) // 2, (size[1] - self.side) // 2
        middle = pictures[:, :, top : top + self.side, left : left + self.side]
        self._model.to(middle.device)
        return ((middle - self._mean.like(middle)) / self._spread.like(middle)).to(self._model.dtype)


def _refuse(given: str, cause: Exception, folder: Path | None = None, *, here: bool) -> WeightsError:
    """Returns the error about a network that cannot be loaded.

    folder: of its files, whose path the reason leaves out
    here: True if it is on this machine, False if it is on the hub
    """
    said = str(cause) if folder is None else str(cause).replace(f"{folder}/", "")
    reason = " ".join(said.split())[:160].rstrip(".")
    advice = f"give a folder that holds {_FILES}" if here else "check the name and the network, or give a folder"
    return WeightsError(f"{given[:80]} cannot be loaded as CLIP ({reason}); {advice}.")


def _read_model(folder: Path) -> Any:
    """Returns the network of a folder. Raises WeightsError, and what `transformers` raises."""
    import transformers
    from safetensors import SafetensorError

    plain = not is_of_open_clip(folder)
    record = _read_json(folder / "config.json") if plain else clip_settings(_read_json(folder / OPEN_CLIP))
    found = str(record.get("model_type", "nameless"))[:40]
    if found not in _FAMILIES:
        raise WeightsError(f"it is a {found!r} network, not a CLIP or SigLIP")
    kind = getattr(transformers, _FAMILIES[found].model)
    towers = [record] + [record[tower] for tower in ("text_config", "vision_config") if record.get(tower) is not None]
    for tower in towers:
        for name, most in _SIZES.items():
            size = tower.get(name, 1) if isinstance(tower, dict) else None
            if size is not None and not (isinstance(size, int) and 1 <= size <= most):
                raise WeightsError(f"its settings have {name} as {str(size)[:40]}; it is a number from 1 to {most}")
    try:
        settings = kind.config_class.from_dict(record)
    except Exception as cause:  # `transformers` raises anything
        raise WeightsError("config.json is not the settings of such a network; fetch it again") from cause
    how: dict[str, Any] = {"output_loading_info": True, "ignore_mismatched_sizes": True}
    if plain and any(folder.glob("model*.safetensors")):
        how |= {"local_files_only": True, "use_safetensors": True, "dtype": torch.float32}
        try:
            model, told = kind.from_pretrained(folder, config=settings, **how)
        except SafetensorError as cause:
            raise WeightsError("its weights are cut off, or not safetensors; fetch them again") from cause
    else:
        file = folder / "open_clip_model.safetensors"
        if plain:
            tensors = state_dict(folder / "pytorch_model.bin")
        elif file.is_file():
            tensors = clip_tensors(tensor_file.read_tensors(file, "the weights of a CLIP", WeightsError)[0])
        else:
            tensors = clip_tensors(state_dict(folder / "open_clip_pytorch_model.bin"))
        tensors = {name: tensor.float() for name, tensor in tensors.items() if "position_ids" not in name}
        model, told = kind.from_pretrained(None, config=settings, state_dict=tensors, **how)
    missing = sorted(told["missing_keys"])
    if missing:
        raise WeightsError(f"its weights lack {missing[0]}")
    if told["mismatched_keys"]:
        raise WeightsError(f"its weights have {min(told['mismatched_keys'])[0]} in another size than config.json")
    return model


def _read_tokenizer(folder: Path, settings: Any) -> Any:
    """Returns the tokenizer of a folder. Raises what `transformers` raises.

    SigLIP's folders name a class that needs a library besides `transformers`; their tokenizer.json does not.
    """
    from transformers import AutoTokenizer, PreTrainedTokenizerFast

    how: dict[str, Any] = {"local_files_only": True, "trust_remote_code": False}
    try:
        return AutoTokenizer.from_pretrained(folder, **how)
    except (ImportError, ValueError):
        tokenizer = PreTrainedTokenizerFast.from_pretrained(folder, **how)
    if tokenizer.pad_token is None:
        tokenizer.pad_token = tokenizer.convert_ids_to_tokens(settings.text_config.pad_token_id)
    return tokenizer


@contextmanager
def quietly() -> Iterator[None]:
    """Hides bars and reports of `transformers`, which would lie between the lines of the terminal."""
    from transformers import utils

    logging: Any = utils.logging  # has no types

    level, shown = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity(logging.CRITICAL)
    logging.disable_progress_bar()
    try:
        yield
    finally:
        logging.set_verbosity(level)
        if shown:
            logging.enable_progress_bar()


def _statistics(folder: Path) -> tuple[tuple[float, ...] | None, tuple[float, ...] | None]:
    """Returns mean and spread of the channels that the folder tells; None if it does not. Raises WeightsError."""
    if is_of_open_clip(folder):
        path, keys = folder / OPEN_CLIP, ("mean", "std")
        record = _read_json(path).get("preprocess_cfg") or {}
    else:
        path, keys = folder / "preprocessor_config.json", ("image_mean", "image_std")
        record = _read_json(path) if path.is_file() else {}
    if not record:
        return None, None
    try:
        mean, spread = (tuple(float(part) for part in record[key]) for key in keys)
        if len(mean) != 3 or len(spread) != 3 or not all(0 < part < 10 for part in spread):
            raise ValueError(f"{mean}, {spread}")
    except (ValueError, KeyError, TypeError) as cause:
        raise WeightsError(f"{path} does not say {' and '.join(keys)} as three numbers each; mend it") from cause
    return mean, spread


def _read_json(path: Path) -> dict[str, Any]:
    """Returns the object in a JSON file. Raises WeightsError."""
    try:
        record = json.loads(storage.read_bytes(path, "the settings of a CLIP", _MAX_BYTES, WeightsError))
    except (ValueError, RecursionError) as cause:
        raise WeightsError(f"{path.name} is cut off, or not JSON; fetch it again") from cause
    if not isinstance(record, dict):
        raise WeightsError(f"{path.name} is not the settings of a network; fetch it again")
    return record
