"""Words beside a photograph, without a CLIP: their thing becomes a part of it."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.drawing.arrangement import Relation
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.classifiers import EfficientNetLite
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal, ObjectiveContext
from frida_painter.objectives.semantic import SemanticTerm
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.words.reading import Reading, SaidWord, Thing
from frida_painter.words.text import TextTerm
from support.networks import QuickEncoders, index_of, random_lite_tensors

GRID = PixelGrid(CanvasSize.parse("12x9cm"), 48, 64)
WORDS = TextTerm("a strawberry", 2.0)


class Seeing(EfficientNetLite):
    """Sees one class in every picture: 949, a strawberry, or 0, a tench."""

    def __init__(self, number: int) -> None:
        super().__init__(random_lite_tensors())
        self._number = number

    def logits(self, views: torch.Tensor) -> torch.Tensor:
        return 9.0 * torch.nn.functional.one_hot(torch.tensor([self._number] * len(views)), 1000).float()


class SeeingEncoders(QuickEncoders):
    number = 0

    def meaning(self) -> EfficientNetLite:
        return Seeing(self.number)


@pytest.fixture
def encoders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SeeingEncoders:
    monkeypatch.setattr("frida_painter.words.retrieval._FILLED", 2.0)  # these pictograms fill their boxes
    quick = SeeingEncoders()
    monkeypatch.setattr(QuickEncoders, "reads_by_clip", property(lambda self: False))
    quick.own["picture index"] = index_of(tmp_path)
    return quick


def meadow() -> torch.Tensor:
    picture = torch.full((3, 96, 128), 0.6)
    picture[:, 40:] = torch.tensor([0.2, 0.5, 0.2])[:, None, None]
    return picture


def interpret(goal: Goal, encoders: SeeingEncoders) -> Goal:
    return TextTerm.interpret(goal, ObjectiveContext(GRID, encoders, 0))


@pytest.mark.parametrize("kind", [ImageTerm, SemanticTerm])
def test_the_thing_is_in_the_photograph_matters_more_and_takes_the_place_of_the_words(
    kind: type[ImageTerm] | type[SemanticTerm], encoders: SeeingEncoders
) -> None:
    (term,) = interpret(Goal((kind(meadow()), WORDS)), encoders).terms
    assert isinstance(term, kind) and term.weight == 1 and term.picture is not None and term.importance is not None
    changed = (term.picture - meadow()).abs().amax(0) > 0.1
    assert 0.03 < float(changed.float().mean()) < 0.3
    assert float(changed[48:].float().sum()) > 0.5 * float(changed.sum()), "it stands in the lower half"
    red = term.picture[:, changed].mean(1)
    assert float(red[0]) > 0.2 + float(red[2]), "it keeps some of its own colour"
    matters = term.importance
    assert float(matters.mean()) == pytest.approx(1)
    assert float(matters[changed].median()) == pytest.approx(8 * float(matters[0, 0]))
    assert encoders.remarks[0].startswith("Laid into the photograph: 'strawberry'")
    assert encoders.remarks[-1] == "Your words: shown: 'strawberry'."


def test_faces_still_matter_more(encoders: SeeingEncoders) -> None:
    matters = torch.ones(48, 64)
    matters[:8, :8] = 7.0
    (term,) = interpret(Goal((ImageTerm(meadow(), importance=matters / matters.mean()), WORDS)), encoders).terms
    assert term.importance is not None
    assert float(term.importance[2, 2]) == pytest.approx(7 * float(term.importance[2, -2]), rel=0.01)


def test_a_photograph_that_a_painting_begins_with_stays_in_the_goal(encoders: SeeingEncoders) -> None:
    goal = interpret(Goal((WORDS,), (ImageTerm(meadow()),)), encoders)
    (kept,), (begun,) = goal.terms, goal.initial
    assert isinstance(kept, ImageTerm) and isinstance(begun, ImageTerm) and kept.image is begun.image
    assert kept.weight == 20 * WORDS.weight and not torch.equal(begun.image, meadow())


def test_nothing_is_laid_over_what_is_there_already(encoders: SeeingEncoders) -> None:
    encoders.number = 949
    photograph = ImageTerm(meadow())
    assert interpret(Goal((photograph, WORDS)), encoders).terms == (photograph,)
    assert encoders.remarks == ["Your words: shown by something similar: 'strawberry' (by what the photograph shows)."]


def test_what_no_picture_shows_is_told(encoders: SeeingEncoders) -> None:
    photograph = ImageTerm(meadow())
    assert interpret(Goal((photograph, TextTerm("a zygote"))), encoders).terms == (photograph,)
    assert encoders.remarks == ["Your words: not shown: 'zygote'."]


def test_words_beside_a_drawing_on_it_name_the_drawing(encoders: SeeingEncoders) -> None:
    frame = torch.ones(3, 96, 128)
    frame[:, 20:60, 30:33] = 0
    photograph, sketch = ImageTerm(meadow()), SketchTerm(frame)
    assert interpret(Goal((photograph, sketch, WORDS)), encoders).terms == (photograph, sketch)
    assert "adds nothing to the drawing" in encoders.remarks[0]


def night_and_rain(words: str, encoders: SeeingEncoders, importance: torch.Tensor | None = None) -> ImageTerm:
    (term,) = interpret(Goal((ImageTerm(meadow(), importance=importance), TextTerm(words))), encoders).terms
    assert isinstance(term, ImageTerm)
    return term


def test_a_light_lies_over_the_whole_photograph_and_contrasts_stay(encoders: SeeingEncoders) -> None:
    shown = night_and_rain("midnight", encoders).image
    change = shown.mean((1, 2)) / meadow().mean((1, 2))
    assert float(change.max()) < 0.8, "darker"
    assert float(change[2]) > 1.2 * float(change[0]), "and bluer"
    upper, lower = shown[:, :40].mean((1, 2)), shown[:, 40:].mean((1, 2))
    assert float((upper - lower).abs().max()) > 0.1, "and can still be told"
    assert encoders.remarks == [
        "Laid over the photograph: night.",
        "Your words: shown by something similar: 'midnight' (by night).",
    ]


def test_a_thing_and_its_weather_are_both_shown(encoders: SeeingEncoders) -> None:
    alone = night_and_rain("a strawberry", encoders)
    shade = night_and_rain("gloomy", encoders).image / meadow()
    encoders.remarks.clear()
    words = SaidWord(1, "strawberry", "strawberry", "thing"), SaidWord(2, "in", "in", "relation")
    things = Thing("strawberry", "strawberry", at=(1,)), Thing("rain", "rain", at=(4,))
    said = (*words, SaidWord(4, "rain", "rain", "thing"))
    read = Reading(things, (Relation(0, "in", 1, at=(2,)),), (), said)
    encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt: read)
    term = night_and_rain("a strawberry in the rain", encoders)
    fallen = ((term.image - alone.image * shade).amax(0) > 0.05).float()
    assert 0.005 < float(fallen.mean()) < 0.2, "the rain is in marks"
    assert encoders.remarks[0].startswith("Laid into the photograph: 'strawberry'")
    assert "Laid over the photograph: rain." in encoders.remarks
    assert "Your words: shown: 'strawberry', 'in', 'rain'." in encoders.remarks


def test_no_rain_falls_over_faces_and_faces_keep_their_importance(encoders: SeeingEncoders) -> None:
    face = torch.ones(96, 128)
    face[20:70, 30:90] = 7.0
    term = night_and_rain("rain", encoders, face / face.mean())
    assert term.importance is not None
    inside = term.image[:, 45:65, 35:85] / meadow()[:, 45:65, 35:85]
    assert float(inside.std((1, 2)).max()) < 1e-3
    assert float(term.importance[45, 60] / term.importance.amin()) == pytest.approx(7, rel=0.05)


def test_the_same_seed_gives_the_same_rain(encoders: SeeingEncoders) -> None:
    assert torch.equal(night_and_rain("rain", encoders).image, night_and_rain("rain", encoders).image)
