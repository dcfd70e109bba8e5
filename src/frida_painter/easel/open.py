"""Opens easels by name: what is wanted of one, and how it is put together.

A whole easel opens itself (easel_kinds/), a real robot stands with its camera in a workspace that a file tells of.
Both are found through entry points (registry.py); everything else, their process, stop, latch and lock, is the
same for all.
"""

import hashlib
from contextlib import suppress
from pathlib import Path

from frida_painter import registry
from frida_painter.easel.kinds import (
    MACHINES,
    SIMULATED,
    EaselKind,
    OpenEasel,
    camera_forms,
    require_known,
    robot_forms,
)
from frida_painter.easel.operator import AbsentOperator
from frida_painter.easel.order import EaselOrder
from frida_painter.errors import ConfigError, FridaError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.kinds import CameraKind, MachineName, RobotKind, by_name
from frida_painter.hardware.robot import Camera, Robot, Workspace
from frida_painter.hardware.workcell import WorkcellConfig


def open_easel(order: EaselOrder) -> OpenEasel:
    """Opens the easel of that name; its robot and camera are not connected yet. Raises ConfigError and StorageError."""
    kind = require_known(order.robot)
    if kind in MACHINES:
        return _open_real(order)
    return registry.parts(registry.EASELS)[kind].load(EaselKind).open(order)


def load_easel(robot: str) -> None:
    """Loads what an easel of that name computes with; of one that there is not, opening it will tell."""
    with suppress(FridaError):
        if (known := registry.parts(registry.EASELS).get(robot)) is not None:
            known.load(EaselKind).load()


def is_simulated(order: EaselOrder) -> bool:
    """Whether no real machine is moved: then a stop is not latched, and a slow computer is waited for."""
    return order.robot in SIMULATED


def machines(order: EaselOrder) -> frozenset[str]:
    """What only one process may have at a time, by every identity that it has; nothing where nobody could know of it.

    Of a simulated machine that is the world of one painting, of a real one the machine, whatever it is called.
    """
    if is_simulated(order):
        return frozenset(() if order.folder is None else {f"the {order.robot} studio of {order.folder.resolve()}"})
    name = MachineName.of(order.robot)
    known = registry.parts(registry.ROBOTS).get(name.kind)
    return by_name(name) if known is None else known.load(RobotKind).identify(name)


def lock_path(state: Path, name: str) -> Path:
    """Where the lock of the machine of that name is kept."""
    return state / "locks" / f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.lock"


def _open_real(order: EaselOrder) -> OpenEasel:
    """Robot and camera as they are named, where the workspace file says that things stand."""
    if order.workspace is None or not order.camera:
        raise ConfigError(
            f"The robot {order.robot[:60]!r} needs a workspace file (--workspace) and a camera (--camera "
            f"{'|'.join(camera_forms())}); `frida-painter workspace example` prints a whole one."
        )
    workcell = WorkcellConfig.load(order.workspace)
    if max(abs(order.canvas.width - workcell.canvas.width), abs(order.canvas.height - workcell.canvas.height)) > 0.001:
        raise ConfigError(
            f"The painting is for a canvas of {order.canvas}, and the one in {str(order.workspace)!r} is "
            f"{workcell.canvas}; leave out --canvas, or put up the other canvas and make the workspace true."
        )
    easel = Easel(
        robot=robot_named(order.robot, workcell.workspace),
        camera=camera_named(order.camera),
        operator=AbsentOperator(),
        workspace=workcell.workspace,
        calibration=workcell.calibration(order.brushes[0], camera=order.camera, others=order.brushes[1:]),
        canvas=workcell.canvas,
        reach=workcell.reach,
    )
    return OpenEasel(easel, lambda: None)


def robot_named(text: str, workspace: Workspace) -> Robot:
    """The driver of a machine that stands in a workspace; not connected. Raises ConfigError."""
    known = registry.parts(registry.ROBOTS).get(MachineName.of(text).kind)
    if known is None:
        raise ConfigError(f"There is no robot {text[:60]!r}; take one of {', '.join(robot_forms())}.")
    kind = known.load(RobotKind)
    return kind.open(MachineName.of(text, kind.form), workspace)


def camera_named(text: str) -> Camera:
    """The driver of a camera; not connected. Raises ConfigError."""
    name, _, where = text.partition(":")
    known = registry.parts(registry.CAMERAS).get(name)
    if known is None:
        raise ConfigError(f"There is no camera {text[:60]!r}; take one of {', '.join(camera_forms())}.")
    return known.load(CameraKind).open(where)
