"""`make` installs from where pip is told to, whether uv does it or pip."""

import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from support.programs import load_program

ROOT = Path(__file__).parents[2]
UV = "/somewhere/uv"


@pytest.fixture
def install() -> ModuleType:
    return load_program(ROOT / "tools" / "install.py")


class Commands:
    """Stands in for subprocess.run: notes each command, lists pip's configuration, and has uv succeed or fail."""

    def __init__(self, configuration: str, uv_status: int = 0) -> None:
        self.configuration, self.uv_status = configuration, uv_status
        self.installs: list[list[str]] = []
        self.environments: list[dict[str, str]] = []

    def __call__(self, command: list[str], *, check: bool, env: dict[str, str] | None = None, **_: object) -> object:
        if command[-2:] == ["config", "list"]:
            return SimpleNamespace(stdout=self.configuration)
        self.installs.append(command)
        self.environments.append(env or {})
        return SimpleNamespace(returncode=self.uv_status if command[0] == UV else 0)


def installed(
    install: ModuleType, monkeypatch: pytest.MonkeyPatch, commands: Commands, uv: str | None = UV
) -> list[list[str]]:
    monkeypatch.setattr(install.shutil, "which", lambda name: uv)
    monkeypatch.setattr(install.subprocess, "run", commands)
    install.install(".[dev]", Path("constraints.txt"))
    return commands.installs


def test_uv_asks_the_indexes_that_pip_would(install: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    commands = Commands(
        "global.index-url='https://packages.example/simple'\n"
        "global.extra-index-url='https://a.example/simple\\nhttps://b.example/simple'\n"
        "global.find-links='/somewhere/wheels'\n"
        "install.trusted-host='packages.example'\n"
        ":env:.cert='/somewhere/ca.crt'\n"
        ":env:.default-timeout='180'\n"
        ":env:.disable-pip-version-check='1'\n"
    )
    (command,) = installed(install, monkeypatch, commands)
    assert command[:3] == [UV, "pip", "install"] and command[command.index("--python") + 1] == sys.executable
    assert command[command.index("--default-index") + 1] == "https://packages.example/simple"
    extra = [command[at + 1] for at, word in enumerate(command) if word == "--index"]
    assert extra == ["https://a.example/simple", "https://b.example/simple"]
    assert command[command.index("--find-links") + 1] == "/somewhere/wheels"
    assert command[command.index("--allow-insecure-host") + 1] == "packages.example"
    assert command[command.index("--constraint") + 1] == "constraints.txt" and command[-1] == ".[dev]"
    assert commands.environments[0]["SSL_CERT_FILE"] == "/somewhere/ca.crt"
    assert commands.environments[0]["UV_HTTP_TIMEOUT"] == "180"


def test_what_the_environment_says_goes_before_the_files(install: ModuleType) -> None:
    settings = install.pip_settings(
        ":env:.index-url='https://environment.example'\nglobal.index-url='https://file.example'\n"
        "install.index-url='https://command.example'\ndownload.no-binary=':all:'\n"
    )
    assert settings == {"index-url": "https://environment.example"}


@pytest.mark.parametrize("setting", ["global.proxy='http://proxy.example'", "install.only-binary=':all:'"])
def test_pip_installs_where_uv_would_not_see_a_setting(
    install: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], setting: str
) -> None:
    (command,) = installed(install, monkeypatch, Commands(setting + "\n"))
    assert command[:3] == [sys.executable, "-m", "pip"] and "settings that uv does not know" in capsys.readouterr().out


def test_pip_installs_where_there_is_no_uv_or_it_fails(install: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    (alone,) = installed(install, monkeypatch, Commands(""), uv=None)
    assert alone[:3] == [sys.executable, "-m", "pip"] and alone[-1] == ".[dev]"
    first, second = installed(install, monkeypatch, Commands("", uv_status=2))
    assert first[0] == UV and second == alone


@pytest.mark.slow
def test_pip_really_lists_what_is_read_here(
    install: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "pip.conf").write_text("[global]\nextra-index-url =\n    https://a.example\n    https://b.example\n")
    monkeypatch.setenv("PIP_CONFIG_FILE", str(tmp_path / "pip.conf"))
    monkeypatch.setenv("PIP_INDEX_URL", "https://environment.example")
    monkeypatch.delenv("PIP_EXTRA_INDEX_URL", raising=False)
    listed = subprocess.run([sys.executable, "-m", "pip", "config", "list"], capture_output=True, text=True, check=True)
    settings = install.pip_settings(listed.stdout)
    assert settings["index-url"] == "https://environment.example"
    assert settings["extra-index-url"].split() == ["https://a.example", "https://b.example"]


def test_a_first_painting_installs_no_extra_and_each_step_says_what_it_does() -> None:
    said = subprocess.run(
        ["make", "--dry-run", "VENV=.no-such-environment", "paint"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    steps = [line for line in said.splitlines() if "install.py" in line]
    assert len(steps) == 1 and steps[0].endswith(" ."), "one installation, of the package without extras"
    assert [line.split(maxsplit=2)[1].strip('"') for line in said.splitlines() if line.startswith("echo")] == [
        "Making",
        "Installing",
        "Painting",
    ]
