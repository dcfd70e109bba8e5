"""Registry of parts from this and other packages: robots, easels, cameras, stroke models, goals, replan policies.

Parts are found through entry points. A package registers a part with one line in its pyproject.toml, under the
name that a person types:

    [project.entry-points."frida_painter.robots"]
    mybot = "mybot.driver:KIND"

The parts of this project are registered in the same way. They are also listed here, because the metadata of an
editable installation may be out of date.
"""

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, distributions, entry_points
from importlib.util import find_spec
from pathlib import Path, PurePath
from traceback import walk_tb
from typing import TypeVar

import platformdirs

from frida_painter.errors import ConfigError, FridaError, PluginError
from frida_painter.extras import PROJECT as OURS
from frida_painter.extras import install_command

Kind = TypeVar("Kind")

ROBOTS = "frida_painter.robots"
EASELS = "frida_painter.easels"
CAMERAS = "frida_painter.cameras"
STUDIO_ARMS = "frida_painter.studio_arms"
STROKE_MODELS = "frida_painter.stroke_models"
STROKE_FAMILIES = "frida_painter.stroke_families"
OBJECTIVES = "frida_painter.objectives"
COMMANDS = "frida_painter.commands"
PLAN_CHOOSERS = "frida_painter.plan_choosers"
REPLAN_POLICIES = "frida_painter.replan_policies"
TURN_POLICIES = "frida_painter.turn_policies"
EXPORTERS = "frida_painter.exporters"
PLANNERS = "frida_painter.planners"
INITIALISERS = "frida_painter.initialisers"
MIXERS = "frida_painter.mixers"
LISTENERS = "frida_painter.listeners"
ENCODERS = "frida_painter.encoders"
PICTURE_LIBRARIES = "frida_painter.picture_libraries"
PICTURE_MAKERS = "frida_painter.picture_makers"

_GROUPS = "frida_painter."
OUR_PARTS: Mapping[str, Mapping[str, str]] = {
    EASELS: {
        "human": "frida_painter.session.human_easel:KIND",
        "virtual": "frida_painter.easel.virtual_easel:VIRTUAL_KIND",
        "sawyer-sim": "frida_painter.sawyer.easel:KIND",
    },
    ROBOTS: {
        "xarm": "frida_painter.hardware.drivers.xarm:KIND",
        "franka": "frida_painter.hardware.drivers.franka:KIND",
        "so101": "frida_painter.hardware.drivers.so101:KIND",
        "gcode": "frida_painter.hardware.drivers.gcode:GRBL",
        "marlin": "frida_painter.hardware.drivers.gcode:MARLIN",
        "axidraw": "frida_painter.hardware.drivers.axidraw:KIND",
        "rosbridge": "frida_painter.hardware.drivers.rosbridge:KIND",
    },
    CAMERAS: {
        "opencv": "frida_painter.hardware.cameras.opencv:KIND",
        "gphoto": "frida_painter.hardware.cameras.gphoto:KIND",
        "folder": "frida_painter.hardware.cameras.folder:KIND",
        "none": "frida_painter.hardware.cameras.none:KIND",
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
    STROKE_FAMILIES: {
        "comma": "frida_painter.brush.families:COMMA",
        "zigzag": "frida_painter.brush.families:ZIGZAG",
        "flourish": "frida_painter.brush.families:FLOURISH",
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
        "verify": "frida_painter.lab.verify_command:VERIFY",
        "benchmark": "frida_painter.lab:BENCHMARK",
    },
    PLAN_CHOOSERS: {
        "candidates": "frida_painter.lab.sweeps.sweep_command:choose_candidate",
    },
    REPLAN_POLICIES: {
        "times": "frida_painter.session.replan_policy:EvenlySpaced.parse",
        "every": "frida_painter.session.replan_policy:EveryNth.parse",
        "when-off-by": "frida_painter.session.replan_policy:WhenOffBy.parse",
        "when-it-pays": "frida_painter.session.replan_policy:WhenItPays.parse",
    },
    PLANNERS: {
        "layers": "frida_painter.planning.planner:LAYERS_KIND",
    },
    INITIALISERS: {
        "growth": "frida_painter.planning.initialisers:GROWTH",
        "uniform": "frida_painter.planning.initialisers:UNIFORM",
    },
    MIXERS: {
        "kubelka-munk": "frida_painter.mixing.recipe:KUBELKA_MUNK",
    },
    LISTENERS: {
        "events": "frida_painter.runs.event_file:EVENTS",
    },
    PICTURE_MAKERS: {
        "command": "frida_painter.picture_makers.command:COMMAND",
        "diffusers": "frida_painter.picture_makers.diffusion:DIFFUSERS",
        "http": "frida_painter.picture_makers.service:HTTP",
    },
    EXPORTERS: {
        "svg": "frida_painter.cli.plan_output:SVG",
        "gcode": "frida_painter.cli.plan_output:GCODE",
        "csv": "frida_painter.cli.plan_output:CSV",
        "png": "frida_painter.render.painting:PNG",
    },
    TURN_POLICIES: {
        "alternate": "frida_painter.session.turn_policy:ALTERNATE",
        "continue": "frida_painter.session.turn_policy:CONTINUE",
        "fill": "frida_painter.session.turn_policy:FILL",
        "side": "frida_painter.session.turn_policy:SIDE",
    },
}
"""Parts of this project: "module:object" by group and name, as in pyproject.toml."""


@dataclass(frozen=True)
class Part:
    """A registered part that is not loaded yet.

    group, name: place in the registry
    target: "module:object"
    packages: distributions that register the part; more than one if they conflict
    """

    group: str
    name: str
    target: str
    packages: tuple[str, ...]

    @property
    def is_ours(self) -> bool:
        """True if the part belongs to this project."""
        return self.packages == (OURS,)

    def load(self, kind: type[Kind]) -> Kind:
        """Imports the part and checks that it is a `kind` with the registered name.

        Raises PluginError that names the part and its package, also if its module fails with another error.
        FridaErrors of the module pass through.
        """
        what = f"{self.name!r} of {self.group}"
        if len(self.packages) > 1:
            raise PluginError(f"{what} is registered by {' and by '.join(self.packages)}; uninstall all but one.")
        brought = f"{what}, which the package {self.packages[0]} registers as {self.target!r},"
        try:
            found = EntryPoint(self.name, self.target, self.group).load()
        except FridaError:
            raise
        except (Exception, SystemExit) as failure:  # a foreign module may raise anything
            why = " ".join(f"{type(failure).__name__}: {failure}".split())[:200]
            raise PluginError(f"{brought} cannot be loaded ({why}); mend or uninstall that package.") from failure
        if not isinstance(found, kind):
            raise PluginError(f"{brought} is a {type(found).__name__} and should be a {kind.__name__}; mend it there.")
        called = getattr(found, "name", self.name)
        if called != self.name:
            raise PluginError(f"{brought} calls itself {called!r}; give it one name in both places.")
        return found


def names_of_others(group: str) -> tuple[str, ...]:
    """Returns the names that other packages register in a group, without those of this project; imports nothing."""
    ours = OUR_PARTS.get(group, {})
    return tuple(sorted({point.name for point in _points_of_others(tuple(sys.path)) if point.group == group} - {*ours}))


def modules_of_others() -> Mapping[str, tuple[str, ...]]:
    """Returns the top-level modules that other packages register in any of our groups, by the package's name."""
    found: dict[str, set[str]] = {}
    for point in _points_of_others(tuple(sys.path)):
        package = point.dist.name if point.dist is not None else "unknown"
        found.setdefault(package, set()).add(point.value.partition(":")[0].partition(".")[0])
    return {package: tuple(sorted(names)) for package, names in sorted(found.items())}


def blame(failure: BaseException) -> PluginError | None:
    """Returns an error that names the package of a part whose code was running; None if there was none."""
    packages = {module: package for package, modules in modules_of_others().items() for module in modules}
    for frame, line in reversed([*walk_tb(failure.__traceback__)]):
        package = packages.get(str(frame.f_globals.get("__name__")).partition(".")[0])
        if package is not None:
            why = " ".join(f"{type(failure).__name__}: {failure}".split())[:200]
            return PluginError(
                f"The package {package} failed ({why}; {PurePath(frame.f_code.co_filename).name}, line {line}); "
                f"mend it, or leave out its parts. `frida-painter parts {package}` tries them."
            )
    return None


@cache  # reading the metadata of all packages takes a tenth of a second; they change with the path
def _points_of_others(path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    found: list[EntryPoint] = []
    for package in distributions(path=list(path)):
        with suppress(*_DAMAGES):
            if package.name != OURS:
                found += [point for point in package.entry_points if point.group.startswith(_GROUPS)]
    return tuple(found)


def parts(group: str) -> Mapping[str, Part]:
    """Returns the parts of a group by name: first those of this project, then those of other packages by name.

    Reads metadata and imports nothing. A name of this project always means its own part. If several other
    packages register one name, `Part.load` raises an error. Packages with unreadable metadata are skipped.
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


_DAMAGES = (TypeError, ValueError, OSError)
"""Errors of damaged metadata."""


def _points(group: str) -> list[EntryPoint]:
    """Returns the entry points of a group; skips packages with damaged metadata."""
    try:
        return list(entry_points(group=group))
    except _DAMAGES:  # one damaged package stops the read of all
        found: dict[str, list[EntryPoint]] = {}
        for package in distributions():
            with suppress(*_DAMAGES):
                found.setdefault(package.name, list(package.entry_points.select(group=group)))
        return [point for points in found.values() for point in points]


# Optional packages
#
# Each belongs to an extra in pyproject.toml. A module imports such a package inside a function, right after
# `require`.


def is_installed(package: str) -> bool:
    """Returns True if the package with this import name can be imported; does not import it."""
    if package in sys.modules:
        return sys.modules[package] is not None
    return find_spec(package) is not None


def advice(extra: str, user: str) -> str:
    """Returns a sentence that names the missing extra and the command that installs it.

    user: subject of the sentence, for example "The studio"
    """
    return f'{user} needs the extra "{extra}", which is not installed; say: {install_command(extra)}'


@contextmanager
def importing(extra: str, user: str, error: type[FridaError] = ConfigError) -> Iterator[None]:
    """Raises `error` with installation advice if an import in the block fails; extra, user: as for `require`."""
    try:
        yield
    except ImportError as missing:
        raise error(advice(extra, user)) from missing


def require(extra: str, package: str, user: str, error: type[FridaError] = ConfigError) -> None:
    """Raises `error` with installation advice unless `package` is installed.

    extra: extra that installs the package
    user: part that needs it, for example "The studio"
    """
    if not is_installed(package):
        raise error(advice(extra, user))


# Cache of network weights: <cache>/<name>/, with a record that is written last.

VARIABLE = "FRIDA_PAINTER_MODELS"
RECORD = "record.json"
IMAGINE = "imagine"
"""Name of the generator that makes pictures from words, among the weights."""


def cache_folder(cache: Path | None = None) -> Path:
    """Returns the folder of weights: `cache`, or FRIDA_PAINTER_MODELS, or the system's cache folder."""
    if cache is not None:
        return cache
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE]).expanduser()
    return platformdirs.user_cache_path("frida-painter", appauthor=False) / "models"


def are_here(name: str, cache: Path | None = None) -> bool:
    """Returns True if the weights `name` were fetched. Checks no content; weights/cache.py does that at each use."""
    return (cache_folder(cache) / name / RECORD).is_file()
