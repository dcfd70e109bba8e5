"""The check of words, of a repository of one file that is made here."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[2] / "tools" / "check_words.py"
HARD = {
    "first word": '"""Whether the lamp is on."""',
    "its first word, if it is a pronoun": '"""Its name."""',
    "where at the start": '"""Height of the tip in metres. Where it has none, zero."""',
    "where for if": '"""Name of the brush, or None where there is none."""',
    "where of an error": '"""Reads a plan. Raises PlanError where the file is damaged."""',
    "inverted opening": '"""Height of the image.\n\nIn which is planned."""',
    "clause for a noun": '"""Names of what was seen."""',
    "comment": "# Where it rains, nobody paints.",
    "paragraph": '"""Plan.\n\n' + "word " * 121 + '"""',
}
PLAIN = (
    '"""True if the lamp is on."""',
    '"""Returns the place where the tip is."""',
    '"""Plan.\n\n' + "word " * 120 + '"""',
    '"""Reads a plan.\n\nRaises PlanError if the file is damaged."""',
    "# Two lamps are lit because one makes hard shadows.",
    '"""Calls `where there is none`."""',
    'text = "Whether it rains"',
)


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    (tmp_path / "tools").mkdir()
    (tmp_path / "src").mkdir()
    (tmp_path / "tools" / "check_words.py").write_text("")
    (tmp_path / "tools" / "run.py").write_text(TOOL.read_text().split('"""', 2)[2])
    (tmp_path / "pyproject.toml").write_text("[tool.frida-words]\nmax-found = 1\n")
    return tmp_path


def check(repository: Path, source: str, *words: str) -> tuple[int, str]:
    """The exit status and what is printed."""
    (repository / "src" / "one.py").write_text(source + "\n")
    # Without the docstring and comments of the tool itself, which stands in the repository that it checks.
    command = [sys.executable, str(repository / "tools" / "run.py"), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert not done.stderr
    return done.returncode, done.stdout


@pytest.mark.parametrize("kind", HARD)
def test_hard_words_are_found(repository: Path, kind: str) -> None:
    status, said = check(repository, HARD[kind], str(repository / "src"))
    assert status == 0
    assert re.search(r"^1 places", said, re.MULTILINE), said


@pytest.mark.parametrize("source", PLAIN)
def test_plain_words_are_not(repository: Path, source: str) -> None:
    assert "0 places" in check(repository, source, str(repository / "src"))[1]


def test_the_count_may_only_fall(repository: Path) -> None:
    one, two, none = "# Where it rains.", "# Where it rains.\n\n# Where it snows.", "# It rains."
    assert check(repository, one)[0] == 0
    status, said = check(repository, two)
    assert status == 1 and "2 places; 1 are allowed" in said and "src/one.py" in said
    status, said = check(repository, none)
    assert status == 1 and "--lower" in said
    assert check(repository, none, "--lower")[0] == 0
    assert check(repository, none)[0] == 0
    assert check(repository, one)[0] == 1
