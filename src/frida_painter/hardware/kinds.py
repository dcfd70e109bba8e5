"""Kinds of real robots and cameras: what the program must know before it opens one of them.

Each driver describes itself in an object that is registered as an entry point (registry.py). The program imports
the driver's module even to print a list. Therefore the module loads the library of its device only in `connect`.
"""

import ipaddress
import re
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from platformdirs import user_state_path

from frida_painter.errors import ConfigError, StorageError
from frida_painter.registry import advice
from frida_painter.system import storage

if TYPE_CHECKING:
    from frida_painter.hardware.robot import Camera, Point, Robot, Workspace

Value = TypeVar("Value")
Default = TypeVar("Default")


@dataclass(frozen=True)
class MachineName:
    """Machine name as a person wrote it: kind, address and options.

    form: how names of this kind are written, for messages
    """

    kind: str
    where: str
    options: Mapping[str, str]
    form: str = ""

    @classmethod
    def of(cls, text: str, form: str = "") -> "MachineName":
        """Reads "kind:where,name=value". Raises ConfigError if an option is malformed or given twice."""
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
        """Returns an option as converted by `read`, or the default. Raises ConfigError if `read` fails."""
        if name not in self.options:
            return default
        try:
            return read(self.options[name])
        except (ValueError, KeyError) as error:
            raise ConfigError(f"{name}={self.options[name][:40]} is not understood; write {self.form}.") from error

    def require(self, *known: str, where: bool = True) -> None:
        """Raises ConfigError if the name has an unknown option, or no place although `where` is True."""
        strangers = sorted(set(self.options) - set(known))
        if strangers:
            raise ConfigError(f"{self.kind} does not know {', '.join(strangers)}; write {self.form}.")
        if where and not self.where:
            raise ConfigError(f"{self.kind!r} was given without where it is; write {self.form}.")


def yes_or_no(text: str) -> bool:
    """Converts "yes" and "no" to a bool, for `MachineName.choose`. Raises KeyError for other words."""
    return {"yes": True, "no": False}[text]


def millimetres_per_second(text: str) -> float:
    """Converts a speed in mm/s to m/s, for `MachineName.choose`. Raises ValueError if it is not above 0."""
    speed = float(text) / 1000
    if not 0 < speed <= 1:
        raise ValueError(f"a speed of {text} mm/s")
    return speed


# Identities of machines: two names of the same machine share an identity.
# A stop is latched, and a machine is locked, under each of its identities. "localhost", "127.0.0.1" and the
# computer's own address are one identity. So are /dev/ttyUSB0, a link to it, and the serial number of the device
# there.

_HERE = "this computer"


def by_name(name: MachineName) -> frozenset[str]:
    """Returns the identity of a machine of which only the name is known."""
    return frozenset({f"{name.kind}:{name.where}"})


def at_host(host: str, port: int | None = None) -> frozenset[str]:
    """Returns the identities of a machine on the network: the addresses of `host`, with the port if one is given.

    A host that the name service does not know keeps its name.
    """
    try:
        found = {str(place[4][0]) for place in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)}
    except (OSError, UnicodeError):  # names of more than 63 letters raise UnicodeError
        found = {host.lower().rstrip(".")}
    beside = "" if port is None else f" port {port}"
    return frozenset(f"{_address(one)}{beside}" for one in found)


def at_port(device: str) -> frozenset[str]:
    """Returns the identities of a machine on a serial port: the resolved device path and its serial number.

    A port on the network (socket://, rfc2217://) is known by its address. Raises ConfigError, as `find_port` does.
    """
    if "://" in device:
        address = urlsplit(device)
        return at_host(address.hostname or "", address.port)
    numbers, path = _numbers(), _resolve(find_port(device))
    alone = [number for number in numbers.values() if [*numbers.values()].count(number) == 1]
    return frozenset({path, *(f"serial number {number}" for number in alone if number == numbers.get(path))})


def find_port(name: str) -> str:
    """Returns the port at which a device is now: of that name, or with the serial number that it had under that name.

    name: of a port, with links of udev; an address (socket://HOST:PORT); or a device's serial number
    Raises ConfigError if another device took the name, or if several have the serial number.
    """
    if "://" in name or not (numbers := _numbers()):
        return name
    there = Path(name).exists() or any(port.device == name for port in _ports())  # COM3 is no path
    linked = there and "/by-id/" in name  # to one of those that share a number
    wanted = numbers.get(_resolve(name), "") if linked else _remembered().get(name, "" if there else name)
    found = [device for device, number in numbers.items() if number.lower() == wanted.lower()]
    if there and (not found or (not linked and _resolve(name) in found)):
        return name
    if len(found) > 1:
        raise ConfigError(
            f"{', '.join(found)} have one serial number, {wanted}, so which of them {name!r} is, is not known. Unplug "
            "the other, or give the place where it is plugged in: see ls -l /dev/serial/by-path."
        )
    if there and not linked:
        raise ConfigError(
            f"At {name} is another device than before; the machine that was there is at {found[0]} now. Give that port."
        )
    return found[0] if found else name


def remember_port(name: str, device: str) -> None:
    """Keeps the serial number of the device that was opened under a name, so that it is found under another one."""
    number = _numbers().get(_resolve(device))
    if number and _remembered().get(name) != number and "/by-" not in name:
        with suppress(StorageError):
            storage.write_json(_kept(), {**_remembered(), name: number})


def _kept() -> Path:
    return user_state_path("frida-painter", appauthor=False) / "ports.json"


def _remembered() -> dict[str, str]:
    with suppress(StorageError):
        return {str(name): str(number) for name, number in storage.read_json(_kept(), "the ports of machines").items()}
    return {}


def _numbers() -> dict[str, str]:
    """Returns the serial numbers of the devices that have one, by the paths of their ports."""
    return {_resolve(port.device): str(port.serial_number) for port in _ports() if port.serial_number}


def _resolve(device: str) -> str:
    return device if re.fullmatch(r"COM\d+", device) else str(Path(device).resolve())


def _address(text: str) -> str:
    """Returns an address in its canonical form; all addresses of this computer become one."""
    try:
        address = ipaddress.ip_address(text.partition("%")[0])
    except ValueError:
        return text
    plain = getattr(address, "ipv4_mapped", None) or address
    return _HERE if plain.is_unspecified or plain.is_loopback or _is_own(str(plain)) else str(plain)


def _is_own(address: str) -> bool:
    """Returns True if the system lets this computer listen at the address."""
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
    except ImportError:  # without pyserial, nothing is driven over a port either
        return []
    return list(comports())


@dataclass(frozen=True)
class Needed:
    """Requirement of a device: how a person installs it, and the module that is importable afterwards.

    install: command that installs it; not for an extra of this project
    extra: extra of this project that installs it
    """

    install: str = ""
    module: str = ""
    extra: str = ""

    def advice(self, user: str) -> str:
        """Returns a sentence that says how to install what is lacking; user: its subject."""
        return advice(self.extra, user) if self.extra else f"{user} needs a package; say: {self.install}"

    @property
    def lacking(self) -> bool:
        """True if the module is not known to be installed."""
        return not self.module or find_spec(self.module.partition(".")[0]) is None


@dataclass(frozen=True)
class RobotKind:
    """Kind of real robot.

    name: under which it is registered
    form: how it is written after --robot
    title: what people call it
    open: makes the driver, not yet connected, of a named machine in a workspace; raises ConfigError if the name is
        invalid
    needed: what must be installed for it; None for nothing
    identify: returns the identities of the machine of a name
    """

    name: str
    form: str
    title: str
    open: "Callable[[MachineName, Workspace], Robot]"
    needed: Needed | None = None
    identify: Callable[[MachineName], frozenset[str]] = by_name


@dataclass(frozen=True)
class CameraKind:
    """Kind of camera.

    name: under which it is registered
    form: how it is written after --camera
    title: what people call it
    open: makes the driver, not yet connected, from the text after the name's colon; raises ConfigError if it is
        invalid
    needed: what must be installed for it; None for nothing
    is_path: True if that text is a path, which is then relative to the folder in which the program started
    """

    name: str
    form: str
    title: str
    open: "Callable[[str], Camera]"
    needed: Needed | None = None
    is_path: bool = False


def require_home(name: MachineName, workspace: "Workspace") -> "Point":
    """Returns the workspace's home position, for robots that have none. Raises ConfigError if it is missing."""
    if workspace.home is None:
        raise ConfigError(
            f"The workspace says no home, and {name.kind} knows none of its own; write [motion] home = [x, y, z], "
            "where the camera sees the whole canvas."
        )
    return workspace.home
