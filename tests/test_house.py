"""The house: imports only go down, no module imports itself in a circle, and some things never enter."""

import ast
import re
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

import frida_painter
from frida_painter import registry

ROOT = Path(frida_painter.__file__).parent
PACKAGES = (ROOT, *sorted(path for path in ROOT.parent.glob("frida_painter_*") if path.is_dir()))
SOURCES = sorted(path for package in PACKAGES for path in package.rglob("*.py"))
CONTRIBUTING = Path(__file__).parents[1] / "CONTRIBUTING.md"


def place_of(path: Path) -> str:
    """The path of a file below the painter's package, or below src if it belongs to another one."""
    return path.relative_to(ROOT if path.is_relative_to(ROOT) else ROOT.parent).as_posix()


def layers() -> tuple[tuple[str, ...], ...]:
    """Rooms by layer, the lowest first, as the table in CONTRIBUTING.md says."""
    rows = re.findall(r"^\| \d+ \| (`.*?`) \|", CONTRIBUTING.read_text(encoding="utf-8"), re.M)
    return (*(tuple(re.findall(r"`(\w+)/?`", row)) for row in reversed(rows)), ("__main__", ""))


LAYERS = layers()
# Faces are thin, and none knows another: each can be taken away.
FACES = ("frida_painter_cli", "frida_painter_studio")
# Edges are packages of their own, found by name as a stranger's are; the core imports none of them, and a
# painting of a photograph loads none of them.
EDGES = (
    "frida_painter_calibration",
    "frida_painter_drivers",
    "frida_painter_lab",
    "frida_painter_studio",
    "frida_painter_together",
    "frida_painter_words",
)
# What may name an edge: the public names, and those for packages of parts, which are loaded when they are used.
DOORS = ("", "plugins", "__main__")
# What a painting is opened from. PaintingRun opens all of it, and a face asks PaintingRun.
OPENED_BY_A_RUN = {"planning.planner", "easel.parent", "session.journal", "report.recorder"}
# Experiments take less: no session and no easel of a painting either.
OPENED_FOR = {
    "frida_painter_cli": OPENED_BY_A_RUN,
    "frida_painter_studio": OPENED_BY_A_RUN,
    "frida_painter_lab": OPENED_BY_A_RUN | {"runs.settle", "session.loop", "easel.open", "brush.table"},
}
# The virtual studio is reality: what judges or predicts it must not be inside it.
REALITY = {"virtual": {"brush", "render", "perception", "mixing", "objectives", "planning", "session"}}
# Pickles run what they hold, and torchvision does not import beside the build of torch that is pinned.
FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "joblib", "yaml", "shelve", "marshal", "torchvision"}
MAX_ROOMS, MAX_BESIDE = 14, 8
MAX_LINES = 800
MAX_PARAMETERS = 8  # of a function; kernels of numba and Triton, and the judge, are let be
LONG_CONSTRUCTORS = 23  # dataclasses with more fields than that; they may only become fewer
MIN_LINES = 60  # of a module with one reader
# Whatever a person names is read through storage.open_checked: a plain file of a size that was checked. These read
# their own.
OWN_FILES = {
    "__init__.py",
    "easel/open.py",
    "easel/watchdog.py",
    "hardware/preset.py",
    "hardware/workcell.py",
    "mixing/paint.py",
    "system/provenance.py",
    "frida_painter_drivers/sawyer/surroundings.py",
    "frida_painter_lab/benchmark/suite.py",
    "frida_painter_studio/studio_folder.py",
    "frida_painter_studio/security.py",
    "frida_painter_studio/server.py",
    "objectives/weights/archive.py",
    "objectives/weights/cache.py",
    "objectives/weights/sources.py",
    "plugins.py",
    "registry.py",
    "objectives/weights/catalogue.py",
}
# Python is started by python_process.py, in which no code comes from the current folder. These start other programs.
STARTING = {
    "system/python_process.py": {"sys.executable", "subprocess.Popen"},
    "system/video.py": {"subprocess.Popen", "subprocess.run"},
    "system/operating_system.py": {"sys.executable", "subprocess.run", "subprocess.STARTUPINFO"},
    "registry.py": {"sys.executable"},
    "objectives/weights/sources.py": {"sys.executable"},
}
STARTS = re.compile(
    r"subprocess\.(?!PIPE|DEVNULL|STDOUT|TimeoutExpired|CompletedProcess)\w+|sys\.(_base_)?executable|pty\.\w+|runpy\.\w+"
    r"|os\.(system|popen|fork|forkpty|exec\w+|spawn\w+|posix_spawnp?)|.*\bcreate_subprocess_\w+|.*\bProcessPoolExecutor"
    r"|(torch\.)?(multiprocessing|ray)\b.*"
)
# Nothing of a person's is ever deleted. Each of these deletes so often, only what it wrote, known by name and place.
DELETING = {
    "brush/table.py": 1,  # the oldest tables of its cache, named by 32 hexadecimal digits
    "easel/host.py": 2,  # the live picture
    "easel/watchdog.py": 1,  # the stop file that it obeyed
    "system/event_log.py": 4,  # the log, its tally and its reserve, by their full names
    "hardware/latch.py": 2,  # the record of a stop; a folder in its place is renamed
    "frida_painter_lab/commands.py": 1,  # a folder named by storage.PART
    "frida_painter_lab/runs.py": 1,  # the failure of a run
    # numbered strokes of the recording in a folder that was empty before it
    "frida_painter_calibration/procedures/strokes.py": 3,
    "runs/look_folder.py": 1,  # moves a picture beside others of its name
    # pictures that its record names; a canvas without pictures; empty folders
    "frida_painter_words/picture_makers/making.py": 5,
    "runs/run.py": 3,  # empty folders; a stop file of another sitting
    "frida_painter_drivers/sawyer/arm_film.py": 1,  # the end of the film, which it just made
    "system/storage.py": 2,  # temporary files, named by PART
    "frida_painter_studio/side_jobs.py": 1,  # copies for the page, named by a random name of 24 digits
    "frida_painter_studio/server.py": 1,  # the links of the studio that closes
    "frida_painter_studio/stop.py": 1,  # its own key in the making
    "frida_painter_studio/store.py": 1,  # the folder of a painting, on a person's word
    "frida_painter_studio/studio_folder.py": 1,  # a lock
    "frida_painter_cli/leading.py": 1,  # the pause file, when a person at a page goes on
    "frida_painter_studio/web_studio.py": 5,  # stop files
    "frida_painter_together/asking.py": 1,  # pictures with random names that it made itself
    "frida_painter_together/inbox.py": 1,  # pictures with random names for the page
    "frida_painter_together/plan_pictures.py": 1,  # numbered previews of a plan
    "frida_painter_studio/worker.py": 1,  # a stop file
    "frida_painter_studio/workers.py": 3,  # stop files
    "objectives/weights/cache.py": 5,  # downloads that are named by their hash, and their empty folder; the record
    "objectives/weights/sources.py": 3,  # downloads that are named by their hash; folders named by storage.PART
}
READING = {"read_bytes", "read_text", "copyfile", "imread", "fromfile", "loadtxt", "genfromtxt", "safe_open", "memmap"}


@dataclass(frozen=True)
class Source:
    """What is asked of a file: syntax trees of all would fill the memory.

    targets: what it imports, by its whole name; forbidden, opened: lines; started: what could start a process
    """

    text: str
    documented: bool
    targets: frozenset[str]
    forbidden: list[int]
    opened: list[int]
    started: set[str]
    deletions: int
    crowded: tuple[set[str], set[str]]

    @classmethod
    def read(cls, path: Path) -> "Source":
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        found = forbidden(tree), files_opened(tree), starts(tree), deletions(tree), crowded(tree)
        return cls(text, bool(ast.get_docstring(tree)), frozenset(targets(path, tree)), *found)


def read_sources(root: Path) -> dict[str, Source]:
    """All files below a folder, by their paths in it."""
    return {path.relative_to(root).as_posix(): Source.read(path) for path in sorted(root.rglob("*.py"))}


@cache
def sources() -> dict[str, Source]:
    """Those of the project's packages, read once."""
    return {place_of(path): Source.read(path) for path in SOURCES}


def targets(path: Path, tree: ast.Module) -> set[str]:
    """What a module imports, anywhere in it, also inside functions."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively in line {node.lineno}; write the whole name"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def imports_below(root: Path, package: str) -> dict[str, set[str]]:
    """The package's own modules that each module imports, by its dotted name; the root package itself is ""."""
    known = {
        path.removesuffix(".py").replace("/", ".").removesuffix("__init__").removesuffix("."): source.targets
        for path, source in (sources() if root == ROOT else read_sources(root)).items()
    }
    graph = {}
    for name, imported in known.items():
        graph[name] = set()
        for target in imported:
            if target == package or target.startswith((f"{package}.", f"{package}_")):
                inner = target if target.startswith(f"{package}_") else target.removeprefix(package).removeprefix(".")
                while inner not in known:  # a name inside a module belongs to that module
                    inner = inner.rpartition(".")[0]
                graph[name] |= {inner} - {name}
    return graph


def layer(name: str) -> int:
    top = name.partition(".")[0]
    for number, members in enumerate(LAYERS):
        if top in members:
            return number
    raise AssertionError(f"{name} stands on no layer of the house; give it one in docs and in this test")


def is_edge(name: str) -> bool:
    return any(f"{name}.".startswith(f"{edge}.") for edge in EDGES)


def broken_rules(root: Path, package: str) -> list[str]:
    """One line for every upward import, forbidden import and circle."""
    graph = imports_below(root, package)
    broken = [
        f"{name} imports {target}, which lies above it"
        for name, targets in graph.items()
        for target in sorted(targets)
        if layer(target) > layer(name)
    ]
    broken += [
        f"{name} imports {target}, which must not be part of reality"
        for name, targets in graph.items()
        for target in sorted(targets)
        if target.partition(".")[0] in REALITY.get(name.partition(".")[0], ())
    ]
    broken += [
        f"{name} imports {target}, which is another face"
        for name, targets in graph.items()
        for target in sorted(targets)
        if name.partition(".")[0] in FACES
        and target.partition(".")[0] in FACES
        and name.partition(".")[0] != target.partition(".")[0]
    ]
    broken += [
        f"{name} imports {target}, which PaintingRun opens for it"
        for name, targets in graph.items()
        for target in sorted(targets & OPENED_FOR.get(name.partition(".")[0], set()))
        if not name.startswith(
            ("frida_painter_lab.sweeps", "frida_painter_lab.env", "frida_painter_lab.conformance")
        )  # many runs, each of them a PaintingRun
        and (name, target) != ("frida_painter_cli.painting", "easel.parent")  # early, for PaintingRun
    ]
    broken += [
        f"{name} imports {target}, which is an edge"
        for name, targets in graph.items()
        for target in sorted(targets)
        if is_edge(target) and not is_edge(name) and name not in DOORS
    ]
    broken += [f"rooms in a circle: {' -> '.join(circle)}" for circle in circles(between_rooms(graph))]
    return broken + [" -> ".join(circle) for circle in circles(graph)]


def between_rooms(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """Which room imports which; a room inside a room is one of its own."""
    packages = {name.rpartition(".")[0] for name in graph}

    def room(name: str) -> str:
        return name if name in packages else name.rpartition(".")[0] or name

    found: dict[str, set[str]] = {}
    for name, targets in graph.items():
        if name:
            found.setdefault(room(name), set()).update(room(target) for target in targets if target)
        for target in targets:
            found.setdefault(room(target), set())
    return {name: targets - {name} for name, targets in found.items()}


def readers(graph: dict[str, set[str]]) -> dict[str, int]:
    """How many modules import each module."""
    counts = dict.fromkeys(graph, 0)
    for targets in graph.values():
        for target in targets:
            counts[target] += 1
    return counts


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Circles of imports, each once, by depth-first search."""
    done: set[str] = set()
    found = []

    def visit(name: str, path: list[str]) -> None:
        if name in path:
            found.append([*path[path.index(name) :], name])
        elif name not in done:
            for target in sorted(graph[name]):
                visit(target, [*path, name])
            done.add(name)

    for name in graph:
        visit(name, [])
    return found


def test_imports_only_go_down_and_never_in_circles() -> None:
    assert broken_rules(ROOT, "frida_painter") == []


@pytest.mark.parametrize(
    ("files", "says"),
    [
        ({"errors.py": "import house.frames", "frames.py": ""}, "errors imports frames, which lies above"),
        (
            {"errors.py": "def f():\n    from house.strokes import plan", "strokes/plan.py": ""},
            "errors imports strokes.plan, which lies above",
        ),
        (
            {"brush/__init__.py": "", "brush/a.py": "from house.session.loop import Loop", "session/loop.py": ""},
            "above",
        ),
        (
            {"frames.py": "import house.calibration", "calibration.py": "from house.frames import Size"},
            "calibration -> frames -> calibration",
        ),
        (
            {"brush/__init__.py": "from house.brush.a import A", "brush/a.py": "from house.brush import B"},
            "brush -> brush.a -> brush",
        ),
        ({"render/fast.py": "import house.brush.a", "brush/a.py": "import house.render.fast"}, " -> "),
        ({"virtual/a.py": "from house.render import fast", "render/fast.py": ""}, "must not be part of reality"),
        (
            {
                "frida_painter_studio/a.py": "def f():\n    from house.frida_painter_cli import b",
                "frida_painter_cli/b.py": "",
            },
            "which is another face",
        ),
        (
            {"runs/a.py": "from house.frida_painter_words.b import c", "frida_painter_words/b.py": ""},
            "which is an edge",
        ),
        (
            {
                "objectives/a.py": "import house.objectives.kinds.b",
                "objectives/kinds/b.py": "import house.objectives.c",
                "objectives/c.py": "",
            },
            "rooms in a circle: objectives -> objectives.kinds -> objectives",
        ),
        (
            {"frida_painter_cli/a.py": "from house.planning.planner import P", "planning/planner.py": ""},
            "PaintingRun opens for it",
        ),
        ({"frida_painter_lab/a.py": "import house.session.loop", "session/loop.py": ""}, "PaintingRun opens for it"),
    ],
)
def test_the_checker_can_fail(tmp_path: Path, files: dict[str, str], says: str) -> None:
    for name, content in {"__init__.py": "", **files}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content)
    assert any(says in line for line in broken_rules(tmp_path, "house"))


def test_the_checker_passes_what_is_right_and_refuses_strangers(tmp_path: Path) -> None:
    (tmp_path / "__init__.py").write_text("")
    (tmp_path / "errors.py").write_text("import math")
    (tmp_path / "frames.py").write_text("from house.errors import ConfigError\nimport torch")
    assert broken_rules(tmp_path, "house") == []
    (tmp_path / "helpers.py").write_text("import house.errors")
    with pytest.raises(AssertionError, match="on no layer"):
        broken_rules(tmp_path, "house")


def test_a_short_module_has_two_readers_or_is_an_entry_point() -> None:
    count = readers(imports_below(ROOT, "frida_painter"))
    points = {target.partition(":")[0] for group in registry.OUR_PARTS.values() for target in group.values()}
    points = {point.removeprefix("frida_painter.") for point in points}
    for path, source in sources().items():
        name = path.removesuffix(".py").replace("/", ".")
        if not path.endswith("__init__.py") and source.text.count("\n") < MIN_LINES:
            late = name.endswith("kernels")  # numba is loaded by those alone that compute
            called = "__main__" in source.text or "@in_own_process(" in source.text  # in a process of its own
            entered = late or called or name in (*points, *DOORS)
            assert entered or count[name] >= 2, f"{name} has {count[name]} reader; put it there"


def forbidden(tree: ast.Module) -> list[int]:
    """Lines that import a forbidden module, run a text, or start a shell."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            entered = {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            entered = {(node.module or "").partition(".")[0]}
        else:
            entered = set()
        if entered & FORBIDDEN_MODULES:
            found.append(node.lineno)
        if isinstance(node, ast.Call):
            on = {
                word.arg for word in node.keywords if isinstance(word.value, ast.Constant) and word.value.value is True
            }
            runs = isinstance(node.func, ast.Name) and node.func.id in ("eval", "exec")
            if runs or on & {"shell", "allow_pickle"}:
                found.append(node.lineno)
    return found


def test_what_never_enters() -> None:
    assert [name for name, source in sources().items() if source.text.count("\n") > MAX_LINES] == []
    assert [name for name, source in sources().items() if not source.documented] == [], "a module says what it is for"
    assert {name: source.forbidden for name, source in sources().items() if source.forbidden} == {}
    for line in (
        "import pickle",
        "from yaml import load",
        "eval(a)",
        "run(a, shell=True)",
        "load(a, allow_pickle=True)",
    ):
        assert forbidden(ast.parse(line)) == [1], line
    assert forbidden(ast.parse("import json\nrun(a, shell=False)\nmodel.eval()")) == []


def files_opened(tree: ast.Module) -> list[int]:
    """Lines in which a file is opened by its path, past `storage`."""
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        if isinstance(called, ast.Name):
            if called.id == "open":
                found.append(node.lineno)
        elif isinstance(called, ast.Attribute):
            owner = called.value.id if isinstance(called.value, ast.Name) else ""
            mode = [one.value for one in node.args if isinstance(one, ast.Constant)]
            named = [word.arg for word in node.keywords]
            by_mode = any(isinstance(one, str) and re.fullmatch("r[bt+]*", one) for one in mode)
            path_opened = called.attr == "open" and owner != "os" and (by_mode or "encoding" in named)
            if owner != "storage" and (called.attr in READING or path_opened):
                found.append(node.lineno)
    return found


def test_files_that_a_person_names_have_one_door() -> None:
    opened = {name: source.opened for name, source in sources().items() if source.opened}
    assert {name: lines for name, lines in opened.items() if name not in OWN_FILES} == {}, "past storage.open_checked"
    assert opened.keys() >= OWN_FILES, "one of these opens no file any more"


def dotted(node: ast.expr) -> str:
    """The name of an attribute with those before it; they end at a call."""
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def starts(tree: ast.Module) -> set[str]:
    """What could start a process; not the types of processes."""
    found = set()
    types = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Subscript)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and id(node) not in types:
            found.add(dotted(node))
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name for name in found if STARTS.fullmatch(name)}


def test_python_is_started_in_one_place() -> None:
    for path, source in sources().items():
        allowed = STARTING.get(path, set())
        assert {name for name in source.started if not {name, name.partition(".")[0]} & allowed} == set(), path


def test_every_way_to_start_a_process_is_seen() -> None:
    for line in (
        "subprocess.run(a)", "from subprocess import Popen", "subprocess.check_output(a)", "b = sys.executable",
        "from sys import executable", "os.execv(a, b)", "os.system(a)", "asyncio.create_subprocess_exec(a)",
        "import multiprocessing.pool", "from multiprocessing import Process", "import torch.multiprocessing as m",
        "from concurrent.futures import ProcessPoolExecutor", "from os import posix_spawn", "import ray",
    ):  # fmt: skip
        assert starts(ast.parse(line)), line
    assert not starts(ast.parse("a: list[subprocess.Popen[bytes]]\nsubprocess.PIPE\nimport os, sys, subprocess"))


def deletions(tree: ast.Module) -> int:
    """How often a module deletes or moves a file or a folder."""
    calls = [one for one in ast.walk(tree) if isinstance(one, ast.Call) and isinstance(one.func, ast.Attribute)]
    by_name = {"unlink", "rmtree", "rmdir", "removedirs"}
    count = 0
    for call in calls:
        assert isinstance(call.func, ast.Attribute)
        owner = call.func.value.id if isinstance(call.func.value, ast.Name) else ""
        moved = call.func.attr == "rename" and len(call.args) == 1
        count += (
            moved
            or call.func.attr in by_name
            or (owner, call.func.attr) in (("os", "remove"), ("os", "replace"), ("shutil", "move"))
        )
    return count


def test_what_is_deleted_is_argued_for() -> None:
    assert {name: source.deletions for name, source in sources().items() if source.deletions} == DELETING
    said = "a.unlink()", "shutil.rmtree(a)", "os.remove(a)", "a.rename(b)", "os.replace(a, b)", "a.rmdir()"
    assert [deletions(ast.parse(line)) for line in said] == [1] * 6
    assert not any(deletions(ast.parse(line)) for line in ("a.remove(b)", "a.replace(b, c)", "store.rename(a, b)"))


def test_the_door_is_watched() -> None:
    said = "open('a')", "path.open('rb')", "path.open(encoding='utf-8')", "path.read_bytes()", "shutil.copyfile(a, b)"
    assert [files_opened(ast.parse(line)) for line in said] == [[1]] * 5
    for line in ("storage.read_bytes(a, 'b', 1)", "kind.open(order)", "archive.open(info)"):
        assert files_opened(ast.parse(line)) == []


def crowded(tree: ast.Module) -> tuple[set[str], set[str]]:
    """Functions with over MAX_PARAMETERS, but kernels; and classes whose constructor takes more from their fields."""
    functions, classes = set(), set()
    for node in ast.walk(tree):
        marks = " ".join(map(ast.unparse, getattr(node, "decorator_list", ())))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not re.search(r"\bn?jit\b", marks):
            taken = [one.arg for one in ast.iter_child_nodes(node.args) if isinstance(one, ast.arg)]
            if len(taken) - (taken[:1] in (["self"], ["cls"])) > MAX_PARAMETERS:
                functions.add(node.name)
        if isinstance(node, ast.ClassDef) and "dataclass" in marks:
            fields = [ast.unparse(one) for one in node.body if isinstance(one, ast.AnnAssign)]
            if sum("init=False" not in field and "ClassVar" not in field for field in fields) > MAX_PARAMETERS:
                classes.add(node.name)
    return functions, classes


def test_functions_and_constructors_take_at_most_eight() -> None:
    ours = {path: source.crowded for path, source in sources().items() if not path.startswith("virtual/")}
    assert {path: functions for path, (functions, _) in ours.items() if functions} == {}, "what belongs together is one"
    assert len(long := [name for _, classes in ours.values() for name in classes]) <= LONG_CONSTRUCTORS, long
    nine = "a, b, c, d, e, f, g, h, *i"
    many = f"def at({nine}): ...\nclass C:\n def fits(self, {nine[:-4]}): ...\n@numba.njit()\ndef k({nine}): ..."
    fields = "\n".join(f" f{number}: int" for number in range(9))
    said = f"{many}\n@dataclass(frozen=True)\nclass D:\n{fields}\n@dataclass\nclass E:\n{fields} = field(init=False)"
    assert crowded(ast.parse(said)) == ({"at"}, {"D"})


def test_the_painter_has_fourteen_rooms_and_eight_modules_beside_them() -> None:
    rooms = {path.partition("/")[0] for path in sources() if "/" in path and not path.startswith("frida_painter_")}
    beside = {path for path in sources() if "/" not in path and not path.startswith("__")}
    assert len(rooms) <= MAX_ROOMS and len(beside) <= MAX_BESIDE


def test_no_room_is_over_its_budget() -> None:
    """A room that needs more takes something out first; `make size` prints lines, budget and aim."""
    budgets = tomllib.loads((ROOT.parents[1] / "budgets.toml").read_text())
    lines: dict[str, int] = {}
    for path, source in sources().items():
        room, _, below = path.partition("/")
        name = f"{room}/" if below else "(no room)"
        lines[name] = lines.get(name, 0) + len(source.text.splitlines())
    assert lines.keys() == budgets.keys()
    over = {room: (count, budgets[room][0]) for room, count in lines.items() if count > budgets[room][0]}
    assert not over, "lines, and how many there may be"
