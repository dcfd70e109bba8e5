"""Kinds of real robots and cameras: all that the rest of the program has to know before one of them is opened.

Each driver says it of itself in an object that is registered as an entry point (registry.py). A module that
holds one is imported to print a list, too: it leaves the library of its device to `connect`.
"""

import ipaddress
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from frida_painter.errors import ConfigError

if TYPE_CHECKING:
    from frida_painter.hardware.robot import Camera, Point, Robot, Workspace


# A real robot as a person names it: "xarm:192.168.1.10", or "gcode:/dev/ttyUSB0,homing=yes".

Value = TypeVar("Value")
Default = TypeVar("Default")


@dataclass(frozen=True)
class MachineName:
    """A machine as it was named: its kind, where it is, and what else was said of it.

    form: how machines of its kind are named, for messages.
    """

    kind: str
    where: str
    options: Mapping[str, str]
    form: str = ""

    @classmethod
    def of(cls, text: str, form: str = "") -> "MachineName":
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
        return cls(kind.strip(), where.strip(), options, form)

    def choose(self, name: str, read: Callable[[str], Value], default: Default) -> Value | Default:
        """An option as `read` understands it. Raises ConfigError where it does not."""
        if name not in self.options:
            return default
        try:
            return read(self.options[name])
        except (ValueError, KeyError) as error:
            raise ConfigError(f"{name}={self.options[name][:40]} is not understood; write {self.form}.") from error

    def require(self, *known: str, where: bool = True) -> None:
        """Raises ConfigError where something is said that this kind does not know, or not where it is."""
        strangers = sorted(set(self.options) - set(known))
        if strangers:
            raise ConfigError(f"{self.kind} does not know {', '.join(strangers)}; write {self.form}.")
        if where and not self.where:
            raise ConfigError(f"{self.kind!r} was given without where it is; write {self.form}.")


def yes_or_no(text: str) -> bool:
    """What "yes" and "no" mean, for `MachineName.choose`. Raises KeyError."""
    return {"yes": True, "no": False}[text]


# What a machine is, whatever it is called: two names that lead to one machine have an identity in common.
#
# A stop is latched, and a machine is locked, under each of its identities. "localhost", "127.0.0.1" and the
# computer's
# own address are one; so are /dev/ttyUSB0, a link to it, and the serial number of what is plugged in there.

_HERE = "this computer"


def by_name(name: MachineName) -> frozenset[str]:
    """That of a machine of which no more is known than what it was called."""
    return frozenset({f"{name.kind}:{name.where}"})


def at_host(host: str, port: int | None = None) -> frozenset[str]:
    """Those of a machine on the network: every address that `host` has, with the port where several may listen there.

    The name service is asked; a host that it does not know keeps its name.
    """
    try:
        found = {str(place[4][0]) for place in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)}
    except (OSError, UnicodeError):  # which is what names of more than 63 letters become
        found = {host.lower().rstrip(".")}
    beside = "" if port is None else f" port {port}"
    return frozenset(f"{_address(one)}{beside}" for one in found)


def at_port(device: str) -> frozenset[str]:
    """Those of a machine on a serial port: the device that a link leads to, and the serial number of what is there."""
    path = str(Path(device).resolve())
    numbers = {
        f"serial number {port.serial_number}"
        for port in _ports()
        if port.serial_number and str(Path(port.device).resolve()) == path
    }
    return frozenset({path, *numbers})


def _address(text: str) -> str:
    """An address in one form; of all that this computer itself has, one."""
    try:
        address = ipaddress.ip_address(text.partition("%")[0])
    except ValueError:
        return text
    plain = getattr(address, "ipv4_mapped", None) or address
    return _HERE if plain.is_unspecified or plain.is_loopback or _is_own(str(plain)) else str(plain)


def _is_own(address: str) -> bool:
    """Whether the system lets this computer listen there."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((address, 0))
    except OSError:
        return False
    return True


def _ports() -> list[Any]:
    try:
        from serial.tools.list_ports import comports
    except ImportError:  # then nothing is driven over a port either
        return []
    return list(comports())


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
