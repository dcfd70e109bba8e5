import math

import pytest
import torch

from downloads import fetched
from frida_painter.objectives.encoders.classifiers import class_names
from frida_painter.objectives.encoders.loading import EncoderRegistry
from support.networks import WordBag, random_reader


def views() -> torch.Tensor:
    return torch.rand(3, 3, 64, 64, generator=torch.Generator().manual_seed(0))


def test_a_picture_means_a_mixture_of_its_classes() -> None:
    reader = random_reader()
    seen = reader.embed_pictures(views())
    assert torch.allclose(seen.norm(dim=1), torch.ones(3), atol=1e-5)
    assert torch.allclose(reader.embed_text("a ship").norm(), torch.ones(()))
    probable = reader._classifier.logits(views()).softmax(1)
    meanings = torch.stack(
        [torch.nn.functional.normalize(WordBag().embed(some).sum(0), dim=0) for some in class_names()]
    )
    expected = torch.nn.functional.normalize(probable @ meanings, dim=1)
    assert torch.allclose(seen, expected, atol=1e-5)


@pytest.mark.parametrize(("prompt", "number"), [("a lighthouse", 437), ("a ladybird", 301), ("a strawberry", 949)])
def test_words_ask_for_the_class_that_has_one_of_their_names(prompt: str, number: int) -> None:
    wanted = random_reader().class_weights(prompt)
    assert float(wanted.sum()) == pytest.approx(1, abs=1e-5)
    assert int(wanted.argmax()) == number and float(wanted[number]) > 0.5


def test_the_distance_is_half_cosine_and_half_cross_entropy_and_has_a_slope_everywhere() -> None:
    reader, pictures = random_reader(), views().requires_grad_()
    apart = reader.distance_to("a strawberry")(pictures)
    apart.sum().backward()
    assert float(pictures.grad.abs().amax((1, 2, 3)).min()) > 0
    cosine = 1 - reader.embed_pictures(views()) @ reader.embed_text("a strawberry")
    seen = reader._classifier.logits(views()).log_softmax(1)
    surprise = -(seen @ reader.class_weights("a strawberry")) / math.log(1000)
    assert torch.allclose(apart, (cosine + surprise) / 2, atol=1e-4)


@pytest.mark.slow
def test_the_real_one_tells_photographs_apart_by_words() -> None:
    import skimage

    for name in ("minilm", "efficientnet-lite0"):
        fetched(name)
    photographs = torch.stack(
        [
            torch.nn.functional.interpolate(
                torch.from_numpy(photo[None, ..., :3].copy()).permute(0, 3, 1, 2).float() / 255, (224, 224)
            )[0]
            for photo in (skimage.data.coffee(), skimage.data.chelsea(), skimage.data.rocket())
        ]
    )
    reader = EncoderRegistry().readers()[0]
    words = torch.stack([reader.embed_text(prompt) for prompt in ("a cup of coffee", "a cat", "a rocket")])
    assert (reader.embed_pictures(photographs) @ words.T).argmax(0).tolist() == [0, 1, 2]


def test_a_thousand_classes_each_with_a_name() -> None:
    names = class_names()
    assert len(names) == 1000
    assert all(name.strip() == name and name for some in names for name in some)
    assert names[437][:2] == ("beacon", "lighthouse") and names[949] == ("strawberry",) and names[0][0] == "tench"
