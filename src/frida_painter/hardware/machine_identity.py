"""What a machine is, whatever it is called: two names that lead to one machine have an identity in common.

A stop is latched, and a machine is locked, under each of its identities. "localhost", "127.0.0.1" and the computer's
own address are one; so are /dev/ttyUSB0, a link to it, and the serial number of what is plugged in there.
"""

import ipaddress
import socket
from pathlib import Path
from typing import Any

from frida_painter.hardware.machine_name import MachineName

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
