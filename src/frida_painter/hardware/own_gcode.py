"""G-code of one's own: a person's lines with named fields, checked before they are sent among the program's lines.

Lines are read as GRBL and Marlin read them: motion must stay in the workspace, and the lines must leave millimetres
and absolute coordinates behind. Codes without motion, such as M codes, pass.
"""

import re
import string
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from frida_painter import storage
from frida_painter.errors import ConfigError
from frida_painter.hardware.robot import Point, Workspace

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
_INCH = 25.4
_OBEYED = "!?~"
"""Characters that GRBL takes out of the stream as commands."""
_ADVICE = "give start, end, lift, lower, dip or change a list of lines, and down_below the height of the lift"

Text = Annotated[str, Field(strict=True)]
Lines = Annotated[tuple[Text, ...], Field(max_length=MAX_OWN_LINES)]


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    start: Lines = ()
    end: Lines = ()
    lift: Lines = ()
    lower: Lines = ()
    dip: Lines = ()
    change: Lines = ()
    down_below: Annotated[float, Field(strict=True, ge=-10, le=10, allow_inf_nan=False)] | None = None


@dataclass(frozen=True)
class OwnGcode:
    """Lines of a person's own, by event.

    lines_at: for each event of `EVENTS` the lines with fields in braces; an event without lines is left out
    down_below: robot z in metres below which the brush is down, if `lift` and `lower` replace axis or servo

    start and end come once. lift and lower raise and lower the brush instead of an axis or a servo. dip comes before a
    dip, or instead of the pause for it. change comes before a change of the brush, or instead of the pause for it.
    Raises ConfigError if a field is unknown, or if a line is too long or could be obeyed in another way.
    """

    lines_at: Mapping[str, tuple[str, ...]]
    down_below: float | None = None

    def __post_init__(self) -> None:
        for event, lines in self.lines_at.items():
            if event not in EVENTS:
                raise ConfigError(
                    f"G-code of one's own at {event[:40]!r} was given; the events are {', '.join(EVENTS)}."
                )
            for line in lines:
                _require_sound(event, line)
        lifts = [event for event in ("lift", "lower") if self.lines_at.get(event)]
        if len(lifts) == 1 or (bool(lifts) != (self.down_below is not None)):
            raise ConfigError(
                "lift, lower and down_below belong together: lines that raise the brush, lines that lower it, and the "
                "height in metres below which it is down; give all three or none."
            )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads a TOML file. Raises ConfigError in one sentence if it is not as it must be."""
        values = storage.read_toml(path, "G-code of one's own (TOML)", _MAX_BYTES, _ADVICE)
        try:
            read = _File.model_validate(values)
        except ValidationError as error:
            fault = error.errors()[0]
            where = ".".join(str(part) for part in fault["loc"])[:60]
            raise ConfigError(f"{path}: {where} is not as it must be ({fault['msg'].lower()}); {_ADVICE}.") from error
        lines = {event: getattr(read, event) for event in EVENTS if getattr(read, event)}
        try:
            return cls(lines, read.down_below)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from error

    @property
    def lifts(self) -> bool:
        """True if the lines raise and lower the brush."""
        return self.down_below is not None

    def at(self, event: str, **fields: float | str) -> Iterator[str]:
        """Yields the lines of an event with its fields filled in: metres and m/s become mm and mm/min."""
        told = {name: _written(name, value) for name, value in fields.items()}
        return (line.format(**told) for line in self.lines_at.get(event, ()))

    def has(self, event: str) -> bool:
        """Returns True if the event has lines."""
        return bool(self.lines_at.get(event))

    def require_within(self, lower: Point, upper: Point) -> None:
        """Raises ConfigError unless all motion that can be read stays between two corners (m) of the workspace."""
        box = tuple((1000 * low, 1000 * high) for low, high in zip(lower, upper, strict=True))
        for event, lines in self.lines_at.items():
            for corner in (0, 1):  # a field may be anywhere in the workspace
                ends = {axis: f"{box[number][corner]:.3f}" for number, axis in enumerate("xyz")}
                known = {"feed": "100", "well": "1", "brush": "b", **ends}
                filled = [line.format(**{name: known[name] for name in EVENTS[event]}) for line in lines]
                _Reader(event, box, known if event in ("lift", "lower") else {}).read(filled)


def read_own(path: Path | None, workspace: Workspace) -> OwnGcode | None:
    """Returns the lines of a file, checked against the workspace; None without a file. Raises ConfigError."""
    if path is None:
        return None
    own = OwnGcode.load(path)
    try:
        own.require_within(workspace.lower, workspace.upper)
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


def _written(name: str, value: float | str) -> str:
    if name == "feed":
        return f"{60_000 * float(value):.0f}"
    if name in ("x", "y", "z"):
        return f"{1000 * float(value):.3f}"
    if name == "brush":
        return re.sub(r"[^A-Za-z0-9_-]", "_", str(value))[:20]
    return str(value)


# Reader of motion in lines, as far as it can be read.

_WORD = re.compile(r"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
_COMMENT = re.compile(r"\([^)]*\)|;.*")
_HARMLESS = {4.0, 17.0, 21.0, 40.0, 49.0, 54.0, 80.0, 94.0, 64.0, 61.0}
_MEANINGS = {
    10.0: "moves the zero", 18.0: "turns the plane of arcs", 19.0: "turns the plane of arcs",
    28.0: "drives to the machine's own home", 30.0: "drives to the machine's own place", 53.0: "leaves the work zero",
    92.0: "moves the zero", 93.0: "changes what F means", 95.0: "changes what F means",
}  # fmt: skip


class _Reader:
    """Reader of the lines of one event, with the state that G-code keeps from line to line.

    box: allowed millimetres of each axis
    known: position in millimetres before the lines, as text by axis; empty if it is unknown
    """

    def __init__(self, event: str, box: tuple[tuple[float, float], ...], known: Mapping[str, str]) -> None:
        self._event, self._box = event, box
        self._place: dict[str, float] = {axis.upper(): float(known[axis]) for axis in "xyz" if axis in known}
        self._absolute, self._unit, self._motion = True, 1.0, 1.0

    def read(self, lines: Iterable[str]) -> None:
        """Raises ConfigError at the first line that leaves the box or cannot be trusted."""
        for line in lines:
            self._line(line)
        if not self._absolute or self._unit != 1.0:
            raise ConfigError(
                f"{self._event}: its lines end in {'inches' if self._absolute else 'relative coordinates'}; end them "
                "with G90 and G21."
            )

    def _line(self, line: str) -> None:
        code = _COMMENT.sub("", line).strip().upper()
        if code.startswith("$"):
            if code == "$H" and self._event == "start":
                self._place = {}
                return
            self._refuse(line, "is a command to the controller itself; only $H at start is allowed")
        words = [(letter, float(number)) for letter, number in _WORD.findall(code)]
        left = set("".join(_WORD.sub("", code).split()))
        if left and not (("G", 28.0) in words and left <= set("XYZ")):  # axes to be homed have no number
            self._refuse(line, "cannot be read")
        if any(letter == "M" for letter, _ in words):
            return  # M codes move no axis; their parameters may look like one
        moves = False
        for letter, value in words:
            if letter == "G":
                moves |= self._code(line, value)
        axes = {letter: value for letter, value in words if letter in "XYZ"}
        arc = {letter: value for letter, value in words if letter in "IJKR"}
        if axes or (moves and arc):
            self._move(line, axes, arc)

    def _code(self, line: str, code: float) -> bool:
        """Takes a G code; returns True if it is one of motion."""
        if code in (0.0, 1.0, 2.0, 3.0):
            self._motion = code
            return True
        if code in (90.0, 91.0):
            self._absolute = code == 90.0
        elif code in (20.0, 21.0):
            self._unit = _INCH if code == 20.0 else 1.0
        elif code == 28.0 and self._event == "start":
            self._place = {}
        elif code not in _HARMLESS:
            self._refuse(line, f"has G{code:g}, which {_MEANINGS.get(code, 'is not known here')}")
        return False

    def _move(self, line: str, axes: Mapping[str, float], arc: Mapping[str, float]) -> None:
        before = dict(self._place)
        for axis, value in axes.items():
            if not self._absolute and axis not in before:
                self._refuse(line, "moves relatively from a place that cannot be known; write G90 and the place itself")
            self._place[axis] = value * self._unit + (0.0 if self._absolute else before[axis])
            self._require(line, axis, self._place[axis])
        if self._motion in (2.0, 3.0):
            self._arc(line, before, arc)

    def _arc(self, line: str, before: Mapping[str, float], arc: Mapping[str, float]) -> None:
        """Checks the whole circle of an arc: it goes no farther."""
        if not arc or set(arc) - {"I", "J"} or not {"X", "Y"} <= set(before):
            self._refuse(line, "is an arc that cannot be checked; write it with I and J, after a line with X and Y")
        reach = [arc.get(letter, 0.0) * self._unit for letter in "IJ"]
        radius = (reach[0] ** 2 + reach[1] ** 2) ** 0.5
        for axis, offset in zip("XY", reach, strict=True):
            for side in (-radius, radius):
                self._require(line, axis, before[axis] + offset + side)

    def _require(self, line: str, axis: str, millimetres: float) -> None:
        low, high = self._box["XYZ".index(axis)]
        if not low - 1e-3 <= millimetres <= high + 1e-3:
            self._refuse(
                line, f"goes to {axis} {millimetres:.1f} mm; the workspace reaches from {low:.1f} to {high:.1f} mm"
            )

    def _refuse(self, line: str, reason: str) -> Any:
        raise ConfigError(f"{self._event}: the line {line[:MAX_LINE]!r} {reason}. Nothing was sent.")
