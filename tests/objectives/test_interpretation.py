import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid, Rows
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.interpretation import WeightedObjective, interpret_goal, prepare
from frida_painter.objectives.objective import Goal, ObjectiveContext, ObjectiveTerm
from frida_painter.objectives.semantic import SemanticTerm
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm
from frida_painter_words.text import TextTerm
from support.networks import QuickEncoders
from support.planning import CANVAS, picture

GRID = PixelGrid.of_height(CANVAS, 24)


def flat(value: float) -> torch.Tensor:
    return torch.full((3, 240, 320), value)


def test_a_goal_is_the_weighted_sum_of_its_terms() -> None:
    objective = prepare(Goal((ImageTerm(flat(0.0), 2.0), ImageTerm(flat(1.0), 0.5))), GRID)
    assert float(objective(torch.full((3, GRID.rows, GRID.columns), 0.2))) == pytest.approx(2 * 0.04 + 0.5 * 0.64)


def test_pixels_that_vary_cost_on_average_what_they_cost() -> None:
    """The mean over many pictures of a squared error is that of their mean picture and of their variance."""
    generator, importance = torch.Generator().manual_seed(0), torch.rand(12, 16)
    for term in (ImageTerm(flat(0.3), 2.0), ImageTerm(flat(0.3), 2.0, importance=importance / importance.mean())):
        objective = prepare(Goal((term,)), GRID)
        pictures = torch.rand(400, 3, GRID.rows, GRID.columns, generator=generator)
        each = torch.stack([objective(one) for one in pictures]).mean()
        at_once = objective(pictures.mean(0), pictures.var(0, correction=0))
        assert float(at_once) == pytest.approx(float(each), rel=1e-4)
        assert float(at_once) > float(objective(pictures.mean(0))) + 0.1


def test_pictures_are_judged_by_some_of_their_rows_and_all_else_sees_whole_pictures() -> None:
    first, second = ImageTerm(flat(0.0), 2.0), ImageTerm(flat(1.0), 0.5)
    by_rows = prepare(Goal((first, second)), GRID).on_rows
    assert by_rows is not None
    seen = torch.full((3, GRID.rows, GRID.columns), 0.2)
    seen[:, ::2] = 0.6
    even, odd = Rows(2, 0), Rows(2, 1)
    assert float(by_rows(even)(even.of(seen))) == pytest.approx(2 * 0.36 + 0.5 * 0.16)
    assert float(by_rows(odd)(odd.of(seen), odd.of(seen))) == pytest.approx(2 * (0.04 + 0.2) + 0.5 * (0.64 + 0.2))
    whole = ObjectiveTerm(lambda picture: picture.mean())
    assert (
        WeightedObjective([(1.0, first.prepare(ObjectiveContext(GRID, EncoderRegistry(), 0))), (1.0, whole)]).on_rows
        is None
    )


def test_a_slow_term_counts_by_its_tangent_until_it_is_computed_anew() -> None:
    calls: list[int] = []

    def slow(picture: torch.Tensor) -> torch.Tensor:
        calls.append(1)
        return picture.pow(3).mean()

    quick = ImageTerm(flat(0.25)).prepare(ObjectiveContext(GRID, EncoderRegistry(), 0))
    whole = WeightedObjective([(1.0, quick), (0.5, ObjectiveTerm(slow, lasts=3))])
    assert whole.sparing is not None
    sparing, chance = whole.sparing(), torch.Generator().manual_seed(0)
    assert sparing.lasts == 3
    first, later = (torch.rand(3, GRID.rows, GRID.columns, generator=chance).requires_grad_() for _ in range(2))
    variance = torch.rand(GRID.rows, GRID.columns, generator=chance)
    for loss in (sparing.anew, sparing.between):  # its value and its slope are those of the plain sum
        seen, plain = loss(first, variance), whole(first, variance)
        torch.testing.assert_close(seen, plain)
        torch.testing.assert_close(*(torch.autograd.grad(one, first)[0] for one in (seen, plain)))
    before = len(calls)
    tangent = first.pow(3).mean() + ((later - first) * 3 * first.square()).sum() / first.numel()
    torch.testing.assert_close(sparing.between(later), quick.objective(later) + 0.5 * tangent)
    assert len(calls) == before, "between, the slow term is not computed"
    torch.testing.assert_close(sparing.anew(later), whole(later))


def test_an_objective_has_the_slope_of_what_it_says() -> None:
    objective = prepare(Goal((ImageTerm(flat(0.25)),)), PixelGrid.of_height(CANVAS, 6))
    picture = torch.rand(3, 6, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(0), requires_grad=True)
    assert torch.autograd.gradcheck(objective, (picture,))


@pytest.mark.parametrize("weight", [0.0, -1.0, float("nan"), float("inf")])
def test_weights_that_mean_nothing_are_refused(weight: float) -> None:
    with pytest.raises(ConfigError, match="above 0 and finite"):
        ImageTerm(flat(0.5), weight)


GRID = PixelGrid.of_height(CanvasSize(0.12, 0.09), 64)
LINES = torch.ones(3, 64, 85)
LINES[:, 30:33, 10:70] = 0


def pursued(*terms) -> Goal:
    return interpret_goal(Goal(terms), GRID, QuickEncoders(), seed=0)


def test_words_in_a_style_begin_with_a_picture_in_the_styles_colors() -> None:
    plain, styled = pursued(TextTerm("a lemon")), pursued(TextTerm("a lemon"), StyleTerm(1 - picture()))
    (first,), (instead,) = plain.initial, styled.initial
    assert instead.image is styled.terms[-1].image and not torch.equal(first.image, instead.image)


def test_a_sketch_is_drawn_on_its_photograph_before_the_photograph_takes_a_styles_colors() -> None:
    goal = pursued(ImageTerm(picture()), SketchTerm(LINES), StyleTerm(1 - picture()))
    wanted = goal.terms[0].image
    beside = pursued(ImageTerm(picture()), StyleTerm(1 - picture())).terms[0].image
    assert float((wanted - beside)[:, 30:33, 12:68].abs().mean()) > 2 * float((wanted - beside).abs().mean())


def test_meaning_in_a_style_is_attended_to_where_it_is() -> None:
    goal = pursued(SemanticTerm(picture()), StyleTerm(1 - picture()))
    (begun,) = goal.initial
    assert begun.importance is not None and begun.image.shape == goal.terms[0].image.shape  # it is evened out


def lightness_recognized(weight: float, begun: torch.Tensor | None) -> WeightedObjective:
    """To a toy network a picture shows what is meant the lighter it is; beside it a black picture is wanted."""
    seen = ObjectiveTerm(lambda picture: picture.mean(), lambda picture: 1 - picture.mean(), recognizes=True)
    black = ObjectiveTerm(lambda picture: picture.square().mean())
    return WeightedObjective([(1.0, seen), (weight, black)], begun)


def test_a_painting_is_not_to_be_less_recognisable_than_its_beginning() -> None:
    """What pleases the sum, but is less recognisable than the beginning, is not kept; above it, the sum decides."""
    begun, dark, light = flat(0.5), flat(0.35), flat(0.7)
    free, kept = lightness_recognized(3.0, None).validation, lightness_recognized(3.0, begun).validation
    assert free is not None and kept is not None
    assert float(free(dark)) < float(free(begun)), "the sum alone would darken it"
    assert float(kept(dark)) > float(kept(begun))
    assert float(kept(light)) == pytest.approx(float(free(light))), "as recognisable as the beginning is enough"
    assert float(lightness_recognized(3.0, begun).recognition(light)) == pytest.approx(0.3)
