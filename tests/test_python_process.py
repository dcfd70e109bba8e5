"""No code is loaded from the current folder: each Python process of ours starts among files named like its imports."""

import importlib.metadata
import io
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

import frida_painter
from frida_painter import python_process
from frida_painter_words import svg_process
from test_house import SOURCES

ROOT = Path(frida_painter.__file__).parent
# A module that leaves a file with its name; it needs only what is built into Python.
POISON = "import posix\nposix.close(posix.open({!r}, posix.O_CREAT | posix.O_WRONLY, 0o600))\n"
OF_PYTHON = {*sys.stdlib_module_names, "sitecustomize", "usercustomize", "frida_painter"}
PARTS = "[frida_painter.robots]\npoison = poison:KIND\n[frida_painter.mixers]\npoison = poison:KIND\n"
ONE_TASK = """
from frida_painter_lab.engine import Engine, TaskLimits
if __name__ == "__main__":
    print(*(ended.value for ended in Engine(TaskLimits(), 1).run(len, ["abc"])))
"""


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


# Arguments, input and status of each process, so that it imports what its work needs. The input None stays open.
CHILDREN = {
    "frida_painter.easel.host": (("SOCKET", "SOCKET", "virtual"), None, 0),
    "frida_painter.picture_file": (("a.png", "9999", "9", "3"), picture(), 0),
    "frida_painter_words.picture_makers.pipeline_process": ((".",), None, 1),
    "frida_painter_studio.reader": (("picture",), picture(), 0),
    "frida_painter_studio.reader makers": (("command:true", "diffusers:a/b"), None, 0),
    "frida_painter_studio.stop_listener": (("nowhere", "-1", "-1", "-1", "{}"), None, 1),
    "frida_painter_studio.worker_process": (("plan", "FOLDER", "1", "-1", "{}"), None, 1),
    "huggingface_hub.cli.hf": (("download", "a/b", "-q"), None, 1),
    "pip": (("download", "--no-index", "nothing-of-this-name"), None, 1),
    svg_process.__file__: ((), b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"/>', 0),
}


@pytest.mark.parametrize("child", CHILDREN)
def test_no_process_loads_code_from_the_current_folder(
    child: str, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place / "all")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(("", str(ROOT.parent), ".")))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    arguments, given, status = CHILDREN[child]
    reading, writing = os.pipe()  # stays open
    ours, its = socket.socketpair()
    ours.close()
    (tmp_path / "input").write_bytes(given or b"")
    values = {"SOCKET": its.fileno(), "FOLDER": tmp_path}
    program = [*child.split(" "), *(values.get(word, word) for word in arguments)]
    with its, (tmp_path / "input").open("rb") as file:
        done = python_process.run(
            *(program if Path(child).is_absolute() else ["-m", *program]),
            stdin=reading if given is None else file, pass_fds=[its.fileno()], timeout=300,
        )  # fmt: skip
    os.close(reading)
    os.close(writing)
    assert (loaded(place), done.returncode) == ([], status), done.stderr.decode()


def test_no_process_of_a_sweep_loads_code_from_the_current_folder(place: Path, tmp_path: Path) -> None:
    script = tmp_path / "own" / "sweep.py"
    script.parent.mkdir()
    script.write_text(ONE_TASK)
    given = {**os.environ, "PYTHONPATH": str(ROOT.parent)}
    done = subprocess.run([sys.executable, script], cwd=place / "all", env=given, capture_output=True, text=True)
    assert (loaded(place), done.stdout) == ([], "3\n"), done.stderr


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


def test_every_process_of_ours_is_in_the_table() -> None:
    """A module that does something when it is run is one."""
    run = {path for path in SOURCES if re.search("^if __name__ ==", path.read_text(encoding="utf-8"), re.M)}
    run.remove(ROOT / "__main__.py")
    modules = {".".join(path.relative_to(ROOT.parent).with_suffix("").parts): path for path in run}
    assert {modules.get(child.partition(" ")[0], Path(child)) for child in CHILDREN} == run | {
        Path("pip"),
        Path("huggingface_hub.cli.hf"),
    }


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
