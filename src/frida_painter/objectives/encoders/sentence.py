"""Sentence encoder MiniLM: the mean over the words of a sentence is its embedding.

Reimers and Gurevych 2019 (Sentence-BERT); Wang et al. 2020 (MiniLM). The network is BERT's (Devlin et al. 2019); its
forward pass stands here because the import of a library for it takes longer than all else in a first picture.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import registry
from frida_painter.errors import StorageError, WeightsError
from frida_painter.objectives import weights
from frida_painter.system import tensor_file

if TYPE_CHECKING:
    from tokenizers import Tokenizer


_LONGEST = 256  # tokens, as in training
_AT_A_TIME = 64
_HEAD = 32  # numbers of a head of attention
_EPSILON = 1e-12


class SentenceEncoder:
    """Encoder of sentences: a frozen network of the BERT kind, by its tensors, with its tokenizer."""

    def __init__(self, tensors: Mapping[str, Tensor], tokenizer: Tokenizer) -> None:
        self._tensors, self._tokenizer = tensors, tokenizer
        tokenizer.no_padding()
        tokenizer.enable_truncation(_LONGEST)
        self._layers = len({name.split(".")[2] for name in tensors if name.startswith("encoder.layer.")})

    @classmethod
    def load(cls, cache: Path | None = None) -> SentenceEncoder:
        """Loads the fetched MiniLM.

        Raises WeightsError if it is missing, altered or another network, ConfigError if tokenizers is not
        installed.
        """
        registry.require("words", "tokenizers", "Painting towards words")
        from tokenizers import Tokenizer

        tensors = weights.tensors("minilm", cache)
        path = weights.cache_folder(cache) / "minilm" / "tokenizer.json"
        try:
            encoder = cls(tensors, Tokenizer.from_file(str(path)))
            encoder.embed(["a fox"])
        except Exception as cause:  # `tokenizers` raises plain exceptions
            raise WeightsError(f"{path.parent} does not hold the sentence encoder; fetch minilm again.") from cause
        return encoder

    def embed(self, sentences: Sequence[str]) -> Tensor:
        """Returns embeddings of sentences: [n, d], each of unit length. Cuts off those beyond 256 tokens."""
        numbers = [encoded.ids for encoded in self._tokenizer.encode_batch(list(sentences))]
        of_length = defaultdict[int, list[int]](list)  # sentences of one length need no padding
        for at, one in enumerate(numbers):
            of_length[len(one)].append(at)
        found: dict[int, Tensor] = {}
        for same in of_length.values():
            for first in range(0, len(same), _AT_A_TIME):
                batch = same[first : first + _AT_A_TIME]
                found |= zip(batch, self._read(torch.tensor([numbers[at] for at in batch])), strict=True)
        return torch.stack([found[at] for at in range(len(numbers))])

    @torch.no_grad()
    def _read(self, numbers: Tensor) -> Tensor:
        """Returns embeddings [n, d] of sentences of one length, by the numbers of their tokens [n, tokens]."""
        table, count = self._tensors, numbers.shape[1]
        x = table["embeddings.word_embeddings.weight"][numbers]
        x = (
            x
            + table["embeddings.position_embeddings.weight"][:count]
            + table["embeddings.token_type_embeddings.weight"][0]
        )
        x = self._norm(x, "embeddings.LayerNorm")
        for layer in (f"encoder.layer.{number}" for number in range(self._layers)):
            parts = (self._linear(x, f"{layer}.attention.self.{part}") for part in ("query", "key", "value"))
            query, key, value = (part.reshape(*part.shape[:2], -1, _HEAD).transpose(1, 2) for part in parts)
            seen = functional.scaled_dot_product_attention(query, key, value).transpose(1, 2).flatten(2)
            x = self._norm(
                x + self._linear(seen, f"{layer}.attention.output.dense"), f"{layer}.attention.output.LayerNorm"
            )
            inner = functional.gelu(self._linear(x, f"{layer}.intermediate.dense"))
            x = self._norm(x + self._linear(inner, f"{layer}.output.dense"), f"{layer}.output.LayerNorm")
        return functional.normalize(x.mean(1), dim=1)

    def _linear(self, x: Tensor, name: str) -> Tensor:
        return functional.linear(x, self._tensors[f"{name}.weight"], self._tensors[f"{name}.bias"])

    def _norm(self, x: Tensor, name: str) -> Tensor:
        weight, bias = self._tensors[f"{name}.weight"], self._tensors[f"{name}.bias"]
        return functional.layer_norm(x, x.shape[-1:], weight, bias, _EPSILON)

    def embed_once(self, sentences: Sequence[str], keep: Path) -> Tensor:
        """Returns embeddings of sentences, cached in a file in the folder `keep`.

        A damaged or unfit file is replaced. If the folder cannot be written, there is no cache.
        """
        mark = hashlib.sha256("\n".join(sentences).encode()).hexdigest()[:16]
        path = keep / f"sentences-{mark}.safetensors"
        try:
            kept = tensor_file.read_tensors(path, "embedded sentences", StorageError)[0].get("meanings")
            if kept is not None and len(kept) == len(sentences):
                return kept
        except StorageError:
            pass
        meanings = self.embed(sentences)
        with contextlib.suppress(StorageError):
            tensor_file.write_tensors(path, {"meanings": meanings})
        return meanings
