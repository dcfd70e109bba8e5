"""First pictures of words: by a CLIP, by the settings, or a scene that replaces the words."""

from pathlib import Path

import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, Interrupted, WeightsError
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.clip import Clip
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal, ObjectiveContext
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm
from frida_painter.objectives.text_loss import Text, draw_pyramid, wish
from frida_painter.objectives.word_settings import Beginning, ClipWork, WordSettings
from frida_painter.runs.goals import open_goal
from frida_painter.runs.settle import open_networks, open_planner
from frida_painter.runs.spec import RunSpec
from frida_painter_words.text import TextTerm, initial_composition
from support.networks import NoEncoderRegistry, QuickEncoders, index_of
from support.planning import CANVAS, picture
from tiny_clip import write_clip

GRID = PixelGrid(CanvasSize.parse("12x9cm"), 24, 32)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clip(tmp_path_factory.mktemp("clip"))


@pytest.fixture
def alone(folder: Path, tmp_path: Path) -> EncoderRegistry:
    """A CLIP, and nothing else: no sentence encoder, no classifier, no pictures."""
    return EncoderRegistry(tmp_path, clip=str(folder))


def begin(encoders: EncoderRegistry, beginning: Beginning, *more: ImageTerm) -> Goal:
    goal = Goal((TextTerm("a fox", settings=WordSettings(beginning, effort=0.05)), *more))
    return TextTerm.interpret(goal, ObjectiveContext(GRID, encoders, 0))


class TestAClipAlone:
    @pytest.mark.parametrize("beginning", ["auto", "colors"])
    def test_it_begins_with_coarse_colors_that_it_prefers(self, alone: EncoderRegistry, beginning: Beginning) -> None:
        goal = begin(alone, beginning)
        (first,) = goal.initial
        assert isinstance(first, ImageTerm) and first.image.shape == (3, 24, 32)
        assert alone.remarks == ["Begun with a coarse picture, coloured for the words."]
        judge = Text("a fox", alone.reader(), 99)
        with torch.no_grad():
            levels = [
                torch.randn(12, 3, *cells, generator=torch.Generator().manual_seed(5)) for cells in ((1, 1), (3, 4))
            ]
            others = torch.stack([judge.validation(one) for one in draw_pyramid(levels, 24, 32)])
            assert float(judge.validation(first.image)) < float(others.median())
        again = begin(alone, beginning).initial[0]
        assert isinstance(again, ImageTerm) and torch.equal(again.image, first.image)

    def test_it_begins_with_nothing_or_with_a_picture_beside_the_words(self, alone: EncoderRegistry) -> None:
        assert begin(alone, "nothing").initial == ()
        assert begin(alone, "auto", ImageTerm(torch.rand(3, 24, 32))).initial == ()

    def test_a_scene_needs_more_networks(self, alone: EncoderRegistry) -> None:
        with pytest.raises(ConfigError, match=r"--beginning scene .* `frida-painter models fetch words`, or give"):
            begin(alone, "scene")

    def test_it_validates_what_it_optimised_in_views_that_the_optimiser_never_sees(
        self, alone: EncoderRegistry, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        term = TextTerm("a fox", settings=WordSettings(effort=0.05)).prepare(ObjectiveContext(GRID, alone, 0))
        assert term.recognizes and term.lasts > 1 and term.validation is not None
        seen: list[torch.Tensor] = []
        look = Clip.embed_pictures

        def watch(clip: Clip, pictures: torch.Tensor) -> torch.Tensor:
            seen.append(pictures)
            return look(clip, pictures)

        monkeypatch.setattr(Clip, "embed_pictures", watch)
        picture = torch.rand(3, 24, 32)
        for _ in range(12):
            term.objective(picture)
        count = len(seen)
        first, again = term.validation(picture), term.validation(picture)
        assert torch.equal(first, again)
        held_out = torch.cat(seen[count:])
        apart = torch.cdist(held_out.flatten(1), torch.cat(seen[:count]).flatten(1))
        assert float(apart.min()) > 3 * 0.03 * held_out[0].numel() ** 0.5  # beyond the optimiser's own noise


class TestSettings:
    def test_words_of_absence_are_told_where_to_go(self, alone: EncoderRegistry) -> None:
        context = ObjectiveContext(GRID, alone, 0)
        TextTerm("a fox", settings=WordSettings()).prepare(context)
        TextTerm("a fox without a tail", settings=WordSettings(avoid="a tail")).prepare(context)
        assert not any("--avoid" in remark for remark in alone.remarks)
        TextTerm("a fox without a tail").prepare(context)
        assert "'tail'" in alone.remarks[-1] and "--avoid" in alone.remarks[-1]

    def test_words_to_avoid_are_part_of_the_distance(self, alone: EncoderRegistry) -> None:
        settings = WordSettings(avoid="a dog")
        clip = alone.reader()
        pictures = torch.rand(2, 3, 32, 32)
        said = [1 - clip.embed_pictures(pictures) @ clip.embed_text(one) for one in ("a fox", "a dog")]
        torch.testing.assert_close(wish("a fox", clip, settings)(pictures), said[0] - 0.5 * said[1], atol=1e-5, rtol=0)

    def test_the_first_picture_takes_as_many_steps_as_the_effort_allows(
        self, alone: EncoderRegistry, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        seen: list[int] = []

        def color_in(wish: object, reader: object, size: tuple[int, int], seed: int, budget: ClipWork, *_: object):  # type: ignore[no-untyped-def]
            seen.append(budget.first_steps)
            return torch.zeros(3, *size)

        monkeypatch.setattr("frida_painter_words.text.color_in", color_in)
        for effort in (0.05, 20):
            settings = WordSettings("colors", effort=effort)
            TextTerm.interpret(Goal((TextTerm("a fox", settings=settings),)), ObjectiveContext(GRID, alone, 0))
            assert seen[-1] == settings.budget(alone.reader()).first_steps
        assert seen[0] < seen[1]


def test_a_planner_tells_it_and_a_stop_ends_it(folder: Path) -> None:
    spec = RunSpec.of(goal=[{"text": "a fox"}], clip=str(folder), canvas="12x9cm", strokes=5, render_height=64)
    told: list[str] = []

    def heed() -> None:
        if told:
            raise Interrupted("You stopped.")

    with pytest.raises(Interrupted):
        open_planner(spec, open_goal(spec), open_networks(spec, told.append, heed))
    assert len(told) == 1 and "first picture is coloured" in told[0]


SCENE = PixelGrid.of_height(CANVAS, 48)
WORDS = TextTerm("a strawberry", 2.0)


@pytest.fixture
def encoders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> QuickEncoders:
    monkeypatch.setattr("frida_painter_words.retrieval._FILLED", 2.0)  # these pictograms fill their boxes
    quick = QuickEncoders()
    quick.own["picture index"] = index_of(tmp_path)
    return quick


def test_words_alone_become_their_picture(encoders: QuickEncoders) -> None:
    goal = initial_composition(Goal((WORDS,)), SCENE, encoders)
    (kept,), (begun,) = goal.terms, goal.initial
    assert isinstance(kept, ImageTerm) and isinstance(begun, ImageTerm) and kept.image is begun.image
    assert torch.allclose(begun.image[:, SCENE.rows // 2, SCENE.columns // 2], torch.tensor([1.0, 0, 0]), atol=0.2)
    matters = begun.importance
    assert matters is not None and float(matters.mean()) == pytest.approx(1)
    assert float(matters[SCENE.rows // 2, SCENE.columns // 2]) > 3 * float(matters[0, 0])


def test_several_words_are_one_scene_the_heaviest_first(encoders: QuickEncoders) -> None:
    goal = initial_composition(Goal((TextTerm("an umbrella"), WORDS, TextTerm("an umbrella", 0.5))), SCENE, encoders)
    assert len(goal.terms) == 1 and goal.terms[0].weight == 2
    assert encoders.remarks[1] == "Your words: shown: 'strawberry', 'umbrella'."


def test_a_picture_to_begin_with_needs_no_imagination() -> None:
    goal = Goal((ImageTerm(picture()),))
    assert initial_composition(goal, SCENE, NoEncoderRegistry()) is goal


@pytest.mark.parametrize("is_begun", [False, True])
def test_a_thing_is_laid_into_a_photograph(encoders: QuickEncoders, is_begun: bool) -> None:
    photograph = ImageTerm(torch.full((3, 60, 80), 0.5))
    given = Goal((WORDS,), (photograph,)) if is_begun else Goal((WORDS, photograph))
    goal = initial_composition(given, SCENE, encoders)
    (term,) = goal.terms
    assert isinstance(term, ImageTerm) and bool(goal.initial) is is_begun
    red = (term.image[0] - term.image[2]) > 0.1
    assert 0.05 < float(red.float().mean()) < 0.5 and bool(red[30:].any())
    assert term.importance is not None and float(term.importance[red].mean()) > 3 * float(term.importance[~red].mean())
    unknown = Goal((TextTerm("a zygote"), photograph))
    (term,) = initial_composition(unknown, SCENE, encoders).terms
    assert torch.equal(term.picture, photograph.image) and "'zygote'" in encoders.remarks[-1]  # type: ignore[arg-type]


def test_a_sketch_is_filled_with_the_colours_of_what_the_words_say(encoders: QuickEncoders) -> None:
    frame = torch.ones(3, 60, 80)
    frame[:, 15:45, 20:60] = 0
    frame[:, 18:42, 23:57] = 1
    goal = initial_composition(Goal((WORDS, SketchTerm(frame))), SCENE, encoders)
    sketch, kept = goal.terms
    assert isinstance(sketch, SketchTerm) and isinstance(kept, ImageTerm)
    red, green, blue = kept.image[:, SCENE.rows // 2, SCENE.columns // 2].tolist()
    assert red > 0.9 and max(green, blue) < 0.1, "what the lines enclose"
    assert encoders.remarks[0].startswith("Coloured like: 'strawberry'")
    styled = Goal((WORDS, SketchTerm(frame), StyleTerm(picture())))
    assert len(initial_composition(styled, SCENE, encoders).terms) == 3


def test_into_a_style_picture_that_is_begun_with_the_thing_is_laid(encoders: QuickEncoders) -> None:
    style = torch.linspace(0, 1, SCENE.columns).expand(3, SCENE.rows, -1).contiguous()
    goal = initial_composition(Goal((WORDS, StyleTerm(style)), (StyleTerm(style),)), SCENE, encoders)
    (begun,), kept = goal.initial, goal.terms[-1]
    assert isinstance(begun, ImageTerm) and isinstance(kept, ImageTerm) and kept.image is begun.image
    changed = (begun.image - style).abs().amax(0) > 0.1
    assert 0.05 < float(changed.float().mean()) < 0.6 and float(begun.image.std(0).max()) < 0.02, "a gray style"
    unknown = Goal((TextTerm("a zygote"), StyleTerm(style)), (StyleTerm(style),))
    assert [type(term) for term in initial_composition(unknown, SCENE, encoders).terms] == [StyleTerm]


def test_in_a_style_the_scene_of_words_is_in_its_colours(encoders: QuickEncoders) -> None:
    style = torch.zeros(3, 60, 80)
    style[2], style[0, ::4] = 0.6, 0.5
    begun = initial_composition(Goal((TextTerm("a strawberry"), StyleTerm(style))), SCENE, encoders).terms[-1]
    assert begun.picture is not None and float(begun.picture[1].max()) < 0.1, "no green, as in the style"


@pytest.mark.parametrize("beginning", ["colors", "nothing"])
def test_what_only_a_clip_can_begin_with_is_refused(encoders: QuickEncoders, beginning: str) -> None:
    said = TextTerm("a strawberry", settings=WordSettings(beginning, effort=0.05))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="fetch clip-vit-b-32"):
        TextTerm.interpret(Goal((said,)), ObjectiveContext(SCENE, encoders, 0))


def test_without_any_network_what_helps_is_told(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="models fetch words"):
        TextTerm.interpret(Goal((WORDS,)), ObjectiveContext(SCENE, EncoderRegistry(tmp_path), 0))
