"""Kinds of real robots and cameras: all that the rest of the program has to know before one of them is opened.

Each driver says it of itself in an object that is registered as an entry point (registry.py). A module that
holds one is imported to print a list, too: it leaves the library of its device to `connect`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING

from frida_painter.errors import ConfigError
from frida_painter.hardware.machine_identity import by_name
from frida_painter.hardware.machine_name import MachineName

if TYPE_CHECKING:  # a process that only passes names on does without arrays
    from frida_painter.hardware.camera import Camera
    from frida_painter.hardware.robot import Robot
    from frida_painter.hardware.workspace import Point, Workspace


@dataclass(frozen=True)
class Needed:
    """What has to be installed for a device: how a person does it, and the module that is there afterwards.

    module: "" where it cannot be looked for, such as packages of the system outside of a virtual environment;
    such a thing always counts as lacking.
    """

    install: str
    module: str = ""

    @property
    def lacking(self) -> bool:
        """Whether it is not known to be installed."""
        return not self.module or find_spec(self.module.partition(".")[0]) is None


@dataclass(frozen=True)
class RobotKind:
    """A kind of real robot.

    name: by which it is registered; form: how it is written after --robot; title: what people call it;
    open: makes the driver, not connected, of a machine of that name in a workspace, and raises ConfigError
    where the name makes no sense; needed: what has to be installed for it, None for nothing; identify: what the
    machine of a name is, whatever else it is called (machine_identity.py).
    """

    name: str
    form: str
    title: str
    open: "Callable[[MachineName, Workspace], Robot]"
    needed: Needed | None = None
    identify: Callable[[MachineName], frozenset[str]] = by_name


@dataclass(frozen=True)
class CameraKind:
    """A kind of camera.

    name: by which it is registered; form: how it is written after --camera; title: what people call it;
    open: makes the driver, not connected, from what stands behind the name's colon, and raises ConfigError
    where that makes no sense; needed: what has to be installed for it, None for nothing; is_path: whether
    that is a path, which is then completed from the folder in which the program was started.
    """

    name: str
    form: str
    title: str
    open: "Callable[[str], Camera]"
    needed: Needed | None = None
    is_path: bool = False


def require_home(name: MachineName, workspace: "Workspace") -> "Point":
    """Where the tip waits while the camera looks, for robots that know no such place. Raises ConfigError."""
    if workspace.home is None:
        raise ConfigError(
            f"The workspace says no home, and {name.kind} knows none of its own; write [motion] home = [x, y, z], "
            "where the camera sees the whole canvas."
        )
    return workspace.home
