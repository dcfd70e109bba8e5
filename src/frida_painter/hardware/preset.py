"""Presets of machines, and the layout of a machine's table during its setup.

Presets are small TOML files that say what is known of a kind of machine before it is set up. The project brings presets
in the folder `presets`; a person adds a file in the folder of `user_folder`, or names one. No code of it is run.

A layout is proposed from a preset, then corrected by a person's marks. Every layout is a whole workspace, which can be
checked and drawn at any step.
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from platformdirs import user_config_path
from pydantic import Field, PrivateAttr, ValidationError

from frida_painter import registry
from frida_painter.canvas_size import SMALLEST_CANVAS, CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.kinds import Needed, RobotKind
from frida_painter.hardware.motion import STIR_RADIUS
from frida_painter.hardware.robot import Point, Workspace
from frida_painter.hardware.workcell import (
    DEEPEST,
    Bounds,
    Metre,
    Position,
    Section,
    Speeds,
    WorkcellConfig,
    describe_faults,
)
from frida_painter.strokes.palette import MAX_COLORS
from frida_painter.system import storage

_MAX_BYTES = 2**16
_ADVICE = "`frida-painter setup --presets` lists the presets and says where yours are kept"
_THINNEST = 0.05  # metres: a smaller area has no room for a canvas and a well

UsbId = Annotated[str, Field(pattern="^[0-9a-f]{4}:[0-9a-f]{4}$")]
Words = Annotated[str, Field(min_length=1, max_length=200)]


class Level(Section):
    """Height of the tip in metres with the value of the servo there."""

    height: Metre
    value: Annotated[float, Field(ge=0, le=1_000_000, allow_inf_nan=False)]


class LiftSection(Section):
    """Lift of the brush, and the heights at which it is expected to touch and to press hardest.

    by: axis Z, a servo, an arm, or a person's hand
    low, high: calibration of a servo; None for other lifts
    """

    by: Literal["axis", "servo", "arm", "hand"]
    touch: Metre = 0.0
    press: Metre = -0.002
    low: Level | None = None
    high: Level | None = None


class Probing(Section):
    """Findings that each machine needs.

    zero: found by homing switches, by a corner to which a person moves the carriage, or known to the robot itself
    corner: position of the tip in that corner, in the robot's frame
    touch: heights are found by jogging, by a probe that closes a contact (G38.2), or by the arm's force
    """

    zero: Literal["homing", "corner", "robot"]
    corner: Position | None = None
    touch: Literal["jog", "probe", "force"] = "jog"


class Preset(Section):
    """Preset of a kind of machine.

    title: what people call the machine
    robot: registered name of the robot or of the whole easel
    connection: serial port, address on the network, or none
    options: of the robot's name, such as baud; a relative path in `own` counts from the folder of the preset's file
    before: what a person does before the machine is connected, a sentence each
    usb: ids ("vendor:product", hexadecimal) of the boards or serial chips that such machines have
    area: box that the tip reaches, metres; None for a person's hand, as are motion and probe
    """

    title: Words
    robot: Words
    connection: Literal["serial", "network", "none"]
    options: dict[str, str | int] = Field(default_factory=dict)
    before: Annotated[tuple[Words, ...], Field(strict=False)] = ()
    usb: Annotated[tuple[UsbId, ...], Field(strict=False)] = ()
    area: Bounds | None = None
    lift: LiftSection
    motion: Speeds | None = None
    probe: Probing | None = None
    _name: str = PrivateAttr("")

    @property
    def name(self) -> str:
        """Name of its file, without the ending."""
        return self._name

    @property
    def is_machine(self) -> bool:
        """True if the program moves it; False for a person's hand."""
        return self.area is not None

    def robot_name(self, where: str = "") -> str:
        """Returns the name for --robot.

        where: its port or address; "" if none is needed
        """
        options = dict(self.options)
        if self.lift.low is not None and self.lift.high is not None:
            low, high = self.lift.low, self.lift.high
            options["servo"] = f"{low.height:g}/{low.value:g}/{high.height:g}/{high.value:g}"
        named = f"{self.robot}:{where}" if where else self.robot
        return ",".join((named, *(f"{name}={value}" for name, value in options.items())))

    @property
    def needed(self) -> Needed | None:
        """Package that must be installed for the machine; None if nothing is missing.

        Raises ConfigError if no driver is registered under the name of its robot.
        """
        robots, easels = registry.parts(registry.ROBOTS), registry.parts(registry.EASELS)
        if self.robot not in (robots if self.is_machine else easels):
            raise ConfigError(
                f"The preset {self.name} is for the robot {self.robot[:40]!r}, which is not installed here; there are "
                f"{', '.join(robots if self.is_machine else easels)}."
            )
        needed = robots[self.robot].load(RobotKind).needed if self.is_machine else None
        return needed if needed is not None and needed.lacking else None

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads a preset. Raises ConfigError, which names each missing, unknown, wrong or contradictory entry."""
        values = storage.read_toml(path, "a preset of a machine (TOML)", _MAX_BYTES, _ADVICE)
        options = values.get("options")
        if isinstance(options, dict) and isinstance(own := options.get("own"), str):  # a file beside the preset
            options["own"] = str((path.parent / own).absolute())
        return cls.of(values, path.stem)

    @classmethod
    def of(cls, values: dict[str, Any], name: str) -> Self:
        """Returns the preset with these entries. Raises ConfigError as `load` does."""
        try:
            read = cls.model_validate(values)
        except ValidationError as error:
            faults = describe_faults(error, cls)
        else:
            faults = [*_contradictions(read)]
            if not faults:
                read._name = name
                return read
        raise ConfigError(f"{storage.abridge(name)} is no preset of a machine: {'; '.join(faults)}. Correct the file.")


def _contradictions(read: Preset) -> Iterator[str]:
    """Yields a sentence for each contradiction between entries that are each in range."""
    lift, area, motion, probe = read.lift, read.area, read.motion, read.probe
    low, high = lift.low, lift.high
    missing = [f"[{name}]" for name in ("area", "motion", "probe") if getattr(read, name) is None]
    if lift.by == "hand" and len(missing) < 3:
        yield "[area], [motion] and [probe] are not for a person's hand; leave them out"
    elif lift.by != "hand" and missing:
        yield f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
    for option, value in read.options.items():
        text = str(value)
        if not option.isidentifier() or not text or set(text) & set(",=") or not text.isprintable():
            yield f"options.{option[:40]} is {text[:40]!r}; it has printable characters, and no comma or ="
    if not 0 < lift.touch - lift.press <= DEEPEST:
        yield (
            f"lift.press ({lift.press:g} m) is {(lift.touch - lift.press) * 1000:g} mm below lift.touch "
            f"({lift.touch:g} m); it is above 0 to {DEEPEST * 1000:g} mm below"
        )
    if (lift.by == "servo") != (low is not None and high is not None):
        yield "lift.low and lift.high, each with height and value, belong to lift.by = 'servo' and to no other"
    if low and high and not low.height < high.height:
        yield (
            f"lift.low.height ({low.height:g} m) is not below lift.high.height ({high.height:g} m); exchange them with "
            "their values"
        )
    if low and high and low.value == high.value:
        yield f"lift.low and lift.high have the same value ({low.value:g}), so the servo would not move"
    if area is None:
        return
    floor, ceiling = area.lower[2], area.upper[2]
    yield from area.upside_down("area")
    for axis, start, end in zip("xy", area.lower, area.upper, strict=False):
        if 0 < end - start < _THINNEST:
            yield f"the area is {(end - start) * 1000:g} mm in {axis}; at least {_THINNEST * 1000:g} mm are needed"
    if not floor <= lift.press < lift.touch <= ceiling:
        yield (
            f"lift.press and lift.touch ({lift.press:g} and {lift.touch:g} m) are not within the area in z ({floor:g} "
            f"to {ceiling:g} m)"
        )
    if low and high and not low.height <= floor < ceiling <= high.height:
        yield (
            f"the servo reaches from {low.height:g} to {high.height:g} m, and not all of the area in z ({floor:g} to "
            f"{ceiling:g} m)"
        )
    if probe and (probe.zero == "corner") != (probe.corner is not None):
        yield "probe.corner = [x, y, z], where the tip stands in its home corner, belongs to probe.zero = 'corner'"
    elif probe and probe.corner:
        yield from area.beyond("probe.corner", probe.corner, of="area")
    if motion:
        yield from motion.faults()
        if not lift.touch + motion.hover <= ceiling:
            yield (
                f"motion.hover ({motion.hover:g} m) above lift.touch ({lift.touch:g} m) is above the area, which ends "
                f"at {ceiling:g} m"
            )


# The presets on this computer.


def user_folder() -> Path:
    """Returns the folder of a person's own presets; it need not exist."""
    return user_config_path("frida-painter", appauthor=False) / "presets"


def read_preset(name: str) -> str:
    """Returns the text of a preset of the project. Raises ConfigError if there is none."""
    file = resources.files("frida_painter.hardware") / "presets" / f"{name}.toml"
    if not name.replace("-", "").isalnum() or not file.is_file():
        raise ConfigError(f"There is no preset {name[:60]!r} of the project; {_ADVICE}.")
    return file.read_text(encoding="utf-8")


def presets() -> dict[str, Preset]:
    """Returns all presets by name: those of the project, then a person's own, which replace ones of the same name.

    Raises ConfigError if a file is no preset.
    """
    ours = sorted((resources.files("frida_painter.hardware") / "presets").iterdir(), key=lambda file: file.name)
    found = {}
    for file in ours:
        if file.name.endswith(".toml"):
            with resources.as_file(file) as path:
                found[path.stem] = Preset.load(path)
    own = user_folder()
    if own.is_dir():
        found |= {path.stem: Preset.load(path) for path in storage.list_files(own, "*.toml")}
    return found


def find_preset(name: str) -> Preset:
    """Returns a preset by its name, or from a file if the name ends in .toml. Raises ConfigError if there is none."""
    if name.endswith(".toml"):
        return Preset.load(Path(name))
    known = presets()
    if name not in known:
        raise ConfigError(
            f"There is no preset {name[:60]!r}; take one of {', '.join(known)}, or a file that ends in .toml."
        )
    return known[name]


# The layout of a table. Wells, water and rag are proposed in a strip beside the canvas. Metres.

_STRIP = 0.036  # width of the strip that they need
_RAG = 0.030  # width of a small rag
_FIRST = 0.020  # from the end of the strip to the rag
_TO_WATER, _TO_WELLS = 0.034, 0.026
_NARROWEST, _WIDEST = 0.022, 0.035  # between two wells
_END = 0.012
_EDGE = 0.005  # around a proposed canvas
_BELOW = 0.002  # from the lowest wanted height to the floor of the workspace
_MAX_SKEW = math.radians(2.0)  # of a marked canvas from a right angle
_MAX_OFF = 0.003  # of a marked edge from the stated size of the canvas


@dataclass(frozen=True)
class Layout:
    """Layout of a table. Lengths in metres of the robot's frame.

    easel: name under which the calibration is kept
    workspace: not checked; its bounds are the box that the tip reaches, as the preset or the machine says
    touch, press: robot z of the lightest touch and the hardest press
    uneven: the lowest and the highest point of the canvas, metres above the place where the touch was found
    """

    easel: str
    workspace: Workspace
    canvas: CanvasSize
    touch: float
    press: float
    uneven: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def propose(cls, preset: Preset, easel: str = "", canvas: CanvasSize | None = None) -> Self:
        """Returns a layout that fits into the area of a machine's preset.

        easel: name of the easel; "" for the preset's
        canvas: its size; None for the largest that leaves room for wells
        Raises ConfigError if the canvas and a strip for wells do not fit into the area.
        """
        if preset.area is None or preset.motion is None:
            raise ConfigError(f"The preset {preset.name} is for a person's hand, which needs no workspace.")
        lower, upper, lift = preset.area.lower, preset.area.upper, preset.lift
        room = upper[0] - lower[0] - _STRIP - 2 * _EDGE, upper[1] - lower[1] - 2 * _EDGE
        if canvas is None:
            if min(room) < SMALLEST_CANVAS:
                raise ConfigError(f"The area of the preset {preset.name} has no room for a canvas beside the wells.")
            canvas = CanvasSize(*(math.floor(side * 1000 + 1e-6) / 1000 for side in room))
        corner = upper[0] - _EDGE - canvas.width, lower[1] + (upper[1] - lower[1] - canvas.height) / 2, lift.touch
        motion = preset.motion
        home = lower[0] + _EDGE, upper[1] - _EDGE, min(lift.touch + 2 * motion.hover, upper[2])
        workspace = Workspace(
            lower, upper, corner, 0.0, (), home, home, _RAG,
            motion.hover, motion.painting_speed, motion.travel_speed, home,
        )  # fmt: skip
        return cls(easel or preset.name, workspace, canvas, lift.touch, lift.press).with_proposed_paint()

    @property
    def travel_height(self) -> float:
        """Robot z at which the tip travels: above everything that is known, and within the box."""
        return min(max(self.touch + self.uneven[1], self.workspace.top) + self.workspace.hover, self.workspace.upper[2])

    def corners(self) -> dict[str, Point]:
        """Returns the corners of the canvas by name: bottom-left, bottom-right, top-right and top-left."""
        return self.workspace.corners(self.canvas)

    def with_canvas(self, left: Point, right: Point, top: Point | None, size: CanvasSize | None = None) -> Self:
        """Returns the layout with a marked canvas; its size is measured unless it is known.

        left, right, top: bottom-left, bottom-right and top-left corner; top may be None if the size is known
        Raises ConfigError if the corners are no rectangle, do not fit the size, or leave no room for the wells.
        """
        along = np.subtract(right, left)[:2]
        width = float(np.linalg.norm(along))
        if not width >= SMALLEST_CANVAS:
            raise ConfigError(
                f"The two lower corners are {width * 1000:.1f} mm apart; a canvas is at least "
                f"{SMALLEST_CANVAS * 1000:g} mm wide. Mark them again."
            )
        angle = math.atan2(along[1], along[0])
        height = size.height if size is not None else 0.0
        if top is not None:
            up = np.subtract(top, left)[:2]
            height = float(np.linalg.norm(up))
            skew = (math.atan2(up[1], up[0]) - angle - math.pi / 2 + math.pi) % (2 * math.pi) - math.pi
            if not abs(skew) <= _MAX_SKEW:
                raise ConfigError(
                    f"The marked edges meet at {90 + math.degrees(skew):.1f} degrees; a canvas has right angles, "
                    "within 2 degrees. Mark bottom left, bottom right and top left in this order."
                )
        true = size or CanvasSize(round(width, 4), round(height, 4))
        for name, measured, said in (("lower", width, true.width), ("left", height, true.height)):
            if not abs(measured - said) <= _MAX_OFF:
                raise ConfigError(
                    f"The {name} edge was marked {measured * 1000:.1f} mm long, and the canvas was said to have "
                    f"{said * 1000:g} mm there. Mark the corners again, or say the true size (--canvas)."
                )
        found = replace(self._with(canvas_origin=left, canvas_angle=angle), canvas=true)
        try:
            found.workcell()
        except ConfigError:
            return found.with_proposed_paint()
        return found

    def with_touch(self, touch: float, press: float) -> Self:
        """Returns the layout with measured heights of the lightest touch and the hardest press."""
        origin = *self.workspace.canvas_origin[:2], touch
        return replace(self._with(canvas_origin=origin), touch=touch, press=press)

    def with_paint(self, wells: Sequence[Point], water: Point, rag: Point) -> Self:
        """Returns the layout with marked wells, water and rag. Raises ConfigError if they overlap something."""
        found = self._with(wells=tuple(wells), water=water, rag=rag)
        found.workcell()
        return found

    def with_proposed_paint(self) -> Self:
        """Returns the layout with wells, water and rag in the widest free strip beside the canvas.

        Raises ConfigError if no strip is wide enough.
        """
        faults = ""
        for wells, water, rag in self._strips():
            found = self._with(wells=wells, water=water, rag=rag)
            try:
                found.workcell()
            except ConfigError as error:
                faults = faults or str(error)
                continue
            return found
        raise ConfigError(
            f"The canvas ({self.canvas}) leaves no strip of {_STRIP * 1000:g} mm for wells, water and rag within the "
            f"area; take a smaller canvas or put it nearer to an edge.{' ' + faults if faults else ''}"
        )

    def _with(self, **places: Any) -> Self:
        return replace(self, workspace=replace(self.workspace, **places))

    def _strips(self) -> Iterator[tuple[tuple[Point, ...], Point, Point]]:
        """Yields wells, water and rag in each strip that is wide enough, the widest strip first."""
        corners = np.array([*self.corners().values()])[:, :2]
        low, high = corners.min(0), corners.max(0)
        lower, upper = np.array(self.workspace.lower[:2]), np.array(self.workspace.upper[:2])
        free = [(float(low[axis] - lower[axis]), axis, lower[axis]) for axis in (0, 1)]
        free += [(float(upper[axis] - high[axis]), axis, high[axis]) for axis in (0, 1)]
        for width, across, start in sorted(free, key=lambda strip: -strip[0]):
            if width < _STRIP - 1e-6:
                continue
            beside = start + (width - _STRIP / 2 if start in high else _STRIP / 2)  # at the edge of the table
            along = 1 - across
            spots = list(self._in_a_row(float(lower[along]), float(upper[along])))
            if len(spots) > 2:
                z = self.touch
                places = [(beside, spot, z) if across == 0 else (spot, beside, z) for spot in spots]
                rag, water, *wells = [(float(x), float(y), float(z)) for x, y, z in places]
                yield tuple(wells), water, rag

    @staticmethod
    def _in_a_row(start: float, end: float) -> Iterator[float]:
        """Yields the places of rag, water and wells along a strip."""
        water = start + _FIRST + _TO_WATER
        yield from (start + _FIRST, water)
        first, last = water + _TO_WELLS, end - _END
        count = min(MAX_COLORS, math.floor((last - first) / _NARROWEST + 1e-6) + 1)
        if count >= 1:
            pitch = min(_WIDEST, (last - first) / max(count - 1, 1))
            yield from (first + pitch * number for number in range(count))

    def values(self) -> dict[str, Any]:
        """Returns the entries of the workspace file, lengths in hundredths of a millimetre."""
        place, (deepest, highest) = self.workspace, self.uneven
        assert place.home is not None
        lowest = min(self.press + min(deepest, 0.0), place.water[2], place.rag[2], *(z for *_, z in place.wells))
        floor = max(place.lower[2], lowest - _BELOW)
        top = max(self.touch + max(highest, 0.0), place.top)
        home = *place.home[:2], max(place.home[2], min(top + place.hover, place.upper[2]))
        size = {"width": self.canvas.width, "height": self.canvas.height}
        entries = {
            "easel": self.easel,
            "bounds": {"lower": (*place.lower[:2], floor), "upper": place.upper},
            "canvas": {**size, "corner": place.canvas_origin, "turn": math.degrees(place.canvas_angle)},
            "brush": {"touch_height": self.touch, "press_height": self.press},
            "paint": {name: getattr(place, name) for name in ("wells", "water", "rag", "rag_width")},
            "motion": {
                **{name: getattr(place, name) for name in ("hover", "painting_speed", "travel_speed")},
                "home": home,
            },
        }
        return _rounded(entries)

    def workcell(self) -> WorkcellConfig:
        """Returns the layout as a workspace. Raises ConfigError, which names every contradiction."""
        return WorkcellConfig.of(self.values(), "What was marked", "mark it again, or move it on the table")

    def toml(self, *, draft: bool = False) -> str:
        """Returns the workspace file, with the comments that a person needs to change it.

        draft: True for the setup of the machine: its bounds are the whole box
        """
        values = self.values()
        if draft:
            values["bounds"] = _rounded({"lower": self.workspace.lower, "upper": self.workspace.upper})
        lines = [
            "# Written by `frida-painter setup`. Metres of the robot's own frame, z up; places are those of the tip.",
            f"easel = {json.dumps(values.pop('easel'), ensure_ascii=False)}",
        ]
        for section, entries in values.items():
            lines += ["", f"# {_MEANINGS[section]}", f"[{section}]"]
            lines += [f"{name} = {json.dumps(value)}" for name, value in entries.items()]
        return "\n".join((*lines, ""))


_MEANINGS = {
    "bounds": "The tip never leaves this box.",
    "canvas": "Size; bottom-left corner; degrees from the robot's x axis to the lower edge.",
    "brush": "Robot z of the lightest touch and of the hardest press.",
    "paint": f"The tip in each well, in the water and on the rag. The brush stirs {STIR_RADIUS * 1000:g} mm around.",
    "motion": "hover: above the highest thing. Speeds in m/s. home: where the robot waits.",
}


def _rounded(value: Any) -> Any:
    """Returns entries with lists in place of tuples, and numbers of five decimals."""
    if isinstance(value, dict):
        return {name: _rounded(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [*map(_rounded, value)]
    return value if isinstance(value, str) else round(float(value), 5) + 0.0
