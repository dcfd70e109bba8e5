"""Hooks of mkdocs: a page of reference for every room of the house, made from its docstrings, and links to it.

A room is a package or a module directly below `frida_painter`. The pages in docs/ link to source
files, as people read them in the repository; on the site these links lead to the reference.
"""

import ast
import logging
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

PACKAGE = Path(__file__).parents[1] / "src/frida_painter"
LOG = logging.getLogger("mkdocs.hooks.reference")  # a warning of mkdocs, which ends a strict build
_SOURCE = re.compile(r"\]\(\.\./src/frida_painter/([\w/]+)\.py\)")
_ELSEWHERE = re.compile(r"\[([^\]]*)\]\(\.\./(?!src/frida_painter/[\w/]+\.py\))([^)]*)\)")


def rooms() -> list[str]:
    """The names of all rooms, by the alphabet."""
    found = [path.parent.name for path in PACKAGE.glob("*/__init__.py")]
    return sorted(found + [path.stem for path in PACKAGE.glob("*.py") if not path.stem.startswith("__")])


def on_config(config: Any) -> Any:
    """Adds the reference to the navigation."""
    config.nav.append({"Reference": ["api/index.md", *({room: f"api/{room}.md"} for room in rooms())]})
    return config


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages of the reference."""
    for room in rooms():
        content = f"# {room}\n\n::: frida_painter.{room}\n"
        files.append(File.generated(config, f"api/{room}.md", content=content))
    table = "\n".join(f"| [{room}]({room}.md) | {_purpose(room)} |" for room in rooms())
    opening = "# Reference\n\nEvery room of the house, from its docstrings."
    index = f"{opening}\n\n| room | what it is for |\n|---|---|\n{table}\n"
    files.append(File.generated(config, "api/index.md", content=index))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Leads links to source files to the reference; what else lies outside docs/ is named by its path."""
    markdown = _SOURCE.sub(lambda found: f"]({_reference(found[1])})", markdown)
    return _ELSEWHERE.sub(
        lambda found: f"{found[1]} (`{found[2]}`)" if found[2] not in found[1] else found[1], markdown
    )


def _reference(path: str) -> str:
    if not (PACKAGE / f"{path}.py").is_file():
        LOG.warning("A page links to src/frida_painter/%s.py, which does not exist.", path)
    parts = [part for part in path.split("/") if part != "__init__"]
    return f"api/{parts[0]}.md#{'.'.join(('frida_painter', *parts))}"


def _purpose(room: str) -> str:
    path = PACKAGE / room / "__init__.py" if (PACKAGE / room).is_dir() else PACKAGE / f"{room}.py"
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0].replace("|", r"\|")
