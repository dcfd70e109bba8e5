"""The benchmarks still run, and the comparator of the planner's iteration still draws what the renderer draws."""

from pathlib import Path

import pytest
import torch

from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.planning.initialize import uniform
from frida_painter.render import render
from frida_painter_lab.experiment import Outcome, ResultTable
from support.programs import load_program

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return lambda name: load_program(BENCHMARKS / f"{name}.py")


def test_the_comparator_paints_what_the_renderer_paints(program):
    size, network = CanvasSize(0.3556, 0.2794), load_stroke_model("broad")
    strokes = uniform(12, network.limits, size, torch.Generator().manual_seed(0))
    canvas = torch.ones(3, 256, 326)
    with torch.no_grad():
        theirs = program("original").OriginalPlan(strokes, network)(canvas, size)
        ours = render(strokes, network, canvas, size)
    assert (ours - canvas).abs().mean() > 0.02
    # The comparator places padded maps to the nearest pixel, and samples them twice.
    assert (theirs - ours).abs().mean() < 0.002


@pytest.mark.parametrize("name", ["render", "iteration"])
def test_a_quick_run_writes_its_section_and_leaves_the_others(name, program, tmp_path, in_small_world, capsys):
    report = program("report")
    path = tmp_path / "page.md"
    path.write_text("# Old\n\n## On a GPU\n\nMeasured elsewhere.\n")
    report.main([name, "--quick", "--page", str(path)])
    sections = report.known_sections(path.read_text())
    kinds = {key: report.find_benchmark(key) for key in report.PLACES}
    assert list(sections) == [kind.TITLE for kind in kinds.values()]
    mine = sections[kinds[name].TITLE]
    assert "Measured on 2" in mine and "| ---" in mine and report.MISSING not in mine
    assert "Measured elsewhere." in sections["On a GPU"] and report.MISSING in sections["Whole plans"]
    assert "**" in capsys.readouterr().out


def test_the_page_in_the_docs_is_what_the_command_writes(program):
    report = program("report")
    page = report.PAGE.read_text(encoding="utf-8")
    assert page.startswith(report.OPENING)
    assert [kind.TITLE for kind in map(report.find_benchmark, report.PLACES)] == list(report.known_sections(page))
    for kind in map(report.find_benchmark, report.PLACES):
        assert report.head_of(kind) in page
        assert kind.NAME in report.PLACES
    made = report.section_of(kind, Outcome("x", "X", {}, [ResultTable("T", [{"a": 1}])]))
    assert report.known_sections(made)[kind.TITLE] == made


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU here")
def test_without_a_gpu_its_benchmark_says_what_to_do(program):
    with pytest.raises(SystemExit, match=r"^There is no CUDA device here.*BENCHMARK_DEVICE=cpu"):
        program("gpu").Gpu(quick=True).run()
