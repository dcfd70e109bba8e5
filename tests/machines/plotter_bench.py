"""Benches of plotters with an EBB for the table of behaviours."""

from dataclasses import dataclass

import numpy as np

from frida_painter.hardware.gcode import Servo
from frida_painter_drivers.axidraw import AxidrawRobot, AxidrawSettings
from machines.bench import SerialBench
from machines.ebb import BRUSHLESS, EbbController
from machines.simulated_time import SimulatedTime

SERVOS = {"standard": Servo((-0.003, 9855), (0.05, 27_831)), "brushless": Servo((-0.003, 5400), (0.05, 12_600))}


@dataclass
class PlotterBench(SerialBench):
    """Bench of a plotter with an EBB, in simulated time. Implements Bench."""

    exact: float = 1.3e-5  # its steps

    def height_of_servo(self) -> float:
        servo, pulse = self.servo, self.controller.pen
        assert servo is not None and pulse is not None, "the lift has no power"
        (low, at_low), (high, at_high) = servo.low, servo.high
        return low + (pulse - at_low) / (at_high - at_low) * (high - low)

    def fault(self, name: str) -> None:
        match name:
            case "alarm":  # it has none; the nearest is a power supply that fails
                self._fault = name
                self.controller.cut_motor_power()
            case "lose a line":
                self._fault = name
                self.controller.faults[self.controller.made + 3] = "lost"
            case "chatter":
                self.controller.chatters = True
            case "press the button":
                self.controller.press()
            case _:
                super().fault(name)

    def mend(self) -> None:
        if self._fault == "alarm":
            self.controller.voltage = 300
            self._fault = ""
        else:
            super().mend()


def plotter_bench(
    clock: SimulatedTime, version: str, *, future: bool | str = False, lift: str = "standard"
) -> PlotterBench:
    """Returns the bench of a plotter with an EBB of that firmware."""
    controller = EbbController(version, future=future, lift=BRUSHLESS if lift == "brushless" else 4)
    cable = clock.attach(controller)

    def make(port: str) -> AxidrawRobot:
        return AxidrawRobot(AxidrawSettings((0.0, 0.0, 0.05), port, lift, SERVOS[lift], approach=0.1))

    bench = PlotterBench(clock, controller, cable, make, servo=SERVOS[lift], origin=np.zeros(3))
    bench.lacks["alarm"] = "an EBB has no alarms"
    return bench
