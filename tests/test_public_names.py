"""What `import frida_painter as fp` offers, and what it costs: few names, all of them explained, loaded when used."""

import ast
import doctest
import inspect
import io
import json
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import frida_painter
from support.planning import picture
from support.plans import made_up_plan
from test_house import is_edge

MAX_NAMES = 31
FOLDER = Path(frida_painter.__file__).parent


def modules_after(program: str) -> set[str]:
    """What is loaded in a fresh interpreter after this program."""
    done = subprocess.run(
        [sys.executable, "-c", f"{program}\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(FOLDER.parent)},
    )
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_the_names_are_few_and_each_is_explained() -> None:
    assert 1 <= len(frida_painter.__all__) <= MAX_NAMES
    assert frida_painter.__all__ == sorted(frida_painter.__all__)
    for name in frida_painter.__all__:
        assert (getattr(frida_painter, name).__doc__ or "").strip(), name
    assert set(frida_painter.__all__) <= set(dir(frida_painter))


# These start processes; each of the other examples takes a second or two.
SLOW_EXAMPLES = (
    "Plan",
    "PaintingRun",
    "events",
    "export_plan",
    "make_planner",
    "paint",
    "record",
    "render_plan",
    "sweep",
)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW_EXAMPLES)) for name in frida_painter.__all__]
)
def test_the_example_of_each_name_is_true(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It runs as it stands in the docstring, in a folder that holds a photo.jpg."""
    monkeypatch.chdir(tmp_path)
    frida_painter.save_picture(picture(), "photo.jpg")
    explained = inspect.getdoc(getattr(frida_painter, name)) or ""
    example = doctest.DocTestParser().get_doctest(explained, {"__name__": "__main__"}, name, None, None)
    assert any(f"fp.{name}" in line.source for line in example.examples), "the example is of something else"
    said = io.StringIO()
    assert doctest.DocTestRunner().run(example, out=said.write).failed == 0, said.getvalue()


def test_no_name_is_hidden_by_a_module() -> None:
    """A module of that name would take its place as soon as anybody imports it."""
    modules = {path.stem for path in FOLDER.glob("*.py")} | {path.name for path in FOLDER.iterdir() if path.is_dir()}
    for name in modules & set(frida_painter.__all__):
        assert getattr(frida_painter, name) is import_module(f"frida_painter.{name}")


def test_editors_see_the_same_names_as_python() -> None:
    """The stub for type checkers, from which the names are read, names nothing else."""
    tree = ast.parse(Path(frida_painter.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imported = [alias for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    assert {alias.asname for alias in imported} == set(frida_painter.__all__)


def test_a_name_that_is_not_there_is_answered_with_those_that_are() -> None:
    with pytest.raises(AttributeError, match=r"offers .*Planner"):
        frida_painter.Plannar  # type: ignore[attr-defined]  # noqa: B018


def test_files_are_named_by_texts_as_well_as_by_paths(tmp_path: Path) -> None:
    plan, folder = made_up_plan(), str(tmp_path)
    plan.save(f"{folder}/plan.json")
    plan.palette.save(f"{folder}/palette.json")
    frida_painter.save_picture(picture(), f"{folder}/picture.png")
    assert frida_painter.Plan.load(f"{folder}/plan.json").digest == frida_painter.Plan.load(tmp_path).digest
    assert len(frida_painter.Palette.load(f"{folder}/palette.json")) == len(plan.palette)
    assert frida_painter.load_picture(f"{folder}/picture.png").shape == picture().shape
    studio = frida_painter.open_virtual_studio("12x9cm", "fine", state=f"{folder}/studio.log")
    assert studio.easel.canvas.width == 0.12 and (tmp_path / "studio.log").exists()


def test_the_package_alone_loads_nothing() -> None:
    loaded = modules_after("import frida_painter")
    assert not {name for name in loaded if name.startswith("frida_painter.")}
    assert not loaded & {"torch", "numpy", "typer", "pydantic"}
    assert len(loaded) < 120


def test_a_painting_loads_neither_calibration_procedures_nor_a_simulated_studio() -> None:
    """The studio is the business of the easel's process."""
    loaded = modules_after("from frida_painter_cli import painting; from frida_painter.runs.run import PaintingRun")
    ours = {
        name.removeprefix("frida_painter.") for name in loaded if name.partition(".")[0].startswith("frida_painter")
    }
    assert not {name for name in ours if is_edge(name) and name != "words"}  # which only describes its kind of goal
    assert not {name for name in ours if name.startswith("virtual")}


def test_the_planner_loads_no_network_and_no_rare_format() -> None:
    loaded = modules_after("from frida_painter import Planner")
    assert "torch" in loaded and "frida_painter.planning.planner" in loaded
    assert not loaded & {"h5py", "resvg_py", "transformers", "scipy", "cv2", "numba", "typer", "fastapi"}
    encoders = {name for name in loaded if name.startswith("frida_painter.objectives.encoders.")}
    assert encoders == {"frida_painter.objectives.encoders.base", "frida_painter.objectives.encoders.loading"}
