"""Hooks of mkdocs: a page of reference for every room of the house, made from its docstrings, and links to it.

A room is a package or a module directly below `frida_painter`. The pages in docs/ link to source
files and examples, as people read them in the repository; on the site, links to source lead to the reference.
After the build, a module without a reference is a warning, and a warning ends a strict build.
"""

import ast
import logging
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

SOURCE = Path(__file__).parents[1] / "src"
PACKAGE = SOURCE / "frida_painter"
API = "reference/api"
LOG = logging.getLogger("mkdocs.hooks.reference")  # a warning of mkdocs, which ends a strict build
_SOURCE = re.compile(r"\]\(((?:\.\./)+)src/(frida_painter\w*)/([\w/]+)\.py\)")
_ELSEWHERE = re.compile(r"\[([^\]]*)\]\((?:\.\./)+((?:examples|src|tests|tools|benchmarks|CONTRIBUTING)\b[^)]*)\)")


def rooms() -> list[str]:
    """The names of all rooms, by the alphabet."""
    found = [path.parent.name for path in PACKAGE.glob("*/__init__.py")]
    found += [path.stem for path in PACKAGE.glob("*.py") if not path.stem.startswith("__")]
    return sorted(found) + sorted(path.parent.name for path in SOURCE.glob("frida_painter_*/__init__.py"))


def dotted(room: str) -> str:
    """The whole name of a room of the painter, or of a package beside it."""
    return room if (SOURCE / room).is_dir() else f"frida_painter.{room}"


def on_config(config: Any) -> Any:
    """Adds the reference of all modules to the part Reference of the navigation."""
    (part,) = (entry["Reference"] for entry in config.nav if "Reference" in entry)
    part.append({"All modules": [f"{API}/index.md", *({room: f"{API}/{room}.md"} for room in rooms())]})
    return config


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages of the reference."""
    for room in rooms():
        content = f"# {room}\n\n::: {dotted(room)}\n"
        files.append(File.generated(config, f"{API}/{room}.md", content=content))
    table = "\n".join(f"| [{room}]({room}.md) | {_purpose(room)} |" for room in rooms())
    opening = "# All modules\n\nEvery room of the house, from its docstrings."
    index = f"{opening}\n\n| room | what it is for |\n|---|---|\n{table}\n"
    files.append(File.generated(config, f"{API}/index.md", content=index))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Leads links to source files to the reference; what else lies outside docs/ is named by its path."""
    up = "../" * page.file.src_uri.count("/")
    markdown = _SOURCE.sub(lambda found: f"]({up}{_reference(found[2], found[3])})", markdown)
    return _ELSEWHERE.sub(
        lambda found: f"{found[1]} (`{found[2]}`)" if found[2] not in found[1] else found[1], markdown
    )


def on_post_build(config: Any) -> None:
    """Warns of modules that have no reference."""
    pages = "".join(path.read_text(encoding="utf-8") for path in (Path(config.site_dir) / API).rglob("index.html"))
    named = set(re.findall(r'id="(frida_painter[\w.]*)"', pages))
    for name in sorted(modules() - named):
        LOG.warning("%s has no reference on the site.", name)


def modules() -> set[str]:
    """The dotted names of all public modules but the package itself."""
    paths = (path.relative_to(SOURCE).with_suffix("").parts for path in SOURCE.rglob("*.py"))
    found = {".".join(part for part in parts if part != "__init__") for parts in paths}
    public = {name for name in found if not any(part.startswith("_") for part in name.split("."))}
    return public - {"frida_painter"}


def _reference(package: str, path: str) -> str:
    if not (SOURCE / package / f"{path}.py").is_file():
        LOG.warning("A page links to src/%s/%s.py, which does not exist.", package, path)
    parts = [part for part in (package, *path.split("/")) if part != "__init__"]
    return f"{API}/{package if package != PACKAGE.name else parts[1]}.md#{'.'.join(parts)}"


def _purpose(room: str) -> str:
    place = SOURCE.joinpath(*dotted(room).split("."))
    path = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0].replace("|", r"\|")
