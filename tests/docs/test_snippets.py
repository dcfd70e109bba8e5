"""What the pages show can be typed: commands and options exist, code imports what is there, files can be read."""

import ast
import importlib
import importlib.util
import json
import re
import shlex
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import frida_painter as fp
from frida_painter_cli.commands import all_commands

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^( *)```(\w*)[^\n]*\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)
# The laboratory tells of commands as they were.
PAGES = [ROOT / "README.md", *sorted(path for path in DOCS.rglob("*.md") if path.relative_to(DOCS).parts[0] != "lab")]
# What the example package of own parts adds to `paint`.
ADDED = {"--mirror", "--mirror-weight"}


def blocks(page: Path, *kinds: str) -> Iterator[str]:
    for indent, kind, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if kind in kinds:
            yield re.sub(f"^{indent}", "", text, flags=re.MULTILINE)


def commands(page: Path) -> Iterator[list[str]]:
    """The words of every line that calls the program, in blocks of commands and in running text."""
    lines = [line for text in blocks(page, "sh", "console") for line in text.splitlines()]
    inline = re.findall(r"`(frida-painter [^`]*)`", BLOCK.sub("", page.read_text(encoding="utf-8")))
    for line in [*lines, *inline]:
        words = shlex.split(line, comments=True)
        if words[:1] == ["frida-painter"]:
            yield words[1:]


@cache
def command(name: str) -> Any:
    return next(entry for entry in all_commands() if entry.name == name).load()


def what_is_wrong(words: list[str]) -> str:
    """Why the program would not take these words; "" where it would. Values are checked where there is a choice."""
    if not words or words[0] in ("COMMAND", "--help"):
        return ""
    if words[0] not in {entry.name for entry in all_commands()}:
        return f"no command {words[0]}"
    found, rest = command(words[0]), words[1:]
    while getattr(found, "commands", None) and rest and rest[0] in found.commands:
        found, rest = found.commands[rest[0]], rest[1:]
        found = found._entry.load() if hasattr(found, "_entry") else found
    if words[0] == "sweep" and getattr(found, "commands", None):  # `sweep FILE` is short for `sweep run FILE`
        found = found.commands["run"]
    if getattr(found, "commands", None) and "".join(rest[:1]).isupper():
        return ""  # `experiments NAME` stands for any of them
    options = {flag: param for param in found.params for flag in (*param.opts, *param.secondary_opts)}
    values, given = 0, iter(rest)
    for word in given:
        if word in ("--help", "-h", ">"):
            break
        if not word.startswith("-"):
            values += 1
        elif word in ADDED:
            next(given)
        elif word not in options:
            return f"no option {word} of {words[0]}"
        elif not options[word].is_flag and next(given, None) is None:
            return f"{word} is given nothing"
    arguments = [param for param in found.params if param.param_type_name == "argument"]
    most = 99 if any(param.nargs != 1 for param in arguments) else len(arguments)
    return f"{values} arguments for {words[0]}" if values > most else ""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_can_be_typed(page: Path) -> None:
    assert {" ".join(words): wrong for words in commands(page) if (wrong := what_is_wrong(words))} == {}


def test_there_are_commands_and_a_wrong_one_is_found() -> None:
    assert sum(1 for page in PAGES for _ in commands(page)) > 100
    assert what_is_wrong(["pant", "me.jpg"]) == "no command pant"
    assert what_is_wrong(["paint", "me.jpg", "--strookes", "3"]) == "no option --strookes of paint"
    assert what_is_wrong(["paint", "me.jpg", "--strokes"]) == "--strokes is given nothing"
    assert what_is_wrong(["strokes", "train", "--brush", "broad", "--model", "field", "a", "b"]).startswith("2 arg")
    assert what_is_wrong(["paint", "me.jpg", "--strokes", "3", "--no-film"]) == ""


def lost_names(source: str) -> list[str]:
    """Names that a snippet imports from the project, or takes of `fp`, and that are not there."""
    lost = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("frida_painter"):
            module = importlib.import_module(node.module or "")
            for alias in node.names:
                inside = f"{node.module}.{alias.name}"
                packaged = hasattr(module, "__path__") and importlib.util.find_spec(inside) is not None
                if not hasattr(module, alias.name) and not packaged:
                    lost.append(inside)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "fp":
            lost += [] if node.attr in fp.__all__ else [f"fp.{node.attr}"]
    return lost


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_names_what_is_there(page: Path) -> None:
    assert [name for source in blocks(page, "python") for name in lost_names(source)] == []


def test_a_lost_name_is_found() -> None:
    assert lost_names("import frida_painter as fp\nfp.Plannr") == ["fp.Plannr"]
    assert lost_names("from frida_painter.strokes.plan import Plan, Plam") == ["frida_painter.strokes.plan.Plam"]
    assert lost_names("from frida_painter_lab import experiment") == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_can_be_read(page: Path) -> None:
    for text in blocks(page, "toml"):
        tomllib.loads(text)
    for text in blocks(page, "json"):
        json.loads(text)
