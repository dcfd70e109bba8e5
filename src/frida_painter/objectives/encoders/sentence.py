"""Sentence encoder MiniLM: the mean over the words of a sentence is its embedding.

Reimers and Gurevych 2019 (Sentence-BERT); Wang et al. 2020 (MiniLM).
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import registry, tensor_file, weights
from frida_painter.errors import StorageError, WeightsError

if TYPE_CHECKING:
    from transformers import BertModel, PreTrainedTokenizerBase


_LONGEST = 256  # tokens, as in training
_AT_A_TIME = 64


class SentenceEncoder:
    """Encoder of sentences: a frozen network of the BERT kind with its tokenizer."""

    def __init__(self, network: BertModel, tokenizer: PreTrainedTokenizerBase) -> None:
        self._network = network.train(False).requires_grad_(False)
        self._tokenizer = tokenizer

    @classmethod
    def load(cls, cache: Path | None = None) -> SentenceEncoder:
        """Loads the fetched MiniLM.

        Raises WeightsError if it is missing, altered or another network, ConfigError if transformers is not
        installed.
        """
        registry.require("words", "transformers", "Painting towards words")
        from transformers import AutoTokenizer, BertConfig, BertModel

        folder, tensors = weights.require("minilm", cache), weights.tensors("minilm", cache)
        tensors.pop("embeddings.position_ids", None)  # only in older files: the numbers 0, 1, 2, ...
        network = BertModel(BertConfig.from_pretrained(folder, local_files_only=True), add_pooling_layer=False)
        wanted = network.state_dict().keys()
        try:
            network.load_state_dict({name: tensors[name] for name in wanted})
        except (KeyError, RuntimeError) as cause:
            raise WeightsError(f"{folder} does not hold the sentence encoder; fetch minilm again.") from cause
        return cls(network, AutoTokenizer.from_pretrained(folder, local_files_only=True))

    def is_cut_off(self, sentence: str) -> bool:
        """Returns True if the sentence is longer than 256 tokens (about 200 words), so its end is cut off."""
        return len(self._tokenizer(sentence, verbose=False)["input_ids"]) > _LONGEST

    @torch.no_grad()
    def embed(self, sentences: Sequence[str]) -> Tensor:
        """Returns embeddings of sentences: [n, d], each of unit length. Cuts off long sentences."""
        found = []
        for first in range(0, len(sentences), _AT_A_TIME):
            batch = self._tokenizer(
                list(sentences[first : first + _AT_A_TIME]),
                padding=True,
                truncation=True,
                max_length=_LONGEST,
                return_tensors="pt",
            )
            read = self._network(**batch).last_hidden_state  # [n, tokens, d]
            real = batch["attention_mask"][..., None].to(read)
            found.append(functional.normalize((read * real).sum(1) / real.sum(1), dim=1))
        return torch.cat(found)

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
