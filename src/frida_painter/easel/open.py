"""Opens easels by name, and locks their machines: one robot, one process.

A whole easel opens itself. A real robot stands with its camera in a workspace that a file describes.
"""

import contextlib
import hashlib
import os
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from frida_painter import registry
from frida_painter.easel.kinds import (
    NO_CAMERA,
    EaselKind,
    OpenEasel,
    camera_forms,
    is_machine,
    is_simulated,
    require_equipment,
    robot_forms,
)
from frida_painter.easel.operator import AbsentOperator
from frida_painter.easel.order import EaselOrder
from frida_painter.errors import ConfigError, FridaError, RobotBusy
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.kinds import CameraKind, MachineName, RobotKind, by_name
from frida_painter.hardware.robot import Camera, Reach, Robot, Workspace
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.system import storage
from frida_painter.system.operating_system import write_at


def open_easel(order: EaselOrder) -> OpenEasel:
    """Opens an ordered easel; its robot and camera are not connected yet. Raises ConfigError and StorageError."""
    if is_machine(order.robot):
        opened = _open_real(order)
    else:
        opened = registry.parts(registry.EASELS)[order.robot].load(EaselKind).open(order)
    if order.camera != NO_CAMERA:
        return opened
    unseen = replace(opened.easel.calibration, camera=NO_CAMERA)
    return replace(opened, easel=replace(opened.easel, has_camera=False, calibration=unseen))


def load_easel(robot: str) -> None:
    """Loads the computations of a named easel. Ignores unknown names and failures, which `open_easel` reports."""
    with contextlib.suppress(FridaError):
        if (known := registry.parts(registry.EASELS).get(robot)) is not None:
            known.load(EaselKind).load()


def machines(order: EaselOrder) -> frozenset[str]:
    """Returns the identities that only one process may hold at a time.

    For a simulated robot this is the world of one painting; without a folder there is none. For a real robot these
    are all identities of the machine.
    """
    if is_simulated(order.robot):
        return frozenset(() if order.folder is None else {f"the {order.robot} studio of {order.folder.resolve()}"})
    return identities(order.robot)


def identities(robot: str) -> frozenset[str]:
    """Returns all identities of a named real robot."""
    name = MachineName.of(robot)
    known = registry.parts(registry.ROBOTS).get(name.kind)
    return by_name(name) if known is None else known.load(RobotKind).identify(name)


def hold_machines(stack: ExitStack, state: Path, identities: Iterable[str]) -> None:
    """Locks the machine of these identities until the end of `stack`.

    state: folder of latches and locks. A lock file remains, with the id of the last process that held the lock. The
        system releases a lock when its process ends for any reason.

    Raises RobotBusy, with the id of the process that holds a lock, or StorageError if a file cannot be created.
    """
    for identity in sorted(identities):
        path = state / "locks" / f"{hashlib.sha256(identity.encode()).hexdigest()[:16]}.lock"
        # Only a lock of the system will do: a marker file would outlive a process that dies.
        lock = FileLock(
            path, mode=0o644, fallback_to_soft=False, preserve_lock_file=True, thread_local=False, on_acquired=_sign
        )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            lock.acquire(blocking=False)
        except Timeout as error:
            holder = _signature(path)
            whose = f"process {holder}" if holder else "another process"
            raise RobotBusy(
                f"{identity} is in use by {whose}; wait until that painting is done, or stop it first.", holder
            ) from error
        except OSError as error:
            raise storage.cannot_write(path, error) from error
        stack.callback(lock.release)


def _sign(file: int) -> None:
    with contextlib.suppress(OSError):  # the lock holds without the process id, too
        os.ftruncate(file, 0)
        write_at(file, str(os.getpid()).encode(), 0)


def _signature(path: Path) -> int | None:
    """Returns the process id in a lock file; None if there is none (yet)."""
    try:
        with path.open("rb") as file:
            text = file.read(20)
    except OSError:
        return None
    return int(text) if text.isdigit() else None


def _open_real(order: EaselOrder) -> OpenEasel:
    """Opens a named robot and camera in the workspace of the order's file."""
    require_equipment(order.robot, order.workspace, order.camera)
    assert order.workspace is not None
    workcell = WorkcellConfig.load(order.workspace)
    if max(abs(order.canvas.width - workcell.canvas.width), abs(order.canvas.height - workcell.canvas.height)) > 0.001:
        raise ConfigError(
            f"The painting is for a canvas of {order.canvas}, and the one in {str(order.workspace)!r} is "
            f"{workcell.canvas}; leave out --canvas, or put up the other canvas and make the workspace true."
        )
    robot = make_robot(order.robot, workcell.workspace)
    easel = Easel(
        robot=robot,
        camera=make_camera(order.camera),
        operator=AbsentOperator(),
        workspace=workcell.workspace,
        calibration=workcell.calibration(order.brushes[0], camera=order.camera, others=order.brushes[1:]),
        canvas=workcell.canvas,
        reach=find_reach(workcell, robot),
    )
    return OpenEasel(easel, lambda: None)


@dataclass(frozen=True)
class _BothReach:
    """Reach by two judgements: a position counts as reached if both agree. Implements hardware.robot.Reach."""

    one: Reach
    other: Reach

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each position [k, 3] that both reach: [k]."""
        return self.one.reachable(position) & self.other.reachable(position)


def find_reach(workcell: WorkcellConfig, robot: Robot) -> Reach | None:
    """Returns the reach of a real robot: the workspace's [arm] and the driver's own kinematics, as far as known."""
    own = robot if isinstance(robot, Reach) else None
    if own is None or workcell.reach is None:
        return own or workcell.reach
    return _BothReach(workcell.reach, own)


def make_robot(text: str, workspace: Workspace) -> Robot:
    """Returns the driver of a named robot in a workspace, not connected. Raises ConfigError."""
    known = registry.parts(registry.ROBOTS).get(MachineName.of(text).kind)
    if known is None:
        raise ConfigError(f"There is no robot {text[:60]!r}; take one of {', '.join(robot_forms())}.")
    kind = known.load(RobotKind)
    return kind.open(MachineName.of(text, kind.form), workspace)


def make_camera(text: str) -> Camera:
    """Returns the driver of a named camera, not connected. Raises ConfigError."""
    name, _, where = text.partition(":")
    known = registry.parts(registry.CAMERAS).get(name)
    if known is None:
        raise ConfigError(f"There is no camera {text[:60]!r}; take one of {', '.join(camera_forms())}.")
    return known.load(CameraKind).open(where)
