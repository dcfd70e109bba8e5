"""Planning on another device than the CPU: one that is pretended, so that it needs no GPU."""

import math
from collections import Counter
from dataclasses import replace

import pytest
import torch

from elsewhere import elsewhere, waits
from frida_painter.errors import PlanningDiverged
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.base import Reader
from frida_painter.objectives.encoders.clip import Clip
from frida_painter.objectives.encoders.convolutional import EfficientNetLite, Hed, Vgg16
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.interpretation import WeightedObjective, prepare
from frida_painter.objectives.objective import Goal, ObjectiveTerm, Term
from frida_painter.objectives.semantic import SemanticTerm
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm
from frida_painter.objectives.text_loss import wish
from frida_painter.objectives.word_settings import WordSettings
from frida_painter.planning.effort import Effort
from frida_painter.planning.initialize import uniform
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.planning.problem import Region
from frida_painter.strokes.palette import Palette, to_lab
from frida_painter.strokes.plan import Plan
from frida_painter.system.devices import half_precision
from frida_painter_words.text import TextTerm
from support.networks import QuickEncoders, RandomReader, random_hed_tensors, random_lite_tensors, random_vgg_tensors
from support.planning import CANVAS, as_it_is, goal, picture, plain, small_table
from tiny_clip import write_clip

QUICK = Effort(2, 2, 4, relocations=1, refining=2, drawing=1, binding=2, settling=2, polishing=2, replanning=2)
BARE = torch.ones(3, 64, 85)
LINES = torch.ones(3, 64, 85)
LINES[:, 30:33, 10:70] = 0


def planner(wanted: Goal, device: torch.device | None) -> Planner:
    return Planner(
        wanted, *plain(CANVAS, small_table(), rows=64, effort=QUICK, seed=3), encoders=QuickEncoders(), device=device
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
    clear = by.keeping_clear(Region(forbidden))
    again = clear.towards(as_it_is(1 - picture())).replan(plan.part(slice(4, 8)), after, unheard)
    return plan, bound, again, by.expected(plan, BARE), by.validation_loss(after), known


def alike(one: Plan, other: Plan) -> None:
    for name, group in one.strokes.arrays().items():
        assert group.device.type == "cpu"
        torch.testing.assert_close(other.strokes.arrays()[name], group, rtol=1e-4, atol=1e-5)
    assert torch.equal(one.paint, other.paint)
    torch.testing.assert_close(other.palette.color, one.palette.color, rtol=1e-4, atol=1e-5)


def test_everything_is_planned_on_the_device_and_comes_back_the_same() -> None:
    plan, bound, again, picture_after, loss, known = everything(planner(goal(), None))
    with elsewhere() as device:
        theirs = everything(planner(goal(), device))
    alike(plan, theirs[0])
    alike(bound, theirs[1])
    alike(again, theirs[2])
    torch.testing.assert_close(theirs[3], picture_after, rtol=1e-3, atol=1e-3)  # of strokes that are alike
    assert theirs[4] == pytest.approx(loss, rel=1e-4)
    assert theirs[5].error == pytest.approx(known.error, abs=5e-5)


def test_every_kind_of_goal_is_seen_on_the_device() -> None:
    seen = ImageTerm(picture()), StyleTerm(1 - picture()), SemanticTerm(picture())
    said = SketchTerm(LINES), TextTerm("a lemon", 0.5)
    with elsewhere() as device:
        by = planner(Goal((*seen, *said)), device)
        plan = by.plan(BARE, 4, 2, unheard)
    assert len(plan) == 4 and plan.strokes.color.device.type == "cpu"


@torch.no_grad()
def test_networks_see_on_the_device_what_they_see_on_the_cpu(tmp_path) -> None:
    clip = Clip.load(write_clip(tmp_path))
    vgg, hed, lite = (
        Vgg16.of_torchvision(random_vgg_tensors()),
        Hed(random_hed_tensors()),
        EfficientNetLite(random_lite_tensors()),
    )

    def seen(views: torch.Tensor) -> list[torch.Tensor]:
        return [
            vgg.features(views[0], ["conv3_1"])[0],
            hed.edges(views[0]),
            *lite.features(views),
            clip.embed_pictures(views),
            wish("lemon", clip, WordSettings())(views),
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
        left = WeightedObjective([(1.0, ObjectiveTerm(lambda seen: (seen - here).square().mean()))])
        by.problems = replace(by.problems, initial_objective=left)
        with pytest.raises(RuntimeError, match="one device"):
            by.plan(BARE, 4, 2, unheard)


class ThereEncoders(QuickEncoders):
    """Networks of random weights that lie on the device, as fetched ones do."""

    def style(self) -> Vgg16:
        return Vgg16.of_torchvision(on(self.device, random_vgg_tensors()))

    shapes = style

    def meaning(self) -> EfficientNetLite:
        return EfficientNetLite(on(self.device, random_lite_tensors()))

    def edges(self) -> Hed:
        return Hed(on(self.device, random_hed_tensors()))

    def reader(self) -> Reader:
        return RandomReader()


def on(device: torch.device, tensors: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    return {name: tensor.to(device) for name, tensor in tensors.items()}


def waited_for(by: Planner, iterations: int) -> list[str]:
    """Where the CPU would wait while so many iterations are made."""
    problem = by.problems.of(BARE, by.coarse, by.brushes[0])
    strokes = uniform(4, problem.limits, CANVAS, torch.Generator().manual_seed(0)).to(by.device)
    with waits() as noted:
        optimize(strokes, problem, iterations=iterations)
    return noted


def test_no_iteration_waits_for_the_device() -> None:
    with elsewhere() as device:
        by = planner(goal(), device)
        few, more = waited_for(by, 8), waited_for(by, 24)
    assert Counter(more) - Counter(few) == {"tolist": 2}  # of eight iterations each


@pytest.mark.parametrize(
    "term",
    [StyleTerm(1 - picture()), SemanticTerm(picture()), SketchTerm(LINES), TextTerm("a lemon", 0.5)],
    ids=lambda term: type(term).__name__,
)
def test_no_objective_waits_for_the_device(term: Term) -> None:
    with elsewhere() as device:
        grid = PixelGrid.of_height(CANVAS, 64)
        objective = prepare(Goal((term.to(device),)), grid, ThereEncoders(device=device))
        seen = picture(64, 85).to(device).requires_grad_()
        torch.autograd.backward(objective(seen))  # what never changes is sent once
        with waits() as noted:
            torch.autograd.backward(objective(seen))
    assert Counter(noted) == {}


def test_a_wait_would_be_found() -> None:
    with elsewhere() as device, waits() as noted:
        there = torch.rand(3).to(device, non_blocking=True)
        assert noted == []
        there.cpu()
        float(there.sum())
        there[there > 0.5]
        there[torch.tensor([0, 1])]
        torch.rand(3).to(device)
        there.new_tensor([1.0])
    assert len(noted) == 6


def test_colours_are_as_light_on_the_device() -> None:
    colors = torch.rand(200, 3, generator=torch.Generator().manual_seed(0))
    colors[:3] = torch.tensor([[0.0, 0, 0], [1, 1, 1], [0.01, 0.02, 0.03]])
    with elsewhere() as device:
        there = to_lab(colors.to(device))
    torch.testing.assert_close(there.held, to_lab(colors), rtol=0, atol=0.3)  # that of OpenCV is rounded


@pytest.mark.parametrize("failing", [{5}, {5, 6}, {5, 12, 20}])
def test_losses_that_are_not_finite_are_noticed_late_on_a_device_and_do_no_harm(failing: set[int]) -> None:
    """Fault F29: values that are not finite while planning. Eight iterations are read together."""
    calls = 0

    def turning(picture: torch.Tensor) -> torch.Tensor:
        nonlocal calls
        calls += 1
        return picture.square().mean() * (torch.nan if calls - 1 in failing else 1)

    heard: list[Step] = []
    with elsewhere() as device:
        by = planner(goal(), device)
        problem = by.problems.of(BARE, by.coarse, by.brushes[0])
        dark = replace(problem, objective=turning)
        strokes = uniform(4, problem.limits, CANVAS, torch.Generator().manual_seed(0)).to(device)
        if len(failing) == 3:
            with pytest.raises(PlanningDiverged, match=r"iteration 20, for the 3\. time \(the loss was nan\)"):
                optimize(strokes, dark, iterations=24, notify=heard.append)
        else:
            found, _ = optimize(strokes, dark, iterations=24, notify=heard.append)
            found.to("cpu").check(problem.limits, CANVAS)
            assert bool(problem.render(found).to("cpu").isfinite().all())
    assert [step.iteration for step in heard][:5] == [1, 2, 3, 4, 5]
    assert all(step.iteration not in (6, 7, 8) and math.isfinite(step.loss) for step in heard)


@torch.no_grad()
def test_networks_in_half_precision_see_nearly_the_same_in_full_precision(tmp_path, monkeypatch) -> None:
    clip = Clip.load(write_clip(tmp_path))
    vgg, lite = Vgg16.of_torchvision(random_vgg_tensors()), EfficientNetLite(random_lite_tensors())
    looks = (
        lambda views: vgg.features(views[0], ["conv3_1"])[0],
        lambda views: lite.features(views)[1],
        clip.embed_pictures,
        lambda views: clip.features(views)[0],
    )
    views = picture(64, 64)[None]
    whole = [look(views) for look in looks]
    for module in ("clip", "convolutional"):
        monkeypatch.setattr(
            f"frida_painter.objectives.encoders.{module}.half_precision",
            lambda device: torch.autocast("cpu", dtype=torch.bfloat16),
        )
    for look, expected in zip(looks, whole, strict=True):
        seen = look(views)
        assert seen.dtype == torch.float32
        assert not torch.equal(seen, expected), "it was not computed in half precision"
        assert float((seen - expected).norm() / expected.norm()) < 0.06


def test_the_cpu_computes_in_full_precision() -> None:
    with half_precision(torch.device("cpu")):
        assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == torch.float32
