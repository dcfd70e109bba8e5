"""The report of sizes, of a repository of a few files that is made here."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[2] / "tools" / "size.py"


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A tag with a room of 3 lines, a module of 2 and a test; then a longer module and another room."""
    write(tmp_path, {"tools/size.py": TOOL.read_text(), "src/frida_painter/brush/tip.py": "a\nb\nc\n"})
    write(tmp_path, {"src/frida_painter/plan.py": "a\nb\n", "src/frida_painter/notes.txt": "x\n" * 9})
    write(tmp_path, {"tests/brush/test_tip.py": "t\n"})
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "first")
    return tmp_path


def write(folder: Path, files: dict[str, str]) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)


def git(folder: Path, *words: str) -> None:
    who = {f"GIT_{role}_{what}": "a@b" for role in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
    alone = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_SYSTEM": os.devnull}
    subprocess.run(["git", *words], cwd=folder, env={**os.environ, **who, **alone}, check=True)


def size(folder: Path, *words: str) -> tuple[int, list[list[str]], str]:
    """The exit status, the words of each line, and what it says of errors."""
    command = [sys.executable, str(folder / "tools" / "size.py"), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, [line.split() for line in done.stdout.splitlines()], done.stderr


def test_rooms_are_compared_with_the_last_tag(repository: Path) -> None:
    git(repository, "tag", "1.0")
    write(repository, {"src/frida_painter/plan.py": "a\n" * 70, "src/frida_painter/lens/eye.py": "a\n"})
    (repository / "tests/brush/test_tip.py").unlink()
    status, lines, _ = size(repository)
    assert status == 0
    assert lines[1:4] == [
        ["(no", "room)", "1", "70", "+0", "+68"],
        ["brush/", "1", "3", "+0", "+0"],
        ["lens/", "1", "1", "+1", "+1"],
    ]
    assert ["all", "of", "src", "3", "74", "+1", "+69"] in lines
    assert ["tests", "0", "0", "-1", "-1"] in lines
    assert " ".join(lines[-2]) == "Now: median 3 lines, 2 files under 60 lines, the longest 70."
    assert " ".join(lines[-1]) == "At 1.0: median 2 lines, 2 files under 60 lines, the longest 3."


def test_budgets_are_printed_beside_the_lines(repository: Path) -> None:
    write(repository, {"budgets.toml": '"brush/" = [4, 2]'})
    _, lines, _ = size(repository)
    assert lines[0] == ["room", "files", "lines", "budget", "aim"] and ["brush/", "1", "3", "4", "2"] in lines


def test_without_a_tag_there_is_nothing_to_compare_with(repository: Path) -> None:
    status, lines, _ = size(repository)
    assert status == 0 and ["brush/", "1", "3"] in lines and lines[-1][:4] == ["There", "is", "no", "tag"]
    status, _, error = size(repository, "--since", "nonsense")
    assert status == 2 and error.startswith("git does not know 'nonsense'")
