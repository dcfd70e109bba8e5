"""The virtual studio as an easel with the paper's Rethink Sawyer, simulated with its weight and its friction."""

import contextlib
from typing import TYPE_CHECKING

from frida_painter.easel.kinds import ARM_FILM, SAWYER_SIM, EaselKind, OpenEasel
from frida_painter.easel.virtual_easel import assemble_easel, load_loops
from frida_painter.hardware.kinds import Needed

if TYPE_CHECKING:  # pages and help load this kind without its numerical libraries
    from frida_painter.canvas_size import CanvasSize
    from frida_painter.easel.order import EaselOrder
    from frida_painter.hardware.robot import Reach, Workspace
    from frida_painter.hardware.timing import Timing


def _open_sawyer(order: "EaselOrder") -> OpenEasel:
    """Opens the studio with the Sawyer, and films the arm if the order says so."""
    from frida_painter_drivers.sawyer.arm import SAWYER

    studio, easel = assemble_easel(order, SAWYER)
    if order.film and order.folder is not None:
        with contextlib.suppress(ImportError):  # connecting the arm reports what to install
            from frida_painter_drivers.sawyer.arm_film import ArmFilm
            from frida_painter_drivers.sawyer.surroundings import Meshes, Surroundings

            seen = None if order.meshes is None else Meshes.in_folder(order.meshes)
            before = Surroundings(easel.workspace, order.canvas, seen)
            studio.robot.watcher = ArmFilm(order.folder / ARM_FILM, before, studio.table)

    def close() -> None:
        studio.robot.watcher.close()
        studio.close()

    return OpenEasel(easel, close)


def _require_meshes(order: "EaselOrder") -> None:
    """Raises ConfigError if the folder of --arm-meshes contains no arm."""
    with contextlib.suppress(ImportError):  # connecting the arm reports what to install
        from frida_painter_drivers.sawyer.surroundings import Meshes

        if order.meshes is not None:
            Meshes.in_folder(order.meshes)


def _why_no_film() -> str | None:
    with contextlib.suppress(ImportError):  # connecting the arm reports what to install
        from frida_painter_drivers.sawyer.arm_film import NONE, headless_opengl

        return NONE if headless_opengl() is None else None
    return None


def _reach_from(workspace: "Workspace", canvas: "CanvasSize") -> "tuple[Reach, Timing]":
    from frida_painter_drivers.sawyer.arm import TIMING, SawyerReach

    return SawyerReach(workspace, canvas), TIMING


KIND = EaselKind(
    SAWYER_SIM,
    "Rethink Sawyer, simulated",
    _open_sawyer,
    simulated=True,
    needed=Needed(module="mujoco", extra="mujoco"),
    load=load_loops,
    require=_require_meshes,
    why_no_film=_why_no_film,
    reach_from=_reach_from,
)
