"""What can be put in by other packages, found through entry points: robots, easels, cameras, stroke
models, kinds of goals and replan policies.

A package registers a part with one line of its own pyproject.toml, under the name by which a person asks for it:

    [project.entry-points."frida_painter.robots"]
    mybot = "mybot.driver:KIND"

Ours are registered in the same way. They are known without metadata as well, for an editable installation
keeps the metadata of the day on which it was made.
"""

import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import EntryPoint, distributions, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

import platformdirs

from frida_painter.errors import ConfigError, FridaError, PluginError

Kind = TypeVar("Kind")

ROBOTS = "frida_painter.robots"
EASELS = "frida_painter.easels"
CAMERAS = "frida_painter.cameras"
STUDIO_ARMS = "frida_painter.studio_arms"
STROKE_MODELS = "frida_painter.stroke_models"
OBJECTIVES = "frida_painter.objectives"
COMMANDS = "frida_painter.commands"
PLAN_CHOOSERS = "frida_painter.plan_choosers"
REPLAN_POLICIES = "frida_painter.replan_policies"

OURS = "frida-painter"
OUR_PARTS: Mapping[str, Mapping[str, str]] = {
    EASELS: {
        "human": "frida_painter.session.human_easel:KIND",
        "virtual": "frida_painter.easel.studio:VIRTUAL_KIND",
        "sawyer-sim": "frida_painter.sawyer.easel:KIND",
    },
    ROBOTS: {
        "xarm": "frida_painter.hardware.drivers.xarm:KIND",
        "gcode": "frida_painter.hardware.drivers.gcode:GRBL",
        "marlin": "frida_painter.hardware.drivers.gcode:MARLIN",
        "axidraw": "frida_painter.hardware.drivers.axidraw:KIND",
        "ros": "frida_painter.hardware.drivers.ros_connections:ROSPY",
        "rosbridge": "frida_painter.hardware.drivers.ros_connections:ROSBRIDGE",
    },
    CAMERAS: {
        "opencv": "frida_painter.hardware.cameras.opencv:KIND",
        "gphoto": "frida_painter.hardware.cameras.gphoto:KIND",
        "folder": "frida_painter.hardware.cameras.folder:KIND",
    },
    STUDIO_ARMS: {
        "sawyer": "frida_painter.sawyer.arm:SAWYER_ARM",
        "kinematic-sawyer": "frida_painter.sawyer.arm:KINEMATIC_ARM",
    },
    STROKE_MODELS: {
        "fine": "frida_painter.brush.weights:FINE_MODEL",
        "medium": "frida_painter.brush.weights:MEDIUM_MODEL",
        "broad": "frida_painter.brush.weights:BROAD_MODEL",
    },
    OBJECTIVES: {
        "image": "frida_painter.objectives.image:KIND",
        "semantic": "frida_painter.objectives.semantic:KIND",
        "sketch": "frida_painter.objectives.sketch:KIND",
        "text": "frida_painter.words.text:KIND",
        "style": "frida_painter.objectives.style:KIND",
    },
    COMMANDS: {
        "sweep": "frida_painter.lab:SWEEP",
        "experiments": "frida_painter.lab:EXPERIMENTS",
    },
    PLAN_CHOOSERS: {
        "candidates": "frida_painter.lab.sweeps.command:choose_candidate",
    },
    REPLAN_POLICIES: {
        "times": "frida_painter.session.replan_policy:EvenlySpaced.parse",
        "every": "frida_painter.session.replan_policy:EveryNth.parse",
        "when-off-by": "frida_painter.session.replan_policy:WhenOffBy.parse",
        "when-it-pays": "frida_painter.session.replan_policy:WhenItPays.parse",
    },
}
"""What ships with the project: "module:object" by group and name, as pyproject.toml registers it."""


@dataclass(frozen=True)
class Part:
    """A part that is registered and not loaded yet.

    group, name: where it is registered; target: "module:object"; packages: the distributions that register
    it, one unless they contradict each other.
    """

    group: str
    name: str
    target: str
    packages: tuple[str, ...]

    @property
    def is_ours(self) -> bool:
        """Whether it ships with the project."""
        return self.packages == (OURS,)

    def load(self, kind: type[Kind]) -> Kind:
        """Imports the part, which has to be a `kind` and to call itself what it is registered as.

        Raises PluginError naming part and package, whatever its module raises.
        """
        what = f"{self.name!r} of {self.group}"
        if len(self.packages) > 1:
            raise PluginError(f"{what} is registered by {' and by '.join(self.packages)}; uninstall all but one.")
        brought = f"{what}, which the package {self.packages[0]} registers as {self.target!r},"
        try:
            found = EntryPoint(self.name, self.target, self.group).load()
        except FridaError:
            raise
        except (Exception, SystemExit) as failure:  # a module of somebody else's may raise anything
            why = " ".join(f"{type(failure).__name__}: {failure}".split())[:200]
            raise PluginError(f"{brought} cannot be loaded ({why}); mend or uninstall that package.") from failure
        if not isinstance(found, kind):
            raise PluginError(f"{brought} is a {type(found).__name__} and should be a {kind.__name__}; mend it there.")
        called = getattr(found, "name", self.name)
        if called != self.name:
            raise PluginError(f"{brought} calls itself {called!r}; give it one name in both places.")
        return found


def parts(group: str) -> Mapping[str, Part]:
    """The parts of a group by name: ours in their order, then those of other packages in the order of their names.

    Reads metadata and imports nothing. A name of ours always means ours. One that several other packages
    register is listed, and says so when it is loaded. A package with unreadable metadata registers nothing.
    """
    ours = {name: Part(group, name, target, (OURS,)) for name, target in OUR_PARTS.get(group, {}).items()}
    others: dict[str, Part] = {}
    for point in _points(group):
        package = point.dist.name if point.dist is not None else "unknown"
        known = others.get(point.name)
        if point.name not in ours:
            before = known.packages if known is not None else ()
            others[point.name] = Part(group, point.name, point.value, (*before, package))
    return ours | dict(sorted(others.items()))


def _points(group: str) -> list[EntryPoint]:
    """The entry points of a group, whatever one package's metadata looks like."""
    damages = (TypeError, ValueError, OSError)
    try:
        return list(entry_points(group=group))
    except damages:  # of one package, and reading all at once ends there
        found: dict[str, list[EntryPoint]] = {}
        for package in distributions():
            with suppress(*damages):
                found.setdefault(package.name, list(package.entry_points.select(group=group)))
        return [point for points in found.values() for point in points]


# Packages that only some commands need: each comes with an extra of this distribution, and a missing one is named.
#
# The extras stand in pyproject.toml. A module imports such a package inside a function, right after `require`.


def is_installed(package: str) -> bool:
    """Whether `package`, by the name it is imported with, can be imported. It is looked for and not loaded."""
    if package in sys.modules:
        return sys.modules[package] is not None
    return find_spec(package) is not None


def advice(extra: str, user: str) -> str:
    """One sentence that names the extra which `user`, the sentence's subject, needs, and the command to install it."""
    return f'{user} needs the extra "{extra}", which is not installed; say: pip install "frida-painter[{extra}]"'


def require(extra: str, package: str, user: str, error: type[FridaError] = ConfigError) -> None:
    """Raises `error` with that advice unless `package` is installed.

    extra: the extra that installs it; user: what needs it, such as "The studio".
    """
    if not is_installed(package):
        raise error(advice(extra, user))


# Where the weights of networks are kept on this machine: <cache>/<name>/, with a record that is written last.

VARIABLE = "FRIDA_PAINTER_MODELS"
RECORD = "record.json"


def cache_folder(cache: Path | None = None) -> Path:
    """The folder of weights: `cache`, or what FRIDA_PAINTER_MODELS says, or the one that the system gives to caches."""
    if cache is not None:
        return cache
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE]).expanduser()
    return platformdirs.user_cache_path("frida-painter", appauthor=False) / "models"


def are_here(name: str, cache: Path | None = None) -> bool:
    """Whether weights of that name were fetched. Only a glance: weights/cache.py checks them whenever they are used."""
    return (cache_folder(cache) / name / RECORD).is_file()
