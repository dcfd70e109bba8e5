"""Easel kind `human`: a canvas, a camera and a person who paints by hand, guided by the painting process."""

from dataclasses import replace
from typing import TYPE_CHECKING

from frida_painter.easel.kinds import EaselKind, OpenEasel, camera_forms
from frida_painter.errors import ConfigError

if TYPE_CHECKING:
    from frida_painter.easel.order import EaselOrder


def _open(order: "EaselOrder") -> OpenEasel:
    from frida_painter.calibration import BrushRecord
    from frida_painter.easel.open import make_camera
    from frida_painter.easel.operator import AbsentOperator
    from frida_painter.hardware.easel import Easel
    from frida_painter.session.human import HumanRobot
    from frida_painter.session.rehearsal import FlatbedWorkspace

    if not order.camera:
        raise ConfigError(
            f"To paint by hand, say which camera looks at the canvas (--camera {'|'.join(camera_forms())}); without "
            "one, say --camera none."
        )
    place = FlatbedWorkspace().motion(order.canvas)
    first, *others = order.brushes
    known = replace(
        place.calibration,
        easel="by hand",
        brush=first,
        camera=order.camera,
        canvas=order.canvas,
        others={name: BrushRecord(place.calibration.touch_height, place.calibration.press_height) for name in others},
    )
    easel = Easel(
        robot=HumanRobot(place.workspace.home or place.workspace.upper),
        camera=make_camera(order.camera),
        operator=AbsentOperator(),
        workspace=place.workspace,
        calibration=known,
        canvas=order.canvas,
    )
    return OpenEasel(easel, lambda: None)


KIND = EaselKind("human", "your own hand", _open, simulated=False, person=True)
