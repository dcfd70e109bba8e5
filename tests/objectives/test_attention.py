import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.objectives import attention
from frida_painter.objectives.attention import (
    importance,
    importance_of,
    start_from_meaning,
    weight_by_focus,
)
from frida_painter.objectives.faces import Face
from frida_painter.objectives.image import ImageTerm, spread
from frida_painter.objectives.objective import Goal, Term
from frida_painter.objectives.semantic import SemanticTerm
from frida_painter.objectives.style import StyleTerm
from support.networks import NoEncoderRegistry, QuickEncoders, QuickHed
from support.planning import picture


class Spot:
    """Answers strongly in the upper left quarter only."""

    def features(self, views: torch.Tensor) -> tuple[torch.Tensor, ...]:
        answer = torch.zeros(len(views), 4, 8, 8)
        answer[:, :, :4, :4] = 1
        return (answer,)


def test_edges_and_things_matter_more_than_the_rest() -> None:
    image = torch.full((3, 120, 160), 0.8)
    image[:, 90:110, 100:140] = 0.1
    matters = importance(image, Spot(), QuickHed())
    assert abs(float(matters.mean()) - 1) < 1e-5 and float(matters.min()) > 0
    rows, columns = matters.shape
    edge, thing, nothing = (
        float(matters[int(y * rows), int(x * columns)]) for y, x in ((0.83, 0.63), (0.2, 0.2), (0.25, 0.85))
    )
    assert edge > 2 * nothing and thing > 1.5 * nothing
    without = importance(image, Spot(), None)
    assert float(without[int(0.83 * rows), int(0.63 * columns)]) < edge


def test_a_goal_that_begins_with_what_is_meant_begins_where_its_meaning_is() -> None:
    goal = start_from_meaning(Goal((SemanticTerm(picture(), 2.0), StyleTerm(picture()))), QuickEncoders())
    (begun,) = goal.initial
    assert isinstance(begun, ImageTerm) and begun.importance is not None and begun.weight == 2
    assert goal.initial_terms == goal.initial


def test_importance_is_fitted_as_the_picture_is() -> None:
    matters = torch.ones(40, 80)
    matters[:, :20] = 9
    fitted = spread(matters, 20, 20)
    assert fitted.shape == (20, 20) and abs(float(fitted.mean()) - 1) < 1e-6
    assert float(fitted.std()) < 1e-6, "the strong columns are cropped away"
    assert float(spread(matters, 20, 40)[10, 5] / spread(matters, 20, 40)[10, 30]) > 8


def test_faces_matter_more_where_there_are_any_and_a_person_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    goal, encoders = Goal((ImageTerm(picture()), StyleTerm(picture()))), NoEncoderRegistry()
    monkeypatch.setattr(attention, "faces", lambda seen: [])
    assert weight_by_focus(goal, True, (), encoders) is goal and encoders.remarks == []
    monkeypatch.setattr(attention, "faces", lambda seen: [Face(0.5, 0.5, 0.2, 0.2)])
    assert weight_by_focus(goal, False, (), encoders) is goal
    found, style = weight_by_focus(goal, True, (), encoders).terms
    assert isinstance(found, ImageTerm) and found.importance is not None and style is goal.terms[1]
    rows, columns = found.importance.shape
    assert float(found.importance[rows // 2, columns // 2]) > 5 * float(found.importance[0, 0])
    assert encoders.remarks == [
        "A face was found in the picture and matters more than the rest; --focus none changes that."
    ]
    assert weight_by_focus(Goal((found,)), True, (), encoders).terms[0] is found, "what matters was said already"


def test_a_face_matters_more_for_its_content_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attention, "faces", lambda seen: [Face(0.5, 0.5, 0.2, 0.2)])
    goal = Goal((SemanticTerm(picture()),))
    (found,) = weight_by_focus(goal, True, (), NoEncoderRegistry()).terms
    (begun,) = start_from_meaning(Goal((found,)), QuickEncoders()).initial
    (before,) = start_from_meaning(goal, QuickEncoders()).initial
    assert begun.importance is not None and before.importance is not None
    rows, columns = begun.importance.shape
    more = (begun.importance / before.importance)[rows // 2, columns // 2]
    assert float(more) > 5 * float((begun.importance / before.importance)[0, 0])
    assert float(begun.importance.mean()) == pytest.approx(1, abs=1e-4)


def test_a_marked_place_matters_more_and_needs_no_face() -> None:
    (found,) = weight_by_focus(Goal((ImageTerm(picture()),)), False, [(0.25, 0.75, 0.1)], NoEncoderRegistry()).terms
    assert isinstance(found, ImageTerm) and found.importance is not None
    rows, columns = found.importance.shape
    assert divmod(int(found.importance.argmax()), columns)[0] > rows / 2
    assert float(found.importance[3 * rows // 4, columns // 4]) > 5 * float(found.importance[rows // 4, columns // 4])


def test_eyes_matter_most_of_a_face() -> None:
    face = Face(0.5, 0.5, 0.5, 0.5, ((0.4, 0.4), (0.4, 0.6), (0.5, 0.5), (0.6, 0.4), (0.6, 0.6)))
    matters = importance_of([face], 100, 100)
    eye, nose, mouth, cheek = (float(matters[at]) for at in ((40, 40), (50, 50), (60, 60), (50, 38)))
    assert eye > mouth > nose > cheek > 5 * float(matters[5, 5])


def test_faces_share_a_budget_so_that_small_ones_count_more() -> None:
    def of(*sides: float) -> torch.Tensor:
        faces = [Face(0.3, 0.2 + 0.5 * number, side, side) for number, side in enumerate(sides)]
        matters = importance_of(faces, 200, 200, by_size=True)
        return matters / matters.min()

    small, large, two = of(0.05), of(0.3), of(0.3, 0.3)
    assert float(small.max()) == pytest.approx(61), "no face counts more than that"
    for matters, share in ((large, 1), (two, 0.5)):
        added = (matters - 1)[:, :100].sum() / 200**2
        assert float(added) == pytest.approx(0.5 * share, rel=1e-2)
    assert float(two.max()) - 1 == pytest.approx((float(large.max()) - 1) / 2, rel=1e-3)


def test_only_photographs_give_their_faces_a_budget() -> None:
    def most(*more: Term) -> float:
        goal = weight_by_focus(Goal((ImageTerm(picture()), *more)), False, [(0.5, 0.5, 0.3)], NoEncoderRegistry())
        matters = goal.terms[0].importance
        assert matters is not None
        return float(matters.max() / matters.min())

    assert most() < 5 and most(StyleTerm(picture())) == pytest.approx(7)


SHARE = st.floats(0, 1)


MARKS = st.sampled_from([(), ((0.4, 0.4), (0.4, 0.6), (0.5, 0.5), (0.6, 0.4), (0.6, 0.6))])
FOUND = st.builds(Face, SHARE, SHARE, st.floats(0.05, 1), st.floats(0.05, 1), MARKS)


@given(st.lists(FOUND, max_size=4))
def test_importance_is_one_in_the_mean_and_never_nothing(found: list[Face]) -> None:
    matters = importance_of(found, 40, 60)
    assert matters.shape == (40, 60) and float(matters.mean()) == pytest.approx(1, rel=1e-4)
    assert float(matters.min()) > 0.05 and float(matters.max()) <= 13 * float(matters.min()) * 1.0001
