"""Planning on another device than the CPU: one that is pretended, so that it needs no GPU."""

import importlib.util

import pytest
import torch

from elsewhere import elsewhere
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.clip import Clip
from frida_painter.objectives.encoders.clip_resnet import ClipResNet
from frida_painter.objectives.encoders.hed import Hed
from frida_painter.objectives.encoders.vgg import Vgg16
from frida_painter.objectives.interpretation import WeightedObjective
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.semantic import SemanticTerm
from frida_painter.objectives.kinds.sketch import SketchTerm
from frida_painter.objectives.kinds.style import StyleTerm
from frida_painter.objectives.kinds.text import TextTerm
from frida_painter.objectives.objective import ObjectiveTerm
from frida_painter.objectives.text import distance_to
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.planning.effort import Effort
from frida_painter.planning.initialize import Growth
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.planning.region import Region
from networks import QuickEncoders, random_hed_tensors, random_reader, random_vgg_tensors
from scenes import CANVAS, goal, picture, small_table
from tiny_clip import resnet_tensors, write_clip

QUICK = Effort(Growth(2, 2, 4), relocations=1, refining=2, drawing=1, binding=2, polishing=2, replanning=2)
BARE = torch.ones(3, 64, 85)
LINES = torch.ones(3, 64, 85)
LINES[:, 30:33, 10:70] = 0


@pytest.fixture
def without_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """The CPU renders as other devices do."""
    there = importlib.util.find_spec
    monkeypatch.setattr(
        "frida_painter.render.painting.find_spec", lambda name: None if name == "numba" else there(name)
    )


def planner(wanted: Goal, device: torch.device | None) -> Planner:
    return Planner(
        wanted, CANVAS, small_table(), rows=64, effort=QUICK, seed=3, encoders=QuickEncoders(), device=device
    )


def unheard(step: object) -> None:
    """Where nobody listens."""


def everything(by: Planner) -> tuple[Plan, Plan, Plan, torch.Tensor, float, Placement]:
    """All that a planner is asked, from the first plan to one for another goal around what must stay."""
    plan = by.plan(BARE, 8, 3, unheard)
    after = by.expected(plan.part(slice(0, 4)), BARE)
    known = by.locate(plan.part(slice(0, 4)), Placement.unknown(), BARE, after)
    bound = by.bind_to_palette(plan, BARE, Palette(plan.palette.color * 0.9), unheard)
    forbidden = torch.zeros(64, 85, dtype=torch.bool)
    forbidden[40:, 60:] = True
    by.region = Region(forbidden)
    again = by.towards(Goal((ImageTerm(1 - picture()),))).replan(plan.part(slice(4, 8)), after, unheard)
    return plan, bound, again, by.expected(plan, BARE), by.validation_loss(after), known


def alike(one: Plan, other: Plan) -> None:
    for name, group in one.strokes.arrays().items():
        assert group.device.type == "cpu"
        torch.testing.assert_close(other.strokes.arrays()[name], group, rtol=1e-4, atol=1e-5)
    assert torch.equal(one.paint, other.paint)
    torch.testing.assert_close(other.palette.color, one.palette.color, rtol=1e-4, atol=1e-5)


@pytest.mark.slow
def test_everything_is_planned_on_the_device_and_comes_back_the_same(without_compiler) -> None:
    plan, bound, again, picture_after, loss, known = everything(planner(goal(), None))
    with elsewhere() as device:
        theirs = everything(planner(goal(), device))
    alike(plan, theirs[0])
    alike(bound, theirs[1])
    alike(again, theirs[2])
    torch.testing.assert_close(theirs[3], picture_after, rtol=1e-3, atol=2e-4)  # of strokes that are alike
    assert theirs[4] == pytest.approx(loss, rel=1e-4)
    assert theirs[5].error == pytest.approx(known.error, abs=1e-5)


@pytest.mark.slow
def test_every_kind_of_goal_is_seen_on_the_device() -> None:
    seen = ImageTerm(picture()), StyleTerm(1 - picture()), SemanticTerm(picture())
    said = SketchTerm(LINES), TextTerm("a lemon", 0.5)
    with elsewhere() as device:
        by = planner(Goal((*seen, *said)), device)
        plan = by.plan(BARE, 4, 2, unheard)
    assert len(plan) == 4 and plan.strokes.color.device.type == "cpu"


@torch.no_grad()
def test_networks_see_on_the_device_what_they_see_on_the_cpu(tmp_path) -> None:
    clip, tower = Clip.load(write_clip(tmp_path)), ClipResNet(resnet_tensors())
    vgg, hed, lite = Vgg16.of_torchvision(random_vgg_tensors()), Hed(random_hed_tensors()), random_reader()

    def seen(views: torch.Tensor) -> list[torch.Tensor]:
        return [
            vgg.features(views[0], ["conv3_1"])[0],
            hed.edges(views[0]),
            lite.embed_pictures(views),
            distance_to("a lemon", lite)(views),
            tower.embed_pictures(views),
            clip.embed_pictures(views),
            distance_to("lemon", clip)(views),
        ]

    views = picture(40, 40)[None]
    here = seen(views)
    with elsewhere() as device:
        there = seen(views.to(device))
    for one, other in zip(here, there, strict=True):
        assert other.device.type == "meta"
        torch.testing.assert_close(other.held, one, rtol=1e-4, atol=1e-5)


def test_a_tensor_left_behind_would_be_found() -> None:
    with elsewhere() as device:
        by = planner(goal(), device)
        here = torch.rand(3, by.coarse.rows, by.coarse.columns)
        by.scenes.initial_objective = WeightedObjective(
            [(1.0, ObjectiveTerm(lambda seen: (seen - here).square().mean()))]
        )
        with pytest.raises(RuntimeError, match="one device"):
            by.plan(BARE, 4, 2, unheard)
