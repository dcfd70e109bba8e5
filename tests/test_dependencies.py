"""What the package imports is what it declares: nothing comes in because something else happened to bring it."""

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import frida_painter

ROOT = Path(frida_painter.__file__).parent
PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"


def plain(name: str) -> str:
    return re.split(r"[<>=!~;\[ ]", name)[0].lower().replace("_", "-")


def declared() -> set[str]:
    return {plain(name) for name in tomllib.loads(PYPROJECT.read_text())["project"]["dependencies"]}


def extras() -> set[str]:
    """What is installed for one robot or camera only, and imported when that is connected."""
    optional = tomllib.loads(PYPROJECT.read_text())["project"]["optional-dependencies"]
    return {plain(name) for extra, names in optional.items() if extra != "dev" for name in names}


def imported(*, when_connecting: bool = False) -> dict[str, set[str]]:
    """Modules that are neither Python's nor ours, by name, with the files that import them.

    With `when_connecting` those that functions import, otherwise those that are imported with the file.
    """
    found: dict[str, set[str]] = {}
    for path in ROOT.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        inner = {node for function in functions for node in ast.walk(function)}
        for node in inner if when_connecting else set(ast.walk(tree)) - inner:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            for name in names:
                top = name.partition(".")[0]
                if top not in sys.stdlib_module_names and top != "frida_painter":
                    found.setdefault(top, set()).add(str(path.relative_to(ROOT)))
    return found


def test_everything_that_is_imported_is_declared() -> None:
    known = packages_distributions()
    for module, files in imported().items():
        distributions = {plain(name) for name in known.get(module, [module])}
        assert distributions & declared(), f"{module}, imported by {sorted(files)}, is not in pyproject.toml"


def test_what_is_imported_when_connecting_is_an_extra_or_needed_anyway() -> None:
    known = packages_distributions()
    for module, files in imported(when_connecting=True).items():
        distributions = {plain(name) for name in known.get(module, [module])}
        assert distributions & (declared() | extras()), f"{module}, imported by {sorted(files)}, is in no extra"


def test_everything_that_is_declared_is_imported() -> None:
    known = packages_distributions()
    later = {plain(name) for module in imported(when_connecting=True) for name in known.get(module, [module])}
    used = {plain(name) for module in imported() for name in known.get(module, [])} | later
    assert declared() <= used, f"{sorted(declared() - used)} are installed for nothing"
    assert extras() <= later, f"{sorted(extras() - later)} are installed for nothing"


@pytest.mark.slow
def test_the_command_line_does_not_load_what_only_tests_need() -> None:
    """In a process of its own: what was loaded before by other tests does not count."""
    program = (
        "import sys; from frida_painter import cli; cli.build(); "
        "print(*{name.partition('.')[0] for name in sys.modules})"
    )
    loaded = set(
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    )
    assert "frida_painter" in loaded
    assert not loaded & {"torchvision", "skimage", "pytest", "hypothesis", "matplotlib", "pandas", "transformers"}
    assert not loaded & {"mujoco", "mink"}, "an extra is imported when its robot is connected, and not before"
