"""Waypoints as G-code, for machines that move a brush or pen in x and y and raise it by an axis or a servo.

A person may add lines of their own with named fields, which are checked before they are sent among the program's
lines. They are read as GRBL and Marlin read them: motion must stay in the workspace, and the lines must leave absolute
coordinates behind. Codes without motion, such as M codes, pass.
"""

import math
import re
import string
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NoReturn, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from frida_painter.errors import ConfigError, WorkspaceViolation
from frida_painter.hardware.robot import Point, Waypoints, Workspace
from frida_painter.hardware.timing import ServoTiming
from frida_painter.system import storage

PREAMBLE = ("G21", "G90", "G94")
"""Millimetres, absolute coordinates, feed per minute."""
_FINEST = 5e-7  # metres; half of the last digit that is written
MAX_LINE = 70
"""Greatest number of characters in a line; the serial buffers of GRBL hold 127, those of Marlin 96."""
MAX_OWN_LINES = 40
"""Greatest number of lines at one event."""
EVENTS: Mapping[str, tuple[str, ...]] = {
    "start": (),
    "end": (),
    "lift": ("x", "y", "z", "feed"),
    "lower": ("x", "y", "z", "feed"),
    "dip": ("well",),
    "change": ("brush",),
}
"""Events with the fields of their lines: millimetres, mm/min, the number of a well from 1, the name of a brush."""
_LONGEST = {"x": "-1234.567", "y": "-1234.567", "z": "-1234.567", "feed": "60000", "well": "24", "brush": "b" * 20}
_MAX_BYTES = 2**16
_OBEYED = "!?~"
"""Characters that GRBL takes out of the stream as commands."""
_ADVICE = "give start, end, lift, lower, dip or change a list of lines, and down_below the height of the lift"

Text = Annotated[str, Field(strict=True)]
Lines = Annotated[tuple[Text, ...], Field(max_length=MAX_OWN_LINES)]


class OwnGcode(BaseModel):
    """Lines of a person's own with fields in braces, by event.

    down_below: robot z in metres below which the brush is down, if `lift` and `lower` replace axis or servo

    start and end come once. lift and lower raise and lower the brush instead of an axis or a servo. dip comes before a
    dip, or instead of the pause for it. change comes before a change of the brush, or instead of the pause for it.
    Raises ConfigError if a field is unknown, or if a line is too long or could be obeyed in another way.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    start: Lines = ()
    end: Lines = ()
    lift: Lines = ()
    lower: Lines = ()
    dip: Lines = ()
    change: Lines = ()
    down_below: Annotated[float, Field(strict=True, ge=-10, le=10, allow_inf_nan=False)] | None = None

    def model_post_init(self, context: Any) -> None:
        """Checks the lines one by one, and that those of a lift are complete."""
        for event in EVENTS:
            for line in getattr(self, event):
                _require_sound(event, line)
        if not bool(self.lift) == bool(self.lower) == (self.down_below is not None):
            raise ConfigError(
                "lift, lower and down_below belong together: lines that raise the brush, lines that lower it, and the "
                "height in metres below which it is down; give all three or none."
            )

    @property
    def lifts(self) -> bool:
        """True if the lines raise and lower the brush."""
        return self.down_below is not None

    def at(self, event: str, **fields: float | str) -> Iterator[str]:
        """Yields the lines of an event with its fields filled in: metres and m/s become mm and mm/min."""
        told = {name: _filled_in(name, value) for name, value in fields.items()}
        return (line.format(**told) for line in getattr(self, event))

    def _require_within(self, lower: Point, upper: Point) -> None:
        """Raises ConfigError unless all motion that can be read stays between two corners (m) of the workspace."""
        box = {axis: (1000 * low, 1000 * high) for axis, low, high in zip("XYZ", lower, upper, strict=True)}
        for event, fields in EVENTS.items():
            for corner in (0, 1):  # a field may be anywhere in the workspace
                place = {axis: box[axis][corner] for axis in box}
                known = {"feed": "100", "well": "1", "brush": "b"}
                known |= {axis.lower(): f"{millimetres:.3f}" for axis, millimetres in place.items()}
                filled = [line.format(**{name: known[name] for name in fields}) for line in getattr(self, event)]
                _require_inside(event, filled, box, place if event in ("lift", "lower") else {})


def read_own(path: Path | None, workspace: Workspace) -> OwnGcode | None:
    """Returns the lines of a TOML file, checked against the workspace; None without a file.

    Raises ConfigError in one sentence if it is not as it must be.
    """
    if path is None:
        return None
    values = storage.read_toml(path, "G-code of one's own (TOML)", _MAX_BYTES, _ADVICE)
    try:
        own = OwnGcode.model_validate(values)
        own._require_within(workspace.lower, workspace.upper)
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])[:60]
        raise ConfigError(f"{path}: {where} is not as it must be ({fault['msg'].lower()}); {_ADVICE}.") from error
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    return own


def _require_sound(event: str, line: str) -> None:
    """Raises ConfigError unless a line has known fields, printable ASCII, and a length that fits."""
    shown = line if len(line) <= 40 else f"{line[:37]}..."
    try:
        parts = list(string.Formatter().parse(line))
    except ValueError as error:
        raise ConfigError(f"{event}: {shown!r} cannot be read ({error}); write a field as {{name}}.") from error
    for _, name, form, conversion in parts:
        if name is None:
            continue
        if name not in EVENTS[event]:
            known = ", ".join(f"{{{field}}}" for field in EVENTS[event]) or "none"
            raise ConfigError(
                f"{event}: {shown!r} has the unknown field {{{name[:20]}}}; the fields there are {known}."
            )
        if form or conversion:
            raise ConfigError(f"{event}: {shown!r} has a field with a format; write {{{name}}} alone.")
    longest = line.format(**{name: _LONGEST[name] for name in EVENTS[event]})
    if not line.strip() or not all(" " <= sign <= "~" for sign in line) or set(_OBEYED) & set(line):
        raise ConfigError(
            f"{event}: {shown!r} is empty or has a sign that a machine obeys at once; printable ASCII without ! ? ~ is "
            "allowed."
        )
    if len(longest) > MAX_LINE:
        raise ConfigError(
            f"{event}: {shown!r} may become {len(longest)} characters long; at most {MAX_LINE} fit. Write two lines."
        )


def _filled_in(name: str, value: float | str) -> str:
    if name == "feed":
        return f"{60_000 * float(value):.0f}"
    if name in ("x", "y", "z"):
        return f"{1000 * float(value):.3f}"
    if name == "brush":
        return re.sub(r"[^A-Za-z0-9_-]", "_", str(value))[:20]
    return str(value)


# Motion in lines of a person's own, as far as it can be read.

_WORD = re.compile(r"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
_COMMENT = re.compile(r"\([^)]*\)|;.*")
_HARMLESS = {0.0, 1.0, 4.0, 17.0, 21.0, 40.0, 49.0, 54.0, 80.0, 90.0, 91.0, 94.0, 64.0, 61.0}
_MEANINGS = {
    2.0: "is an arc; write straight ways", 3.0: "is an arc; write straight ways", 10.0: "moves the zero",
    18.0: "turns the plane of arcs", 19.0: "turns the plane of arcs", 20.0: "changes the unit; write millimetres",
    28.0: "drives to the machine's own home", 30.0: "drives to the machine's own place", 53.0: "leaves the work zero",
    92.0: "moves the zero", 93.0: "changes what F means", 95.0: "changes what F means",
}  # fmt: skip


def _require_inside(
    event: str, lines: Sequence[str], box: Mapping[str, tuple[float, float]], known: Mapping[str, float]
) -> None:
    """Raises ConfigError at the first line of an event that leaves the box or cannot be trusted.

    box: allowed millimetres of each axis
    known: position in millimetres before the lines, by axis; empty if it is unknown
    """
    place, absolute = dict(known), True

    def refuse(line: str, reason: str) -> NoReturn:
        raise ConfigError(f"{event}: the line {line[:MAX_LINE]!r} {reason}. Nothing was sent.")

    for line in lines:
        code = _COMMENT.sub("", line).strip().upper()
        if code == "$H" and event == "start":
            place = {}
            continue
        if code.startswith("$"):
            refuse(line, "is a command to the controller itself; only $H at start is allowed")
        words = [(letter, float(number)) for letter, number in _WORD.findall(code)]
        homes = ("G", 28.0) in words
        left = set("".join(_WORD.sub("", code).split()))
        if left and not (homes and left <= set("XYZ")):  # axes to be homed have no number
            refuse(line, "cannot be read")
        if codes := [value for letter, value in words if letter == "M"]:
            beside = {letter for letter, _ in words} & ({"G", *box} if min(codes) < 10 else {"G"})
            if beside:  # GRBL obeys both
                refuse(line, "has an M code beside other codes or a place; write two lines")
            continue  # M codes move no axis; the parameters of those of Marlin may look like one
        for letter, value in words:
            if letter != "G":
                continue
            if value in (90.0, 91.0):
                absolute = value == 90.0
            elif value == 28.0 and event == "start":
                place = {}
            elif value not in _HARMLESS:
                refuse(line, f"has G{value:g}, which {_MEANINGS.get(value, 'is not known here')}")
        for axis, value in words:
            if axis not in box:
                continue
            if not absolute and axis not in place:
                refuse(line, "moves relatively from a place that cannot be known; write G90 and the place itself")
            place[axis] = value if absolute else place[axis] + value
            low, high = box[axis]
            if not low - 1e-3 <= place[axis] <= high + 1e-3:
                reach = f"the workspace reaches from {low:.1f} to {high:.1f} mm"
                refuse(line, f"goes to {axis} {place[axis]:.1f} mm; {reach}")
    if not absolute:
        raise ConfigError(f"{event}: its lines end in relative coordinates; end them with G90.")


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

    def lines(self, waypoints: Waypoints, here: Point | None = None) -> Iterator[tuple[int, str]]:
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
                yield from self._lifted_by_own(self.own, waypoints)
                return
        if self.servo is not None:
            yield from self._lifted_by_servo(self.servo, waypoints, here)
            return
        before: Point | None = None
        for index, (x, y, z) in enumerate(waypoints.position.tolist()):
            speed = self._slow(waypoints.speed, before, (x, y, z)) if index else self.approach
            yield index, f"G1 {_ground(x, y)} Z{_millimetres(z)} {_feed(speed)}"
            before = x, y, z

    def _slow(self, speed: float, start: Point | None, end: Point) -> float:
        """Returns the speed on a straight way at which the brush goes down or up no faster than it should."""
        if start is None:
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
            yield f"G1 Z{_millimetres(height)} {_feed(self.approach)}"
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

    def _lifted_by_own(self, own: OwnGcode, waypoints: Waypoints) -> Iterator[tuple[int, str]]:
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
            if last is None or math.dist(last, (x, y)) > _FINEST:
                yield index, f"G1 {_ground(x, y)} {_feed(speed)}"
            last = x, y
            if wanted and not is_down:
                yield from ((index, line) for line in own.at("lower", **fields))
                is_down = True

    def _lifted_by_servo(self, servo: Servo, waypoints: Waypoints, here: Point | None) -> Iterator[tuple[int, str]]:
        """Yields the lines of a motion whose brush a servo raises and lowers."""
        before: Point | None = None
        for index, (x, y, z) in enumerate(waypoints.position.tolist()):
            lines: list[str] = []
            if before is None:
                now, top = (math.nan, servo.high[0]) if here is None else (here[2], max(here[2], z))
                if not abs(top - now) < _FINEST:
                    lines += self._servo_on_the_spot(servo, now, top)
                lines.append(f"G1 {_ground(x, y)} {_feed(self.approach)}")
                if top - z > _FINEST:
                    lines += self._servo_on_the_spot(servo, top, z)
            elif math.dist(before[:2], (x, y)) > _FINEST:
                value = _servo_word(servo.value(z))
                if self.flavour == "grbl":  # GRBL applies the S word as the motion begins (laser mode, $32=1).
                    lines.append(f"G1 {_ground(x, y)} {value} {_feed(waypoints.speed)}")
                else:
                    changes = value != _servo_word(servo.value(before[2]))
                    lines += ["M400", f"M280 P0 {value}"] if changes else []
                    lines.append(f"G1 {_ground(x, y)} {_feed(waypoints.speed)}")
            else:
                lines += self._servo_on_the_spot(servo, before[2], z)
            yield from ((index, line) for line in lines)
            before = x, y, z

    def _servo_on_the_spot(self, servo: Servo, before: float, height: float) -> Iterator[str]:
        """Yields the lines that set the servo and wait for it; NaN as the old height means the full travel.

        The brush is lowered in small steps, because a servo jumps to its value and a brush that falls makes blots. It
        is lifted at once, unless a speed is set.
        """
        timing = self.servo_timing()
        assert timing is not None
        steps = [(height, timing.seconds(servo.low[0], servo.high[0]))]
        for step, seconds in timing.steps(before, height) if math.isfinite(before) else steps:
            value = _servo_word(servo.value(step))
            if self.flavour == "grbl":
                yield from (f"M3 {value}", f"G4 P{seconds:.3f}")
            else:
                yield from ("M400", f"M280 P0 {value}", f"G4 P{1000 * seconds:.0f}")


def _ground(x: float, y: float) -> str:
    return f"X{_millimetres(x)} Y{_millimetres(y)}"


def _feed(speed: float) -> str:
    return f"F{60_000 * speed:.0f}"


def _servo_word(value: float) -> str:
    return f"S{value:.0f}"


def _millimetres(metres: float) -> str:
    return f"{metres * 1000:.3f}"
