"""The documentation: its links lead somewhere, and the site holds a reference of every module."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "RELEASE.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page: Path) -> None:
    links = re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8"))
    lost = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert lost == []


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("mkdocs") is None or importlib.util.find_spec("mkdocstrings") is None,
    reason='mkdocs is not installed; say: pip install "frida-painter[docs]"',
)
def test_the_site_is_built_without_a_warning_and_refers_to_every_module(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    built = subprocess.run(command, cwd=ROOT, env=quiet, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr[-4000:]
    pages = "".join(path.read_text(encoding="utf-8") for path in (tmp_path / "api").rglob("index.html"))
    named = set(re.findall(r'id="(frida_painter[\w.]*)"', pages))
    source = ROOT / "src"
    modules = {
        ".".join(part for part in path.relative_to(source).with_suffix("").parts if part != "__init__")
        for path in (source / "frida_painter").rglob("*.py")
    }
    public = {name for name in modules if not any(part.startswith("_") for part in name.split("."))}
    assert public - {"frida_painter"} - named == set()
