"""The documentation: the site is built strictly, pages stay short, and whatever names a page names a real one."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from nightly import installed

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "RELEASE.md", *sorted(DOCS.rglob("*.md"))]
PARTS = ("tutorial", "how-to", "explanation", "reference", "lab")
OUTSIDE = ("index.md", "benchmarks.md")  # the home page, and what `make benchmarks` writes
MADE = "<!-- `make reference` writes this page"
MAX_WORDS, MAX_WORDS_A_PAGE = 20_000, 2_500
MAX_WORDS_OF_THE_LABORATORY = 12_000
MAX_LINES = 2_600  # of the ten files that CONTRIBUTING.md names first
MAX_FILES = (25, 30, 8)  # that follow a photograph, a prompt and a stroke through the code


def lost_links(page: Path) -> list[str]:
    """Links to files that are not there. Pages of modules are made when the site is built, which checks them itself."""
    links = re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8"))
    inside = [link for link in links if "://" not in link and not link.startswith(("mailto:", "api/"))]
    return [link for link in inside if not (page.parent / link).exists()]


def readers_pages() -> dict[str, int]:
    """How many words each page for readers has: all but the laboratory and what a program writes."""
    paths = [path for path in DOCS.rglob("*.md") if path.relative_to(DOCS).parts[0] not in ("lab", "benchmarks.md")]
    texts = {str(path.relative_to(DOCS)): path.read_text(encoding="utf-8") for path in paths}
    return {name: len(text.split()) for name, text in texts.items() if not text.startswith(MADE)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page: Path) -> None:
    assert lost_links(page) == []


def test_a_lost_link_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("[here](page.md) [there](gone.md#part) [far](https://example.org/gone.md)")
    assert lost_links(page) == ["gone.md"]


def test_every_page_is_in_one_part() -> None:
    assert {path.relative_to(DOCS).parts[0] for path in DOCS.rglob("*.md")} == {*PARTS, *OUTSIDE}
    assert len(list((DOCS / "tutorial").glob("*.md"))) == 1


def test_the_readers_part_stays_short() -> None:
    pages = readers_pages()
    assert sum(pages.values()) <= MAX_WORDS
    assert {name: words for name, words in pages.items() if words > MAX_WORDS_A_PAGE} == {}


def test_notes_of_the_laboratory_are_short_and_dated() -> None:
    pages = list((DOCS / "lab").rglob("*.md"))
    assert sum(len(path.read_text(encoding="utf-8").split()) for path in pages) <= MAX_WORDS_OF_THE_LABORATORY
    notes = [path for path in pages if path.name != "index.md"]
    undated = [path.name for path in notes if not re.search(r"last changed on \d{4}-\d\d-\d\d", path.read_text())]
    assert undated == []


def test_the_way_into_the_code_is_short() -> None:
    """Ten files that a newcomer reads, three paths through the code, and a table of ten rows."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    way = text.partition("## Five minutes through the code")[2].partition("\n## ")[0]
    files = re.findall(r"^\d+\. \[`[\w/]+\.py`\]\((src/[\w/]+\.py)\)", way, re.MULTILINE)
    assert len(files) == 10
    assert sum((ROOT / file).read_text(encoding="utf-8").count("\n") for file in files) <= MAX_LINES
    paths = re.findall(r"^- \*\*.*", way, re.MULTILINE)  # of a photograph, a prompt, a stroke
    followed = [re.findall(r"\]\((src/[\w/]+\.py)\)", path) for path in paths]
    assert [len(set(path)) <= most for path, most in zip(followed, MAX_FILES, strict=True)] == [True] * 3
    assert all(len(path) > 5 and all((ROOT / file).is_file() for file in path) for path in followed)
    table = text.partition("## Where do I change X?")[2].partition("\n## ")[0]
    assert len(re.findall(r"^\|(?!---)", table, re.MULTILINE)) == 1 + 10


@pytest.mark.parametrize("folder", ["src", "benchmarks", "tools", "examples", "tests"])
def test_sentences_that_name_a_page_name_one_that_is_there(folder: str) -> None:
    named = {
        (str(path.relative_to(ROOT)), page)
        for path in (ROOT / folder).rglob("*.py")
        for page in re.findall(r"docs/[\w/-]+\.md", path.read_text(encoding="utf-8"))
        if path != Path(__file__)
    }
    assert folder != "src" or len(named) > 5
    assert {(path, page) for path, page in named if not (ROOT / page).is_file()} == set()


def test_files_made_from_the_program_are_up_to_date() -> None:
    """By a process of its own, in which no other test has registered a part."""
    command = [sys.executable, "tools/write_reference.py", "--show"]
    shown = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    pages = json.loads(shown)
    assert len(pages) == 6
    for name, page in pages.items():
        assert page == (ROOT / name).read_text(encoding="utf-8"), "say `make reference`, and look at it"


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """Links, anchors, docstrings, the navigation, and a reference of every module: all are warnings of the build."""
    installed("mkdocs")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    built = subprocess.run(command, cwd=ROOT, env=quiet, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr[-4000:]
    for page in DOCS.rglob("*.md"):
        inside = page.relative_to(DOCS).with_suffix("")
        folder = inside.parent if inside.name == "index" else inside
        assert (tmp_path / folder / "index.html").is_file()
