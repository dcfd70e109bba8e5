from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import torch

from downloads import fetched
from frida_painter.objectives.encoders.sentence import SentenceEncoder

if TYPE_CHECKING:
    from transformers import BertModel, BertTokenizerFast

WORDS = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", "a", "red", "ship", "sails", "at", "sea"]


def _tiny() -> tuple["BertModel", "BertTokenizerFast"]:
    from transformers import BertConfig, BertModel, BertTokenizerFast

    config = BertConfig(
        vocab_size=len(WORDS),
        hidden_size=64,
        num_hidden_layers=2,
        num_attention_heads=2,
        intermediate_size=32,
        max_position_embeddings=256,
    )
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = BertModel(config, add_pooling_layer=False).train(False)
    return network, BertTokenizerFast(vocab={word: number for number, word in enumerate(WORDS)})


@pytest.fixture(scope="module")
def tiny() -> SentenceEncoder:
    network, tokenizer = _tiny()
    return SentenceEncoder(network.state_dict(), tokenizer.backend_tokenizer)


@torch.no_grad()
def test_the_forward_pass_is_that_of_transformers(tiny: SentenceEncoder) -> None:
    network, tokenizer = _tiny()
    words = "a red ship sails at sea"
    read = network(**tokenizer(words, return_tensors="pt")).last_hidden_state[0].mean(0)
    torch.testing.assert_close(tiny.embed([words])[0], torch.nn.functional.normalize(read, dim=0))


def test_sentences_have_unit_length_whatever_stands_beside_them(tiny: SentenceEncoder) -> None:
    alone = tiny.embed(["a ship"])
    beside = tiny.embed(["a red ship sails at sea", "a ship"])
    assert torch.allclose(beside.norm(dim=1), torch.ones(2))
    assert torch.allclose(alone[0], beside[1], atol=1e-6), "padding is no word"
    assert not torch.allclose(beside[0], beside[1], atol=1e-3)


def test_many_sentences_are_embedded_once(tiny: SentenceEncoder, tmp_path: Path, monkeypatch) -> None:
    names = ["a ship", "a sea"]
    first = tiny.embed_once(names, tmp_path / "new")
    with monkeypatch.context() as patch:
        patch.setattr(tiny, "embed", lambda sentences: pytest.fail("they were kept"))
        assert torch.equal(tiny.embed_once(names, tmp_path / "new"), first)
    (kept,) = (tmp_path / "new").iterdir()
    kept.write_bytes(b"damaged")
    assert torch.equal(tiny.embed_once(names, tmp_path / "new"), first), "what is damaged is made anew"
    (tmp_path / "file").write_text("in the way")
    assert torch.equal(tiny.embed_once(names, tmp_path / "file"), first), "where nothing can be kept, it works as well"


def test_the_real_one_knows_what_is_alike() -> None:
    fetched("minilm")
    ship, boat, lemon = SentenceEncoder.load().embed(["a sailing ship", "schooner", "a lemon"])
    assert float(ship @ boat) > 0.6 > 0.4 > float(ship @ lemon)
