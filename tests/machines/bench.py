"""Benches: a driver and the simulated controller that it drives, as the table of behaviours sees them.

A bench is a column of tests/hardware/test_behaviours.py. It knows how the machine is made to misbehave. What it
cannot do is named in `lacks`, with the reason; the table then asks for the honest substitute.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from frida_painter.hardware.gcode import Gcode, Servo
from frida_painter.hardware.robot import Waypoints
from frida_painter_drivers.gcode import GcodeRobot
from machines.grbl import GrblController, Kind
from machines.marlin import Build, MarlinController
from machines.simulated_time import Cable, Controller, SimulatedTime

SERVO_GRBL = Servo((-0.003, 100), (0.05, 900))
SERVO_MARLIN = Servo((-0.003, 10), (0.05, 90))
FOUND = np.array([0.1, 0.05, 0.012])
"""Where the tip stands when the zero is found at the beginning of a row, metres."""


class Bench(Protocol):
    """Column of the table.

    exact, exact_height: metres by which the true tip may miss a waypoint
    lacks: behaviour and reason, for what this machine has no part for
    """

    exact: float
    exact_height: float
    lacks: dict[str, str]

    def robot(self) -> Any:
        """Returns a new driver of the machine, not connected."""

    def ready(self) -> Any:
        """Returns a connected driver whose machine knows its zero, with the tip at `FOUND`."""

    def tip(self) -> np.ndarray:
        """Returns where the tip really is, [3] metres in the frame of the robot when its zero was found."""

    def moved(self) -> np.ndarray:
        """Returns every place of the tip until now, [n, 3] metres."""

    def wait(self, seconds: float) -> None:
        """Lets the machine live for so long."""

    def when_moved(self, metres: float, act: Callable[[], object]) -> None:
        """Calls `act` in the middle of the next motion, after that much of its way."""

    def fault(self, name: str) -> None:
        """Makes the machine misbehave: "alarm", "reset", "lose a line", "chatter", "unplug", "silence", "power cut",
        "press the button", "garbage"."""

    def mend(self) -> None:
        """A person puts right what `fault` did: plugs in, clears the alarm, lets go of the button, ends the silence."""

    def commands(self) -> list[str]:
        """Returns the lines that the machine got."""


@dataclass
class SerialBench:
    """Bench of a machine on a serial line, in simulated time. Implements Bench."""

    clock: SimulatedTime
    controller: Any
    cable: Cable
    make: Callable[[str], Any]
    servo: Servo | None = None
    exact: float = 1e-5
    lacks: dict[str, str] = field(default_factory=dict)
    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    _fault: str = ""

    def robot(self) -> Any:
        return self.make(self.cable.name)

    def ready(self) -> Any:
        robot = self.robot()
        robot.connect()
        robot.set_zero(FOUND)
        self.origin = FOUND - self.controller.tip / 1000
        return robot

    @property
    def exact_height(self) -> float:
        """Half of the smallest step of the height, metres."""
        if self.servo is None:
            return self.exact
        (low, at_low), (high, at_high) = self.servo.low, self.servo.high
        return 0.51 * abs((high - low) / (at_high - at_low))

    def height_of_servo(self) -> float:
        servo, machine = self.servo, self.controller
        assert servo is not None
        value = machine.angle if isinstance(machine, MarlinController) else machine.pulse
        if value is None:
            return servo.high[0]  # it was told nothing yet, and stands where its builder put it
        (low, at_low), (high, at_high) = servo.low, servo.high
        return low + (value - at_low) / (at_high - at_low) * (high - low)

    def tip(self) -> np.ndarray:
        tip = self.controller.tip / 1000 + self.origin
        if self.servo is not None:
            tip[2] = self.height_of_servo()
        return tip

    def moved(self) -> np.ndarray:
        places = self.controller.moved
        return np.array(places).reshape(-1, 3) / 1000 + self.origin

    def wait(self, seconds: float) -> None:
        self.clock.sleep(seconds)

    def when_moved(self, metres: float, act: Callable[[], object]) -> None:
        start = len(self.moved())

        def there() -> bool:
            way = self.moved()[start:]
            return len(way) > 1 and float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum()) >= metres

        self.clock.when(there, act)

    def fault(self, name: str) -> None:
        self._fault = name
        machine = self.controller
        match name:
            case "alarm" if hasattr(machine, "fail"):
                machine.fail(1)
            case "alarm":
                machine.queue.drop()
                machine._answer("Error:Thermal Runaway, system stopped! Heater_ID: bed")
                machine.killed = True
            case "reset" | "power cut":
                machine.power_cut()
            case "lose a line":
                machine.lose_lines = 1
            case "chatter":
                machine.chat_often()
            case "unplug":
                self.cable.unplug()
            case "silence":
                self.cable.silent = True
            case "press the button":
                machine.button = True
            case "garbage":
                self.cable.say(bytes(range(128, 250)) * 20)
            case _:
                raise AssertionError(name)

    def mend(self) -> None:
        match self._fault:
            case "alarm" if hasattr(self.controller, "fail"):
                self.controller.state, self.controller.mute = "Idle", False  # with its own controls
            case "alarm" | "reset" | "power cut":
                self.controller.power_cut()
                self.wait(3)
            case "unplug":
                self.controller.power_cut()  # it is fed by the cable
                self.cable.plug()
            case "silence":
                self.cable.speak_again()
            case "press the button":
                self.controller.release()
        self._fault = ""

    def commands(self) -> list[str]:
        return list(self.controller.received)


def serial_bench(clock: SimulatedTime, controller: Controller, language: Gcode, **settings: Any) -> SerialBench:
    """Returns the bench of a G-code machine."""
    cable = clock.attach(controller)
    return SerialBench(
        clock,
        controller,
        cable,
        lambda port: GcodeRobot(port, (0.0, 0.0, 0.05), gcode=language, **settings),
        servo=language.servo,
    )


def grbl_bench(
    clock: SimulatedTime, kind: Kind, settings: dict[str, float] | None = None, servo: Servo | None = None
) -> SerialBench:
    """Returns the bench of a machine of the GRBL family."""
    return serial_bench(clock, GrblController(kind, settings), Gcode("grbl", 0.1, servo))


def marlin_bench(clock: SimulatedTime, build: Build, servo: Servo | None = None) -> SerialBench:
    """Returns the bench of a machine with Marlin."""
    bench = serial_bench(clock, MarlinController(build), Gcode("marlin", 0.1, servo))
    bench.exact = 1.5e-5  # its position has two digits
    if not build.keepalive:
        bench.lacks["pause button"] = "it says nothing while it is held"
    return bench


def tell_zero(language: Gcode, port: str, tip: tuple[float, float, float]) -> None:
    """Tells a machine where its tip stands, as a person does once after it was switched on; it knows that then."""
    robot = GcodeRobot(port, tip, gcode=language)
    robot.connect()
    robot.set_zero(np.array(tip))
    robot.close()


def a_dip(speed: float = 0.06) -> Waypoints:
    """Down into a well, one turn of 8 mm radius, and up."""
    angle = np.linspace(0, 2 * np.pi, 13)
    ring = np.array([0.02, 0.03, 0.001]) + 0.008 * np.c_[np.cos(angle), np.sin(angle), 0 * angle]
    above = ring[[0, -1]].copy()
    above[:, 2] = 0.03
    return Waypoints("dip into well 1", np.concatenate([above[:1], ring, above[1:]]), speed)
