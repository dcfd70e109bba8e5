"""First pictures of coarse colours."""

from types import SimpleNamespace

import pytest
import torch

from frida_painter.objectives.text_loss import color_in
from frida_painter.objectives.word_settings import ClipWork
from support.networks import RandomReader

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


def test_the_time_is_told_after_the_second_step() -> None:
    looks: list[int] = []
    told: list[tuple[int, str]] = []

    def wish(pictures: torch.Tensor) -> torch.Tensor:
        looks.append(len(pictures))
        return pictures.mean((1, 2, 3))

    color_in(wish, READER, (30, 40), 0, ClipWork(4, 5, 10), tell=lambda said: told.append((len(looks), said)))
    ((after, sentence),) = told
    assert after == 2 < len(looks) and sentence.startswith("A first picture is coloured for the words, in about ")


def test_a_first_picture_that_takes_longer_is_told_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each step takes a second; from the fourth on other programs take three quarters of the machine."""
    times = iter([0, 9, *range(10, 12), *range(14, 90, 4)])
    monkeypatch.setattr("frida_painter.objectives.text_loss.time", SimpleNamespace(monotonic=lambda: next(times)))
    told: list[str] = []
    color_in(lambda pictures: pictures.mean((1, 2, 3)), READER, (30, 40), 0, ClipWork(4, 9, 10), tell=told.append)
    assert told[0].endswith("in about 7 s; the plan follows.")
    assert len(told) > 1 and told[1].startswith("The first picture takes longer, about ")
