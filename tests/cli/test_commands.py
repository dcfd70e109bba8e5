"""What `--help` lists is what there is, and nobody waits for PyTorch to read it."""

import json
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
import typer
from typer.main import get_group

import frida_painter
from frida_painter_cli import commands
from frida_painter_cli.commands import Deferred, all_commands
from test_house import ROOT, SOURCES

ENTRIES = [(("",), entry) for entry in all_commands()] + [(("strokes",), entry) for entry in commands.STROKE_COMMANDS]
IDS = [" ".join((*group, entry.name)).strip() for group, entry in ENTRIES]
HEAVY = ["torch", "numba", "transformers", "cv2", "fastapi", "numpy", "scipy", "PIL"]
HELP = """
import json, os, sys
from frida_painter_cli import commands  # as every page does

def run(words):
    # In a copy of this interpreter, which has loaded nothing else: the names of the modules that are there at the end.
    ours, theirs = os.pipe()
    if os.fork() == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.argv[1:] = words
        try:
            commands.main()
        except SystemExit as end:
            assert not end.code, end.code
        with open(theirs, "w") as told:
            json.dump(sorted(sys.modules), told)
        os._exit(0)
    os.close(theirs)
    with open(ours) as told:
        loaded = json.load(told)
    assert os.wait()[1] == 0
    return loaded

print(json.dumps([run(words) for words in json.loads(sys.argv[1])]))
"""


def first_paragraph(text: str) -> str:
    return " ".join(text.split("\n\n")[0].split())


@pytest.mark.parametrize("entry", [entry for _, entry in ENTRIES], ids=IDS)
def test_the_list_says_of_a_command_what_the_command_says_of_itself(entry: Deferred) -> None:
    assert first_paragraph(entry.load().help) == entry.help


def test_every_command_of_a_module_is_listed() -> None:
    for entries in (all_commands(), commands.STROKE_COMMANDS):
        for module in {entry.module for entry in entries}:
            app = typer.Typer(callback=lambda: None)
            import_module(module).register(app)
            listed = [entry.name for entry in entries if entry.module == module]
            assert sorted(get_group(app).commands) == sorted(listed)


def test_every_module_with_commands_is_listed() -> None:
    listed = {entry.module for _, entry in ENTRIES}
    assert listed == {
        ".".join(path.relative_to(ROOT.parent).with_suffix("").parts)
        for path in SOURCES
        if "\ndef register(app" in path.read_text()
    }


def help_pages() -> list[tuple[str, ...]]:
    """Every command, and the groups above them."""
    pages: list[tuple[str, ...]] = [()]
    for entry in all_commands():
        pages.append((entry.name,))
        pages += [(entry.name, name) for name in getattr(entry.load(), "commands", {})]
    return pages


def test_help_loads_no_more_than_it_shows() -> None:
    pages = [(*page, "--help") for page in help_pages()]
    done = subprocess.run(
        [sys.executable, "-c", HELP, json.dumps(pages)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(Path(frida_painter.__file__).parents[1])},
    )
    for page, loaded in zip(pages, json.loads(done.stdout), strict=True):
        assert not set(loaded) & set(HEAVY), page
        assert 100 < len(loaded) < 500, page


def test_the_help_of_a_painting_is_one_screen_and_help_all_tells_every_option(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for name in ("paint", "plan"):
        command = next(entry for entry in all_commands() if entry.name == name).load()
        flags = [param.opts[0] for param in command.params if param.param_type_name == "option"]
        for word in ("--help", "--help-all"):
            monkeypatch.setattr("sys.argv", ["frida-painter", name, word])
            with pytest.raises(SystemExit) as end:
                commands.main()
            said = capsys.readouterr().out
            assert not end.value.code and max(map(len, said.splitlines())) <= 80
            listed = re.findall(r"^  (--[a-z-]+)", said, re.MULTILINE)
            if word == "--help":
                assert len(said.splitlines()) <= 45 and 10 <= len(listed) <= 15 and set(listed) < set(flags)
            else:
                assert set(flags) - {"--help"} <= set(listed)


def test_a_command_without_arguments_is_not_run_by_its_entry(capsys: pytest.CaptureFixture[str]) -> None:
    """An entry hands its words over: what they lack is said by the command itself."""
    with pytest.raises(SystemExit) as end, pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["frida-painter", "export"])
        commands.main()
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert "PLAN" in said and "`frida-painter export --help`" in said
