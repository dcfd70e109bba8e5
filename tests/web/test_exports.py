from pathlib import Path

from frida_painter.web.exports import export
from plans import made_up_plan
from scenes import small_table


def test_a_plan_is_written_for_plotters_and_machines(tmp_path: Path) -> None:
    export(made_up_plan(6, 2), small_table(), tmp_path)
    assert (tmp_path / "strokes.svg").read_text().startswith("<?xml")
    assert "M0" in (tmp_path / "strokes.gcode").read_text()
    assert (tmp_path / "strokes.csv").stat().st_size > 100
