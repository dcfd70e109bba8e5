"""What is missing from an installation is said in one sentence, with the command that brings it."""

import re
import shlex
import sys
import tomllib
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from frida_painter import registry
from frida_painter.errors import CameraError, ConfigError, FridaError, RobotError, WeightsError
from frida_painter.objectives.encoders.clip import Clip
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.weights import catalogue
from frida_painter_cli import commands
from frida_painter_drivers.cameras import GphotoCamera
from frida_painter_drivers.serial_line import SerialLine
from frida_painter_lab.env import make_env
from frida_painter_studio.web_studio import abilities
from frida_painter_words.libraries import read_picture

PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"


@pytest.mark.parametrize("package", ["fastapi", "uvicorn"])
def test_the_studio_names_its_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, package: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr(sys, "argv", ["frida-painter", "studio", "--no-browser", "--folder", str(tmp_path / "kept")])
    with pytest.raises(SystemExit) as end:
        commands.main()
    said = " ".join(capsys.readouterr().err.split())
    assert end.value.code == 2
    assert said.startswith('frida-painter: The studio needs the extra "web", which is not installed; say: ')
    assert said.endswith(registry.install_command("web"))
    assert not (tmp_path / "kept").exists(), "nothing is made where the studio cannot open"


@pytest.mark.parametrize(
    ("package", "extra", "error", "use"),
    [
        ("tokenizers", "words", ConfigError, lambda folder: SentenceEncoder.load(folder)),
        ("transformers", "words", ConfigError, lambda folder: Clip.load(folder)),
        ("resvg_py", "words", ConfigError, lambda folder: read_picture(b"<svg/>", "drawing.svg")),
        ("gymnasium", "env", ConfigError, lambda folder: make_env("renderer/strokes-v1")),
        ("h5py", "sketch", WeightsError, lambda folder: catalogue.holistic_edges(folder / "hed.h5")),
        ("serial", "plotter", RobotError, lambda folder: SerialLine.open("/dev/null", 115200)),
        ("gphoto2", "gphoto", CameraError, lambda folder: GphotoCamera().connect()),
    ],
)
def test_what_is_missing_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, package: str, extra: str, error: type[FridaError],
    use: Callable[[Path], object],
) -> None:  # fmt: skip
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(error, match=re.escape(registry.install_command(extra))):
        use(tmp_path)


def test_the_page_says_what_words_need(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "transformers", None)
    told = abilities()
    assert told["image"]["ready"] and not told["text"]["ready"]
    assert 'extra "words"' in str(told["text"]["advice"])


def test_a_package_that_this_system_has_not_is_told_with_the_systems_that_have_it(
    installation: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    declared = tomllib.loads(PYPROJECT.read_text())["project"]["optional-dependencies"]
    lines = [
        f"{one.name}; extra == '{extra}'" + (f" and {one.marker}" if one.marker else "")
        for extra in ("franka", "gphoto", "so101")
        for one in map(Requirement, declared[extra])
    ]
    told, wanted = {}, registry._wanted
    for system in registry.SYSTEMS.values():
        monkeypatch.setattr(registry, "_wanted", lambda extra, other, here=system: wanted(extra, other or here))
        installation(declared=lines)
        told[system["platform_machine"]] = [registry.advice(extra, "It") for extra in ("franka", "gphoto", "so101")]
    only = "franky-control exists for Linux on Intel and AMD alone"
    assert [only in franka for franka, _, _ in told.values()] == [True, True, True, False]
    assert ["gphoto2 exists for macOS, Linux" in gphoto for _, gphoto, _ in told.values()] == [
        True,
        False,
        False,
        False,
    ]
    assert "install franky-control" in told["x86_64"][0] and all(
        "install feetech" in so101 for _, _, so101 in told.values()
    )


def test_an_extra_is_asked_for_without_being_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "wave", raising=False)
    registry.require("web", "wave", "The studio")
    assert "wave" not in sys.modules
    with pytest.raises(ConfigError, match='The studio needs the extra "web"'):
        registry.require("web", "no_such_package_anywhere", "The studio")


REQUIRES = [
    "numpy>=2.0", "pytest>=1; extra == 'web'", "absent<2,>=1.5; extra == 'web'", "hypothesis>=9999; extra == 'web'",
    "of_plan_9; platform_system == 'Plan 9' and extra == 'web'", "always; python_version > '3'", "a; extra == 'words'",
]  # fmt: skip


@pytest.fixture
def installation(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """An installation of this project, which returns its command for an extra as a shell reads it."""

    def command(extra: str = "web", pip: bool = True, uv: bool = True, declared: object = REQUIRES) -> list[str]:
        def requires(name: str) -> list[str]:
            if declared is None:
                raise PackageNotFoundError(name)
            return list(declared)

        monkeypatch.setattr(registry, "requires", requires)
        monkeypatch.setattr(registry, "find_spec", lambda name: pip or None)
        monkeypatch.setattr(registry.shutil, "which", lambda name: f"/bin/{name}" if uv else None)
        return shlex.split(registry.install_command(extra))

    return command


def test_the_command_brings_what_this_installation_lacks(
    installation: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", "/home/an artist/bin/python")
    monkeypatch.setattr(sys, "prefix", "/home/an artist")
    pip = ["/home/an artist/bin/python", "-m", "pip", "install"]
    assert installation() == [*pip, "absent<2,>=1.5", "hypothesis>=9999"]
    assert installation(pip=False)[:5] == ["uv", "pip", "install", "--python", sys.executable]
    assert installation(pip=False, uv=False)[:8] == [sys.executable, "-m", "ensurepip", "&&", *pip]
    assert installation(declared=["pytest>=1; extra == 'web'"]) == [*pip, "pytest>=1"], "it is here, but broken"
    for declared in (None, []):
        assert installation(declared=declared) == [*pip, f"{PYPROJECT.parent}[web]"]


def test_a_python_of_the_system_is_told_that_a_person_decides(
    installation: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(registry.sysconfig, "get_path", lambda name: str(tmp_path))
    monkeypatch.setattr(sys, "prefix", sys.base_prefix)
    assert "--break-system-packages" not in installation()
    (tmp_path / "EXTERNALLY-MANAGED").touch()
    assert "--break-system-packages" in installation()


def test_every_extra_that_the_sources_name_is_declared() -> None:
    declared = tomllib.loads(PYPROJECT.read_text())["project"]["optional-dependencies"]
    for path in (PYPROJECT.parent / "src").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        called = r"registry\.(?:importing|require|advice)\(|install_command\(|Needed\(.*extra="
        assert {*re.findall(rf'(?:{called})"(\w+)"', text)} <= declared.keys(), path


@pytest.mark.parametrize("place", ["README.md", "docs", "src", "examples", "deploy", "tools", "benchmarks"])
def test_nobody_is_told_to_install_from_an_index(place: str) -> None:
    """The project is on none; a command that asks one for it would install nothing, or what somebody else put there."""
    root = PYPROJECT.parent / place
    for path in [root] if root.is_file() else root.rglob("*"):
        if path.is_file() and path.stat().st_size < 2**20:  # no pictures and no weights
            text = path.read_text(encoding="utf-8", errors="replace")
            assert not re.search(r"frida-painter\[|pip install [^.\n]*\bfrida-painter\b", text), path
