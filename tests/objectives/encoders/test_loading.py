"""Encoders that an installed package brings are taken by name, for what each of them can do."""

from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import WeightsError
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders import loading
from frida_painter.objectives.encoders.loading import Choice, EncoderRegistry
from frida_painter.objectives.interpretation import prepare
from frida_painter.objectives.objective import Goal, ObjectiveContext
from frida_painter.objectives.style import StyleTerm
from frida_painter_words.text import TextTerm
from support.networks import QuickEncoders
from support.planning import picture


class Seeing:
    """Sees the mean colour, wherever it is."""

    name = "mean colours"

    def __init__(self, device: torch.device) -> None:
        self.device = device

    def features(self, views: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return (views,)


class Reading(Seeing):
    """Knows the words "red", and no others."""

    name, side = "colours by name", 16

    def reads_all(self, prompt: str) -> bool:
        return len(prompt) < 20

    def embed_text(self, prompt: str) -> torch.Tensor:
        return torch.tensor([1.0, 0.0, 0.0])

    def embed_pictures(self, pictures: torch.Tensor) -> torch.Tensor:
        colors = pictures.mean((2, 3))
        return colors / colors.norm(dim=1, keepdim=True)


@pytest.fixture
def bring(monkeypatch: pytest.MonkeyPatch) -> Callable[[Any], None]:
    """bring(encoder): an installed package names it as the entry point "own"."""

    def bringing(encoder: Any) -> None:
        class Point(EntryPoint):
            def load(self) -> Any:
                return encoder

        def points(group: str, name: str) -> list[EntryPoint]:
            return [Point("own", "package:encoder", group)] if (group, name) == (loading.GROUP, "own") else []

        monkeypatch.setattr(loading, "entry_points", points)

    return bringing


def test_one_that_reads_is_asked_for_words_and_for_meaning(bring: Callable[[Any], None], tmp_path: Path) -> None:
    bring(Reading)
    encoders = EncoderRegistry(tmp_path, clip="own")
    assert encoders.meaning() is encoders.reader()
    assert encoders.choices == [Choice("meaning", "colours by name"), Choice("words", "colours by name")]
    objective = prepare(Goal((TextTerm("red"),)), PixelGrid.of_height(CanvasSize(0.1, 0.1), 32), encoders)
    red, blue = torch.zeros(2, 3, 32, 32)
    red[0], blue[2] = 1, 1
    assert objective.validation is not None
    assert float(objective.validation(red)) < 0.1 < 0.9 < float(objective.validation(blue))


def test_one_that_only_sees_is_asked_for_meaning_alone(bring: Callable[[Any], None], tmp_path: Path) -> None:
    bring(Seeing)
    encoders = EncoderRegistry(tmp_path, clip="own")
    (seen,) = encoders.meaning().features(picture()[None])
    assert torch.equal(seen, picture()[None])
    with pytest.raises(WeightsError, match=r"fetch clip-vit-b-32"):
        encoders.reader()


def test_its_layers_describe_styles_too(bring: Callable[[Any], None], tmp_path: Path) -> None:
    bring(Seeing)
    grid = PixelGrid.of_height(CanvasSize(0.1, 0.1), 32)
    given, without = QuickEncoders(tmp_path, clip="own"), QuickEncoders(tmp_path)
    judged = [
        float(StyleTerm(picture()).prepare(ObjectiveContext(grid, one, 0)).objective(1 - picture()))
        for one in (given, without)
    ]
    assert abs(judged[0] - judged[1]) > 0.01 * judged[1]
    assert "mean colours" in [choice.used for choice in given.choices]


@pytest.mark.parametrize(
    ("encoder", "says"),
    [(lambda device: 1 / 0, r"'own' cannot be used \(ZeroDivisionError"), (lambda device: 3, "is a int, which sees")],
)
def test_one_that_cannot_be_used_is_told_in_a_sentence(
    bring: Callable[[Any], None], tmp_path: Path, encoder: Any, says: str
) -> None:
    bring(encoder)
    with pytest.raises(WeightsError, match=says):
        EncoderRegistry(tmp_path, clip="own").meaning()
