"""Facts that decide a result: versions of the program, its libraries and plug-ins, and hashes of their code."""

import hashlib
import platform
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.util import find_spec
from pathlib import Path

from frida_painter import registry

LIBRARIES = ("torch", "numpy", "numba")
PROGRAM = "frida-painter"
PLUGIN = "plug-in "
"""Beginning of the name of a plug-in among the facts."""
NOT_DECISIVE = ("commit", "processor")
"""Facts that earlier versions told, and that do not decide what comes out."""
_DIGITS = 16
_CODE = {".py", ".so", ".pyd", ".json", ".toml", ".csv", ".txt"}
_MAX_FILES = 5000


def describe_here(device: str = "cpu") -> dict[str, str]:
    """Returns the facts that decide a result on this machine, by name: versions, hashes of code, device.

    device: type of the device that plans
    """
    home = Path(__file__).parents[1]
    return {
        PROGRAM: version(PROGRAM),
        "code": " ".join(hash_code(package) for package in (home, *sorted(home.parent.glob("frida_painter_*")))),
        "python": platform.python_version(),
        **{name: version(name) for name in LIBRARIES},
        **describe_plugins(),
        "device": device,
        "machine": f"{sys.platform} {platform.machine()}",
    }


def identify(facts: Mapping[str, str]) -> str:
    """Returns the facts that decide a result as one line, the same for the same program, libraries and plug-ins.

    Python, device and machine do not count, so that the machines of one sweep may differ in them.
    """
    known = {PROGRAM, "code", *LIBRARIES}
    return ", ".join(f"{name} {facts[name]}" for name in sorted(facts) if name in known or name.startswith(PLUGIN))


def identify_here() -> str:
    """Returns the line of `identify` for this program, with its libraries and plug-ins."""
    return identify(describe_here())


def describe_plugins() -> dict[str, str]:
    """Returns version and hash of the code of each other package that registers a part, by "plug-in NAME"."""
    return {f"{PLUGIN}{package}": _describe(package, names) for package, names in registry.modules_of_others().items()}


def _describe(package: str, modules: Sequence[str]) -> str:
    """Returns version and hash of a package's code, from the modules that it registers; imports nothing."""
    told, content = "of unknown version", hashlib.sha256()
    with suppress(PackageNotFoundError):
        told = distribution(package).version
    for name in modules:
        with suppress(ImportError, ValueError, AttributeError):
            spec = find_spec(name)
            for place in [] if spec is None else list(spec.submodule_search_locations or [spec.origin or ""]):
                content.update(hash_code(Path(place)).encode())
    return f"{told} code {content.hexdigest()[:_DIGITS]}"


def hash_code(path: Path) -> str:
    """Returns a short hash of a source file, or of the names and contents of all source files below a folder.

    Files that cannot be read count as empty.
    """
    files = [path]
    if not path.is_file():
        found = (file for file in path.rglob("*") if file.suffix in _CODE and "__pycache__" not in file.parts)
        files = sorted(file for number, file in enumerate(found) if number < _MAX_FILES and file.is_file())
    content = hashlib.sha256()
    for file in files:
        name = file.name if file == path else file.relative_to(path).as_posix()
        content.update(f"{name}\0".encode())
        with suppress(OSError):
            found_here = file.stat()
            content.update(_digest(file, found_here.st_size, found_here.st_mtime_ns))
    return content.hexdigest()[:_DIGITS]


@cache  # reading all sources takes 50 ms
def _digest(file: Path, size: int, changed: int) -> bytes:
    """Returns the hash of a file, whose size and time change with its content. Raises OSError."""
    return hashlib.sha256(file.read_bytes()).digest()  # a source file that Python would import


def compare_facts(before: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """Returns a phrase for each fact that decides a result and has changed: "torch was 2.4.0 and is 2.5.1 here"."""
    pairs = {name: (before.get(name, "missing"), here.get(name, "missing")) for name in (*before, *here)}
    return [
        f"{name} was {one} and is {other} here"
        for name, (one, other) in pairs.items()
        if one != other and name not in NOT_DECISIVE
    ]
