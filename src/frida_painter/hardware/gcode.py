"""Waypoints as G-code, for machines that move a brush or pen in x and y and raise it by an axis or a servo."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from frida_painter.errors import ConfigError, WorkspaceViolation
from frida_painter.hardware.own_gcode import OwnGcode
from frida_painter.hardware.robot import Waypoints
from frida_painter.hardware.timing import ServoTiming

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

    def require(self, height: float) -> None:
        """Raises WorkspaceViolation if the servo does not reach a height in metres; nothing has moved then."""
        try:
            self.value(height)
        except ConfigError as error:
            raise WorkspaceViolation(f"{error} Nothing was moved.") from error

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
    lower, lift: greatest vertical speed down and up, m/s; None for that of the motion. A servo lowers the brush at its
        own speed by default, and lifts it at once.
    sinks: True if the brush sinks while the machine's motors are off
    own: lines of a person's own; None if there are none

    Raises ConfigError if a value is not allowed, or if the brush would be raised in two ways.
    """

    flavour: str = "grbl"
    approach: float = 0.1
    servo: Servo | None = None
    lower: float | None = None
    lift: float | None = None
    sinks: bool = False
    own: OwnGcode | None = None

    def __post_init__(self) -> None:
        if self.flavour not in ("grbl", "marlin"):
            raise ConfigError(f"G-code of flavour {self.flavour!r} was wanted; there are grbl and marlin.")
        if not 0 < self.approach < math.inf:
            raise ConfigError(f"An approach at {self.approach} m/s was given; it is above 0 and finite.")
        for name, speed in (("lower", self.lower), ("lift", self.lift)):
            if speed is not None and not 0 < speed < math.inf:
                raise ConfigError(f"A speed to {name} the brush of {speed} m/s was given; it is above 0 and finite.")
        if self.servo is not None and self.own is not None and self.own.lifts:
            raise ConfigError("The brush would be raised by a servo and by G-code of one's own; leave one of them out.")

    def servo_timing(self, tick: float = 0.001, each: float = 0.0, *, stops: bool = True) -> ServoTiming | None:
        """Returns the timing of the servo; None without.

        tick: seconds; the machine waits for multiples of it
        each: seconds that each setting takes besides the wait
        stops: True if the machine stands still at each waypoint at which the height changes
        """
        servo = self.servo
        if servo is None:
            return None
        level = (servo.high[0] - servo.low[0]) / max(abs(servo.high[1] - servo.low[1]), 1e-9)
        return ServoTiming(servo.speed, self.lower, self.lift, servo.low[0], level, tick, each, stops)

    @property
    def tells_height(self) -> bool:
        """True if the machine itself knows the height of the brush, by its axis Z."""
        return self.servo is None and not (self.own is not None and self.own.lifts)

    def lines(self, waypoints: Waypoints, here: tuple[float, float, float] | None = None) -> Iterator[tuple[int, str]]:
        """Yields the lines of a motion, each with the index of its waypoint.

        here: position of the tip before the motion, metres; None if unknown

        The machine goes straight to the first waypoint at the approach speed, then through all others. A servo
        raises the brush before the machine goes there, and lowers it after.
        Raises ConfigError if the servo does not reach a height.
        """
        if self.own is not None:
            if waypoints.cue is not None:
                event, about = waypoints.cue
                field = {"dip": "well", "change": "brush"}[event]
                yield from ((0, line) for line in self.own.at(event, **{field: about}))
            if self.own.lifts:
                yield from self._lifted_by(self.own, waypoints)
                return
        height = math.nan
        before_this = None
        for index, (x, y, z) in enumerate(waypoints.position.tolist()):
            feed = 60_000 * self._slow(waypoints.speed if index else self.approach, before_this, (x, y, z))
            before_this = (x, y, z)
            ground = f"X{_millimetres(x)} Y{_millimetres(y)}"
            if self.servo is None:
                yield index, f"G1 {ground} Z{_millimetres(z)} F{feed:.0f}"
                continue
            if index == 0:
                now, top = (math.nan, self.servo.high[0]) if here is None else (here[2], max(here[2], z))
                if not abs(top - now) < _FINEST / 1000:
                    yield from ((index, line) for line in self._servo_on_the_spot(self.servo, now, top))
                yield index, f"G1 {ground} F{feed:.0f}"
                if top - z > _FINEST / 1000:
                    yield from ((index, line) for line in self._servo_on_the_spot(self.servo, top, z))
            else:
                before = waypoints.position[index - 1]
                travels = math.dist(before[:2], (x, y)) * 1000 > _FINEST
                if not travels:
                    yield from ((index, line) for line in self._servo_on_the_spot(self.servo, height, z))
                else:
                    yield from ((index, line) for line in self._servo_on_the_way(self.servo, height, z, ground, feed))
            height = z

    def _slow(self, speed: float, start: tuple[float, float, float] | None, end: tuple[float, float, float]) -> float:
        """Returns the speed on a straight way at which the brush goes down or up no faster than it should."""
        if start is None or self.servo is not None:
            return speed
        up, length = end[2] - start[2], math.dist(start, end)
        limit = self.lift if up > 0 else self.lower
        return speed if limit is None or up == 0 else min(speed, limit * length / abs(up))

    def rise(self, height: float, here: tuple[float, float]) -> Iterator[str]:
        """Yields the lines that bring the brush vertically to a height, from an unknown one.

        height, here: metres; `here` is the place x, y of the tip
        """
        if self.own is not None and self.own.down_below is not None:
            event = "lower" if height < self.own.down_below else "lift"
            yield from self.own.at(event, x=here[0], y=here[1], z=height, feed=self.approach)
        elif self.servo is None:
            yield f"G1 Z{_millimetres(height)} F{60_000 * self.approach:.0f}"
        else:
            yield from self._servo_on_the_spot(self.servo, math.nan, height)

    def lift_fully(self, here: tuple[float, float]) -> Iterator[str]:
        """Yields the lines that lift the brush all the way; none if an axis Z lifts it, whose zero may be lost.

        here: place x, y of the tip as the machine tells it, metres
        """
        if self.servo is not None:
            yield from self.rise(self.servo.high[0], here)
        elif self.own is not None and self.own.down_below is not None:
            yield from self.rise(self.own.down_below, here)

    def _lifted_by(self, own: OwnGcode, waypoints: Waypoints) -> Iterator[tuple[int, str]]:
        """Yields the lines of a motion whose brush is raised and lowered by lines of a person's own."""
        assert own.down_below is not None
        is_down = True  # nobody knows: it is lifted first
        last: tuple[float, float] | None = None
        for index, (x, y, z) in enumerate(waypoints.position.tolist()):
            speed = waypoints.speed if index else self.approach
            fields = {"x": x, "y": y, "z": z, "feed": speed}
            wanted = z < own.down_below
            if is_down and (not wanted or index == 0):
                yield from ((index, line) for line in own.at("lift", **fields))
                is_down = False
            if last is None or math.dist(last, (x, y)) * 1000 > _FINEST:
                yield index, f"G1 X{_millimetres(x)} Y{_millimetres(y)} F{60_000 * speed:.0f}"
            last = x, y
            if wanted and not is_down:
                yield from ((index, line) for line in own.at("lower", **fields))
                is_down = True

    def _servo_on_the_spot(self, servo: Servo, before: float, height: float) -> Iterator[str]:
        """Yields the lines that set the servo and wait for it; NaN as the old height means the full travel.

        The brush is lowered in small steps, because a servo jumps to its value and a brush that falls makes blots. It
        is lifted at once, unless a speed is set.
        """
        timing = self.servo_timing()
        assert timing is not None
        if math.isfinite(before):
            steps = timing.steps(before, height)
        else:
            steps = [(height, timing.seconds(servo.low[0], servo.high[0]))]
        for step, seconds in steps:
            yield from self._set_servo(servo, step, seconds)

    def _set_servo(self, servo: Servo, height: float, seconds: float) -> Iterator[str]:
        value = _number(servo.value(height))
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
