"""What other programs and machines take of a plan: its strokes as SVG, as a table, and as G-code."""

from collections.abc import Mapping
from pathlib import Path

from frida_painter import storage
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.export.bezier import plan_widths
from frida_painter.export.gcode import gcode
from frida_painter.export.svg import svg
from frida_painter.export.table import table
from frida_painter.hardware.gcode import Gcode
from frida_painter.plan import Plan
from frida_painter.session.choreography import BrushLoad, Choreography
from frida_painter.session.flatbed_workspace import FlatbedWorkspace


def export(plan: Plan, models: Mapping[str, StrokeModel], folder: Path, drying: float) -> None:
    """Writes strokes.svg, strokes.csv and strokes.gcode (GRBL, waiting at every dip) into a folder.

    models: of the plan's brushes, by their names; drying: minutes for which a layer dries. Raises StorageError.
    """
    flatbed = FlatbedWorkspace()
    choreography = Choreography.of(flatbed.motion(plan.canvas), plan.brushes)
    actions = choreography.actions(plan, BrushLoad(), 0, len(plan))
    program = gcode(plan, list(actions), Gcode("grbl", flatbed.travel_speed), pauses=True, drying=60 * drying)
    storage.write_text(folder / "strokes.svg", svg(plan, plan_widths(plan, models)))
    storage.write_text(folder / "strokes.csv", table(plan))
    storage.write_text(folder / "strokes.gcode", program)
