"""Installs the project and all packages that it needs, by the lock.

`python tools/install.py` alone makes the environment .venv, installs the painter and the studio's page there, and
says how to paint: what `make` does, also on Windows. With a requirement, such as .[web], it installs that into the
Python that runs it.

The lock, constraints.txt, gives the version and the hashes of each package; a file with another hash is refused.
pyproject.toml and the installed packages tell which others are needed, so that each platform gets its own.

`make` calls it with the environment's own Python. pip's settings (pip.conf, PIP_INDEX_URL and the
like) say where packages come from. uv does not read them, so they are handed to it; if one of
them has no counterpart, or uv fails, pip installs.
"""

import argparse
import ast
import functools
import importlib
import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from time import monotonic

from pip._vendor.packaging.requirements import Requirement
from pip._vendor.packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
MADE = ROOT / ".venv"
PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
BUILDS = ("torch",)  # has builds of one version, with hashes of their own in the lock
FOR_BUILDING = ("cffi",)  # pyvips is no wheel, and needs it beside setuptools

# Settings of pip that say nothing about which packages are installed, or from where.
HARMLESS = {
    "cache-dir",
    "disable-pip-version-check",
    "no-cache-dir",
    "no-color",
    "no-input",
    "no-python-version-warning",
    "progress-bar",
    "quiet",
    "require-virtualenv",
    "retries",
    "root-user-action",
    "verbose",
}
# Which options of uv mean the same; one for each word of the value.
OPTIONS = {
    "index-url": "--default-index",
    "extra-index-url": "--index",
    "find-links": "--find-links",
    "trusted-host": "--allow-insecure-host",
}
VARIABLES = {"cert": "SSL_CERT_FILE", "timeout": "UV_HTTP_TIMEOUT", "default-timeout": "UV_HTTP_TIMEOUT"}
SECTIONS = ("global", "install", ":env:")  # what `pip install` obeys; the later one wins


def pip_settings(listed: str) -> dict[str, str]:
    """Returns the settings that `pip config list` printed and `pip install` obeys, without their section."""
    found: dict[str, dict[str, str]] = {section: {} for section in SECTIONS}
    for line in listed.splitlines():
        key, _, value = line.partition("=")
        section, _, name = key.rpartition(".")
        if section in found:
            found[section][name] = str(ast.literal_eval(value))
    return {name: value for section in SECTIONS for name, value in found[section].items()}


def for_uv(settings: dict[str, str]) -> tuple[list[str], dict[str, str]] | None:
    """Returns options and variables with which uv finds the packages that pip finds; None if there are none."""
    # Like pip, uv is to compare the versions of all indexes. Left alone, it stops at the first that knows the name.
    options, variables = ["--index-strategy", "unsafe-best-match"], {}
    for name, value in settings.items():
        if name in OPTIONS:
            options += [part for word in value.split() for part in (OPTIONS[name], word)]
        elif name in VARIABLES:
            variables[VARIABLES[name]] = value if name == "cert" else str(round(float(value)))
        elif name == "no-index" and value.lower() in ("1", "true", "yes", "on"):
            options.append("--no-index")
        elif name not in HARMLESS:
            return None
    return options, variables


def read_lock(path: Path) -> dict[str, list[str]]:
    """The entries of a lock by the name of their package: a version with its hashes, one for each kind of machine."""
    found: dict[str, list[str]] = {}
    for entry in re.split(r"\n(?=[A-Za-z0-9])", path.read_text(encoding="utf-8")):
        if name := re.match(r"[A-Za-z0-9._-]+(?===)", entry):
            found.setdefault(canonicalize_name(name[0]), []).append(entry.strip())
    return found


def asked_by(requirement: str) -> list[Requirement]:
    """Requirements of the project with extras (.[web]), by pyproject.toml; else the named package itself."""
    if not requirement.startswith("."):
        return [Requirement(requirement)]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    own, found, extras = canonicalize_name(project["name"]), [*project["dependencies"]], [requirement[1:]]
    while extras:
        for extra in re.findall(r"[a-z0-9-]+", extras.pop()):
            more = project["optional-dependencies"][extra]
            extras += [each.partition("[")[2] for each in more if canonicalize_name(Requirement(each).name) == own]
            found += [each for each in more if canonicalize_name(Requirement(each).name) != own]
    return [Requirement(each) for each in dict.fromkeys(found)]


class Missing(Exception):
    """Reason, in a sentence, why something cannot be installed."""


class Installer:
    """Installs by the lock, level by level: what is asked for, then what these packages need, until nothing is new."""

    def __init__(self, lock: Path, *, hashes: bool) -> None:
        self._lock, self._hashes, self.by = read_lock(lock), hashes, "pip"
        self._done: set[tuple[str, str]] = set()  # packages with each of their extras

    def install(self, asked: Iterable[Requirement]) -> None:
        """Raises Missing, or CalledProcessError where pip fails, which has said why."""
        level = list(asked)
        while level:
            new = [(each, extra) for each in level for extra in ("", *each.extras) if self._is_new(each, extra)]
            entries = [entry for name in dict.fromkeys(each.name for each, _ in new) for entry in self._entries(name)]
            if entries:
                with tempfile.TemporaryDirectory() as folder:
                    file = Path(folder) / "requirements.txt"
                    file.write_text("\n".join(entries) + "\n", encoding="utf-8")
                    wanted = ["--no-deps", "--no-build-isolation", "--requirement", str(file)]
                    self.by = run([*wanted, *(["--require-hashes"] if self._hashes else [])])
            importlib.invalidate_caches()
            level = [needed for each, extra in new for needed in needs_of(each.name, extra)]

    def _is_new(self, each: Requirement, extra: str) -> bool:
        key = canonicalize_name(each.name), extra
        known = key in self._done or (each.marker is not None and not each.marker.evaluate({"extra": ""}))
        if not known:
            self._done.add(key)
        return not known

    def _entries(self, name: str) -> list[str]:
        found = self._lock.get(canonicalize_name(name))
        if found is None:
            raise Missing(f"{name} is needed here and stands not in constraints.txt; renew that file with `make pins`.")
        if canonicalize_name(name) in BUILDS:
            found = [as_offered(entry) for entry in found]
        return found if self._hashes else [re.sub(r"\s*\\?\s*--hash=\S+", "", entry) for entry in found]


def as_offered(entry: str) -> str:
    """The entry of a package with the build of it that pip would take without hashes, such as 2.13.0+cpu.

    With hashes alone, pip would rather take the index's file, which brings gigabytes of CUDA.
    """
    package = entry.split()[0]
    asks = [*PIP, "install", "--quiet", "--dry-run", "--ignore-installed", "--no-deps", "--report", "-", package]
    done = subprocess.run(asks, capture_output=True, text=True, check=False)
    if done.returncode:
        return entry
    offered = json.loads(done.stdout)["install"][0]["metadata"]["version"]
    return entry.replace(package, f"{package.partition('==')[0]}=={offered}", 1)


def needs_of(name: str, extra: str) -> list[Requirement]:
    """Requirements of an installed package, for one of its extras or without any; none if it is not installed."""
    try:
        needed = [Requirement(each) for each in distribution(name).requires or ()]
    except PackageNotFoundError:
        return []
    found = [each for each in needed if each.marker is None or each.marker.evaluate({"extra": extra})]
    for each in found:
        each.marker = None
    return found


@functools.cache
def find_uv() -> tuple[list[str], dict[str, str]] | None:
    """Command and environment of uv, if it is here and finds what pip would; a person is told if it would not."""
    uv = shutil.which("uv")
    if uv is None:
        return None
    listed = subprocess.run([*PIP, "config", "list"], capture_output=True, text=True, check=True).stdout
    same = for_uv(pip_settings(listed))
    if same is None:
        print("  uv is here, but pip's configuration has settings that uv does not know: pip installs.", flush=True)
        return None
    return [uv, "pip", "install", "--quiet", "--python", sys.executable, *same[0]], {**os.environ, **same[1]}


def run(wanted: list[str]) -> str:
    """Has uv or pip install this, and returns what did it.

    Raises Missing if a file is not that of the lock, CalledProcessError if pip fails, which has said why.
    """
    uv = find_uv()
    if uv is not None:
        if subprocess.run([*uv[0], *wanted], env=uv[1], check=False).returncode == 0:
            return "uv"
        print("  uv could not install it: pip tries.", flush=True)
    done = subprocess.run([*PIP, "install", "--quiet", *wanted], stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        if other := re.findall(r"^ {4}(\S+?)==\S+.* from ", done.stderr, re.MULTILINE):
            raise Missing(
                f"The file that pip was given for {' and '.join(other)} is none of those whose hashes stand in "
                "constraints.txt, so it was not installed; use an index with the published files, or, if you trust "
                "this one, say it again with HASHES=no: make HASHES=no paint."
            )
        print(done.stderr, file=sys.stderr, end="")
        raise subprocess.CalledProcessError(done.returncode, "pip")
    return "pip"


def make_environment(folder: Path, options: list[str]) -> int:
    """Installs the painter and its page into an environment of their own; returns the exit status."""
    programs = folder / ("Scripts" if sys.platform == "win32" else "bin")
    python = programs / ("python.exe" if sys.platform == "win32" else "python")
    if not python.exists():
        print(f"Making a Python environment in {folder}: some seconds.", flush=True)
        venv.create(folder, with_pip=True)
    print("Installing PyTorch and some 45 smaller packages: one to two minutes.", flush=True)
    done = subprocess.run([str(python), __file__, ".[web]", *options], check=False)
    if done.returncode == 0:
        painter = programs / "frida-painter"
        print(f'Paint:  "{painter}" paint "{ROOT / "examples" / "photographs" / "coffee.jpg"}"')
        print(f'Page:   "{painter}" studio')
    return done.returncode


def main() -> int:
    """Exit status 0 when it is installed, else pip's."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("requirement", nargs="?", help="the project's folder, with extras: .[dev]; or a package's name")
    parser.add_argument("--lock", type=Path, default=ROOT / "constraints.txt")
    parser.add_argument("--wheel", help="a wheel of the project, instead of its folder")
    parser.add_argument("--without-hashes", action="store_true", help="take files that are not those of the lock")
    given = parser.parse_args()
    if why := runpy.run_path(str(ROOT / "src/frida_painter/system/operating_system.py"))["why_unfit"]():
        sys.exit(why)
    if given.requirement is None:
        return make_environment(MADE, sys.argv[1:])
    began = monotonic()
    try:
        installer = Installer(given.lock, hashes=not given.without_hashes)
        if given.requirement.startswith("."):
            project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
            installer.install(map(Requirement, (*project["build-system"]["requires"], *FOR_BUILDING)))
        installer.install(asked_by(given.requirement))
        if given.requirement.startswith("."):
            run(["--no-deps", "--no-build-isolation", *([given.wheel] if given.wheel else ["--editable", str(ROOT)])])
    except Missing as why:
        print(f"  {why}", file=sys.stderr)
        return 1
    except subprocess.CalledProcessError as error:
        print("  It could not be installed; what pip says above names the reason.", file=sys.stderr)
        return int(error.returncode) or 1
    print(f"  Installed by {installer.by} in {monotonic() - began:.0f} s.", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
