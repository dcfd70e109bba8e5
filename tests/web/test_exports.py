from pathlib import Path

from frida_painter.brush.weights import load_stroke_model
from frida_painter.web.exports import export
from plans import made_up_plan


def test_a_plan_is_written_for_plotters_and_machines(tmp_path: Path) -> None:
    export(made_up_plan(6, 2), {"medium": load_stroke_model("broad")}, tmp_path)
    assert (tmp_path / "strokes.svg").read_text().startswith("<?xml")
    assert "M0" in (tmp_path / "strokes.gcode").read_text()
    assert (tmp_path / "strokes.csv").stat().st_size > 100
