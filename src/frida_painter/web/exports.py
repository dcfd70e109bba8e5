"""What other programs and machines take of a plan: its strokes as SVG, as a table, and as G-code."""

from pathlib import Path

from frida_painter import storage
from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.export.bezier import mark_widths
from frida_painter.export.gcode import gcode
from frida_painter.export.svg import svg
from frida_painter.export.table import table
from frida_painter.hardware.gcode import Gcode
from frida_painter.plan import Plan
from frida_painter.session.choreography import BrushLoad, Choreography
from frida_painter.session.flatbed_workspace import FlatbedWorkspace


def export(plan: Plan, model: StrokeModel, folder: Path) -> None:
    """Writes strokes.svg, strokes.csv and strokes.gcode (GRBL, waiting at every dip) into a folder.

    Raises StorageError.
    """
    flatbed = FlatbedWorkspace()
    actions = Choreography(flatbed.motion(plan.canvas), brush_kind(model.brush)).actions(
        plan, BrushLoad(), 0, len(plan)
    )
    program = gcode(plan, list(actions), Gcode("grbl", flatbed.travel_speed), pauses=True)
    storage.write_text(folder / "strokes.svg", svg(plan, mark_widths(plan.strokes, model)))
    storage.write_text(folder / "strokes.csv", table(plan))
    storage.write_text(folder / "strokes.gcode", program)
