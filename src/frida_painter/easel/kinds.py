"""Kinds of whole easels: a simulated studio or a person's hand, each with its own surroundings."""

from collections.abc import Callable
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
    from frida_painter.hardware.robot import Reach, Workspace
    from frida_painter.hardware.timing import Timing


@dataclass(frozen=True)
class OpenEasel:
    """Open easel.

    close: ends what is beyond robot and camera, such as a diary; may raise StorageError
    """

    easel: "Easel"
    close: Callable[[], None]


@dataclass(frozen=True)
class EaselKind:
    """Kind of easel with its own workspace and calibration, and, if simulated, its own camera.

    name: under which it is registered, and which is written after --robot
    title: what people call it
    open: opens an order, with robot and camera not yet connected; raises ConfigError and StorageError
    simulated: True if no real robot moves
    person: True if a person paints by hand
    needed: what must be installed for it
    load: loads and compiles its computations, before the order is known
    why_no_film: returns the reason why its arm cannot be filmed, None if it can
    reach_from: returns reach and timing of its arm in a workspace whose origin is the arm's foot

    The module of a kind imports numerical libraries only inside these functions.
    """

    name: str
    title: str
    open: "Callable[[EaselOrder], OpenEasel]"
    simulated: bool
    person: bool = False
    needed: Needed | None = None
    load: Callable[[], None] = lambda: None
    why_no_film: Callable[[], str | None] | None = None
    reach_from: "Callable[[Workspace, CanvasSize], tuple[Reach, Timing]] | None" = None


# Names on which the processes agree. Code that only passes names on must load no driver and no numerical library.

JOURNAL = "journal"
STOP_FILE, PAUSE_FILE = "stop", "pause"  # the latter pauses a painting as long as it exists
INBOX, GIVEN, LIVE, REGIONS = "inbox.jsonl", "given", "live", "regions"  # commands; pictures of and for people
SIMULATION_LOG = "studio.diary"
ARM_FILM = "arm.mp4"
LIVE_PICTURE = ".camera.jpg"  # hidden: it exists only during a painting

HUMAN, VIRTUAL, SAWYER_SIM = "human", "virtual", "sawyer-sim"
NO_CAMERA = "none"
"""Name of the camera of an easel that nobody watches."""


def state_folder() -> Path:
    """Returns the default folder for latches and locks."""
    return user_state_path("frida-painter", appauthor=False)


def easel_kind(name: str) -> EaselKind | None:
    """Returns the kind of easel of that name; None for a robot that stands in a separate workspace."""
    part = registry.parts(registry.EASELS).get(name)
    return None if part is None else part.load(EaselKind)


def is_simulated(robot: str) -> bool:
    """Returns True if no real robot moves: a stop is then not latched, and a slow computer is not a fault."""
    kind = easel_kind(robot)
    return kind is not None and kind.simulated


def is_machine(robot: str) -> bool:
    """Returns True for a real robot with a workspace of its own. Raises ConfigError if the name is unknown."""
    easels = registry.parts(registry.EASELS)
    if robot in easels:
        return False
    if MachineName.of(robot).kind not in registry.parts(registry.ROBOTS):
        raise ConfigError(
            f"There is no robot {robot[:60]!r}; take {', '.join(easels)}, or a real one: {', '.join(robot_forms())}."
        )
    return True


def robot_forms() -> list[str]:
    """Returns the forms of the names of real robots; the bare name if its driver cannot be loaded."""
    return [_form(part, RobotKind) for part in registry.parts(registry.ROBOTS).values()]


def camera_forms() -> list[str]:
    """Returns the forms of the names of cameras; the bare name if its driver cannot be loaded."""
    return [_form(part, CameraKind) for part in registry.parts(registry.CAMERAS).values()]


def _form(part: registry.Part, kind: type[RobotKind] | type[CameraKind]) -> str:
    try:
        return part.load(kind).form
    except PluginError:
        return part.name


def require_equipment(robot: str, workspace: Path | None, camera: str) -> None:
    """Raises ConfigError, which tells what to say, if a named robot has no workspace file or no camera."""
    missing = []
    if workspace is None:
        missing.append(
            "a workspace file (--workspace FILE): `frida-painter setup` writes one for your machine, and "
            "`frida-painter workspace example` prints a whole one"
        )
    if not camera:
        missing.append(
            f"a camera (--camera {'|'.join(camera_forms())}). Without a camera, say --camera {NO_CAMERA}: the plan is "
            "then painted as it is"
        )
    if missing:
        raise ConfigError(f"The robot {robot[:60]!r} needs {'. It also needs '.join(missing)}.")
