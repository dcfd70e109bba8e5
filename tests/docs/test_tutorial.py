"""The tutorial works as it stands: every fenced block is run, in order, and leaves the files that the page promises.

Three things are stood in for, so that it needs no internet: `make` only says what it would do, `pip` only looks
whether there are such extras, and words are judged by small random networks in the place of those that are fetched.
Commands are forked from the test, and their photographs are small, so that it takes little time.
"""

import contextlib
import json
import os
import re
import runpy
import shutil
import socket
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Self

import pytest

from frida_painter.objectives import weights
from frida_painter.objectives.encoders.loading import EncoderRegistry
from killing import ForkedCommand, ForkedProcess
from support.networks import QuickEncoders
from support.small_world import small_world

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "tutorial" / "first-painting.md"
BLOCK = re.compile(
    r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```$|^You now have: ([^\n]*)\.$", re.DOTALL | re.MULTILINE
)
RUN = ("sh", "python", "toml")
# Stands for `frida-painter`: whoever runs the page forks the command, so that nothing is loaded again.
COMMAND = """#!{python} -IS
import json, os, socket, sys
with socket.create_connection(("127.0.0.1", {port})) as line:
    line.sendall(json.dumps([os.getcwd(), sys.argv[1:]]).encode() + b"\\n")
    status, out, err = json.load(line.makefile())
sys.stdout.write(out)
sys.stderr.write(err)
sys.exit(status)
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


class CommandServer:
    """Runs the commands of a page in processes that are forked from this one."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._listening.settimeout(0.02)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._listening.close()

    @property
    def port(self) -> int:
        return int(self._listening.getsockname()[1])

    def serve(self, script: "subprocess.Popen[str]") -> None:
        """Runs what a script asks for, until the script has ended."""
        while script.poll() is None:
            with contextlib.suppress(TimeoutError):
                line, _ = self._listening.accept()
                with line, line.makefile() as asked:
                    folder, words = json.loads(asked.readline())
                    line.sendall(json.dumps(answer(Path(folder), words)).encode())


def answer(folder: Path, words: list[str]) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of `frida-painter` with these words."""
    if words[:2] == ["models", "fetch"]:
        lost = set(words[2:]) - {"words", *(each.name for each in weights.all_weights())}
        return (1, "", f"no: {lost}") if lost else (0, "", "")
    with pytest.MonkeyPatch.context() as patch:
        if "--text" in words:  # in the place of networks that have to be fetched; tests of words use the same ones
            for name in ("sentences", "keep", "own"):
                patch.setattr(EncoderRegistry, name, getattr(QuickEncoders, name), raising=False)
        with contextlib.closing(ForkedCommand(folder, *words)) as command:
            out, err = command.communicate(timeout=600)
    return command.wait(), out, err


def run(block: Block, folder: Path, number: int, commands: CommandServer | None = None) -> None:
    if block.kind == "files":
        lost = [name for name in re.findall("`([^`]+)`", block.text) if not (folder / name).is_file()]
        assert lost == []
    elif block.kind == "toml":
        tomllib.loads(block.text)
        (folder / block.name).write_text(block.text, encoding="utf-8")
    else:
        script = folder / f"block-{number}"
        script.write_text(block.text, encoding="utf-8")
        said = folder / f"said-{number}"
        with said.open("w") as file:
            if block.kind == "sh":
                command = ["bash", "-euo", "pipefail", script.name]
                process = subprocess.Popen(command, cwd=folder, stdout=file, stderr=file, text=True)
                if commands is not None:
                    commands.serve(process)
                status = process.wait()
            else:
                work = partial(runpy.run_path, script.name, run_name="__main__")
                status = ForkedProcess(work, stdout=file, stderr=file, cwd=folder).wait()
        assert status == 0, f"{block.text}\n{said.read_text()[-3000:]}"


def test_only_what_is_run_or_shown_stands_in_a_block() -> None:
    found = blocks(PAGE.read_text(encoding="utf-8"))
    assert {block.kind for block in found} <= {*RUN, "files", "text"}
    assert sum(block.kind == "files" for block in found) >= 6
    assert all(block.name for block in found if block.kind == "toml")


@pytest.mark.timeout(3600)  # some twenty commands, on a machine that may be busy
@pytest.mark.skipif(shutil.which("bash") is None or shutil.which("make") is None, reason="needs bash and make")
def test_every_step_works_as_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "activate").write_text(f'export PATH="{programs}:$PATH"\n')
    for name in ("examples", "Makefile", "pyproject.toml", "constraints.txt", "tools"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.setenv("MAKEFLAGS", "n")
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")  # as activated in every later block
    with CommandServer() as commands, small_world((480, 640)):
        for name, text in (("frida-painter", COMMAND), ("pip", PIP)):
            (programs / name).write_text(text.format(python=sys.executable, port=commands.port))
            (programs / name).chmod(0o755)
        for number, block in enumerate(blocks(PAGE.read_text(encoding="utf-8"))):
            run(block, tmp_path, number, commands)
