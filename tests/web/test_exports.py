from pathlib import Path

from frida_painter.brush.weights import load_stroke_model
from frida_painter_studio.telling import export
from support.plans import in_layers, made_up_plan


def test_a_plan_is_written_for_plotters_and_machines(tmp_path: Path) -> None:
    plan = in_layers(made_up_plan(6, 2), 4, 2)
    export(plan, {"medium": load_stroke_model("broad")}, tmp_path, drying=45)
    assert (tmp_path / "strokes.svg").read_text().startswith("<?xml")
    program = (tmp_path / "strokes.gcode").read_text()
    assert "M0" in program and "dry for 45 minutes" in program
    assert (tmp_path / "strokes.csv").stat().st_size > 100
