"""The drivers of real robots and cameras, by the names that a person gives them."""

from collections.abc import Callable, Mapping
from pathlib import Path

from frida_painter.errors import ConfigError
from frida_painter.hardware.camera import Camera
from frida_painter.hardware.cameras.folder import FolderCamera, FolderSettings
from frida_painter.hardware.cameras.gphoto import GphotoCamera
from frida_painter.hardware.cameras.opencv import OpencvCamera, OpencvSettings
from frida_painter.hardware.drivers.axidraw import AxidrawRobot, AxidrawSettings
from frida_painter.hardware.drivers.gcode import GcodeRobot, GcodeSettings
from frida_painter.hardware.drivers.ros import RosRobot, RosSettings, Wire
from frida_painter.hardware.drivers.rosbridge import RosbridgeWire
from frida_painter.hardware.drivers.rospy_wire import RospyWire
from frida_painter.hardware.drivers.xarm import XarmRobot, XarmSettings
from frida_painter.hardware.gcode import Gcode, Servo
from frida_painter.hardware.robot import Robot
from frida_painter.hardware.workspace import Point, Workspace
from frida_painter.session.names import CAMERAS, MACHINES, MachineName


def robot_named(text: str, workspace: Workspace) -> Robot:
    """The driver of a machine that stands in a workspace; not connected. Raises ConfigError."""
    name = MachineName.of(text)
    if name.kind not in MACHINES:
        raise ConfigError(f"There is no robot {text[:60]!r}; take one of {', '.join(MACHINES.values())}.")
    if workspace.home is None:
        raise ConfigError(
            f"The workspace says no home, and {name.kind} knows none of its own; write [motion] home = [x, y, z], "
            "where the camera sees the whole canvas."
        )
    return _BUILDERS[name.kind](name, workspace.home, workspace.travel_speed)


def camera_named(text: str) -> Camera:
    """The driver of a camera; not connected. Raises ConfigError."""
    kind, _, where = text.partition(":")
    match kind:
        case "opencv":
            return OpencvCamera(OpencvSettings(int(where) if where.isdigit() else where or 0))
        case "gphoto" if not where:
            return GphotoCamera()
        case "folder" if where:
            return FolderCamera(FolderSettings(Path(where).expanduser()))
    raise ConfigError(f"There is no camera {text[:60]!r}; take one of {', '.join(CAMERAS)}.")


def _xarm(name: MachineName, home: Point, speed: float) -> Robot:
    name.require("brush_length")
    length = name.choose("brush_length", float, 0.0)
    assert isinstance(length, float)
    return XarmRobot(XarmSettings(name.where, home, speed, length))


def _gcode(name: MachineName, home: Point, speed: float) -> Robot:
    name.require("baud", "homing", "servo")
    baud, homing = name.choose("baud", int, 115_200), name.choose("homing", _yes, False)
    servo = name.choose("servo", _servo, None)
    assert isinstance(baud, int) and isinstance(homing, bool) and (servo is None or isinstance(servo, Servo))
    language = Gcode("grbl" if name.kind == "gcode" else "marlin", speed, servo)
    return GcodeRobot(GcodeSettings(name.where, home, baud, language, homing))


def _axidraw(name: MachineName, home: Point, speed: float) -> Robot:
    name.require("servo", where=False)
    servo = name.choose("servo", _servo, None)
    if isinstance(servo, Servo):
        return AxidrawRobot(AxidrawSettings(home, name.where or None, servo, speed))
    return AxidrawRobot(AxidrawSettings(home, name.where or None, approach=speed))


def _ros(name: MachineName, home: Point, speed: float) -> Robot:
    name.require("namespace", "frame", where=False)
    return _behind(name, home, speed, lambda: RospyWire(name.where or None))


def _rosbridge(name: MachineName, home: Point, speed: float) -> Robot:
    name.require("namespace", "frame", "ros")
    host, _, port = name.where.partition(":")
    if port and not (port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
        raise ConfigError(f"{port[:20]!r} is no port, which is from 1 to 65535; write {MACHINES[name.kind]}.")
    return _behind(name, home, speed, lambda: RosbridgeWire(host, int(port or 9090)))


def _behind(name: MachineName, home: Point, speed: float, wire: Callable[[], Wire]) -> Robot:
    version = name.choose("ros", int, 1)
    assert isinstance(version, int)
    told = {part: name.options[part] for part in ("namespace", "frame") if part in name.options}
    return RosRobot(RosSettings(home, speed, ros=version, **told), wire(), wire())


def _yes(text: str) -> bool:
    return {"yes": True, "no": False}[text]


def _servo(text: str) -> Servo:
    low, at_low, high, at_high = (float(part) for part in text.split("/"))
    return Servo((low, at_low), (high, at_high))


_BUILDERS: Mapping[str, Callable[[MachineName, Point, float], Robot]] = {
    "xarm": _xarm,
    "gcode": _gcode,
    "marlin": _gcode,
    "axidraw": _axidraw,
    "ros": _ros,
    "rosbridge": _rosbridge,
}
