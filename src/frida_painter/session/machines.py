"""Real robots and cameras by the names that a person gives them."""

from frida_painter import registry
from frida_painter.errors import ConfigError
from frida_painter.hardware.camera import Camera
from frida_painter.hardware.kinds import CameraKind, RobotKind
from frida_painter.hardware.machine_name import MachineName
from frida_painter.hardware.robot import Robot
from frida_painter.hardware.workspace import Workspace
from frida_painter.session.names import camera_forms, robot_forms


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
