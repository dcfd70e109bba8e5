"""Names on which processes agree: of robots and cameras, as a person gives them, and of files in a painting's folder.

A real robot is named like "xarm:192.168.1.10" or "gcode:/dev/ttyUSB0,homing=yes", its camera like "opencv:0".
Whoever only passes names on needs no driver for that.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from frida_painter.errors import ConfigError

JOURNAL = "journal"
STOP_FILE = "stop"

HUMAN, VIRTUAL, SAWYER_SIM = "human", "virtual", "sawyer-sim"
SIMULATED = frozenset({VIRTUAL, SAWYER_SIM})
TITLES: Mapping[str, str] = {VIRTUAL: "virtual studio", SAWYER_SIM: "Rethink Sawyer, simulated"}
"""What pages call a simulated robot."""
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


def require_known(robot: str) -> str:
    """The kind of a robot that is named so. Raises ConfigError where there is none."""
    kind = MachineName.of(robot).kind
    if kind not in {HUMAN, *SIMULATED, *MACHINES}:
        raise ConfigError(
            f"There is no robot {robot[:60]!r}; take {HUMAN}, {VIRTUAL}, {SAWYER_SIM}, or a real one: "
            f"{', '.join(MACHINES.values())}."
        )
    return kind
