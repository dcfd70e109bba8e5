from dataclasses import replace

import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.robot import ArmLength
from frida_painter.session.rehearsal import rehearse
from support.easel import CALIBRATION, WORKSPACE
from support.plans import CANVAS, made_up_plan

PLAN = made_up_plan(30, 3)


def test_what_can_be_painted_passes() -> None:
    found = rehearse(PLAN, WORKSPACE, CANVAS, CALIBRATION)
    assert found.passed and not (found.mismatches or found.strokes or found.others)


def test_strokes_that_cannot_be_painted_are_found_each_and_only_they() -> None:
    bound = WORKSPACE.to_robot(torch.tensor([[0.2, 0.1]]).numpy(), torch.zeros(1).numpy())[0, 0]
    cut = replace(WORKSPACE, upper=(bound, *WORKSPACE.upper[1:]))
    found = rehearse(PLAN, cut, CANVAS, CALIBRATION)
    points = PLAN.strokes.path(torch.linspace(0, 1, 400))
    astray = [
        index
        for index in range(len(PLAN))
        if (WORKSPACE.to_robot(points[index].numpy(), torch.zeros(400).numpy())[:, 0] > bound + 1e-6).any()
    ]
    assert 0 < len(astray) < len(PLAN)
    assert list(found.strokes) == astray
    assert found.strokes[astray[0]].reason.startswith("x = ") and not found.passed


def test_an_arm_that_is_too_short_is_told_for_strokes_and_wells() -> None:
    found = rehearse(PLAN, WORKSPACE, CANVAS, CALIBRATION, ArmLength((0.4, 0.3, 0.1), 0.0, 0.25))
    assert 0 < len(found.strokes) < len(PLAN)
    assert [fault.label for fault in found.others[:1]] == ["dip into well 1"]


def test_another_canvas_and_too_few_wells_are_both_named() -> None:
    fewer = replace(WORKSPACE, wells=WORKSPACE.wells[:2])
    found = rehearse(PLAN, fewer, CanvasSize(0.4, 0.2), CALIBRATION)
    assert [part for sentence in found.mismatches for part in ("400 x 200 mm", "3 paints") if part in sentence] == [
        "400 x 200 mm",
        "3 paints",
    ]
    assert not found.passed


def test_a_millimetre_is_not_another_canvas() -> None:
    assert rehearse(PLAN, WORKSPACE, CanvasSize(CANVAS.width + 0.0009, CANVAS.height), CALIBRATION).passed
