"""`make` installs from where pip is told to, whether uv does it or pip."""

import hashlib
import os
import subprocess
import sys
import zipfile
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
        return SimpleNamespace(returncode=self.uv_status if command[0] == UV else 0, stderr="")


def installed(
    install: ModuleType, monkeypatch: pytest.MonkeyPatch, commands: Commands, uv: str | None = UV
) -> list[list[str]]:
    monkeypatch.setattr(install.shutil, "which", lambda name: uv)
    monkeypatch.setattr(install.subprocess, "run", commands)
    install.find_uv.cache_clear()
    install.run(["--editable", "."])
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
    assert command[-2:] == ["--editable", "."]
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
    assert alone[:3] == [sys.executable, "-m", "pip"] and alone[-1] == "."
    first, second = installed(install, monkeypatch, Commands("", uv_status=2))
    assert first[0] == UV and second == alone


def _packages(folder: Path, *, spoilt: str = "") -> Path:
    """A folder of wheels, in which `above` needs `below` and for its extra `more`; and their lock beside it."""
    lock = []
    for name, needs in (
        ("above", 'Requires-Dist: below\nRequires-Dist: more; extra == "most"\n'),
        ("below", ""),
        ("more", ""),
    ):
        wheel = folder / f"{name}-1.0-py3-none-any.whl"
        with zipfile.ZipFile(wheel, "w") as archive:
            told = f"{name}-1.0.dist-info"
            archive.writestr(f"{told}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n{needs}")
            archive.writestr(f"{told}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
            archive.writestr(f"{told}/RECORD", "")
        digest = hashlib.sha256(wheel.read_bytes() + spoilt.encode() * (name == spoilt)).hexdigest()
        lock.append(f"{name}==1.0 \\\n    --hash=sha256:{64 * '0'} \\\n    --hash=sha256:{digest}")
    (folder / "lock.txt").write_text("\n".join(lock) + "\n")
    return folder / "lock.txt"


def _install(place: Path, *words: str, **how: str) -> subprocess.CompletedProcess[str]:
    """Outcome of the program that installs from the wheels in `place` alone."""
    where = {**os.environ, "PIP_CONFIG_FILE": os.devnull, "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(place), **how}
    program = (
        f"import sys; sys.path.insert(0, {str(ROOT / 'tools')!r}); import install; install.FOR_BUILDING = (); "
        "install.shutil.which = lambda name: None; sys.exit(install.main())"
    )
    command = [sys.executable, "-c", program, *words, "--lock", str(place / "lock.txt")]
    return subprocess.run(
        command,
        env={**where, "PIP_TARGET": str(place / "there"), "PYTHONPATH": str(place / "there")},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("asked", "there"), [("above", {"above", "below"}), ("above[most]", {"above", "below", "more"})]
)
def test_a_package_comes_with_what_it_needs_if_each_file_is_that_of_the_lock(
    tmp_path: Path, asked: str, there: set[str]
) -> None:
    _packages(tmp_path)
    done = _install(tmp_path, asked)
    assert done.returncode == 0, done.stderr
    assert {path.name.partition("-")[0] for path in (tmp_path / "there").glob("*.dist-info")} == there


@pytest.mark.parametrize("spoilt", ["above", "below"])
def test_a_file_that_is_not_that_of_the_lock_is_refused_with_one_sentence(tmp_path: Path, spoilt: str) -> None:
    _packages(tmp_path, spoilt=spoilt)
    done = _install(tmp_path, "above")
    assert done.returncode == 1 and len(done.stderr.strip().splitlines()) == 1
    assert f" {spoilt} is none of those" in done.stderr and "HASHES=no" in done.stderr
    assert not list((tmp_path / "there").glob(f"{spoilt}-*")), "nothing of it is installed"
    assert _install(tmp_path, "above", "--without-hashes").returncode == 0


def test_what_the_lock_does_not_name_is_not_installed(tmp_path: Path) -> None:
    lock = _packages(tmp_path)
    lock.write_text(lock.read_text().replace("below", "beneath"))
    done = _install(tmp_path, "above")
    assert done.returncode == 1 and "below is needed" in done.stderr and len(done.stderr.strip().splitlines()) == 1


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
        "Painting",  # a tiny picture, for which loops are compiled
        "Painting",
    ]
