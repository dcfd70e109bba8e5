"""First pictures of words, chosen by the settings or by the CLIP that reads the words; it needs no other network."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from frida_painter import images
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, Interrupted
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.clip import Clip
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal, ObjectiveContext
from frida_painter.objectives.text_loss import Text, wish
from frida_painter.objectives.word_settings import Beginning, WordSettings
from frida_painter.planning.planner import Planner
from frida_painter.runs.goals import open_goal
from frida_painter.runs.settle import open_planner
from frida_painter.runs.spec import RunSpec
from frida_painter.words.pyramid import color_in, draw_pyramid
from frida_painter.words.text import TextTerm
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
    goal = Goal((TextTerm("a fox", settings=WordSettings(beginning)), *more))
    return TextTerm.interpret(goal, ObjectiveContext(GRID, encoders, 0))


class TestAClipAlone:
    @pytest.mark.parametrize("beginning", ["auto", "colors"])
    def test_it_begins_with_coarse_colors_that_it_prefers(self, alone: EncoderRegistry, beginning: Beginning) -> None:
        goal = begin(alone, beginning)
        (first,) = goal.initial
        assert isinstance(first, ImageTerm) and first.image.shape == (3, 24, 32)
        assert alone.remarks == ["Begun with a coarse picture, coloured for the words."]
        judge = Text("a fox", alone.readers(), 99)
        with torch.no_grad():
            levels = [
                torch.randn(12, 3, *cells, generator=torch.Generator().manual_seed(5)) for cells in ((1, 1), (3, 4))
            ]
            others = torch.stack([judge.validation(one) for one in draw_pyramid(levels, 24, 32)])
            assert float(judge.validation(first.image)) < float(others.median())
        again = begin(alone, beginning).initial[0]
        assert isinstance(again, ImageTerm) and torch.equal(again.image, first.image)

    def test_it_begins_with_nothing(self, alone: EncoderRegistry) -> None:
        assert begin(alone, "nothing").initial == ()

    def test_a_picture_beside_the_words_is_the_beginning(self, alone: EncoderRegistry) -> None:
        assert begin(alone, "auto", ImageTerm(torch.rand(3, 24, 32))).initial == ()

    def test_a_scene_needs_more_networks(self, alone: EncoderRegistry) -> None:
        with pytest.raises(ConfigError, match=r"--beginning scene .* `frida-painter models fetch words`, or give"):
            begin(alone, "scene")

    def test_it_validates_what_it_optimised_in_views_that_the_optimiser_never_sees(
        self, alone: EncoderRegistry, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        term = TextTerm("a fox").prepare(ObjectiveContext(GRID, alone, 0))
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

    @pytest.mark.slow
    def test_the_time_of_a_plan_is_measured_before_it_begins_and_changes_nothing(self, folder: Path) -> None:
        def planner(words: str) -> Planner:
            goal = [{"image": str(folder / "ground.png")}, *([{"text": words}] if words else [])]
            spec = RunSpec.of(goal=goal, strokes=6, colors=2, canvas="12x9cm", render_height=64, effort=0.05,
                              clip=str(folder) if words else None)  # fmt: skip
            return open_planner(spec, open_goal(spec))

        images.save(torch.rand(3, 30, 40, generator=torch.Generator().manual_seed(0)), folder / "ground.png")
        timed, other = planner("a fox"), planner("a fox")
        short, long = timed.measure_clip_plan(6), timed.measure_clip_plan(60)
        assert short is not None and long is not None and 0 < short < 60
        assert timed.plan(timed.bare, 6, 2).digest == other.plan(other.bare, 6, 2).digest
        assert planner("").measure_clip_plan(6) is None, "no network reads anything"


class TestSettings:
    def test_words_of_absence_are_told_where_to_go(self, alone: EncoderRegistry) -> None:
        context = ObjectiveContext(GRID, alone, 0)
        TextTerm("a fox", settings=WordSettings()).prepare(context)
        TextTerm("a fox without a tail", settings=WordSettings(avoid="a tail")).prepare(context)
        assert not any("--avoid" in remark for remark in alone.remarks)
        TextTerm("a fox without a tail").prepare(context)
        assert "hardly understands 'without': name what must not be seen with --avoid." in alone.remarks[-1]

    def test_phrases_and_words_to_avoid_are_part_of_the_distance(self, alone: EncoderRegistry) -> None:
        settings = WordSettings(avoid="a dog", phrases=("{}", "art of {}"))
        (clip,) = alone.readers()
        pictures = torch.rand(2, 3, 32, 32)

        said = [
            1 - clip.embed_pictures(pictures) @ clip.embed_text(words) for words in ("a fox", "art of a fox", "a dog")
        ]
        torch.testing.assert_close(
            wish("a fox", clip, settings)(pictures), (said[0] + said[1]) / 2 - 0.5 * said[2], atol=1e-5, rtol=0
        )

    def test_the_first_picture_takes_as_many_steps_as_asked_for(
        self, alone: EncoderRegistry, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        looks: list[int] = []
        look = Clip.embed_pictures

        def watch(clip: Clip, pictures: torch.Tensor) -> torch.Tensor:
            looks.append(1)
            return look(clip, pictures)

        alone.clip()  # it is tried once when it is loaded
        monkeypatch.setattr(Clip, "embed_pictures", watch)
        for steps in (4, 10):
            goal = Goal((TextTerm("a fox", settings=WordSettings("colors", first_steps=steps)),))
            TextTerm.interpret(goal, ObjectiveContext(GRID, alone, 0))
            looks.append(0)
        few = looks.index(0)
        assert len(looks) - 2 - 2 * few == 6

    @pytest.mark.parametrize("phrase", ["a painting", "{} and {}"])
    def test_a_phrase_has_one_place_for_the_words(self, phrase: str) -> None:
        with pytest.raises(ConfigError, match=r"it has {} once, in the place of the words"):
            WordSettings(phrases=(phrase,))


class TestCoarseColors:
    def test_a_network_finds_its_wish_in_them(self, alone: EncoderRegistry) -> None:
        """A wish for red above blue, by the mean colours of the halves: no network, and known by sight."""

        def wish(pictures: torch.Tensor) -> torch.Tensor:
            upper, lower = pictures.chunk(2, dim=2)
            red, blue = torch.tensor([0.9, 0.1, 0.1]), torch.tensor([0.1, 0.1, 0.9])
            return (upper.mean((2, 3)) - red).square().sum(1) + (lower.mean((2, 3)) - blue).square().sum(1)

        found = color_in(wish, alone.readers()[0], (30, 40), 0)
        assert found.shape == (3, 30, 40) and float(found.min()) >= 0 and float(found.max()) <= 1
        assert float(wish(found[None])) < 0.1
        assert torch.equal(found, color_in(wish, alone.readers()[0], (30, 40), 0))
        hasty = color_in(wish, alone.readers()[0], (30, 40), 0, steps=2)
        assert float(wish(hasty[None])) > 2 * float(wish(found[None]))

    def test_the_time_is_told_after_the_second_step(self, alone: EncoderRegistry) -> None:
        looks: list[int] = []
        told: list[tuple[int, str]] = []

        def wish(pictures: torch.Tensor) -> torch.Tensor:
            looks.append(len(pictures))
            return pictures.mean((1, 2, 3))

        color_in(wish, alone.readers()[0], (30, 40), 0, steps=5, tell=lambda said: told.append((len(looks), said)))
        ((after, sentence),) = told
        assert after == 2 < len(looks) and sentence.startswith("A first picture is coloured for the words, in about ")

    def test_a_first_picture_that_takes_longer_is_told_anew(
        self, alone: EncoderRegistry, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Each step takes a second; from the fourth on other programs take three quarters of the machine."""
        times = iter([0, 9, *range(10, 12), *range(14, 90, 4)])
        monkeypatch.setattr("frida_painter.words.pyramid.time", SimpleNamespace(monotonic=lambda: next(times)))
        told: list[str] = []
        color_in(lambda pictures: pictures.mean((1, 2, 3)), alone.readers()[0], (30, 40), 0, steps=9, tell=told.append)
        assert told[0].endswith("in about 7 s; the plan follows.")
        assert len(told) > 1 and told[1].startswith("The first picture takes longer, about ")

    def test_a_stop_ends_it(self, folder: Path) -> None:
        spec = RunSpec.of(goal=[{"text": "a fox"}], clip=str(folder), canvas="12x9cm", strokes=5, render_height=64)
        told: list[str] = []

        def heed() -> None:
            if told:
                raise Interrupted("You stopped.")

        with pytest.raises(Interrupted):
            open_planner(spec, open_goal(spec), tell=told.append, heed=heed)
        assert len(told) == 1

    def test_a_planner_tells_it(self, folder: Path) -> None:
        spec = RunSpec.of(goal=[{"text": "a fox"}], clip=str(folder), canvas="12x9cm", strokes=5, render_height=64)
        told: list[str] = []
        open_planner(spec, open_goal(spec), tell=told.append)
        assert sum("first picture is coloured" in sentence for sentence in told) == 1
