"""What a painting of words begins with: without a CLIP the scene replaces the words."""

from pathlib import Path

import pytest
import torch

from frida_painter.errors import ConfigError, WeightsError
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal, ObjectiveContext
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm
from frida_painter.objectives.word_settings import WordSettings
from frida_painter_words.beginnings import initial_composition
from frida_painter_words.text import TextTerm
from support.networks import NoEncoderRegistry, QuickEncoders, index_of
from support.planning import CANVAS, picture

GRID = PixelGrid.of_height(CANVAS, 48)
WORDS = TextTerm("a strawberry", 2.0)


@pytest.fixture
def encoders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> QuickEncoders:
    monkeypatch.setattr("frida_painter_words.retrieval._FILLED", 2.0)  # these pictograms fill their boxes
    quick = QuickEncoders()
    quick.own["picture index"] = index_of(tmp_path)
    return quick


def test_words_alone_become_their_picture(encoders: QuickEncoders) -> None:
    goal = initial_composition(Goal((WORDS,)), GRID, encoders)
    (kept,), (begun,) = goal.terms, goal.initial
    assert isinstance(kept, ImageTerm) and isinstance(begun, ImageTerm) and kept.image is begun.image
    assert torch.allclose(begun.image[:, GRID.rows // 2, GRID.columns // 2], torch.tensor([1.0, 0, 0]), atol=0.2)
    matters = begun.importance
    assert matters is not None and float(matters.mean()) == pytest.approx(1)
    assert float(matters[GRID.rows // 2, GRID.columns // 2]) > 3 * float(matters[0, 0])


def test_several_words_are_one_scene_the_heaviest_first(encoders: QuickEncoders) -> None:
    goal = initial_composition(Goal((TextTerm("an umbrella"), WORDS, TextTerm("an umbrella", 0.5))), GRID, encoders)
    assert len(goal.terms) == 1 and goal.terms[0].weight == 2
    assert encoders.remarks[1] == "Your words: shown: 'strawberry', 'umbrella'."


def test_a_picture_to_begin_with_needs_no_imagination() -> None:
    goal = Goal((ImageTerm(picture()),))
    assert initial_composition(goal, GRID, NoEncoderRegistry()) is goal


@pytest.mark.parametrize("is_begun", [False, True])
def test_a_thing_is_laid_into_a_photograph(encoders: QuickEncoders, is_begun: bool) -> None:
    photograph = ImageTerm(torch.full((3, 60, 80), 0.5))
    given = Goal((WORDS,), (photograph,)) if is_begun else Goal((WORDS, photograph))
    goal = initial_composition(given, GRID, encoders)
    (term,) = goal.terms
    assert isinstance(term, ImageTerm) and bool(goal.initial) is is_begun
    red = (term.image[0] - term.image[2]) > 0.1
    assert 0.05 < float(red.float().mean()) < 0.5 and bool(red[30:].any())
    assert term.importance is not None and float(term.importance[red].mean()) > 3 * float(term.importance[~red].mean())
    unknown = Goal((TextTerm("a zygote"), photograph))
    (term,) = initial_composition(unknown, GRID, encoders).terms
    assert torch.equal(term.picture, photograph.image) and "'zygote'" in encoders.remarks[-1]  # type: ignore[arg-type]


def test_a_sketch_is_filled_with_the_colours_of_what_the_words_say(encoders: QuickEncoders) -> None:
    frame = torch.ones(3, 60, 80)
    frame[:, 15:45, 20:60] = 0
    frame[:, 18:42, 23:57] = 1
    goal = initial_composition(Goal((WORDS, SketchTerm(frame))), GRID, encoders)
    sketch, kept = goal.terms
    assert isinstance(sketch, SketchTerm) and isinstance(kept, ImageTerm)
    red, green, blue = kept.image[:, GRID.rows // 2, GRID.columns // 2].tolist()
    assert red > 0.9 and max(green, blue) < 0.1, "what the lines enclose"
    assert encoders.remarks[0].startswith("Coloured like: 'strawberry'")
    styled = Goal((WORDS, SketchTerm(frame), StyleTerm(picture())))
    assert len(initial_composition(styled, GRID, encoders).terms) == 3


def test_into_a_style_picture_that_is_begun_with_the_thing_is_laid(encoders: QuickEncoders) -> None:
    style = torch.linspace(0, 1, GRID.columns).expand(3, GRID.rows, -1).contiguous()
    goal = initial_composition(Goal((WORDS, StyleTerm(style)), (StyleTerm(style),)), GRID, encoders)
    (begun,), kept = goal.initial, goal.terms[-1]
    assert isinstance(begun, ImageTerm) and isinstance(kept, ImageTerm) and kept.image is begun.image
    changed = (begun.image - style).abs().amax(0) > 0.1
    assert 0.05 < float(changed.float().mean()) < 0.6 and float(begun.image.std(0).max()) < 0.02, "a gray style"
    unknown = Goal((TextTerm("a zygote"), StyleTerm(style)), (StyleTerm(style),))
    assert [type(term) for term in initial_composition(unknown, GRID, encoders).terms] == [StyleTerm]


def test_in_a_style_the_scene_of_words_is_in_its_colours(encoders: QuickEncoders) -> None:
    style = torch.zeros(3, 60, 80)
    style[2], style[0, ::4] = 0.6, 0.5
    begun = initial_composition(Goal((TextTerm("a strawberry"), StyleTerm(style))), GRID, encoders).terms[-1]
    assert begun.picture is not None and float(begun.picture[1].max()) < 0.1, "no green, as in the style"


@pytest.mark.parametrize("beginning", ["colors", "nothing"])
def test_what_only_a_clip_can_begin_with_is_refused(encoders: QuickEncoders, beginning: str) -> None:
    said = TextTerm("a strawberry", settings=WordSettings(beginning, effort=0.05))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="fetch clip-vit-b-32"):
        TextTerm.interpret(Goal((said,)), ObjectiveContext(GRID, encoders, 0))


def test_without_any_network_what_helps_is_told(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="models fetch words"):
        TextTerm.interpret(Goal((WORDS,)), ObjectiveContext(GRID, EncoderRegistry(tmp_path), 0))
