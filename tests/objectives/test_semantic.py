import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.objectives.attention import Face, importance_of
from frida_painter.objectives.encoders.convolutional import EfficientNetLite, Vgg16
from frida_painter.objectives.objective import ObjectiveContext
from frida_painter.objectives.semantic import Semantic, SemanticTerm, Views, spread_colors
from frida_painter.strokes.palette import to_lab
from support.networks import QuickEncoders, QuickVgg, random_lite_tensors
from support.planning import picture


def semantic(seed: int = 0, trunk: Vgg16 | None = None) -> Semantic:
    return Semantic(picture(), EfficientNetLite(random_lite_tensors()), seed, trunk)


def test_the_first_view_is_the_whole_picture() -> None:
    ramp = torch.linspace(0, 1, 64).expand(3, 48, 64)
    (whole,) = Views(4, 40, seed=0).of(ramp, torch.tensor([0]))
    wanted = (torch.arange(40) + 0.5) / 40
    assert float((whole[:, 3:-3, 3:-3] - wanted[3:-3]).abs().max()) < 0.02


def test_half_of_the_views_show_the_whole_picture_if_that_is_asked_for() -> None:
    views, crops = Views(9, 24, seed=0, wholes=4), Views(9, 24, seed=0)
    edges = torch.cat((views._points[:, [0, -1]].flatten(1, 2), views._points[:, :, [0, -1]].flatten(1, 2)), 1)
    shows_all = edges.abs().amax(2).amin(1) > 0.8  # of the half sides, at every point of the view's edge
    assert shows_all[:5].all() and not shows_all[5:].any()
    assert torch.equal(views._maps[5:], crops._maps[5:])
    chance = torch.Generator().manual_seed(0)
    for count, whole in ((1, 1), (2, 1), (4, 2), (5, 3), (9, 5)):
        some = views.some(count, chance)
        assert len(set(some.tolist())) == count and int((some <= 4).sum()) == whole
    assert not torch.equal(views.some(9, chance), views.some(9, chance))


def test_views_show_parts_in_other_perspectives_and_follow_their_seed() -> None:
    image = picture()
    which = torch.arange(6)
    one, same, other = (Views(6, 40, seed).of(image, which) for seed in (1, 1, 2))
    assert torch.equal(one, same) and not torch.equal(one, other)
    assert one.shape == (6, 3, 40, 40) and bool(((one >= 0) & (one <= 1)).all())
    assert all(not torch.equal(one[0], view) for view in one[1:])


@pytest.mark.parametrize("trunk", [None, QuickVgg()], ids=["meaning alone", "with shapes and colours"])
def test_the_picture_itself_is_perfect_in_every_view(trunk: Vgg16 | None) -> None:
    objective = semantic(trunk=trunk)
    with torch.no_grad():
        assert all(float(objective(picture())) < 1e-6 for _ in range(8))
        assert float(objective.validation(picture())) < 1e-6
        assert float(objective(1 - picture())) > 1e-3


def test_views_change_from_call_to_call_and_the_judge_stays() -> None:
    one, same = semantic(3), semantic(3)
    other = 1 - picture()
    with torch.no_grad():
        values = [float(one(other)) for _ in range(4)]
        assert values == [float(same(other)) for _ in range(4)]
        assert len(set(values)) > 1
        assert float(one.validation(other)) == float(one.validation(other))


def test_paint_that_is_stronger_all_over_means_the_same() -> None:
    """Only the direction of a feature counts; with shapes, colours are held as well, but not their grain."""
    seer = ScaledSeer()
    image, other = picture(), (0.5 * picture())
    with torch.no_grad():
        assert float(Semantic(image, seer, 0).validation(other)) < 1e-6
        held = Semantic(image, seer, 0, QuickVgg())
        assert float(held.validation(other)) > 0.05
        assert float(Semantic(image, seer, 0, QuickVgg(), 1.0).validation(other)) < 0.1 * float(held.validation(other))
        grain = 0.02 * torch.randn(image.shape, generator=torch.Generator().manual_seed(0))
        assert float(held.validation(image + grain)) < 0.1 * float(held.validation(image + 0.1))


def test_places_that_matter_count_more() -> None:
    image, seer = picture(), ScaledSeer()
    matters = torch.ones(8, 8)
    matters[:, :4] = 0.01
    heeded = Semantic(image, seer, 0, QuickVgg(), importance=matters / matters.mean())
    other = [image.clone(), image.clone()]
    half = image.shape[2] // 2
    other[0][:, :, : half - 4] = 1 - other[0][:, :, : half - 4]
    other[1][:, :, half + 4 :] = 1 - other[1][:, :, half + 4 :]
    with torch.no_grad():
        colors = [float(heeded.validation(one)) for one in other]
    assert colors[1] > 3 * colors[0]


@pytest.mark.parametrize("freedom", [0.0, 0.5, 1.0])
def test_the_grain_of_a_face_counts_and_that_of_the_rest_does_not(freedom: float) -> None:
    image, chance = picture(), torch.Generator().manual_seed(0)
    rows, columns = image.shape[1:]
    matters = importance_of([Face(0.5, 0.25, 0.8, 0.4)], rows, columns)
    heeded = Semantic(image, ScaledSeer(), 0, QuickVgg(), freedom, matters)
    plain = Semantic(image, ScaledSeer(), 0, QuickVgg(), freedom)
    grain = 0.05 * torch.randn(image.shape, generator=chance)
    inside = matters > 6.9 * matters.min()
    outside = matters < 1.1 * matters.min()
    assert min(int(inside.sum()), int(outside.sum())) > 100
    with torch.no_grad():
        face, rest = (float(heeded.validation(image + grain * where)) for where in (inside, outside))
        without = float(plain.validation(image + grain * inside))
    assert face > 5 * rest and face > 5 * without


@pytest.mark.parametrize(("in_style", "lasts"), [(False, 1), (True, 3)])
def test_beside_a_style_one_gradient_serves_as_long_as_that_of_the_style(in_style: bool, lasts: int) -> None:
    grid = PixelGrid(CanvasSize.parse("12x9cm"), 48, 64)
    prepared = SemanticTerm(picture()).prepare(ObjectiveContext(grid, QuickEncoders(), 0, in_style=in_style))
    assert (prepared.lasts, prepared.smooth) == (lasts, in_style)


def test_wild_colors_are_further_from_their_mean() -> None:
    image = 0.4 + 0.2 * picture()
    assert spread_colors(image, 0.5) is image and spread_colors(image, 0.0) is image
    before, after = (to_lab(one.permute(1, 2, 0)).flatten(0, 1) for one in (image, spread_colors(image, 0.75)))
    assert torch.allclose(before.mean(0), after.mean(0), atol=1.0)
    assert torch.allclose(after.std(0) / before.std(0), torch.tensor([1.1, 2.0, 2.0]), atol=0.1)


class ScaledSeer:
    """Sees colours as they are."""

    def features(self, views: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return (views,)
