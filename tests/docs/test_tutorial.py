"""The tutorial works as it stands: every fenced block is run, in order, and leaves the files that the page promises.

Three things are stood in for, so that it needs no internet: `make` only says what it would do, `pip` only looks
whether there are such extras, and words are judged by small random networks in the place of those that are fetched.
"""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "tutorial" / "first-painting.md"
BLOCK = re.compile(
    r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```$|^You now have: ([^\n]*)\.$", re.DOTALL | re.MULTILINE
)
RUN = ("sh", "python", "toml")
# In the place of networks that have to be fetched; tests of words use the same ones.
COMMAND = """#!{python}
import sys
from unittest.mock import patch
from frida_painter.__main__ import main
words = sys.argv[1:]
if words[:2] == ["models", "fetch"]:
    from frida_painter import weights
    sys.exit(0 if set(words[2:]) <= {{"words", *(each.name for each in weights.all_weights())}} else f"no: {{words}}")
elif "--text" in words:
    from frida_painter.objectives.encoders.loading import EncoderRegistry
    from support.networks import QuickEncoders
    for name in ("readers", "reader_aside", "sentences", "keep", "own"):
        setattr(EncoderRegistry, name, getattr(QuickEncoders, name))
    main()
else:
    main()
"""
PIP = """#!{python}
import re, sys, tomllib
from pathlib import Path
extras = tomllib.loads(Path("pyproject.toml").read_text())["project"]["optional-dependencies"]
asked = re.fullmatch(r"\\.\\[([\\w,]+)\\]", sys.argv[2])
sys.exit(0 if sys.argv[1] == "install" and asked and set(asked[1].split(",")) <= set(extras) else f"no: {{sys.argv}}")
"""


@dataclass(frozen=True)
class Block:
    """Something to be run, a file to be written, or, with kind "files", what is there afterwards."""

    kind: str
    name: str
    text: str


def blocks(page: str) -> list[Block]:
    found = []
    for kind, name, text, files in BLOCK.findall(page):
        found.append(Block("files", "", files) if files else Block(kind, name, text))
    return found


def run(block: Block, folder: Path, number: int) -> None:
    if block.kind == "files":
        lost = [name for name in re.findall("`([^`]+)`", block.text) if not (folder / name).is_file()]
        assert lost == []
    elif block.kind == "toml":
        tomllib.loads(block.text)
        (folder / block.name).write_text(block.text, encoding="utf-8")
    else:
        script = folder / f"block-{number}"
        script.write_text(block.text, encoding="utf-8")
        with_what = ["bash", "-euo", "pipefail"] if block.kind == "sh" else [sys.executable]
        done = subprocess.run([*with_what, script.name], cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{block.text}\n{done.stdout[-1000:]}\n{done.stderr[-3000:]}"


def test_only_what_is_run_or_shown_stands_in_a_block() -> None:
    found = blocks(PAGE.read_text(encoding="utf-8"))
    assert {block.kind for block in found} <= {*RUN, "files", "text"}
    assert sum(block.kind == "files" for block in found) >= 6
    assert all(block.name for block in found if block.kind == "toml")


def test_a_page_that_promises_too_much_is_found_out(tmp_path: Path) -> None:
    (tmp_path / "there.txt").write_text("")
    page = "You now have: `there.txt`.\n\n```sh\necho a > b\n```\n\nYou now have: `b`, `c`.\n"
    first, command, second = blocks(page)
    run(first, tmp_path, 0)
    run(command, tmp_path, 1)
    with pytest.raises(AssertionError):
        run(second, tmp_path, 2)
    with pytest.raises(AssertionError, match="false"):
        run(Block("sh", "", "false | cat\n"), tmp_path, 3)


@pytest.mark.slow
@pytest.mark.timeout(3600)  # some twenty commands, on a machine that may be busy
@pytest.mark.skipif(shutil.which("bash") is None or shutil.which("make") is None, reason="needs bash and make")
def test_every_step_works_as_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    for name, text in (("frida-painter", COMMAND), ("pip", PIP)):
        (programs / name).write_text(text.format(python=sys.executable))
        (programs / name).chmod(0o755)
    (programs / "activate").write_text(f'export PATH="{programs}:$PATH"\n')
    for name in ("examples", "Makefile", "pyproject.toml", "constraints.txt", "tools"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.setenv("MAKEFLAGS", "n")
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")  # as activated in every later block
    known = os.pathsep.join(filter(None, (str(ROOT / "src"), str(ROOT / "tests"), os.environ.get("PYTHONPATH"))))
    monkeypatch.setenv("PYTHONPATH", known)
    for number, block in enumerate(blocks(PAGE.read_text(encoding="utf-8"))):
        run(block, tmp_path, number)
