import torch

from frida_painter.objectives.augment import Views
from frida_painter.objectives.encoders.efficientnet import EfficientNetLite
from frida_painter.objectives.semantic import Semantic
from networks import random_lite_tensors
from scenes import picture


def semantic(seed: int = 0) -> Semantic:
    return Semantic(picture(), EfficientNetLite(random_lite_tensors()), seed)


def test_the_first_view_is_the_whole_picture() -> None:
    ramp = torch.linspace(0, 1, 64).expand(3, 48, 64)
    (whole,) = Views(4, 40, seed=0).of(ramp, torch.tensor([0]))
    wanted = (torch.arange(40) + 0.5) / 40
    assert float((whole[:, 3:-3, 3:-3] - wanted[3:-3]).abs().max()) < 0.02


def test_views_show_parts_in_other_perspectives_and_follow_their_seed() -> None:
    image = picture()
    which = torch.arange(6)
    one, same, other = (Views(6, 40, seed).of(image, which) for seed in (1, 1, 2))
    assert torch.equal(one, same) and not torch.equal(one, other)
    assert one.shape == (6, 3, 40, 40) and bool(((one >= 0) & (one <= 1)).all())
    assert all(not torch.equal(one[0], view) for view in one[1:])


def test_slopes_reach_the_picture_through_the_views() -> None:
    image = picture().requires_grad_()
    (slope,) = torch.autograd.grad(Views(3, 24, 0).of(image, torch.tensor([1, 2])).sum(), image)
    assert float(slope.abs().sum()) > 0


def test_the_picture_itself_is_perfect_in_every_view() -> None:
    objective = semantic()
    with torch.no_grad():
        assert all(float(objective(picture())) < 1e-8 for _ in range(8))
        assert float(objective.judge(picture())) < 1e-8
        assert float(objective(1 - picture())) > 1e-3


def test_views_change_from_call_to_call_and_the_judge_stays() -> None:
    one, same = semantic(3), semantic(3)
    other = 1 - picture()
    with torch.no_grad():
        values = [float(one(other)) for _ in range(4)]
        assert values == [float(same(other)) for _ in range(4)]
        assert len(set(values)) > 1
        assert float(one.judge(other)) == float(one.judge(other))
