"""The easel kind `sawyer-sim`: a studio with the paper's Rethink Sawyer, simulated with its weight and its friction."""

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
    if order.simulation.film and order.folder is not None:
        with contextlib.suppress(ImportError):  # connecting the arm reports what to install
            from frida_painter_drivers.sawyer.arm_film import ArmFilm

            film = ArmFilm(order.folder / ARM_FILM, easel.workspace, order.canvas, studio.table)
            studio.robot.watcher = film

    def close() -> None:
        studio.robot.watcher.close()
        studio.close()

    return OpenEasel(easel, close)


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
    why_no_film=_why_no_film,
    reach_from=_reach_from,
)
