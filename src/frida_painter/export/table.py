"""A plan as CSV: one row per stroke in painting order, for spreadsheets and for machines of any make."""

import csv
import io
import math

from frida_painter.export.bezier import control_points
from frida_painter.frames import whole_turns_removed
from frida_painter.palette import to_hex
from frida_painter.plan import Plan

COLUMNS = (
    *("stroke", "layer", "brush", "paint", "color", "start_x_mm", "start_y_mm", "end_x_mm", "end_y_mm"),
    *("angle_deg", "length_mm", "bend_mm", "thickness"),
    *(f"bezier{point}_{axis}_mm" for point in range(4) for axis in "xy"),
)


def table(plan: Plan) -> str:
    """The strokes as CSV with a header row.

    Millimetres from the canvas's bottom-left corner, x right, y up; angles in degrees,
    counter-clockwise from x, in [-180, 180); thickness in [0, 1]; strokes, layers and the wells of paints count from 1.
    """
    content = io.StringIO()
    rows = csv.writer(content, lineterminator="\n")
    rows.writerow(COLUMNS)
    strokes = plan.strokes
    points = (control_points(strokes).double() * 1000).flatten(1).tolist()  # n rows of x, y of four points
    colors = [to_hex(color) for color in plan.palette.color[plan.paint]]
    brushes = [layer.brush for layer in plan.layers]
    groups = zip(
        plan.layer.tolist(),
        plan.well.tolist(),
        colors,
        points,
        (whole_turns_removed(strokes.angle) * (180 / math.pi)).tolist(),
        (strokes.length * 1000).tolist(),
        (strokes.bend * 1000).tolist(),
        strokes.thickness.tolist(),
        strict=True,
    )
    for number, (layer, paint, color, path, angle, length, bend, thickness) in enumerate(groups, start=1):
        shape = (*path[:2], *path[6:], angle, length, bend)
        numbers = (*(f"{value:.3f}" for value in shape), f"{thickness:.4f}", *(f"{value:.3f}" for value in path))
        rows.writerow((number, layer + 1, brushes[layer], paint + 1, color, *numbers))
    return content.getvalue()
