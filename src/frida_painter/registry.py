"""Registry of parts from this and other packages: robots, easels, cameras, stroke models, goals, replan policies.

Parts are found through entry points. A package registers a part with one line in its pyproject.toml, under the
name that a person types:

    [project.entry-points."frida_painter.robots"]
    mybot = "mybot.driver:KIND"

The parts of this project are registered in the same way, by entry_points.txt. It is also read here, because the
metadata of an editable installation may be out of date, and has no order.
"""

import inspect
import os
import platform
import shlex
import shutil
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from configparser import ConfigParser
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, PackageNotFoundError, distributions, requires, version
from importlib.util import find_spec
from pathlib import Path, PurePath
from traceback import walk_tb
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

import platformdirs

from frida_painter.errors import ConfigError, FridaError, PluginError

if TYPE_CHECKING:
    from packaging.requirements import Requirement

Kind = TypeVar("Kind")

OURS = "frida-painter"
"""Name of this project's distribution."""

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
MIXERS = "frida_painter.mixers"
ENCODERS = "frida_painter.encoders"
PICTURE_LIBRARIES = "frida_painter.picture_libraries"
PICTURE_MAKERS = "frida_painter.picture_makers"

_GROUPS = "frida_painter."


_TABLE = ConfigParser(delimiters=("=",), interpolation=None)
_TABLE.read_string(Path(__file__).with_name("entry_points.txt").read_text("utf-8"))
OUR_PARTS: Mapping[str, Mapping[str, str]] = {group: dict(_TABLE[group]) for group in _TABLE.sections()}
"""Parts of this project, as entry_points.txt lists them: "module:object" by group and name."""


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
            raise PluginError(
                f"{brought} cannot be loaded ({_why(failure)}); mend or uninstall that package."
            ) from failure
        if not isinstance(found, kind):
            raise PluginError(f"{brought} is a {type(found).__name__} and should be a {kind.__name__}; mend it there.")
        called = getattr(found, "name", self.name)
        if called != self.name:
            raise PluginError(f"{brought} calls itself {called!r}; give it one name in both places.")
        return found


@dataclass(frozen=True)
class Later:
    """Function or class of a module that is imported when it is called, not before.

    target: "module:object"
    """

    target: str

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Imports the target and calls it. Raises ImportError if it is not there."""
        return EntryPoint("", self.target, "").load()(*arguments, **named)


@cache  # names are read from whole descriptions, so few are read; they change with the path
def _points_of_others(path: tuple[str, ...]) -> tuple[tuple[str, EntryPoint], ...]:
    """Returns the entry points of other packages with the name of each package; damaged metadata is skipped."""
    found: list[tuple[str, EntryPoint]] = []
    for package in distributions(path=list(path)):
        with suppress(TypeError, ValueError, OSError):
            points = [point for point in package.entry_points if point.group.startswith(_GROUPS)]
            found += [(package.name, point) for point in points if package.name != OURS]
    return tuple(found)


def parts(group: str) -> Mapping[str, Part]:
    """Returns the parts of a group by name: first those of this project, then those of other packages by name.

    Reads metadata and imports nothing. A name of this project always means its own part. If several other
    packages register one name, `Part.load` raises an error. Packages with unreadable metadata are skipped.
    """
    ours = {name: Part(group, name, target, (OURS,)) for name, target in OUR_PARTS.get(group, {}).items()}
    others: dict[str, Part] = {}
    for package, point in _points_of_others(tuple(sys.path)):
        before = others[point.name].packages if point.name in others else ()
        if point.group == group and point.name not in ours and package not in before:
            others[point.name] = Part(group, point.name, point.value, (*before, package))
    return ours | dict(sorted(others.items()))


def modules_of_others() -> Mapping[str, tuple[str, ...]]:
    """Returns the top-level modules that other packages register in any of our groups, by the package's name."""
    found: dict[str, set[str]] = {}
    for package, point in _points_of_others(tuple(sys.path)):
        found.setdefault(package, set()).add(point.value.partition(":")[0].partition(".")[0])
    return {package: tuple(sorted(names)) for package, names in sorted(found.items())}


def blame(failure: BaseException) -> PluginError | None:
    """Returns an error that names the package of a part whose code was running; None if there was none."""
    packages = {module: package for package, modules in modules_of_others().items() for module in modules}
    for frame, line in reversed([*walk_tb(failure.__traceback__)]):
        package = packages.get(str(frame.f_globals.get("__name__")).partition(".")[0])
        if package is not None:
            return PluginError(
                f"The package {package} failed ({_why(failure)}; {PurePath(frame.f_code.co_filename).name}, line "
                f"{line}); mend it, or leave out its parts. `frida-painter parts {package}` tries them."
            )
    return None


def _why(failure: BaseException) -> str:
    return " ".join(f"{type(failure).__name__}: {failure}".split())[:200]


def load_part(group: str, name: str, kind: type[Kind], what: str) -> Kind:
    """Returns a registered part. Raises ConfigError if there is none of that name, PluginError if it is broken.

    what: kind of the part in messages, such as "planner"
    """
    known = parts(group)
    if name not in known:
        raise ConfigError(f"There is no {what} called {name[:40]!r}; there are {', '.join(known)}.")
    return known[name].load(kind)


# Comparison of an object with a protocol: its members, and whether its functions take what the protocol gives.


def require_like(made: object, protocol: type[Any], what: str, error: type[FridaError] = PluginError) -> None:
    """Raises `error` unless an object has all members of a protocol, and its functions take what the protocol gives.

    what: subject of the sentence, such as "Its driver"
    """
    bases = [base for base in reversed(protocol.__mro__) if base not in (object, Generic, Protocol)]
    for name in dict.fromkeys(name for base in bases for name in (*inspect.get_annotations(base), *vars(base))):
        if name.startswith("_") and name != "__call__":
            continue
        declared = inspect.getattr_static(protocol, name, None)
        is_function = inspect.isfunction(declared)
        called = f"{name}({', '.join([*inspect.signature(declared).parameters][1:])})" if is_function else name
        try:
            found = getattr(made, name)
        except AttributeError as lack:
            raise error(f"{what} has no {called}; {protocol.__name__} of frida_painter.plugins has it.") from lack
        if is_function and not takes(found, declared):
            raise error(
                f"{what} has a {name} that cannot be called as {called}; give it these arguments, as "
                f"{protocol.__name__} of frida_painter.plugins does."
            )


def takes(found: Any, declared: Any) -> bool:
    """Returns True if `found` can be called with all arguments of `declared` but the first, which is `self`."""
    given = [*inspect.signature(declared).parameters.values()][1:]
    named = {one.name: None for one in given if one.kind is one.KEYWORD_ONLY}
    if not callable(found):
        return False
    try:
        inspect.signature(found).bind(*[None] * (len(given) - len(named)), **named)
    except ValueError:  # a compiled function does not tell
        return True
    except TypeError:
        return False
    return True


# Optional packages
#
# Each belongs to an extra in pyproject.toml. A module imports such a package inside a function, right after
# `require`.


def is_installed(package: str) -> bool:
    """Returns True if the package with this import name can be imported; does not import it."""
    if package in sys.modules:
        return sys.modules[package] is not None
    return find_spec(package) is not None


SYSTEMS = {
    "Windows": {"sys_platform": "win32", "platform_system": "Windows", "platform_machine": "AMD64"},
    "macOS": {"sys_platform": "darwin", "platform_system": "Darwin", "platform_machine": "arm64"},
    "Linux on ARM": {"sys_platform": "linux", "platform_system": "Linux", "platform_machine": "aarch64"},
    "Linux on Intel and AMD": {"sys_platform": "linux", "platform_system": "Linux", "platform_machine": "x86_64"},
}
"""Systems of people, a Raspberry Pi being Linux on ARM, in the words of a requirement's markers."""


def advice(extra: str, user: str) -> str:
    """Returns a sentence that names the missing extra and the command that installs it, or the systems that have it.

    user: subject of the sentence, for example "The studio"
    """
    elsewhere = {name: found for name, system in SYSTEMS.items() if (found := _wanted(extra, system))}
    if elsewhere and not _wanted(extra, {}):
        names = ", ".join(dict.fromkeys(one.name for found in elsewhere.values() for one in found))
        return (
            f'{user} needs the extra "{extra}", and its {names} exists for {", ".join(elsewhere)} alone; this is '
            f"{platform.system()} on {platform.machine()}"
        )
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


def install_command(extra: str) -> str:
    """Returns the command that installs what an extra of this project lacks into this installation, for a shell.

    It names packages and versions from the metadata, because the project itself need not be on any index. Without
    metadata it names the folder of the project.
    """

    def is_satisfied(one: "Requirement") -> bool:
        with suppress(PackageNotFoundError):
            return one.specifier.contains(version(one.name), prereleases=True)
        return False

    wanted = _wanted(extra, {})
    lacking = [one for one in wanted if not is_satisfied(one)] or wanted  # all, if one is here but broken
    packages = [str(one).partition(";")[0] for one in lacking] or [f"{Path(__file__).parents[2]}[{extra}]"]
    python = shlex.quote(sys.executable)
    command = f"{python} -m pip install"
    if find_spec("pip") is None:
        uses_uv = shutil.which("uv") is not None
        command = f"uv pip install --python {python}" if uses_uv else f"{python} -m ensurepip && {command}"
    if sys.prefix == sys.base_prefix and Path(sysconfig.get_path("stdlib"), "EXTERNALLY-MANAGED").is_file():
        command += " --break-system-packages"  # this project was installed so
    return f"{command} {shlex.join(packages)}"


def _wanted(extra: str, system: Mapping[str, str]) -> "list[Requirement]":
    """Returns the requirements of an extra alone, here or on another system of SYSTEMS; none without metadata."""
    from packaging.requirements import Requirement

    with suppress(PackageNotFoundError):
        found = [(one, one.marker) for one in map(Requirement, requires(OURS) or ()) if one.marker is not None]
        met = [[marker.evaluate({**system, "extra": name}) for _, marker in found] for name in (extra, "")]
        return [one for (one, _), here, always in zip(found, *met, strict=True) if here and not always]
    return []


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
