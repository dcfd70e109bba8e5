"""What the package imports is what it declares: nothing comes in because something else happened to bring it."""

import ast
import functools
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from importlib.metadata import packages_distributions, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import frida_painter
from test_house import SOURCES

ROOT = Path(frida_painter.__file__).parent
ENVIRONMENTS = "frida_painter_lab.env"
PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"


def plain(name: str) -> str:
    return re.split(r"[<>=!~;\[ ]", name)[0].lower().replace("_", "-")


def declared() -> set[str]:
    return {plain(name) for name in tomllib.loads(PYPROJECT.read_text())["project"]["dependencies"]}


def extras() -> set[str]:
    """What is installed for one robot, camera, page or kind of goal only, and imported when that is used."""
    optional = tomllib.loads(PYPROJECT.read_text())["project"]["optional-dependencies"]
    return {
        plain(name) for extra, names in optional.items() if extra not in ("dev", "nightly", "docs") for name in names
    }


@functools.cache
def imports(*, inside_functions: bool) -> dict[str, list[str]]:
    """What every file of the package imports, by its dotted name: with the file itself, or inside its functions."""
    found = {}
    for path in SOURCES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        unseen = [
            node for node in ast.walk(tree) if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        ]
        never = {inner for node in unseen for inner in ast.walk(node)}
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        inner = {node for function in functions for node in ast.walk(function)}
        names = []
        for node in (inner if inside_functions else set(ast.walk(tree)) - inner) - never:
            if isinstance(node, ast.Import):
                names += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names += [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
        parts = path.relative_to(ROOT.parent).with_suffix("").parts
        found[".".join(part for part in parts if part != "__init__")] = names
    return found


def loaded_when_connecting() -> set[str]:
    """Files that others import only inside functions, or with files of which that is true: they come only then."""
    with_files, in_functions = imports(inside_functions=False), imports(inside_functions=True)
    late = {name for names in (*with_files.values(), *in_functions.values()) for name in names}
    late |= {file for file in with_files if file.startswith(ENVIRONMENTS)}  # gymnasium imports them, which is an extra
    while early := late & {name for file, names in with_files.items() if file not in late for name in names}:
        late -= early
    return late


def imported(*, when_connecting: bool = False) -> dict[str, set[str]]:
    """Modules that are neither Python's nor ours, by name, with the files that import them.

    With `when_connecting` those that functions import, themselves or with a file that only they
    import; otherwise those that are imported with the file.
    """
    late = loaded_when_connecting()
    found: dict[str, set[str]] = {}
    for inside in (False, True):
        for file, names in imports(inside_functions=inside).items():
            for name in names:
                top = name.partition(".")[0]
                known = top in sys.stdlib_module_names or top.startswith("frida_painter")
                if not known and when_connecting == (inside or file in late):
                    found.setdefault(top, set()).add(file)
    return found


@functools.cache
def distributions_by_module() -> Mapping[str, list[str]]:
    """Names of distributions by their modules, also of one that only the nightly run installs."""
    return {"franky": ["franky-control"], **packages_distributions()}


def test_everything_that_is_imported_is_declared() -> None:
    known = distributions_by_module()
    for module, files in imported().items():
        distributions = {plain(name) for name in known.get(module, [module])}
        assert distributions & declared(), f"{module}, imported by {sorted(files)}, is not in pyproject.toml"


def test_what_is_imported_when_connecting_is_an_extra_or_needed_anyway() -> None:
    known = distributions_by_module()
    for module, files in imported(when_connecting=True).items():
        distributions = {plain(name) for name in known.get(module, [module])}
        assert distributions & (declared() | extras()), f"{module}, imported by {sorted(files)}, is in no extra"


def test_everything_that_is_declared_is_imported() -> None:
    known = distributions_by_module()
    used = {plain(name) for module in imported() for name in known.get(module, [])}
    later = {plain(name) for module in imported(when_connecting=True) for name in known.get(module, [module])}
    assert declared() <= used | later, f"{sorted(declared() - used - later)} are installed for nothing"
    assert extras() <= later, f"{sorted(extras() - later)} are installed for nothing"


def test_the_command_line_does_not_load_what_only_tests_need() -> None:
    """In a process of its own: what was loaded before by other tests does not count."""
    program = (
        "import sys; from frida_painter_cli import commands; commands.build(); "
        "print(*{name.partition('.')[0] for name in sys.modules})"
    )
    loaded = set(
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    )
    assert "frida_painter" in loaded
    assert not loaded & {"torchvision", "skimage", "pytest", "hypothesis", "matplotlib", "pandas", "transformers"}
    assert not loaded & {"mujoco", "mink"}, "an extra is imported when its robot is connected, and not before"


# The lock: one file of versions, with the hashes of every file, that matches what is declared.

ENTRY = re.compile(r"([a-z0-9-]+)==(\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)\n")


def locked() -> dict[str, str]:
    text = PYPROJECT.with_name("constraints.txt").read_text()
    assert ENTRY.sub("", text) == "", "nothing stands in the lock but versions with their hashes"
    return {name: version for name, version, _ in ENTRY.findall(text)}


def test_the_lock_has_one_version_of_everything_that_is_declared() -> None:
    project, lock = tomllib.loads(PYPROJECT.read_text()), locked()
    optional = project["project"]["optional-dependencies"].values()
    asked = [*project["project"]["dependencies"], *(name for names in optional for name in names)]
    for each in map(Requirement, [*asked, *project["build-system"]["requires"]]):
        name = canonicalize_name(each.name)
        assert name == "frida-painter" or each.specifier.contains(lock[name]), f"{each}: say `make pins`"


def test_the_lock_has_all_that_installed_packages_need() -> None:
    """Packages that are not for this machine are looked at when the lock is renewed."""
    lock, needed = locked(), {"frida-painter"}
    reach = list(needed)
    while reach:
        for each in map(Requirement, requires(reach.pop()) or ()):
            name = canonicalize_name(each.name)
            if (each.marker is None or each.marker.evaluate({"extra": ""})) and name not in needed:
                assert name in lock, f"{name} is in no lock: say `make pins`"
                needed.add(name)
                reach.append(name)
    assert len(needed) > 40


def test_each_action_of_a_workflow_is_named_by_its_commit() -> None:
    used = re.findall(
        r"uses:\s*(.+)", "".join(file.read_text() for file in (PYPROJECT.parent / ".github").rglob("*.yml"))
    )
    assert used and not [each for each in used if not re.fullmatch(r"[\w./-]+@[0-9a-f]{40} # v[\d.]+", each)]
