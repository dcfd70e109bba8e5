"""The service and the container start a studio that exists: every option that they give is one of the command."""

import configparser
import json
import re
import shlex
from pathlib import Path

import pytest
import typer
from typer.main import get_group

from frida_painter_cli.commands import nothing_first
from frida_painter_studio import studio_command

DEPLOY = Path(__file__).parents[2] / "deploy"


@pytest.fixture
def options() -> set[str]:
    app = typer.Typer(callback=nothing_first)
    studio_command.register(app)
    command = get_group(app).commands["studio"]
    return {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}


def given(words: list[str]) -> set[str]:
    return {word for word in words if word.startswith("--")}


def test_the_service_starts_a_studio_that_can_write_where_it_may(options: set[str]) -> None:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read_string((DEPLOY / "frida-painter.service").read_text())
    service = unit["Service"]
    program, command, *words = shlex.split(service["ExecStart"])
    assert (Path(program).name, command) == ("frida-painter", "studio")
    (chosen,) = re.findall(r"^STUDIO=(.*)$", (DEPLOY / "frida-painter.env").read_text(), re.M)
    asked = given(words) | given(shlex.split(chosen))
    assert asked <= options and {"--no-browser", "--certificate", "--key"} <= asked
    state = f"/var/lib/{service['StateDirectory']}"
    assert service["WorkingDirectory"] == state and service["Environment"] == f"HOME={state}"
    assert words[words.index("--folder") + 1].startswith(state), "all else is read-only (ProtectSystem)"
    assert service["StandardInput"] == "tty", "a real robot moves only after Enter beside it"


def test_the_container_starts_a_studio(options: set[str]) -> None:
    text = (DEPLOY / "Containerfile").read_text()
    command = json.loads(re.search(r"^CMD (\[.*\])$", text, re.M)[1])  # type: ignore[index]
    assert command[0] == "studio" and given(command) <= options
    for file in re.search(r"^COPY (.*) \./$", text, re.M)[1].split():  # type: ignore[index]
        assert (DEPLOY.parent / file).is_file(), "what the image copies is there"
