"""No code is loaded from the current folder: each Python process of ours starts among files named like its imports."""

import importlib.metadata
import io
import os
import re
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

import frida_painter
from frida_painter.errors import ImageError, ProcessLost
from frida_painter.objectives.weights.pipeline_folder import PipelineFolder
from frida_painter.system import python_process
from frida_painter.system.python_process import ProcessLimits
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_words.picture_makers.pipeline_process import PipelineTask
from frida_painter_words.svg_process import draw
from test_house import SOURCES

ROOT = Path(frida_painter.__file__).parent
# A module that leaves a file with its name; it needs only what is built into Python.
POISON = "import posix\nposix.close(posix.open({!r}, posix.O_CREAT | posix.O_WRONLY, 0o600))\n"
OF_PYTHON = {*sys.stdlib_module_names, "sitecustomize", "usercustomize", "frida_painter"}
PARTS = "[frida_painter.robots]\npoison = poison:KIND\n[frida_painter.mixers]\npoison = poison:KIND\n"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A place with two folders of poisoned modules: `all` that Python could import, and installed `packages`.

    The second lacks those that Python itself loads at its start, for path files.
    """
    place = tmp_path_factory.mktemp("poison")
    (place / "marks").mkdir()
    said = subprocess.run([sys.executable, "-P", "-c", "import sys; print(*sys.modules)"], stdout=-1, text=True).stdout
    packages = {*importlib.metadata.packages_distributions(), "poison"} - OF_PYTHON - {*said.split()}
    for folder, names in (("all", packages | OF_PYTHON), ("packages", packages)):
        metadata = place / folder / "poison-1.0.dist-info"
        metadata.mkdir(parents=True)
        (metadata / "METADATA").write_text("Name: poison\nVersion: 1.0\n")
        (metadata / "entry_points.txt").write_text(PARTS)
        for name in filter(str.isidentifier, names):
            (place / folder / f"{name}.py").write_text(POISON.format(str(place / "marks" / name)))
    return place


def loaded(place: Path) -> list[str]:
    """Names of the poisoned modules that were loaded since the last call."""
    marks = [*(place / "marks").iterdir()]
    for mark in marks:
        mark.unlink()
    return [mark.name for mark in marks]


def picture() -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (32, 32)).save(file, "PNG")
    return file.getvalue()


SVG = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"/>'
PIPELINE = PipelineTask(
    PipelineFolder(Path("none"), "none", "None", (), None, 1), steps=1, hashes=None, words="a sea", seeds=(), width=64,
    height=64, device="cpu", canvas=None, free=None, pictures=Path("none"),
)  # fmt: skip
# Functions that are called in processes of their own: arguments, so that each imports what its work needs, and what it
# answers. "FILE" is an open file with a picture, "SOCKET" a socket.
FUNCTIONS: dict[str, tuple[dict[str, Any], str]] = {
    "frida_painter.easel.host:serve_easel": ({"line": "SOCKET", "name": "virtual"}, "error"),
    "frida_painter.system.picture_file:decode_alone": (
        {"path": Path("a.png"), "file": "FILE", "most_pixels": 9999, "longest": 9, "layered": False}, "result"
    ),
    "frida_painter_words.picture_makers.pipeline_process:make_pictures": ({"task": PIPELINE}, "tell"),
    "frida_painter_lab.engine:do_tasks": (
        {"work": "frida_painter_lab.sweeps.runner:perform", "threads": 1, "asked": "SOCKET"}, "tell"
    ),
    "frida_painter_cli.variants:make_variant": ({"name": "loose", "settings": "{}", "folder": Path("FOLDER")}, "error"),
    "frida_painter_studio.reader:decode_upload": ({"content": picture()}, "result"),
    "frida_painter_studio.reader:check_makers": ({"makers": ("command:true", "diffusers:a/b")}, "result"),
    "frida_painter_studio.reader:read_canvas": ({"workspace": Path("none")}, "error"),
    "frida_painter_studio.worker_process:do_job": (
        {"what": "plan", "path": Path("FOLDER"), "number": 1, "lock": "FILE", "easel": WebAppEasel(Path("none"))},
        "result",
    ),
    "frida_painter_words.svg_process:draw": ({"svg": SVG, "name": "a.svg"}, "result"),
}  # fmt: skip
# Arguments of the other programs, and their status.
PROGRAMS = {
    "frida_painter": (("resume", "nowhere", "--page", "nowhere"), 2),
    "frida_painter_studio.stop_listener": (("nowhere", "-1", "-1", "-1", "{}"), 1),
    "huggingface_hub.cli.hf": (("download", "a/b", "-q"), 1),
    "pip": (("download", "--no-index", "nothing-of-this-name"), 1),
}


@pytest.fixture
def among_poison(place: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The place, with the current folder in its worst part."""
    monkeypatch.chdir(place / "all")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(("", str(ROOT.parent), ".")))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    return place


@pytest.mark.parametrize("name", FUNCTIONS)
def test_no_function_in_its_own_process_loads_code_from_the_current_folder(
    name: str, among_poison: Path, tmp_path: Path
) -> None:
    ours, its = socket.socketpair()
    (tmp_path / "a.png").write_bytes(picture())
    with ours, its, (tmp_path / "a.png").open("rb") as file, (tmp_path / "said").open("wb") as said:
        values = {"FILE": file, "SOCKET": its, Path("FOLDER"): tmp_path}
        arguments, answer = FUNCTIONS[name]
        given = {
            key: values.get(value, value) if isinstance(value, str | Path) else value
            for key, value in arguments.items()
        }
        process, wire = python_process.start_function(name, given, stderr=said)
        if "line" in given:
            wire.send({"order": {}})
        assert answer in wire.receive(300)[0], (tmp_path / "said").read_text()
        wire.close()
        ours.close()
        process.wait(60)
    assert loaded(among_poison) == []


@pytest.mark.parametrize("child", PROGRAMS)
def test_no_process_loads_code_from_the_current_folder(child: str, among_poison: Path) -> None:
    arguments, status = PROGRAMS[child]
    process = python_process.start("-m", child, *arguments, stderr=subprocess.PIPE)
    said = process.communicate(timeout=300)[1]
    assert (loaded(among_poison), process.returncode) == ([], status), said.decode()


@pytest.mark.parametrize(("path", "word", "said"), [("", "doctor", "marlin"), (os.pathsep, "--help", "resume")])
def test_the_program_loads_no_code_from_the_current_folder(path: str, word: str, said: str, place: Path) -> None:
    """Python itself loads modules of its own before it asks ours, which can do nothing about that."""
    given = {**os.environ, "PYTHONPATH": path + str(ROOT.parent)}
    program = [sys.executable, "-m", "frida_painter", word]
    done = subprocess.run(program, cwd=place / "packages", env=given, capture_output=True, text=True)
    assert said in done.stdout and "poison" not in done.stdout
    assert (loaded(place), done.returncode) == ([], 0), done.stderr


def test_the_poison_works(place: Path) -> None:
    subprocess.run([sys.executable, "-c", "import filelock"], cwd=place / "packages", check=True)
    assert loaded(place) == ["filelock"]


def test_every_process_of_ours_is_in_the_tables() -> None:
    """The program, the process of a function and the listener for stops are all that Python runs as a module."""
    texts = {".".join(path.relative_to(ROOT.parent).with_suffix("").parts): path.read_text("utf-8") for path in SOURCES}
    run = {name for name, text in texts.items() if re.search("^if __name__ ==", text, re.M)}
    assert run == {
        "frida_painter.__main__",
        "frida_painter.system.python_process",
        "frida_painter_studio.stop_listener",
    }
    marked = {
        f"{name}:{function}"
        for name, text in texts.items()
        for function in re.findall(r"^@in_own_process\([^@]*?\)\ndef (\w+)", text, re.M)
    }
    assert marked == set(FUNCTIONS)


@pytest.mark.parametrize(
    "name",
    ["os:system", "frida_painter.system.storage:write_text", "frida_painter.errors:none", "frida_painter", "a/b:c"],
)
def test_only_marked_functions_of_the_painter_are_called(name: str) -> None:
    with pytest.raises(ProcessLost, match="is no function that is called in a process of its own"):
        python_process.serve(name, -1)


def test_a_process_ends_with_the_one_that_waits_for_its_answer() -> None:
    ours, its = socket.socketpair()
    with ours, its:
        given = {"line": its, "name": "virtual"}
        process, wire = python_process.start_function("frida_painter.easel.host:serve_easel", given, awaited=True)
        wire.close()
        assert process.wait(60) == 1


def test_what_ends_a_process_is_told_and_errors_come_as_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ImageError, match=r"a\.svg cannot be drawn"):
        draw(b"<html/>", "a.svg")
    with pytest.raises(ProcessLost, match=r"^It did not answer within 0.01 s\.$"):
        replace(draw, limits=ProcessLimits(seconds=0.01))(SVG, "a.svg")
    with pytest.raises(ProcessLost, match=r"^KeyError: .no bytes.$"):
        draw("no bytes", "a.svg")  # type: ignore[arg-type]
    with pytest.raises(ProcessLost, match=r"^Its process ended with status 1; it said: ModuleNotFoundError"):
        monkeypatch.setattr(draw.function, "__module__", "frida_painter.nowhere")
        draw(SVG, "a.svg")


def test_the_environment_has_no_folders_relative_to_the_current_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(os, "environ", {**os.environ, "PYTHONINSPECT": "1"})
    for name, value in {
        "PYTHONPATH": f":a:{tmp_path}:.:", "NUMBA_CACHE_DIR": "cache", "PATH": f":/bin:.:{tmp_path}"
    }.items():  # fmt: skip
        monkeypatch.setitem(os.environ, name, value)
    made = python_process.environment(OTHER="kept")
    assert (made["PYTHONPATH"], made["PATH"], made["OTHER"]) == (str(tmp_path), f"/bin:{tmp_path}", "kept")
    assert made["PYTHONSAFEPATH"] and not {"NUMBA_CACHE_DIR", "PYTHONINSPECT"} & made.keys()
    monkeypatch.chdir(ROOT.parent)
    assert python_process.environment()["PYTHONPATH"].split(":")[0] == str(ROOT.parent), "where this package was found"


def test_a_program_of_the_person_may_import_what_lies_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "environ", {"HOME": "/home"})
    monkeypatch.setattr(sys, "path", [*sys.path])
    python_process.isolate()
    assert os.environ["PYTHONSAFEPATH"] and python_process.environment_of_others() == {"HOME": "/home"}
    monkeypatch.setattr(os, "environ", {"PYTHONSAFEPATH": "1"})
    assert python_process.environment_of_others() == {"PYTHONSAFEPATH": "1"}, "as the person wants it"
