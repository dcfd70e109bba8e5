import math
import platform
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from frida_painter.brush.kinds import FINE
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import lead
from frida_painter.errors import CalibrationError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.faults import PlacementError
from frida_painter.session.hand import Hand
from frida_painter.session.opening import on_record, planning_device
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.virtual.studio import VirtualStudio, open_studio
from frida_painter_calibration.procedures.canvas import canvas
from frida_painter_calibration.procedures.robot import robot
from support.easel import CALIBRATION, CANVAS, stub_easel

SIZE = CanvasSize(0.20, 0.15)


_COUNTING = """
import resource
import numpy as np
from frida_painter.system.devices import prepare_process

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        blocks = [np.empty(2_000_000, np.float32) for _ in range(3)]
        for block in blocks:
            block.fill(1)
        del blocks, block
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

prepare_process()
faults()
print(faults())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries are not told how to keep memory")
def test_a_process_that_plans_keeps_its_memory() -> None:
    """Where each block comes from the system anew, twenty times three of them are some 100,000 pages."""
    counted = subprocess.run([sys.executable, "-c", _COUNTING], capture_output=True, text=True, check=True)
    assert int(counted.stdout) < 5_000


def four_of(record: Calibration) -> Calibration:
    """A record in which all was done that painting needs."""
    done = record.with_canvas(record.corners, record.photograph, camera=record.camera, canvas=CANVAS, residual=0.1)
    done = done.with_robot(record.placement, residual=0.0004).with_color(record.color, residual=1.0)
    return done.with_brush(record.brush, record.touch_height, record.press_height, protrusion=None, residual=0.0002)


def test_nothing_is_painted_on_a_real_easel_without_a_record_that_holds(tmp_path: Path) -> None:
    real = replace(stub_easel(), calibration=replace(CALIBRATION, canvas=CANVAS))
    with pytest.raises(CalibrationError, match=r"'stub' has no calibration record.*calibrate all"):
        on_record(real, None)
    path = tmp_path / "cal.json"
    real.calibration.save(path)
    with pytest.raises(CalibrationError, match=r"never done here.*calibrate canvas"):
        on_record(real, path)
    record = four_of(real.calibration)
    record.save(path)
    assert on_record(real, path).calibration == record
    record.with_canvas(record.corners, record.photograph, camera="camera", canvas=CANVAS, residual=0.1).save(path)
    with pytest.raises(CalibrationError, match="calibrate robot"):
        on_record(real, path)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(CalibrationError, match="calibrate all"):
        on_record(real, path)


def test_the_virtual_studio_is_painted_on_from_what_it_knows_of_itself(tmp_path: Path) -> None:
    easel = open_studio(SIZE, "fine").easel
    assert on_record(easel, None) is easel
    easel.calibration.save(tmp_path / "cal.json")
    assert on_record(easel, tmp_path / "cal.json") == easel


def painted(studio: VirtualStudio, easel: Easel) -> torch.Tensor:
    """The studio's canvas after a few strokes, painted without looking."""
    easel.robot.connect()
    easel.camera.connect()
    easel.operator.lay_paper()
    count = 12
    chance = torch.Generator().manual_seed(4)
    place, turn = torch.rand(2, count, generator=chance), torch.rand(count, generator=chance)
    palette = Palette(torch.tensor([[0.1, 0.1, 0.3], [0.6, 0.1, 0.1]]))
    paint = torch.arange(count) // (count // 2)
    strokes = Strokes(
        position=torch.stack((0.05 + 0.10 * place[0], 0.04 + 0.07 * place[1]), -1),
        angle=2 * math.pi * turn,
        length=torch.full((count,), 0.04),
        bend=torch.zeros(count),
        thickness=torch.full((count,), 0.5),
        color=palette.color[paint],
    )
    easel.operator.fill_wells(palette)
    work = Hand(easel, FINE)
    plan = Plan.of(strokes, palette, paint, canvas=SIZE, brush="fine", limits=FINE.limits)
    for action in work.prepare(plan, 0, count):
        work.perform(action)
    return studio.truth(150)


def test_with_its_record_a_studio_that_stands_askew_paints_nearly_like_one_that_does_not(tmp_path: Path) -> None:
    askew = PlacementError((0.003, -0.0026), math.radians(2))
    straight = open_studio(SIZE, "fine", seed=2, placement_error=PlacementError((0.0, 0.0), 0.0))
    wanted = painted(straight, straight.easel)
    studio = open_studio(SIZE, "fine", seed=2, placement_error=askew)
    unaware = painted(studio, studio.easel)
    easel = studio.easel
    for procedure in (canvas, robot):
        finding = lead(procedure(easel), lambda question: question.proposal)
        easel = replace(easel, calibration=finding.enter(easel.calibration))
    easel.calibration.save(tmp_path / "cal.json")
    calibrated = painted(studio, on_record(studio.easel, tmp_path / "cal.json"))
    off, left = (float((picture - wanted).square().mean()) for picture in (unaware, calibrated))
    assert left < 0.5 * off


@pytest.mark.parametrize(
    ("has_gpu", "has_triton", "chosen"), [(True, True, "cuda"), (True, False, "cpu"), (False, True, "cpu")]
)
def test_planning_runs_on_a_gpu_if_something_compiles_for_it(
    has_gpu: bool, has_triton: bool, chosen: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: has_gpu)
    monkeypatch.setattr("frida_painter.session.opening.is_installed", lambda package: has_triton)
    assert planning_device().type == chosen
