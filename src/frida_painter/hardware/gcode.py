"""Waypoints as G-code, for machines that move a brush or pen in x and y and raise it by an axis or a servo."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from frida_painter.errors import ConfigError
from frida_painter.hardware.robot import Waypoints

PREAMBLE = ("G21", "G90", "G94")
"""Millimetres, absolute coordinates, feed per minute."""
_FINEST = 0.0005  # mm; half of the last digit that is written


@dataclass(frozen=True)
class Servo:
    """Servo that raises the brush: two calibrated heights with their values, linear in between.

    low, high: (height in metres, value); the value is an S word for GRBL (its servo or spindle output) and degrees
        for Marlin (M280)
    speed: m/s of the servo; the machine waits for it if only the height changes

    Raises ConfigError if the numbers are not finite, the heights not ascending, a value negative or the speed not
    positive.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    speed: float = 0.05

    def __post_init__(self) -> None:
        numbers = (*self.low, *self.high, self.speed)
        if not all(math.isfinite(number) for number in numbers) or not self.low[0] < self.high[0]:
            raise ConfigError(
                f"A servo was given the heights {self.low} and {self.high} (metres, value); the first lies below the "
                "second, and all are finite."
            )
        if not (min(self.low[1], self.high[1]) >= 0 and self.speed > 0):
            raise ConfigError(f"A servo was given values {self.low[1]} and {self.high[1]} at {self.speed} m/s; "
                              "values are not negative, and the speed is above 0.")  # fmt: skip

    @classmethod
    def of(cls, text: str) -> Self:
        """Reads "height/value/height/value", the lower height first. Raises ValueError, ConfigError."""
        low, at_low, high, at_high = (float(part) for part in text.split("/"))
        return cls((low, at_low), (high, at_high))

    def value(self, height: float) -> float:
        """Returns the servo's value for a height in metres. Raises ConfigError if it is outside the two heights."""
        (low, at_low), (high, at_high) = self.low, self.high
        if not low - 1e-6 <= height <= high + 1e-6:
            raise ConfigError(
                f"The brush was wanted at a height of {height * 1000:.2f} mm; its servo reaches from "
                f"{low * 1000:g} to {high * 1000:g} mm; make the workspace true or calibrate the servo anew."
            )
        return at_low + (height - low) / (high - low) * (at_high - at_low)


@dataclass(frozen=True)
class Gcode:
    """G-code dialect of one machine. Its work coordinates are the robot's frame, in millimetres.

    flavour: "grbl" or "marlin"
    approach: m/s to the first waypoint of a motion
    servo: raises the brush; None if an axis Z does

    Raises ConfigError if a value is not allowed.
    """

    flavour: str = "grbl"
    approach: float = 0.1
    servo: Servo | None = None

    def __post_init__(self) -> None:
        if self.flavour not in ("grbl", "marlin"):
            raise ConfigError(f"G-code of flavour {self.flavour!r} was wanted; there are grbl and marlin.")
        if not 0 < self.approach < math.inf:
            raise ConfigError(f"An approach at {self.approach} m/s was given; it is above 0 and finite.")

    def lines(self, waypoints: Waypoints) -> Iterator[tuple[int, str]]:
        """Yields the lines of a motion, each with the index of its waypoint.

        The machine goes straight to the first waypoint at the approach speed, then through all others.
        Raises ConfigError if the servo does not reach a height.
        """
        height = math.nan
        for index, (x, y, z) in enumerate(waypoints.position.tolist()):
            feed = 60_000 * (waypoints.speed if index else self.approach)
            ground = f"X{_millimetres(x)} Y{_millimetres(y)}"
            if self.servo is None:
                yield index, f"G1 {ground} Z{_millimetres(z)} F{feed:.0f}"
                continue
            if index == 0:  # The start is unknown: rise first, then move across.
                top = self.servo.high[0]
                yield from ((index, line) for line in self._servo_on_the_spot(self.servo, math.nan, top))
                yield index, f"G1 {ground} F{feed:.0f}"
                yield from ((index, line) for line in self._servo_on_the_spot(self.servo, top, z))
            else:
                before = waypoints.position[index - 1]
                travels = math.dist(before[:2], (x, y)) * 1000 > _FINEST
                if not travels:
                    yield from ((index, line) for line in self._servo_on_the_spot(self.servo, height, z))
                else:
                    yield from ((index, line) for line in self._servo_on_the_way(self.servo, height, z, ground, feed))
            height = z

    def rise(self, height: float) -> Iterator[str]:
        """Yields the lines that raise the brush vertically to a height in metres, from an unknown position."""
        if self.servo is None:
            yield f"G1 Z{_millimetres(height)} F{60_000 * self.approach:.0f}"
        else:
            yield from self._servo_on_the_spot(self.servo, math.nan, height)

    def _servo_on_the_spot(self, servo: Servo, before: float, height: float) -> Iterator[str]:
        """Yields the lines that set the servo and wait for it; NaN as the old height means the full travel."""
        value = _number(servo.value(height))
        far = abs(height - before) if math.isfinite(before) else servo.high[0] - servo.low[0]
        seconds = max(far / servo.speed, 0.01)
        if self.flavour == "grbl":
            yield f"M3 S{value}"
            yield f"G4 P{seconds:.3f}"
        else:
            yield "M400"
            yield f"M280 P0 S{value}"
            yield f"G4 P{1000 * seconds:.0f}"

    def _servo_on_the_way(self, servo: Servo, before: float, height: float, ground: str, feed: float) -> Iterator[str]:
        """Yields the lines of a move across during which the servo changes the height."""
        value = _number(servo.value(height))
        if self.flavour == "grbl":  # GRBL applies the S word as the motion begins (laser mode, $32=1).
            yield f"G1 {ground} S{value} F{feed:.0f}"
        else:
            if value != _number(servo.value(before)):
                yield "M400"
                yield f"M280 P0 S{value}"
            yield f"G1 {ground} F{feed:.0f}"


def _millimetres(metres: float) -> str:
    return f"{metres * 1000:.3f}"


def _number(value: float) -> str:
    return f"{value:.0f}"
