"""Presets of machines: small TOML files that say what is known of a kind of machine before it is set up.

The project brings presets in the folder `presets`. A person adds a preset as a file in the folder of `user_folder`,
or names a file. A preset is data: no code of it is run.
"""

from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from platformdirs import user_config_path
from pydantic import Field, PrivateAttr, ValidationError

from frida_painter import registry, storage
from frida_painter.errors import ConfigError
from frida_painter.hardware.kinds import Needed, RobotKind
from frida_painter.hardware.workcell import DEEPEST, Bounds, Metre, Position, Section, Speeds, describe_faults

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
