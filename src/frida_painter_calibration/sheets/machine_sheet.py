"""Picture of a machine that was set up: its workspace from above, and what its calibration record says."""

from torch import Tensor

from frida_painter import images
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.robot import Workspace
from frida_painter.report.sheets import workspace_plan
from frida_painter.sheet import INK, LINE, SOFT, Sheet, shorten
from frida_painter_calibration.procedures.surface import surface_sheet

_MARGIN, _ROW, _HEAD = 40, 30, 56
_NAMES = 330  # pixels of the column of names


def draw_machine(workspace: Workspace, record: Calibration, title: str, robot: str) -> Tensor:
    """Returns the picture, sRGB [3, H, W] in [0, 1]: the workspace, below it the record and the height map.

    title: what people call the machine
    robot: its name for --robot
    """
    assert record.canvas is not None
    above = workspace_plan(workspace, record.canvas, record.easel)
    rows = list(_facts(workspace, record, record.canvas, title, robot))
    height, width = above.shape[1], above.shape[2]
    uneven = None if record.surface is None else images.to_uint8(surface_sheet(record.surface))
    below = height + _HEAD + _ROW * len(rows) + _MARGIN
    page = (width, below) if uneven is None else (max(width, uneven.shape[1]), below + uneven.shape[0])
    sheet = Sheet(*page)
    if uneven is not None:
        sheet.paste(uneven, (0, below))
    sheet.paste(images.to_uint8(above))
    sheet.draw.line((_MARGIN, height + 8, width - _MARGIN, height + 8), fill=LINE, width=2)
    for number, (name, value) in enumerate(rows):
        y = height + _HEAD / 2 + _ROW * number
        sheet.text((_MARGIN, y), name, 19, SOFT)
        sheet.text((_MARGIN + _NAMES, y), shorten(value, 19, width - 2 * _MARGIN - _NAMES), 19, INK)
    return sheet.tensor()


def _facts(
    workspace: Workspace, record: Calibration, canvas: CanvasSize, title: str, robot: str
) -> list[tuple[str, str]]:
    """Returns the rows of the picture: name and value."""
    touch, press = record.touch_height * 1000, record.press_height * 1000
    facts = [
        ("machine", title),
        ("--robot", robot),
        ("canvas", f"{canvas}, bottom left at {_place(workspace.canvas_origin)} mm"),
        ("lightest touch, hardest press", f"z {touch:.2f} and {press:.2f} mm ({touch - press:.2f} mm apart)"),
        ("brush", record.brush),
        ("wells", str(len(workspace.wells))),
        ("speeds", f"painting {_speed(workspace.painting_speed)}, travel {_speed(workspace.travel_speed)}"),
    ]
    for name, done in record.done.items():
        facts.append((f"calibrated: {name}", done.dated[:10]))
    return facts


def _place(place: tuple[float, float, float]) -> str:
    return ", ".join(f"{metres * 1000:.1f}" for metres in place)


def _speed(speed: float) -> str:
    return f"{speed * 1000:g} mm/s"
