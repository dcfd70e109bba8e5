"""B1, B2: a machine is known by what it is, so that neither a stop nor a lock is got round by another name for it."""

import socket
from pathlib import Path
from types import SimpleNamespace

import pytest

from frida_painter import registry
from frida_painter.errors import ConfigError
from frida_painter.hardware import kinds
from frida_painter.hardware.kinds import MachineName, RobotKind, at_host, at_port, find_port, remember_port


def identity(text: str) -> frozenset[str]:
    name = MachineName.of(text)
    return registry.parts(registry.ROBOTS)[name.kind].load(RobotKind).identify(name)


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST", "127.0.0.1", "127.1", "127.0.0.2", "0.0.0.0"])
def test_all_names_of_this_computer_are_one(host: str) -> None:
    assert identity(f"rosbridge:{host}:9191") & identity("rosbridge:127.0.0.1:9191"), host
    assert not identity(f"rosbridge:{host}:9192") & identity("rosbridge:127.0.0.1:9191")


def test_an_address_of_version_six_is_the_same_as_that_of_version_four_that_it_holds() -> None:
    assert at_host("::ffff:10.3.2.1") == at_host("10.3.2.1") == {"10.3.2.1"}
    assert at_host("::1") == at_host("127.0.0.1") == {"this computer"}


def test_a_host_has_every_address_that_the_name_service_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    def found(host: str, port: int | None, **how: object) -> list[tuple[object, ...]]:
        if host == "robot.studio":
            return [(0, 0, 0, "", (place, port)) for place in ("192.0.2.7", "192.0.2.8")]
        if host == "192.0.2.8":
            return [(0, 0, 0, "", (host, port))]
        raise socket.gaierror("unknown")

    monkeypatch.setattr(kinds.socket, "getaddrinfo", found)
    assert identity("xarm:robot.studio") & identity("xarm:192.0.2.8,brush_length=0.1")
    assert identity("xarm:Nobody.Knows.") == identity("xarm:nobody.knows") == {"nobody.knows"}


def test_a_port_is_what_links_lead_to_and_what_is_plugged_in(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    device, moved = tmp_path / "ttyUSB0", tmp_path / "ttyUSB1"
    for path in (device, moved):
        path.touch()
    (tmp_path / "by-id").symlink_to(device)
    plugged = [SimpleNamespace(device=str(device), serial_number="A7")]
    monkeypatch.setattr(kinds, "_ports", lambda: plugged)
    before = identity(f"gcode:{tmp_path}/by-id")
    assert before == identity(f"marlin:{device},baud=250000") == {str(device), "serial number A7"}
    plugged[0].device = str(moved)
    assert before & at_port(str(moved)) == {"serial number A7"}, "it was plugged in anew"
    assert not at_port(str(tmp_path / "ttyUSB7")) & before


def device(path: Path, number: str | None, about: str = "USB Serial") -> SimpleNamespace:
    return SimpleNamespace(device=str(path), serial_number=number, description=about, manufacturer=None, product=None)


def test_a_device_that_comes_back_under_another_name_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """M33: its serial number tells it, and another device under its old name is not taken for it."""
    first, second = tmp_path / "ttyUSB0", tmp_path / "ttyUSB1"
    plugged = [device(first, "A7")]
    monkeypatch.setattr(kinds, "_ports", lambda: plugged)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    first.touch()
    before = at_port(str(first))
    remember_port(str(first), find_port(str(first)))
    first.unlink()
    second.touch()
    plugged[:] = [device(second, "A7")]
    assert find_port(str(first)) == str(second) == find_port("a7")
    assert at_port(str(first)) & before == {"serial number A7"}, "a stop and a lock hold"
    first.touch()
    plugged.append(device(first, "B9"))
    with pytest.raises(ConfigError, match=r"is another device than before.*ttyUSB1 now. Give that port"):
        find_port(str(first))
    plugged[:] = [device(second, "A7"), device(tmp_path / "ttyUSB2", "A7")]
    first.unlink()
    with pytest.raises(ConfigError, match=r"have one serial number, A7.*by-path"):
        find_port(str(first))
    assert find_port(str(second)) == str(second)
    assert at_port(str(second)) == {str(second)}, "two of one number are not one machine"
    plugged.clear()
    assert find_port(str(first)) == str(first)


@pytest.mark.parametrize("url", ["socket://127.0.0.1:2323", "rfc2217://localhost:2323"])
def test_a_port_on_the_network_is_known_by_its_address(url: str) -> None:
    """M34."""
    assert identity(f"gcode:{url},homing=yes") == {"this computer port 2323"}
