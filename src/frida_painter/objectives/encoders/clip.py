"""CLIP as `transformers` loads it: words and pictures in one space (Radford et al. 2021), without anything unsafe."""

import json
from pathlib import Path
from typing import Any, Self

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import extras, storage
from frida_painter.devices import Constant, half_precision
from frida_painter.errors import WeightsError
from frida_painter.objectives.encoders.clip_resnet import MEAN, SPREAD
from frida_painter.weights.sources import Hub

_MOST_BYTES = 2**20  # of a settings file
_FILES = "config.json, model.safetensors and tokenizer.json"


class Clip:
    """A CLIP of the ViT kind with frozen weights.

    model, tokenizer: of `transformers`; name: as a person is told; mean, spread: of the sRGB
    channels, as it was trained with.
    """

    def __init__(
        self,
        model: Any,
        tokenizer: Any,
        name: str,
        mean: tuple[float, ...] = MEAN,
        spread: tuple[float, ...] = SPREAD,
    ) -> None:
        self._model = model.eval().requires_grad_(False)
        self._tokenizer = tokenizer
        self.name = name
        self.side = int(model.config.vision_config.image_size)
        self._mean, self._spread = (Constant(torch.tensor(part)[:, None, None]) for part in (mean, spread))

    @classmethod
    def load(cls, source: str | Path, name: str | None = None) -> Self:
        """The CLIP in a folder of this machine, or of that name on the hub that `transformers` uses.

        Weights are opened as safetensors only and no code that comes with them is run. Raises
        WeightsError where that is not possible, ConfigError where transformers is not installed.
        """
        extras.require("words", "transformers", "Seeing through CLIP")
        from safetensors import SafetensorError
        from transformers import AutoConfig, AutoTokenizer, CLIPModel

        given = str(source)
        folder = Path(source).is_dir()
        local = folder or _is_here(given)
        try:
            if not local:
                Hub(given, "main").require("config.json")
            settings = AutoConfig.from_pretrained(given, local_files_only=local, trust_remote_code=False)
            if settings.model_type != "clip":
                raise WeightsError(f"it is a {settings.model_type!r} network")
            model = CLIPModel.from_pretrained(
                given, config=settings, local_files_only=local, use_safetensors=True, dtype=torch.float32
            )
            tokenizer = AutoTokenizer.from_pretrained(given, local_files_only=local, trust_remote_code=False)
        except (OSError, ValueError, KeyError, TypeError, RuntimeError, SafetensorError, WeightsError) as cause:
            reason = " ".join(str(cause).split())[:160].rstrip(".")
            advice = f"a folder holds {_FILES}" if folder else "fetch it where there is a network, or give a folder"
            raise WeightsError(f"{given} cannot be loaded as CLIP ({reason}); {advice}.") from cause
        mean, spread = _statistics(Path(source)) if folder else (MEAN, SPREAD)
        return cls(model, tokenizer, name or f"CLIP {Path(source).name}", mean, spread)

    def reads_all(self, prompt: str) -> bool:
        """Whether all of the words are read; those beyond the network's 77 tokens are cut off."""
        return len(self._tokenizer(prompt)["input_ids"]) <= self._most_tokens

    @torch.no_grad()
    def embed_text(self, prompt: str) -> Tensor:
        """The meaning of words, [d], of unit length; what goes beyond the 77 tokens that it can read is cut off."""
        tokens = self._tokenizer(prompt, truncation=True, max_length=self._most_tokens, return_tensors="pt").to(
            self._model.device
        )
        found = self._model.get_text_features(tokens["input_ids"], attention_mask=tokens["attention_mask"])
        return functional.normalize(found.pooler_output[0], dim=0)

    def embed_pictures(self, pictures: Tensor) -> Tensor:
        """What pictures [n, 3, h, w], sRGB in [0, 1], show: [n, d], each of unit length; differentiable."""
        with half_precision(pictures.device):
            found = self._model.get_image_features(self._as_input(pictures))
        return functional.normalize(found.pooler_output.to(pictures), dim=1)

    def features(self, views: Tensor) -> tuple[Tensor]:
        """What is seen where in views [n, 3, h, w], sRGB in [0, 1]: the last layer's patches, [n, d, g, g].

        Differentiable. g = 7 for ViT-B/32.
        """
        with half_precision(views.device):
            every = self._model.vision_model(self._as_input(views)).last_hidden_state
        seen = every[:, 1:]  # the first one is the summary
        cells = round(seen.shape[1] ** 0.5)
        return (seen.transpose(1, 2).reshape(len(seen), -1, cells, cells).to(views),)

    @property
    def _most_tokens(self) -> int:
        return int(self._model.config.text_config.max_position_embeddings)

    def _as_input(self, pictures: Tensor) -> Tensor:
        """As the image processor of `transformers` does it: the shorter side resized, the middle, normalised."""
        _, _, rows, columns = pictures.shape
        scale = self.side / min(rows, columns)
        size = [max(self.side, int(rows * scale)), max(self.side, int(columns * scale))]
        if size != [rows, columns]:
            pictures = functional.interpolate(pictures, size, mode="bicubic", antialias=True).clamp(0, 1)
        top, left = (size[0] - self.side) // 2, (size[1] - self.side) // 2
        middle = pictures[:, :, top : top + self.side, left : left + self.side]
        self._model.to(middle.device)
        return ((middle - self._mean.like(middle)) / self._spread.like(middle)).to(self._model.dtype)


def _is_here(name: str) -> bool:
    """Whether `transformers` has fetched that name before."""
    from transformers import AutoConfig

    try:
        AutoConfig.from_pretrained(name, local_files_only=True, trust_remote_code=False)
    except (OSError, ValueError, KeyError, TypeError):
        return False
    return True


def _statistics(folder: Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Mean and spread of the channels, as the folder says them, else the published ones. Raises WeightsError."""
    path = folder / "preprocessor_config.json"
    if not path.is_file():
        return MEAN, SPREAD
    try:
        record = json.loads(storage.read_bytes(path, "the settings of CLIP's pictures", _MOST_BYTES, WeightsError))
        mean, spread = (tuple(float(part) for part in record[key]) for key in ("image_mean", "image_std"))
        if len(mean) != 3 or len(spread) != 3 or not all(0 < part < 10 for part in spread):
            raise ValueError(f"{mean}, {spread}")
    except (ValueError, KeyError, TypeError) as cause:
        raise WeightsError(f"{path} does not say image_mean and image_std as three numbers each; mend it.") from cause
    return mean, spread
