"""The examples work as they stand, in tiny sizes, and use nothing but public names."""

import ast
import json
import os
import re
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
import torch

import frida_painter as fp

EXAMPLES = Path(__file__).parents[2] / "examples"
PHOTO = str(EXAMPLES / "photographs" / "cat.jpg")
SCRIPTS = (
    "compare_seeds",
    "own_objective",
    "own_paints",
    "own_stroke_model",
    "paint_photograph",
    "plan_photograph",
    "poster",
    "watch_painting",
)
TINY = {"strokes": 6, "render_height": 64, "effort": 0.05}
MAX_LINES = 15


pytestmark = pytest.mark.usefixtures("small_world")


def script(name: str) -> Callable[..., None]:
    """The function that the example of this name runs with its arguments."""
    main: Callable[..., None] = runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]
    return main


def code_cells() -> list[dict[str, Any]]:
    notebook = json.loads((EXAMPLES / "first_painting.ipynb").read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def foreign(source: str) -> set[str]:
    """The project's modules that are imported, other than the package itself, and names that it does not offer."""
    tree = ast.parse(source)
    found = {
        node.module or ""
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("frida_painter")
    }
    attributes = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "fp"
    }
    return found | (attributes - set(fp.__all__))


@pytest.mark.parametrize("name", SCRIPTS)
def test_scripts_are_short_and_use_public_names_only(name: str) -> None:
    source = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    tree = ast.parse(source)
    explained = set(range(tree.body[0].lineno, (tree.body[0].end_lineno or 0) + 1))
    imports = {node.lineno for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)}
    lines = [
        line
        for number, line in enumerate(source.splitlines(), 1)
        if line.strip() and not line.strip().startswith("#") and number not in explained | imports
    ]
    assert len(lines) <= MAX_LINES
    assert not foreign(source)


def test_a_photograph_is_planned_and_printed_large(tmp_path: Path) -> None:
    script("plan_photograph")(PHOTO, str(tmp_path), **TINY)
    assert len(fp.Plan.load(tmp_path / "plan.json")) == 6
    assert tuple(fp.load_picture(tmp_path / "plan.png").shape)[:2] == (3, 64)
    script("poster")(str(tmp_path / "plan.json"), str(tmp_path / "poster.jpg"), "200")
    assert tuple(fp.load_picture(tmp_path / "poster.jpg").shape)[:2] == (3, 200)


def test_ones_own_paints_are_the_only_ones(tmp_path: Path) -> None:
    paints, plan = tmp_path / "paints.json", tmp_path / "plan.json"
    paints.write_text('{"paints": ["#f2e9dc", "#b97f2c", "#3b2f2a"]}')
    script("own_paints")(PHOTO, str(paints), str(plan), **TINY)
    assert torch.equal(fp.Plan.load(plan).palette.color, fp.Palette.load(paints).color)


def test_two_seeds_give_two_plans(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script("compare_seeds")(PHOTO, str(tmp_path / "both.png"), **TINY)
    first, second = fp.load_picture(tmp_path / "both.png").chunk(2, dim=2)
    assert not torch.equal(first, second)
    assert "The first is 0." in capsys.readouterr().out


def test_a_stroke_model_of_ones_own_draws_the_plan(tmp_path: Path) -> None:
    script("own_stroke_model")(PHOTO, str(tmp_path / "pen.png"), **TINY)
    script("plan_photograph")(PHOTO, str(tmp_path), **TINY)
    drawn, painted = (fp.load_picture(tmp_path / name) for name in ("pen.png", "plan.png"))
    assert float(drawn.min()) < 0.9 and not torch.equal(drawn, painted)


def test_a_photograph_is_painted_in_the_virtual_studio(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "painting"
    script("paint_photograph")(PHOTO, str(folder), strokes=4, replans=1, render_height=64, effort=0.05)
    assert {"index.html", "painting.png", "plan.json"} <= {path.name for path in folder.iterdir()}
    assert "4 strokes: " in capsys.readouterr().out


def test_a_listener_is_told_of_every_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = {"strokes": 4, "replans": 1, "render_height": 64, "effort": 0.05}
    script("watch_painting")(PHOTO, str(tmp_path / "painting"), str(tmp_path), **settings)
    half, whole = (fp.load_picture(tmp_path / f"after-{done}.png") for done in (2, 4))
    assert whole.mean() < half.mean()
    assert capsys.readouterr().out.count("strokes are on the canvas") == 2


def test_a_viewer_of_forty_lines_shows_a_painting_from_its_folder_alone(tmp_path: Path) -> None:
    viewer, folder = EXAMPLES / "viewer.py", tmp_path / "painting"
    source = viewer.read_text(encoding="utf-8")
    imported = re.findall(r"^(?:import|from) (\w+)", source, re.MULTILINE)
    assert source.count("\n") <= 40 and set(imported) <= sys.stdlib_module_names
    spec = fp.RunSpec.of(goal=[{"image": PHOTO}], strokes=4, replans=1, render_height=64, effort=0.05)
    seen: list[tuple[str, bytes]] = []

    def look(event: object) -> None:
        if isinstance(event, fp.events.StrokePainted | fp.events.Finished):
            page, picture = (urlopen(f"{address}/{name}").read() for name in ("", "picture"))
            seen.append((page.decode(), picture))

    with fp.PaintingRun(spec, folder, listeners=[look]) as run:
        command = [sys.executable, "-I", str(viewer), str(folder), "0"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            assert process.stdout is not None
            address = process.stdout.readline().strip()
            run.start()
        finally:
            process.kill()
            process.communicate()
    shown = [int(page.partition(" of 4 strokes")[0].rpartition(">")[2]) for page, _ in seen]
    assert shown == sorted(shown) and {0, 4} & set(shown) == {4} and "last: finish" in seen[-1][0]
    assert seen[-1][1][:3] == b"\xff\xd8\xff" and seen[-1][1] != seen[1][1], "the newest picture, a JPEG"


def test_an_objective_of_ones_own_shapes_the_plan(tmp_path: Path) -> None:
    def unrest(weight: float) -> float:
        script("own_objective")(
            PHOTO, str(tmp_path / "calm.png"), strokes=20, weight=weight, render_height=64, effort=0.1
        )
        picture = fp.load_picture(tmp_path / "calm.png")
        return float(picture.diff(dim=1).abs().mean() + picture.diff(dim=2).abs().mean())

    assert unrest(2.0) < 0.8 * unrest(0.001)


def test_the_notebook_runs_from_top_to_bottom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cells = code_cells()
    sources = ["".join(cell["source"]) for cell in cells]
    assert cells[0]["metadata"]["tags"] == ["parameters"]
    sources[0] = f"photo, strokes, rows, effort = {PHOTO!r}, 6, 64, 0.05"
    assert not any(foreign(source) for source in sources)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cells.py").write_text("\n".join(sources))
    runpy.run_path(str(tmp_path / "cells.py"))
    assert {"plan.png", "plan.json", "poster.jpg", "other.png"} <= set(os.listdir(tmp_path))  # noqa: PTH208
    said = capsys.readouterr().out
    assert "6 strokes" in said and "other plan: 0." in said


def test_the_notebook_is_kept_without_results() -> None:
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code_cells())


def test_a_sheet_of_strokes_is_painted_in_the_virtual_studio(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["virtual_strokes.py", str(tmp_path / "sheet.jpg")])
    runpy.run_path(str(EXAMPLES / "virtual_strokes.py"), run_name="__main__")
    assert float(fp.load_picture(tmp_path / "sheet.jpg").std()) > 0.05
