"""What `--help` lists is what there is, and nobody waits for PyTorch to read it."""

import json
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
import typer
from typer.main import get_group

import frida_painter
from frida_painter.cli import commands
from frida_painter.cli.commands import Deferred, all_commands
from frida_painter.lab.text import PROMPTS

ENTRIES = [(("",), entry) for entry in all_commands()] + [(("strokes",), entry) for entry in commands.STROKE_COMMANDS]
IDS = [" ".join((*group, entry.name)).strip() for group, entry in ENTRIES]
HEAVY = ["torch", "numba", "transformers", "cv2", "fastapi", "numpy", "scipy", "PIL"]
HELP = """
import json, sys
from frida_painter.cli import commands as cli
try:
    cli.main()
except SystemExit as end:
    assert not end.code, end.code
print(json.dumps(sorted(sys.modules)))
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
    package = Path(commands.__file__).parent.parent
    files = [path for face in ("cli", "web", "lab", "lab/sweeps") for path in (package / face).glob("*.py")]
    listed = {entry.module for _, entry in ENTRIES}
    assert listed == {
        ".".join(path.relative_to(package.parent).with_suffix("").parts)
        for path in files
        if "\ndef register(app" in path.read_text()
    }


def modules_after(*words: str) -> set[str]:
    """What is loaded in a fresh interpreter after this command."""
    done = subprocess.run(
        [sys.executable, "-c", HELP, *words],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(Path(frida_painter.__file__).parents[1])},
    )
    return set(json.loads(done.stdout.splitlines()[-1]))


def help_pages() -> list[tuple[str, ...]]:
    """Every command, and the groups above them."""
    pages: list[tuple[str, ...]] = [()]
    for entry in all_commands():
        pages.append((entry.name,))
        pages += [(entry.name, name) for name in getattr(entry.load(), "commands", {})]
    return pages


@pytest.mark.slow
@pytest.mark.parametrize("page", help_pages(), ids=" ".join)
def test_help_loads_no_more_than_it_shows(page: tuple[str, ...]) -> None:
    loaded = modules_after(*page, "--help")
    assert not loaded & set(HEAVY)
    assert len(loaded) < 500


def test_a_command_without_arguments_is_not_run_by_its_entry(capsys: pytest.CaptureFixture[str]) -> None:
    """An entry hands its words over: what they lack is said by the command itself."""
    with pytest.raises(SystemExit) as end, pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["frida-painter", "export"])
        commands.main()
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert "PLAN" in said and "`frida-painter export --help`" in said


def test_the_text_experiment_offers_all_its_prompts() -> None:
    from frida_painter.lab.commands import text

    assert text.__defaults__ is not None and len(PROMPTS) in text.__defaults__
