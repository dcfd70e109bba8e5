"""Kinds of whole easels: a simulated studio, or a person's hand, with all that stands around it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from platformdirs import user_state_path

from frida_painter import registry
from frida_painter.errors import ConfigError, PluginError
from frida_painter.hardware.kinds import CameraKind, MachineName, Needed, RobotKind

if TYPE_CHECKING:
    from frida_painter.canvas_size import CanvasSize
    from frida_painter.easel.order import EaselOrder
    from frida_painter.hardware.easel import Easel
    from frida_painter.hardware.robot import Reach, Timing, Workspace


@dataclass(frozen=True)
class OpenEasel:
    """An easel that is open. close: ends what is beyond robot and camera, such as a diary; may raise StorageError."""

    easel: "Easel"
    close: Callable[[], None]


@dataclass(frozen=True)
class EaselKind:
    """A kind of easel that knows its own workspace and calibration, and its own camera where it is simulated.

    name: by which it is registered, and as it is written after --robot; title: what people call it; open: opens
    what is ordered, with robot and camera not connected yet, and raises ConfigError and StorageError;
    simulated: whether no real machine is moved; person: whether somebody paints by hand; needed: what has to be
    installed for it; load: loads and compiles what it computes with, before anybody knows what is ordered; require:
    refuses an order before a process is started for it, with ConfigError; why_no_film: what keeps its arm from being
    filmed, None if nothing does; reach_from: how an arm of the kind reaches and moves off if its foot is the origin of
    a workspace. The module that holds one imports what computes inside these functions.
    """

    name: str
    title: str
    open: "Callable[[EaselOrder], OpenEasel]"
    simulated: bool
    person: bool = False
    needed: Needed | None = None
    load: Callable[[], None] = lambda: None
    require: "Callable[[EaselOrder], None] | None" = None
    why_no_film: Callable[[], str | None] | None = None
    reach_from: "Callable[[Workspace, CanvasSize], tuple[Reach, Timing]] | None" = None


def easel_kind(name: str) -> EaselKind | None:
    """Returns the kind of easel of that name; None for a robot that stands in a workspace of its own."""
    part = registry.parts(registry.EASELS).get(name)
    return None if part is None else part.load(EaselKind)


# Names on which processes agree: robots and cameras, as a person gives them, a painting's files, the state's folder.
#
# A real robot is named like "xarm:192.168.1.10" or "gcode:/dev/ttyUSB0,homing=yes", its camera like "opencv:0".
# Whoever only passes names on loads no driver for that, nor anything that computes.

JOURNAL = "journal"
STOP_FILE = "stop"
DIARY = "studio.diary"
ARM_FILM = "arm.mp4"
LIVE_PICTURE = ".camera.jpg"  # hidden: it is there only while somebody paints

HUMAN, VIRTUAL, SAWYER_SIM = "human", "virtual", "sawyer-sim"


def _form_of_robot(name: str) -> str:
    return registry.parts(registry.ROBOTS)[name].load(RobotKind).form


def _title_of_simulated(name: str) -> str:
    kind = registry.parts(registry.EASELS)[name].load(EaselKind)
    if not kind.simulated:
        raise KeyError(name)
    return kind.title


@dataclass(frozen=True)
class _Registered(Mapping[str, str]):
    """What is told of parts that are registered, by name; a part is loaded when it is asked for."""

    group: str
    tell: Callable[[str], str]

    def __getitem__(self, name: str) -> str:
        return self.tell(name)

    def __iter__(self) -> Iterator[str]:
        for name in registry.parts(self.group):
            try:
                self.tell(name)
            except (KeyError, PluginError):
                continue  # whoever asks for it by name hears why
            yield name

    def __len__(self) -> int:
        return sum(1 for _ in self)


@dataclass(frozen=True)
class _Machines(_Registered):
    """The same, of robots whose names alone tell what they are, so that none is loaded."""

    def __contains__(self, name: object) -> bool:
        return name in registry.parts(self.group)


MACHINES: Mapping[str, str] = _Machines(registry.ROBOTS, _form_of_robot)
"""How each kind of real robot is named."""
SIMULATED: Mapping[str, str] = _Registered(registry.EASELS, _title_of_simulated)
"""The simulated robots, with what pages call them."""
TITLES = SIMULATED


def state_folder() -> Path:
    """Where stops are latched and robots locked when nobody says otherwise."""
    return user_state_path("frida-painter", appauthor=False)


def robot_forms() -> list[str]:
    """How real robots are named; the bare name of one that cannot be loaded."""
    return [_told(part, RobotKind, lambda kind: kind.form) for part in registry.parts(registry.ROBOTS).values()]


def camera_forms() -> list[str]:
    """How cameras are named; the bare name of one that cannot be loaded."""
    return [_told(part, CameraKind, lambda kind: kind.form) for part in registry.parts(registry.CAMERAS).values()]


def require_known(robot: str) -> str:
    """The kind of a robot that is named so; a whole easel has its name alone. Raises ConfigError."""
    kind = MachineName.of(robot).kind
    easels = registry.parts(registry.EASELS)
    if robot not in easels and kind not in MACHINES:
        raise ConfigError(
            f"There is no robot {robot[:60]!r}; take {', '.join(easels)}, or a real one: {', '.join(robot_forms())}."
        )
    return kind


def _told(part: registry.Part, kind: type[registry.Kind], tell: Callable[[registry.Kind], str]) -> str:
    try:
        return tell(part.load(kind))
    except PluginError:
        return part.name
