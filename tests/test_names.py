"""One word for one thing: names of limits, and names that stand in several rooms."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import frida_painter
from test_house import SOURCES

SRC = Path(frida_painter.__file__).parent
ROOT = SRC.parent.parent

# A command, an experiment or a calibration is called as the noun that it is about; a machine's parts have the same
# names wherever they are described.
STEMS = {
    "canvas", "color", "commands", "easel", "gcode", "goals", "kernels", "kinds", "options", "paint",
    "painting", "robot", "strokes", "table",
}  # fmt: skip
CLASSES: set[str] = set()


@cache
def trees() -> dict[Path, ast.Module]:
    return {path: ast.parse(path.read_text("utf-8")) for path in SOURCES}


def bound_names(tree: ast.AST) -> Iterator[str]:
    """Names that a file gives to constants, functions, classes, parameters and variables."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg


def doubles(places: dict[str, list[str]]) -> set[str]:
    return {name for name, found in places.items() if len(found) > 1}


def test_limits_are_called_max_and_min() -> None:
    files = [
        path for folder in ("src", "tests", "benchmarks", "examples", "tools") for path in (ROOT / folder).rglob("*.py")
    ]
    names = {name.lstrip("_") for path in files for name in bound_names(ast.parse(path.read_text("utf-8")))}
    assert {name for name in names if name.split("_")[0] in ("MOST", "LEAST")} == set()


def test_a_public_class_has_a_name_of_its_own() -> None:
    places = defaultdict(list)
    for path, tree in trees().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(str(path))
    assert doubles(places) == CLASSES


def test_modules_of_several_rooms_with_the_same_name_are_known() -> None:
    places = defaultdict(list)
    for path in trees():
        if path.stem not in ("__init__", "__main__"):
            places[path.stem].append(str(path))
    assert doubles(places) == STEMS, "give a new module a name of its own, or say why it shares one"


# Of functions and methods that others may call: names that end in a participle and are no verbs.
IRREGULAR = {
    "begun", "bent", "bound", "drawn", "found", "given", "gone", "heard", "held", "kept", "known", "laid", "left",
    "lost", "made", "seen", "sent", "shown", "taken", "told", "torn", "understood", "worn", "written",
}  # fmt: skip
NO_PARTICIPLES = {"embed", "heed", "need"}
VERBS = {"count", "find", "have", "is", "keep", "list", "load", "mark", "open", "require"}  # and what is done to what
PARTICIPLES = {
    "connection_made",  # callback of asyncio, called so there
    "expected",  # of `Planner`: the canvas as it would look after a plan
}  # fmt: skip


def is_participle(word: str) -> bool:
    return word not in NO_PARTICIPLES and (word in IRREGULAR or (word.endswith("ed") and len(word) > 4))


def test_functions_are_named_by_verbs() -> None:
    found = set()
    for tree in trees().values():
        public = [node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]
        for node in (node for body in (tree, *public) for node in body.body):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or node.name.startswith("_"):
                continue
            first, *_, last = node.name.split("_") * 2
            is_property = any("property" in ast.unparse(each) for each in node.decorator_list)
            if not is_property and first not in VERBS and is_participle(last):
                found.add(node.name)
    assert found == PARTICIPLES, "name a function by what it does"
