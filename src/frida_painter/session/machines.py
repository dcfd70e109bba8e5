"""Real robots and cameras as a person names them: "xarm:192.168.1.10", "gcode:/dev/ttyUSB0,homing=yes", "opencv:0"."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
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

CAMERAS = ("opencv:NUMBER", "gphoto", "folder:PATH")
MACHINES: Mapping[str, str] = {
    "xarm": "xarm:ADDRESS[,brush_length=METRES]",
    "gcode": "gcode:PORT[,baud=N][,homing=yes][,servo=Z/S/Z/S]",
    "marlin": "marlin:PORT[,baud=N][,homing=yes][,servo=Z/DEGREES/Z/DEGREES]",
    "axidraw": "axidraw[:PORT][,servo=Z/PULSE/Z/PULSE]",
    "ros": "ros[:MASTER][,namespace=/NAME][,frame=NAME]",
    "rosbridge": "rosbridge:HOST[:PORT][,ros=2][,namespace=/NAME][,frame=NAME]",
}
"""How each kind of real robot is named."""


@dataclass(frozen=True)
class MachineName:
    """A machine as it was named: its kind, where it is, and what else was said of it."""

    kind: str
    where: str
    options: Mapping[str, str]

    @classmethod
    def of(cls, text: str) -> "MachineName":
        """Reads "kind:where,name=value". Raises ConfigError."""
        named, *parts = text.split(",")
        kind, _, where = named.partition(":")
        options = {}
        for part in parts:
            name, equals, value = part.partition("=")
            if not (equals and name.strip() and value.strip()) or name.strip() in options:
                raise ConfigError(
                    f"{part[:40]!r} in {text[:80]!r} is not understood; write name=value, each name once."
                )
            options[name.strip()] = value.strip()
        return cls(kind.strip(), where.strip(), options)

    def choose(self, name: str, read: Callable[[str], object], default: object) -> object:
        """An option as `read` understands it. Raises ConfigError where it does not."""
        if name not in self.options:
            return default
        try:
            return read(self.options[name])
        except (ValueError, KeyError) as error:
            raise ConfigError(f"{name}={self.options[name][:40]} is not understood; {self._form}.") from error

    def require(self, *known: str, where: bool = True) -> None:
        """Raises ConfigError where something is said that this kind does not know, or not where it is."""
        strangers = sorted(set(self.options) - set(known))
        if strangers:
            raise ConfigError(f"{self.kind} does not know {', '.join(strangers)}; {self._form}.")
        if where and not self.where:
            raise ConfigError(f"{self.kind!r} was given without where it is; {self._form}.")

    @property
    def _form(self) -> str:
        return f"write {MACHINES[self.kind]}"


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
    if port and not port.isdigit():
        raise ConfigError(f"{port[:20]!r} is no port; write {MACHINES[name.kind]}.")
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
