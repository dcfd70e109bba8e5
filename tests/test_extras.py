"""What is missing from an installation is said in one sentence that names the extra which brings it."""

import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from frida_painter import registry
from frida_painter.cli import commands
from frida_painter.env import make_env
from frida_painter.errors import CameraError, ConfigError, FridaError, RobotError, WeightsError
from frida_painter.hardware.cameras.gphoto import GphotoCamera
from frida_painter.hardware.drivers.serial_line import SerialLine
from frida_painter.objectives.encoders.clip import Clip
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.web.web_studio import abilities
from frida_painter.weights import catalogue
from frida_painter.words.libraries import read_picture

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
    assert said == (
        'frida-painter: The studio needs the extra "web", which is not installed; say: pip install "frida-painter[web]"'
    )
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
    with pytest.raises(error, match=rf"frida-painter\[{extra}\]"):
        use(tmp_path)


def test_the_page_says_what_words_need(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "transformers", None)
    told = abilities()
    assert told["image"]["ready"] and not told["text"]["ready"]
    assert 'extra "words"' in str(told["text"]["advice"])


def test_an_extra_is_asked_for_without_being_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "wave", raising=False)
    registry.require("web", "wave", "The studio")
    assert "wave" not in sys.modules
    with pytest.raises(ConfigError, match='The studio needs the extra "web"'):
        registry.require("web", "no_such_package_anywhere", "The studio")


def test_the_extras_that_sentences_name_are_declared() -> None:
    declared = tomllib.loads(PYPROJECT.read_text())["project"]["optional-dependencies"]
    assert {"web", "words", "sketch", "plotter", "gphoto", "ros", "xarm", "mujoco"} <= declared.keys()
