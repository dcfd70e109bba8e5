"""What a board said while nobody listened: a line in two parts, and more lines than anybody read."""

import socket
import time
from collections import deque
from pathlib import Path
from types import SimpleNamespace

import pytest

from frida_painter.errors import MotionFailed, RobotError
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.interlock import Interlock
from frida_painter_drivers.grbl import Grbl
from frida_painter_drivers.serial_line import SerialLine


class Port:
    """Port that gives one part after another, each after its seconds."""

    def __init__(self, *parts: tuple[float, bytes]) -> None:
        self._parts, self._since = deque(parts), time.monotonic()

    @property
    def in_waiting(self) -> int:
        return len(self._parts[0][1]) if self._parts else 0

    def read(self, count: int) -> bytes:
        if self._parts and time.monotonic() >= self._since + self._parts[0][0]:
            self._since = time.monotonic()
            return self._parts.popleft()[1]
        time.sleep(0.005)
        return b""

    def write(self, content: bytes) -> None:
        pass


def listening(*parts: tuple[float, bytes]) -> Grbl:
    firmware = Grbl(SerialLine(Port(*parts), "COM1"), Interlock("the machine"), Gcode("grbl", 0.1), homing=False)
    firmware._heard_at -= 60.0
    return firmware


def test_a_reset_whose_line_came_in_two_parts_is_heard() -> None:
    """A wireless line may stand still within a line; a board that was reset counts from 0 wherever it stands."""
    firmware = listening((0.0, b"ok\r\nGr"), (0.3, b"bl 1.1h ['$' for help]\r\n"))
    with pytest.raises(MotionFailed, match="was reset"):
        firmware.send("G1 X1 F100", "stroke 1", 0)


def test_only_the_part_without_an_end_is_dropped() -> None:
    line = SerialLine(Port((0.0, b"one\ntwo\nALARM:1\nGar")), "COM1")
    assert line.read(0.1) == "one" and line.holds_part
    line.drop_part()
    assert [line.read(0.01) for _ in range(3)] == ["two", "ALARM:1", None]
    assert not line.holds_part


def test_a_line_over_the_network_is_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """M34: ser2net, or FluidNC over WiFi."""
    pytest.importorskip("serial")
    with socket.create_server(("127.0.0.1", 0)) as server:
        line = SerialLine.open(f"socket://127.0.0.1:{server.getsockname()[1]}", 115_200)
        there, _ = server.accept()
        with there:
            line.write(b"?")
            assert there.recv(1) == b"?"
            there.sendall(b"<Idle>\r\n")
            assert line.read(5.0) == "<Idle>" and line.stop_line(b"!") is not None
            line.close()
    assert line.stop_line(b"!") is None


def test_a_modem_is_no_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    comports = pytest.importorskip("serial.tools.list_ports")
    one = SimpleNamespace(device="/dev/ttyACM7", description="HUAWEI Mobile Modem", manufacturer=None, product=None,
                          serial_number=None)  # fmt: skip
    monkeypatch.setattr(comports, "comports", lambda: [one])
    with pytest.raises(RobotError, match=r"is a modem .* give its own port"):
        SerialLine.open("/dev/ttyACM7", 115_200)
