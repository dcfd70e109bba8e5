"""What the virtual studio can do without: each shows in the paint, the camera in its photograph alone."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.open import open_easel
from frida_painter.easel.order import EaselOrder, SimulationOrder
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes
from frida_painter_lab.paintings import (
    CAMERA,
    IMPERFECTIONS,
    LOAD,
    TOOTH,
    TRANSLUCENCY,
    WETNESS,
    Imperfection,
    StudioWithout,
    execute,
)

SIZE, ROWS = CanvasSize(0.09, 0.07), 70
LIMITS = StrokeLimits((0.012, 0.06), (-0.01, 0.01))
pytestmark = pytest.mark.usefixtures("small_world")


def crossing() -> Plan:
    """Three black bars, one below the other, and one cream bar across them."""
    return Plan.of(
        Strokes(
            position=torch.tensor([[0.015, 0.02], [0.015, 0.029], [0.015, 0.038], [0.04, 0.012]]),
            angle=torch.tensor([0.0, 0.0, 0.0, torch.pi / 2]),
            length=torch.tensor([0.05, 0.05, 0.05, 0.04]),
            bend=torch.zeros(4),
            thickness=torch.tensor([0.6, 0.6, 0.6, 0.2]),
            color=torch.zeros(4, 3),
        ),
        Palette(torch.tensor([[0.05, 0.05, 0.05], [0.95, 0.93, 0.88]])),
        torch.tensor([0, 0, 0, 1]),
        canvas=SIZE,
        brush="fine",
        limits=LIMITS,
    )


def painted(folder: Path, *without: Imperfection) -> tuple[Tensor, Tensor]:
    """The photograph and the true canvas of a studio without these."""
    order = EaselOrder(robot="virtual", canvas=SIZE, brushes=("fine",), state=folder, simulation=SimulationOrder(3))
    studio = StudioWithout(without)
    easel = studio.open(order).easel
    easel.robot.connect()
    easel.camera.connect()
    photograph = execute(crossing(), easel, ROWS)
    if not without:
        usual = open_easel(order).easel
        usual.robot.connect()
        usual.camera.connect()
        assert torch.equal(execute(crossing(), usual, ROWS), photograph), "with all of them it is the usual studio"
    return photograph, studio.truth(ROWS)


def test_each_of_them_shows_in_the_paint_and_the_camera_in_its_photograph_alone(tmp_path: Path) -> None:
    photograph, truth = painted(tmp_path)
    found = {one.name: painted(tmp_path, one) for one in IMPERFECTIONS}
    for one in IMPERFECTIONS:
        assert torch.equal(found[one.name][1], truth) is (one is CAMERA), one.name
    assert not torch.equal(found[CAMERA.name][0], photograph)
    bars = slice(0, 34)  # columns left of the cream bar
    dark = {name: float(1 - canvas[..., bars].mean()) for name, (_, canvas) in found.items()}
    usual = float(1 - truth[..., bars].mean())
    assert dark[LOAD.name] > usual and dark[TOOTH.name] > usual, "paint that never runs out, and a flat canvas"
    dry, covering = (float(1 - painted(tmp_path, WETNESS, *more)[1].mean()) for more in ((), (TRANSLUCENCY,)))
    assert covering < dry < float(1 - truth.mean()), "light paint covers, and finds dry paint"
