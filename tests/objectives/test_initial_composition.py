from pathlib import Path

import pytest
import torch

from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.grounds import ground_of
from frida_painter.objectives.initial_composition import initial_composition
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.sketch import SketchTerm
from frida_painter.objectives.kinds.style import StyleTerm
from frida_painter.objectives.kinds.text import TextTerm
from frida_painter.objectives.pictograms import Pictograms
from networks import NoEncoderRegistry, QuickEncoders, WordBag, write_pictograms
from scenes import CANVAS, picture

GRID = PixelGrid.of_height(CANVAS, 48)


@pytest.fixture
def encoders(tmp_path: Path) -> QuickEncoders:
    archive = write_pictograms(tmp_path / "pictograms.zip")
    quick = QuickEncoders()
    quick.pictograms = lambda: Pictograms(archive, WordBag(), tmp_path)  # type: ignore[method-assign]
    return quick


def test_words_alone_begin_with_their_pictogram_which_stays_in_the_goal(encoders: QuickEncoders) -> None:
    goal = initial_composition(Goal((TextTerm("a strawberry", 2.0),)), GRID, encoders, 0)
    words, kept = goal.terms
    (begun,) = goal.initial
    assert isinstance(words, TextTerm) and isinstance(kept, ImageTerm) and isinstance(begun, ImageTerm)
    assert kept.image is begun.image and begun.image.shape == (3, GRID.rows, GRID.columns)
    assert torch.allclose(begun.image[:, GRID.rows // 2, GRID.columns // 2], torch.tensor([1.0, 0, 0]), atol=1e-3)
    assert any("OpenMoji" in remark and "CC BY-SA 4.0" in remark for remark in encoders.remarks)


class Wants:
    """A reader to whom all words mean one colour: how red, green and blue a picture is in the mean."""

    name, side = "wants a colour", 16

    def __init__(self, *color: float) -> None:
        self.color = torch.nn.functional.normalize(torch.tensor(color), dim=0)

    def reads_all(self, prompt: str) -> bool:
        return True

    def embed_text(self, prompt: str) -> torch.Tensor:
        return self.color

    def embed_pictures(self, pictures: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.normalize(pictures.mean((2, 3)), dim=1)


def test_without_a_pictogram_there_is_the_ground(encoders: QuickEncoders, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoders, "readers", lambda: (Wants(0.0, 0.5, 1.0),))
    (begun,) = initial_composition(Goal((TextTerm("a ship on the sea"),)), GRID, encoders, 0).initial
    assert torch.equal(begun.image, ground_of(["a ship"], WordBag()).picture(GRID))
    assert "No pictogram was found for 'a ship'; begun with the sea alone" in encoders.remarks[0]


def test_for_a_thing_that_no_pictogram_is_called_there_is_what_looks_most_like_it(
    encoders: QuickEncoders, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(encoders, "readers", lambda: (Wants(1.0, 0.0, 0.0),))
    (begun,) = initial_composition(Goal((TextTerm("a barn"),)), GRID, encoders, 0).initial
    assert torch.allclose(begun.image[:, GRID.rows // 2, GRID.columns // 2], torch.tensor([1.0, 0, 0]), atol=1e-3)
    assert "No pictogram is called 'a barn'; begun with 'strawberry' on bare paper" in encoders.remarks[0]


def test_a_colour_in_the_words_is_that_of_the_thing(encoders: QuickEncoders) -> None:
    (begun,) = initial_composition(Goal((TextTerm("a blue strawberry on a table"),)), GRID, encoders, 0).initial
    red, _, blue = begun.image[:, GRID.rows // 2, GRID.columns // 2].tolist()
    assert blue > 0.6 and red < 0.3
    assert "'strawberry' in blue on" in encoders.remarks[0]


@pytest.mark.parametrize(("wants", "says"), [((0.0, 0.4, 1.0), " in blue on"), ((1.0, 0.0, 0.0), "'strawberry' on")])
def test_networks_that_are_much_surer_in_another_colour_give_it(
    encoders: QuickEncoders, monkeypatch: pytest.MonkeyPatch, wants: tuple[float, ...], says: str
) -> None:
    monkeypatch.setattr(encoders, "readers", lambda: (Wants(*wants),))
    initial_composition(Goal((TextTerm("a strawberry"),)), PixelGrid.of_height(CanvasSize(0.1, 0.1), 48), encoders, 0)
    assert says in encoders.remarks[0]


def test_a_picture_to_begin_with_needs_no_imagination() -> None:
    with_photo = Goal((TextTerm("a strawberry"), ImageTerm(picture())))
    begun = Goal((TextTerm("a strawberry"),), (ImageTerm(picture()),))
    for goal in (with_photo, begun, Goal((ImageTerm(picture()),))):
        assert initial_composition(goal, GRID, NoEncoderRegistry(), 0) is goal


def test_a_sketch_is_filled_with_the_colours_of_what_the_words_say(encoders: QuickEncoders) -> None:
    frame = torch.ones(3, 60, 80)
    frame[:, 15:45, 20:60] = 0
    frame[:, 18:42, 23:57] = 1
    goal = initial_composition(Goal((TextTerm("a strawberry"), SketchTerm(frame))), GRID, encoders, 0)
    _, sketch, kept = goal.terms
    (begun,) = goal.initial
    assert isinstance(sketch, SketchTerm) and isinstance(kept, ImageTerm) and isinstance(begun, ImageTerm)
    red, green, blue = begun.image[:, GRID.rows // 2, GRID.columns // 2].tolist()
    assert red > 0.9 and max(green, blue) < 0.1, "what the lines enclose"
    assert float(begun.image[:, 2, 2].min()) > 0.9, "the ground"
    assert encoders.remarks[0].startswith("Coloured like the pictogram 'strawberry'")
    styled = Goal((TextTerm("a strawberry"), SketchTerm(frame), StyleTerm(picture())))
    assert initial_composition(styled, GRID, encoders, 0) is styled, "a style has colours of its own"


def test_words_to_begin_with_have_a_picture_first(encoders: QuickEncoders) -> None:
    goal = initial_composition(Goal((StyleTerm(picture()),), (TextTerm("a strawberry"),)), GRID, encoders, 0)
    assert [type(term) for term in goal.initial] == [ImageTerm, TextTerm]
    assert [type(term) for term in goal.terms] == [StyleTerm]


def test_grounds_are_bands_between_which_the_horizon_lies() -> None:
    sea = ground_of(["a ship"], WordBag())
    shown = sea.picture(GRID)
    assert torch.allclose(shown[:, 0, 0], torch.tensor(sea.above)) and torch.allclose(
        shown[:, -1, 0], torch.tensor(sea.below)
    )
    assert ground_of(["zygote"], WordBag()).name == "bare paper"


def test_several_of_a_thing_and_a_second_thing_are_all_there(encoders: QuickEncoders) -> None:
    for words, count in (("two strawberry", 2), ("strawberrys", 3), ("a strawberry with a red strawberry", 2)):
        encoders.remarks.clear()
        (begun,) = initial_composition(Goal((TextTerm(words),)), GRID, encoders, 0).initial
        red = (begun.image[0] > 0.7) & (begun.image[1] < 0.2)
        middle = red[GRID.rows // 2 + 4].int()
        assert int((middle.diff() == 1).sum()) == count, encoders.remarks


def test_what_has_no_look_of_its_own_is_what_its_name_is_nearest_to(
    encoders: QuickEncoders, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(encoders, "readers", lambda: (Wants(1.0, 1.0, 1.0),))
    (begun,) = initial_composition(Goal((TextTerm("strawberry happiness hope peace"),)), GRID, encoders, 0).initial
    assert "begun with the pictogram 'strawberry', whose name is nearest in meaning" in encoders.remarks[0]
    assert torch.allclose(begun.image[:, GRID.rows // 2, GRID.columns // 2], torch.tensor([1.0, 0, 0]), atol=1e-3)


def test_in_a_style_picture_that_is_begun_with_the_thing_is_seen_and_matters_most(encoders: QuickEncoders) -> None:
    style = torch.linspace(0, 1, GRID.columns).expand(3, GRID.rows, -1).contiguous()
    goal = initial_composition(
        Goal((TextTerm("a strawberry"), StyleTerm(style)), (StyleTerm(style),)), GRID, encoders, 0
    )
    (begun,), kept = goal.initial, goal.terms[-1]
    assert isinstance(begun, ImageTerm) and isinstance(kept, ImageTerm) and kept.image is begun.image
    assert begun.importance is not None and kept.weight > 1
    changed = (begun.image - style).abs().amax(0) > 0.1
    assert 0.05 < float(changed.float().mean()) < 0.6
    assert float(begun.importance[changed].mean()) > 3 * float(begun.importance[~changed].mean())
    assert float(begun.image.std(0).max()) < 0.02, "a gray style has gray things"
    assert "laid into the style picture" in encoders.remarks[0] and "CC BY-SA 4.0" in encoders.remarks[0]
    unknown = Goal((TextTerm("a zygote"), StyleTerm(style)), (StyleTerm(style),))
    assert initial_composition(unknown, GRID, encoders, 0) is unknown
    assert "begun with the style picture alone" in encoders.remarks[1]
