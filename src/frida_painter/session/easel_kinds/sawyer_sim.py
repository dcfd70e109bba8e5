"""`sawyer-sim`: the paper's Rethink Sawyer in the virtual studio, simulated with its weight and its friction."""

import contextlib
from typing import TYPE_CHECKING

from frida_painter.hardware.kinds import Needed
from frida_painter.session.easel_kind import EaselKind
from frida_painter.session.names import ARM_FILM

if TYPE_CHECKING:
    from frida_painter.session.easel_order import EaselOrder, OpenEasel


def _open(order: "EaselOrder") -> "OpenEasel":
    """With a film of the arm at work where one is ordered."""
    from frida_painter.session.easel_kinds.studio import furnished
    from frida_painter.session.easel_order import OpenEasel
    from frida_painter.virtual.sawyer.meshes import Meshes
    from frida_painter.virtual.studio import SAWYER

    studio, easel = furnished(order, SAWYER)
    if order.film and order.folder is not None:
        with contextlib.suppress(ImportError):  # connecting the arm says what to install
            from frida_painter.virtual.sawyer.film import ArmFilm
            from frida_painter.virtual.sawyer.surroundings import Surroundings

            seen = None if order.meshes is None else Meshes.in_folder(order.meshes)
            before = Surroundings(easel.workspace, order.canvas, seen)
            studio.robot.watcher = ArmFilm(order.folder / ARM_FILM, before, studio.table)

    def close() -> None:
        studio.robot.watcher.close()
        studio.close()

    return OpenEasel(easel, close)


KIND = EaselKind(
    "sawyer-sim",
    "Rethink Sawyer, simulated",
    _open,
    simulated=True,
    needed=Needed("pip install 'frida-painter[mujoco]'", "mujoco"),
)
