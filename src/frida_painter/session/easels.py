"""The easels there are, by name: what is wanted of one, and how it is opened.

A simulated robot joins with its name in names.py and one line in `OPENERS`, a real one in names.py and
machines.py; everything else, its process, stop, latch and lock, is the same for all.
"""

import contextlib
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from pydantic import ConfigDict, TypeAdapter, ValidationError

from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.drivers.human import HumanRobot
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.session.flatbed_workspace import FlatbedWorkspace
from frida_painter.session.machines import camera_named, robot_named
from frida_painter.session.names import (
    CAMERAS,
    HUMAN,
    MACHINES,
    SAWYER_SIM,
    SIMULATED,
    VIRTUAL,
    MachineName,
    require_known,
)
from frida_painter.session.operator import AbsentOperator
from frida_painter.virtual.faults import NO_FAULTS, Faults
from frida_painter.virtual.kernels import load_kernels
from frida_painter.virtual.sawyer.meshes import Meshes
from frida_painter.virtual.studio import FREE, SAWYER, StudioSettings, VirtualStudio, open_studio
from frida_painter.virtual.table import PlacementError

DIARY = "studio.diary"
ARM_FILM = "arm.mp4"


@dataclass(frozen=True)
class EaselOrder:
    """Which easel is wanted, and for what: everything that its process has to know, as plain values.

    robot: its name in `OPENERS`, or a real one as session/names.py says; canvas, brush, seed: as
    the painting's settings say; state: the folder in which stops are latched and robots locked; folder:
    of the painting, where the stop file is looked for and a virtual studio keeps its diary; pace,
    placement_error, faults: of a virtual studio; film: whether a simulated arm is filmed at work, into
    that folder, and meshes: the folder of shapes in which it is seen there, None for its own; workspace,
    camera: of a real easel, its file and its camera's name.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    robot: str
    canvas: CanvasSize
    brush: str
    seed: int
    state: Path
    folder: Path | None = None
    pace: float = 0.0
    placement_error: PlacementError | None = None
    faults: Faults = field(default=NO_FAULTS)
    workspace: Path | None = None
    camera: str = ""
    film: bool = False
    meshes: Path | None = None

    def record(self) -> dict[str, Any]:
        """The order as plain values."""
        return TypeAdapter(EaselOrder).dump_python(self, mode="json")

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Self:
        """An order from plain values. Raises ConfigError where they are none."""
        try:
            return TypeAdapter(cls).validate_python(record)
        except ValidationError as error:
            faults = "; ".join(
                f"{'.'.join(map(str, fault['loc']))}: {fault['msg'].lower()}" for fault in error.errors()
            )
            raise ConfigError(f"The order of an easel is not as it must be ({faults}).") from error


@dataclass(frozen=True)
class OpenEasel:
    """An easel that is open. close: ends what is beyond robot and camera, such as a diary; may raise StorageError."""

    easel: Easel
    close: Callable[[], None]


def open_easel(order: EaselOrder) -> OpenEasel:
    """Opens the easel of that name; its robot and camera are not connected yet. Raises ConfigError and StorageError."""
    kind = require_known(order.robot)
    return _open_real(order) if kind in MACHINES else OPENERS[kind](order)


def machine(order: EaselOrder) -> str | None:
    """A name for what only one process may have at a time; None where nobody else could know of it.

    Of a simulated machine that is the world of one painting, of a real one the machine.
    """
    if order.robot in SIMULATED:
        return None if order.folder is None else f"the {order.robot} studio of {order.folder.resolve()}"
    name = MachineName.of(order.robot)
    return f"{name.kind}:{name.where}"


def lock_path(state: Path, name: str) -> Path:
    """Where the lock of the machine of that name is kept."""
    return state / "locks" / f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.lock"


def _open_virtual(order: EaselOrder) -> OpenEasel:
    studio = _studio(order, FREE)
    return OpenEasel(studio.easel, studio.close)


def _open_sawyer(order: EaselOrder) -> OpenEasel:
    studio = _studio(order, SAWYER)
    if order.film and order.folder is not None:
        with contextlib.suppress(ImportError):  # connecting the arm says what to install
            from frida_painter.virtual.sawyer.film import ArmFilm
            from frida_painter.virtual.sawyer.surroundings import Surroundings

            seen = None if order.meshes is None else Meshes.in_folder(order.meshes)
            before = Surroundings(studio.easel.workspace, order.canvas, seen)
            studio.robot.watcher = ArmFilm(order.folder / ARM_FILM, before, studio.table)

    def close() -> None:
        studio.robot.watcher.close()
        studio.close()

    return OpenEasel(studio.easel, close)


def _studio(order: EaselOrder, arm: str) -> VirtualStudio:
    load_kernels(order.brush)
    return open_studio(
        order.canvas,
        order.brush,
        seed=order.seed,
        settings=StudioSettings(arm=arm, placement_error=order.placement_error, pace=order.pace, faults=order.faults),
        state=None if order.folder is None else order.folder / DIARY,
    )


def _open_real(order: EaselOrder) -> OpenEasel:
    """Robot and camera as they are named, where the workspace file says that things stand."""
    if order.workspace is None or not order.camera:
        raise ConfigError(
            f"The robot {order.robot[:60]!r} needs a workspace file (--workspace) and a camera (--camera "
            f"{'|'.join(CAMERAS)}); `frida-painter workspace example` prints a whole one."
        )
    stand = WorkcellConfig.load(order.workspace)
    if max(abs(order.canvas.width - stand.canvas.width), abs(order.canvas.height - stand.canvas.height)) > 0.001:
        raise ConfigError(
            f"The painting is for a canvas of {order.canvas}, and the one in {str(order.workspace)!r} is "
            f"{stand.canvas}; leave out --canvas, or put up the other canvas and make the workspace true."
        )
    easel = Easel(
        robot=robot_named(order.robot, stand.workspace),
        camera=camera_named(order.camera),
        operator=AbsentOperator(),
        workspace=stand.workspace,
        calibration=stand.calibration(order.brush, camera=order.camera),
        canvas=stand.canvas,
        reach=stand.reach,
    )
    return OpenEasel(easel, lambda: None)


def _open_by_hand(order: EaselOrder) -> OpenEasel:
    """A canvas, a camera, and the hand of a person whom the painting process talks with."""
    if not order.camera:
        raise ConfigError(f"To paint by hand, say which camera looks at the canvas (--camera {'|'.join(CAMERAS)}).")
    place = FlatbedWorkspace().motion(order.canvas)
    known = replace(place.calibration, easel="by hand", brush=order.brush, camera=order.camera, canvas=order.canvas)
    home = place.workspace.home or place.workspace.upper
    easel = Easel(
        robot=HumanRobot(home),
        camera=camera_named(order.camera),
        operator=AbsentOperator(),
        workspace=place.workspace,
        calibration=known,
        canvas=order.canvas,
    )
    return OpenEasel(easel, lambda: None)


OPENERS: Mapping[str, Callable[[EaselOrder], OpenEasel]] = {
    HUMAN: _open_by_hand,
    VIRTUAL: _open_virtual,
    SAWYER_SIM: _open_sawyer,
}
