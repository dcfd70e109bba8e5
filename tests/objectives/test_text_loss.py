from types import SimpleNamespace

import pytest
import torch

from frida_painter.frames import PixelGrid
from frida_painter.objectives.interpretation import prepare
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.text_loss import Sight, Text, color_in, holding_weight, wish
from frida_painter.objectives.word_settings import ClipWork, WordSettings
from frida_painter_words.text import TextTerm
from support.networks import QuickEncoders, RandomReader
from support.planning import CANVAS


class Toy:
    """Sees the mean colour, and reads the names of colours."""

    name, side, work = "toy", 24, 1.0

    def reads_all(self, prompt: str) -> bool:
        return True

    def embed_text(self, prompt: str) -> torch.Tensor:
        return torch.eye(3)[["red", "green", "blue"].index(prompt)]

    def embed_pictures(self, pictures: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.normalize(pictures.mean((2, 3)), dim=1)


def flat(*color: float) -> torch.Tensor:
    return torch.tensor(color, dtype=torch.float32)[:, None, None].expand(3, 30, 40).contiguous()


def test_distance_is_the_cosine_distance_of_the_meanings() -> None:
    apart = wish("red", Toy(), WordSettings())(torch.stack((flat(1, 0, 0), flat(0, 1, 0), flat(1, 1, 0))))
    assert torch.allclose(apart, torch.tensor([0.0, 1.0, 1 - 0.5**0.5]), atol=1e-6)


def test_views_come_from_the_seed_and_the_judge_is_steady() -> None:
    picture = torch.rand(3, 30, 40, generator=torch.Generator().manual_seed(1))
    one, two, other = (Text("red", Toy(), seed=seed) for seed in (3, 3, 4))
    assert [float(one(picture)) for _ in range(3)] == [float(two(picture)) for _ in range(3)]
    assert float(one(picture)) != float(other(picture))
    assert float(one.validation(picture)) == float(one.validation(picture))


class Counting(Toy):
    """Counts the views that it sees."""

    def __init__(self) -> None:
        self.seen: list[int] = []

    def embed_pictures(self, pictures: torch.Tensor) -> torch.Tensor:
        self.seen.append(len(pictures))
        return super().embed_pictures(pictures)


def test_a_clip_sees_a_picture_once_for_all_words_and_each_counts_as_if_it_looked_alone() -> None:
    random = torch.rand(3, 30, 40, generator=torch.Generator().manual_seed(1))
    reader, sight = Counting(), Sight()
    apart = [Text(words, Toy(), seed=3) for words in ("red", "blue")]
    together = [Text(words, reader, seed=3, sight=sight) for words in ("red", "blue")]
    found = []
    for texts in (apart, together):
        picture = random.clone().requires_grad_()
        losses = [torch.stack([text(picture) for text in texts]).sum() for _ in range(2)]
        slopes = [torch.autograd.grad(loss, picture)[0] for loss in losses]
        with torch.no_grad():
            steady = sum(text.validation(picture) for text in texts)
            picture.mul_(0.5)  # the same tensor, another picture
            found.append([*losses, *slopes, steady, sum(text.validation(picture) for text in texts)])
    for alone, shared in zip(*found, strict=True):
        torch.testing.assert_close(shared, alone)
    assert reader.seen == [1, 1, 2, 2], "each picture once"


def test_a_clip_sees_few_views_at_first_and_more_of_them_later() -> None:
    reader = Counting()
    red = Text("red", reader, seed=0)
    for _ in range(80):
        red(flat(0.5, 0.5, 0.5))
    assert [reader.seen.count(views) for views in (1, 2, 3, 4)] == [16, 16, 16, 32]
    assert sorted(reader.seen) == reader.seen


@pytest.mark.parametrize(
    ("effort", "work", "found"),
    [
        (1.0, 1.0, ClipWork(4, 24, 10)),  # a processor and a ViT-B/32
        (0.05, 1.0, ClipWork(4, 24, 10)),  # the plan has fewer iterations
        (100.0, 1.0, ClipWork(24, 400, 1)),  # a GPU
        (3.0, 0.001, ClipWork(24, 400, 1)),  # a small network
        (1.0, 18.0, ClipWork(4, 24, 10)),  # a large one on a processor
    ],
)
def test_the_work_of_a_network_follows_the_effort_and_the_network(effort: float, work: float, found: ClipWork) -> None:
    reader = Toy()
    reader.work = work
    assert WordSettings(effort=effort).budget(reader) == found
    more = WordSettings(effort=2 * effort).budget(reader)
    assert more.views >= found.views and more.first_steps >= found.first_steps and more.lasts <= found.lasts


def test_words_move_the_picture_that_they_begin_with_a_little() -> None:
    """The sum of both terms is least about a tenth away, whatever the words' distance is multiplied by."""
    begun = torch.rand(3, 24, 24, generator=torch.Generator().manual_seed(1)) / 4 + 0.4

    class Strong(Toy):
        def embed_pictures(self, pictures: torch.Tensor) -> torch.Tensor:
            return 50 * super().embed_pictures(pictures)

    for reader in (Toy(), Strong()):
        text = Text("red", reader, seed=0)
        weight = holding_weight(text, begun)
        at = begun.clone().requires_grad_()
        for _ in range(60):
            loss = text.validation(at) + weight * (at - begun).square().mean()
            (slope,) = torch.autograd.grad(loss, at)
            at = (at - slope * at.numel() / (4 * weight)).detach().requires_grad_()
        moved = float((at.detach() - begun).square().mean().sqrt())
        assert weight >= 1.0 and moved < 0.25


def test_words_that_are_cut_off_are_told_of_once(monkeypatch: pytest.MonkeyPatch) -> None:
    encoders, grid = QuickEncoders(), PixelGrid.of_height(CANVAS, 24)
    monkeypatch.setattr(encoders, "reader", RandomReader)
    prepare(Goal((TextTerm("ship " * 60),)), grid, encoders)
    assert not encoders.remarks
    prepare(Goal((TextTerm("ship " * 100), TextTerm("ship " * 100))), grid, encoders)
    (remark,) = encoders.remarks
    assert "the last were cut off" in remark and len(remark) < 120


READER, BUDGET = RandomReader(), ClipWork(4, 24, 10)


def test_a_network_finds_its_wish_in_coarse_colours() -> None:
    """A wish for red above blue, by the mean colours of the halves: no network, and known by sight."""

    def wish(pictures: torch.Tensor) -> torch.Tensor:
        upper, lower = pictures.chunk(2, dim=2)
        red, blue = torch.tensor([0.9, 0.1, 0.1]), torch.tensor([0.1, 0.1, 0.9])
        return (upper.mean((2, 3)) - red).square().sum(1) + (lower.mean((2, 3)) - blue).square().sum(1)

    found = color_in(wish, READER, (30, 40), 0, BUDGET)
    assert found.shape == (3, 30, 40) and float(found.min()) >= 0 and float(found.max()) <= 1
    assert float(wish(found[None])) < 0.1
    assert torch.equal(found, color_in(wish, READER, (30, 40), 0, BUDGET))
    hasty = color_in(wish, READER, (30, 40), 0, ClipWork(4, 2, 10))
    assert float(wish(hasty[None])) > 2 * float(wish(found[None]))


def test_a_first_picture_that_takes_longer_is_told_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each step takes a second; from the fourth on other programs take three quarters of the machine."""
    times = iter([0, 9, *range(10, 12), *range(14, 90, 4)])
    monkeypatch.setattr("frida_painter.objectives.text_loss.time", SimpleNamespace(monotonic=lambda: next(times)))
    told: list[str] = []
    color_in(lambda pictures: pictures.mean((1, 2, 3)), READER, (30, 40), 0, ClipWork(4, 9, 10), tell=told.append)
    assert told[0].endswith("in about 7 s; the plan follows.")
    assert len(told) > 1 and told[1].startswith("The first picture takes longer, about ")
