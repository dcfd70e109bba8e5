from pathlib import Path

import pytest
import torch
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.open import open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.hardware.easel import Easel
from frida_painter.lab.ladder import with_real_marks
from frida_painter.lab.paintings import (
    CAMERA,
    HAND,
    IMPERFECTIONS,
    LOAD,
    PLACEMENT,
    TOOTH,
    TRANSLUCENCY,
    WETNESS,
    Imperfection,
    StudioWithout,
    execute,
)
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.strokes import StrokeLimits, Strokes

SIZE, ROWS = CanvasSize(0.09, 0.07), 140
LIMITS = StrokeLimits((0.012, 0.06), (-0.01, 0.01))
BLACK, CREAM = (0.05, 0.05, 0.05), (0.95, 0.93, 0.88)


def crossing() -> Plan:
    """Six black bars, one below the other, and three cream ones across them."""
    across, down = torch.arange(6) * 0.009 + 0.012, torch.tensor([0.022, 0.042, 0.062])
    return Plan.of(
        Strokes(
            position=torch.cat([torch.stack((torch.full((6,), 0.015), across), 1), torch.stack((down, 0 * down), 1)])
            + torch.tensor([0.0, 0.006]),
            angle=torch.tensor([0.0] * 6 + [torch.pi / 2] * 3),
            length=torch.tensor([0.05] * 6 + [0.04] * 3),
            bend=torch.zeros(9),
            thickness=torch.tensor([0.6] * 6 + [0.2] * 3),
            color=torch.zeros(9, 3),
        ),
        Palette(torch.tensor([BLACK, CREAM])),
        torch.tensor([0] * 6 + [1] * 3),
        canvas=SIZE,
        brush="fine",
        limits=LIMITS,
    )


def order(folder: Path) -> EaselOrder:
    return EaselOrder(robot="virtual", canvas=SIZE, brushes=("fine",), seed=3, state=folder)


def painted(easel: Easel, plan: Plan | None = None) -> Tensor:
    easel.robot.connect()
    easel.camera.connect()
    return execute(plan or crossing(), easel, ROWS)


def truth(folder: Path, *without: Imperfection, plan: Plan | None = None) -> Tensor:
    studio = StudioWithout(without)
    painted(studio.open(order(folder)).easel, plan)
    return studio.truth(ROWS)


def darkness(picture: Tensor) -> float:
    return float(1 - picture.mean())


@pytest.mark.slow
def test_with_all_of_them_it_is_the_usual_studio(tmp_path: Path) -> None:
    assert torch.equal(painted(StudioWithout().open(order(tmp_path)).easel), painted(open_easel(order(tmp_path)).easel))


@pytest.mark.slow
@pytest.mark.parametrize("without", [one for one in IMPERFECTIONS if one is not CAMERA], ids=lambda one: one.name)
def test_each_of_them_shows_in_the_paint(tmp_path: Path, without: Imperfection) -> None:
    assert not torch.equal(truth(tmp_path, without), truth(tmp_path))


@pytest.mark.slow
def test_the_camera_shows_in_its_photograph_alone(tmp_path: Path) -> None:
    assert torch.equal(truth(tmp_path, CAMERA), truth(tmp_path))
    pictures = [painted(StudioWithout(without).open(order(tmp_path)).easel) for without in ((), (CAMERA,))]
    assert not torch.equal(*pictures)


@pytest.mark.slow
def test_light_paint_that_covers_and_finds_dry_paint_is_lighter(tmp_path: Path) -> None:
    usual, dry = darkness(truth(tmp_path)), darkness(truth(tmp_path, WETNESS))
    assert darkness(truth(tmp_path, WETNESS, TRANSLUCENCY)) < dry < usual


@pytest.mark.slow
def test_paint_that_never_runs_out_on_a_canvas_without_tooth_covers_more(tmp_path: Path) -> None:
    bars = crossing().part(slice(0, 6))
    usual = darkness(truth(tmp_path, plan=bars))
    assert darkness(truth(tmp_path, LOAD, plan=bars)) > usual
    assert darkness(truth(tmp_path, TOOTH, plan=bars)) > usual


@pytest.mark.slow
def test_real_marks_are_those_of_a_perfect_studio(tmp_path: Path) -> None:
    """They lie where the strokes are meant to be, in the colours of the plan."""
    plan = crossing().part(slice(0, 6))
    shares: list[float] = []
    marks = with_real_marks(plan, torch.ones(3, ROWS, 180), 3, shares.append)
    assert shares == pytest.approx([(number + 1) / 6 for number in range(6)])
    assert float(marks.amin()) == pytest.approx(BLACK[0], abs=0.01)
    perfect, astray = truth(tmp_path, PLACEMENT, HAND, LOAD, plan=plan), truth(tmp_path, plan=plan)
    apart, further = (float((marks - picture).abs().mean()) for picture in (perfect, astray))
    assert apart < 0.5 * further
