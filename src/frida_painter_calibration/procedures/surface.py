"""The surface procedure: measures how uneven the canvas is, at nine points or more, by touch or by a person's eye.

The heights become a map of the canvas (calibration.py), which every stroke follows. An arm that feels by its force
first touches five points. If they lie in a plane, the plane is the map: it averages the noise of the force.
"""

from collections.abc import Generator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from torch import Tensor

from frida_painter.calibration import MAX_LINES, MAX_UNEVENNESS, SurfaceMap
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Answer, Confirm, Finding, Jog, JogMove, Procedure, Question
from frida_painter.errors import CalibrationError, ConfigError, WorkspaceViolation
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Sense, TouchProbe, Waypoints
from frida_painter.system import storage
from frida_painter.system.sheet import CREAM, INK, LINE, SOFT, Sheet

POINTS = 3
"""Default number of points along each side."""
_INSET = 0.010  # metres between the outer points and the edge of the canvas
_FLAT = 0.0006  # metres that five touched points may be off their plane, for a canvas that counts as flat
_SLOW = 0.005  # m/s of a touch
JOGGING = 0.02
"""Speed of a jogged tip, m/s."""
_MAX_BYTES = 2**20
Place = tuple[float, float]

HOW_IT_FEELS: Mapping[Sense, str] = {
    "contact": "The machine can feel the canvas by itself; for that, a probe's contact must be fastened to brush and "
    "canvas.",
    "force": "The arm can feel the canvas by itself, by its force; a soft brush with wet hairs must be in its hand.",
}
"""Sentence for the person beside a robot that feels."""


def surface(easel: Easel, *, points: int = POINTS, felt: bool = True) -> Procedure[Finding]:
    """Measures the canvas at `points` x `points` places, or at five if an arm feels by its force that it is flat.

    felt: True to use the robot's sense of touch, if it has one; otherwise a person lowers the brush at each place
    Raises CalibrationError if nothing is felt, or if the map cannot be true. Raises RobotError and its subclasses.
    """
    if not 2 <= points <= 9:
        raise ConfigError(f"{points} points along each side were wanted; there are 2 to 9.")
    feeler = easel.robot if felt and isinstance(easel.robot, TouchProbe) else None
    sense = feeler.feels() if feeler is not None else None
    if sense is None or not (
        yield Confirm(f"{HOW_IT_FEELS[sense]} Shall it touch the canvas? (n: you lower it at each point)", moves=True)
    ):
        feeler = sense = None
    across, up = (_spread(side, points) for side in (easel.canvas.width, easel.canvas.height))
    found: dict[Place, float] = {}
    if sense == "force":
        five = [(across[0], up[0]), (across[-1], up[0]), _middle(across, up, easel.canvas), (across[-1], up[-1]),
                (across[0], up[-1])]  # fmt: skip
        for number, place in enumerate(five, 1):
            found[place] = yield from _measure(easel, feeler, place, f"Point {number} of 5")
        flat = _fit_plane(easel.canvas, found)
        if flat is not None:
            return tell_surface(*flat, easel)
    wanted = [(x, y) for row, y in enumerate(up) for x in across[:: 1 if row % 2 == 0 else -1]]  # there and back
    count = len({*found, *wanted})
    for place in wanted:
        if place not in found:
            found[place] = yield from _measure(easel, feeler, place, f"Point {len(found) + 1} of {count}")
    offset = np.array([[found[x, y] for x in across] for y in up])
    measured = SurfaceMap.of_points(easel.canvas, across, up, offset, today())
    return tell_surface(measured, np.array(list(found)), None, easel)


def tell_surface(surface: SurfaceMap, points: NDArray[np.float64], off_plane: float | None, easel: Easel) -> Finding:
    """Returns the finding of a height map. Raises CalibrationError if it cannot be painted within the workspace.

    points: positions [k, 2] that were measured, canvas metres
    off_plane: greatest distance in metres of a point from the plane that is the map; None if the map is no plane
    """
    _require_room(surface, easel)
    flat = "" if off_plane is None else f", in a plane within {1000 * off_plane:.2f} mm"
    return Finding(
        f"the canvas lies {1000 * surface.lowest:+.2f} to {1000 * surface.highest:+.2f} mm around its lightest touch "
        f"({len(points)} points{flat})",
        surface_sheet(surface, points),
        lambda record: record.with_surface(surface),
    )


def today() -> str:
    """Returns the day of a measurement, ISO 8601."""
    return datetime.now(UTC).date().isoformat()


def _spread(side: float, points: int) -> list[float]:
    inset = min(_INSET, side / 6)
    return [float(place) for place in np.linspace(inset, side - inset, points)]


def _middle(across: list[float], up: list[float], canvas: CanvasSize) -> Place:
    """Returns the place of the grid in the middle of the canvas, or the middle if the grid has none there."""
    return (across[len(across) // 2], up[len(up) // 2]) if len(across) % 2 else (canvas.width / 2, canvas.height / 2)


def _fit_plane(
    canvas: CanvasSize, found: Mapping[Place, float]
) -> tuple[SurfaceMap, NDArray[np.float64], float] | None:
    """Returns the plane through measured places, the places, and how far they are off it; None if they are in none."""
    here, height = np.array(list(found)), np.array(list(found.values()))
    known = np.c_[here, np.ones(len(here))]
    plane = np.linalg.lstsq(known, height, rcond=None)[0]
    off = float(np.abs(known @ plane - height).max())
    lines = (0.0, canvas.width), (0.0, canvas.height)
    offset = tuple(tuple(round(float(plane @ (x, y, 1.0)), 6) for x in lines[0]) for y in lines[1])
    return None if off > _FLAT else (SurfaceMap(*lines, offset, today()), here, off)


def _measure(easel: Easel, feeler: TouchProbe | None, place: Place, told: str) -> Generator[Question, Answer, float]:
    """Returns the height of the canvas at a place, in metres above the lightest touch.

    feeler: robot that feels the canvas; None if a person lowers the brush
    Raises CalibrationError, RobotError and its subclasses.
    """
    workspace, touch = easel.workspace, easel.calibration.touch_height
    flat = replace(easel, calibration=easel.calibration.with_surface(None))  # heights are measured without a map
    gateway, motion = RobotGateway(flat, lowest=workspace.lower[2]), Motion(workspace, flat.calibration)
    here = flat.calibration.place(np.array([place]))
    above = workspace.to_robot(here, np.array([motion.travel_height]))[0]
    tip = gateway.pose()
    high = max(tip[2], above[2])
    path = np.array([(*tip[:2], high), (*above[:2], high), above])
    gateway.perform([Waypoints(told, path, workspace.travel_speed)])
    if feeler is not None:
        height = feel(feeler, workspace.lower[2], told)
    else:
        text = f"{told}: lower the brush until its tip just touches the canvas."
        lowest, known = max(workspace.lower[2], touch - MAX_UNEVENNESS), touch if easel.simulated else None
        height = yield from lower(gateway, text, lowest, workspace.upper[2], known=known)
    gateway.perform([Waypoints("rise", np.array([above]), workspace.travel_speed)])
    return height - touch


def _require_room(surface: SurfaceMap, easel: Easel) -> None:
    """Raises CalibrationError unless the whole map can be painted within the workspace, with room to travel above."""
    surface.require_covers(easel.canvas)
    workspace, known = easel.workspace, easel.calibration
    deepest = known.press_height + surface.lowest
    highest = known.touch_height + surface.highest + workspace.hover
    if not workspace.lower[2] <= deepest:
        raise CalibrationError(
            f"At its lowest point the canvas would be pressed down to z = {deepest * 1000:.2f} mm, and the workspace "
            f"ends at {workspace.lower[2] * 1000:.2f} mm; lower [bounds] lower in the workspace, or raise the canvas."
        )
    if not highest <= workspace.upper[2]:
        raise CalibrationError(
            f"Above its highest point the tip would travel at z = {highest * 1000:.2f} mm, and the workspace ends at "
            f"{workspace.upper[2] * 1000:.2f} mm; lower the canvas or the hover of the workspace."
        )


def feel(feeler: TouchProbe, lowest: float, told: str) -> float:
    """Lowers the brush until it is felt, and returns the height. Raises CalibrationError if nothing is felt."""
    found = float(feeler.touch(lowest, _SLOW).reached[2])
    if found <= lowest + 1e-6:
        raise CalibrationError(
            f"{told}: nothing was felt down to {lowest * 1000:.1f} mm. Look at the brush, at a probe's contact and at "
            "the canvas, then repeat this, or lower the brush yourself."
        )
    return found


def lower(
    gateway: RobotGateway, text: str, lowest: float, highest: float, speed: float = JOGGING, known: float | None = None
) -> Generator[Question, Answer, float]:
    """Lets a person lower the tip where it stands, and returns the height that was settled.

    known: height that is proposed; None if only a person can tell
    """
    again, remark = False, ""
    while True:
        x, y, z = (float(metres) for metres in gateway.pose())
        proposal = None if known is None else JogMove(known - z) if z - known > 1e-6 else JogMove(settled=True)
        answer = yield Jog(text, z, lowest, highest, proposal=proposal, remark=remark, again=again)
        assert isinstance(answer, JogMove)
        if answer.settled:
            return z
        again, remark = True, ""
        try:
            gateway.perform([Waypoints("jog", np.array([(x, y, z + answer.step)]), speed)])
        except WorkspaceViolation as refused:
            remark = f"Not moved: {refused}"


# Height maps from files, for maps that another program measured.

Row = Annotated[tuple[Annotated[float, Field(strict=True)], ...], Field(max_length=MAX_LINES)]


@dataclass(frozen=True)
class _MapFile:
    __pydantic_config__ = ConfigDict(extra="forbid")

    across: Row
    up: Row
    height: Annotated[tuple[Row, ...], Field(max_length=MAX_LINES)]


def read_surface(path: Path, easel: Easel) -> Finding:
    """Reads a height map: TOML with `across` and `up` (canvas metres) and `height` (robot z in metres, row by row).

    The first row is the lowest. Points inside the canvas are extended to its edges.
    Raises CalibrationError if the file is no map, has a hole, or does not fit the canvas and the workspace.
    """
    advice = "write across = [...], up = [...] and height = [[...], ...], in metres"
    values = storage.read_toml(path, "a height map (TOML)", _MAX_BYTES, advice, CalibrationError)
    try:
        read = TypeAdapter(_MapFile).validate_python(values)
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(map(str, fault["loc"])) or "the file"
        raise CalibrationError(f"{path}: {where} is not as it must be ({fault['msg'].lower()}); {advice}.") from error
    rows = [len(row) for row in read.height]
    if len(read.across) < 2 or len(read.up) < 2 or rows != [len(read.across)] * len(read.up):
        raise CalibrationError(
            f"{path}: height has rows of {rows[:6]} numbers; it needs {len(read.up)} rows of {len(read.across)}, and "
            f"at least 2 of each; {advice}."
        )
    for lines, side in ((read.across, easel.canvas.width), (read.up, easel.canvas.height)):
        most = max(0.15 * side, 0.02)  # heights far beyond the points would be guessed
        if not (np.diff(lines) > 0).all() or not (0 <= lines[0] <= most and side - most <= lines[-1] <= side + 1e-6):
            raise CalibrationError(
                f"{path}: the points reach from {lines[0] * 1000:.0f} to {lines[-1] * 1000:.0f} mm of a side of "
                f"{side * 1000:.0f} mm; they ascend, and begin and end at most {most * 1000:.0f} mm inside the edges. "
                "Measure a map of this canvas."
            )
    offset = np.array(read.height) - easel.calibration.touch_height
    wide = SurfaceMap.of_points(easel.canvas, read.across, read.up, offset, today())
    return tell_surface(wide, np.array([(x, y) for y in read.up for x in read.across]), None, easel)


# Picture of a height map.

_LONGEST, _LEFT, _TOP, _BAR = 900, 60, 70, 90


def surface_sheet(surface: SurfaceMap, points: NDArray[np.float64] | None = None) -> Tensor:
    """Returns the picture of a height map, sRGB [3, h, w] in [0, 1]: the canvas in colours, with heights in mm.

    points: measured positions [k, 2] in canvas metres; None for the points of the grid
    """
    size = CanvasSize(surface.across[-1], surface.up[-1])
    scale = _LONGEST / max(size.width, size.height)
    columns, rows = round(size.width * scale), round(size.height * scale)
    x, y = (np.arange(columns) + 0.5) / scale, (rows - 0.5 - np.arange(rows)) / scale
    grid = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    most = max(abs(surface.lowest), abs(surface.highest), 1e-4)
    shade = colormaps["RdYlBu_r"]((surface.at(grid) / most + 1) / 2)[:, :3].reshape(rows, columns, 3)
    sheet = Sheet(columns + 2 * _LEFT + _BAR, rows + _TOP + _LEFT, CREAM)
    title = "Height of the canvas, millimetres above the place of the brush calibration"
    sheet.text((_LEFT, 24), title, 20, INK)
    sheet.paste((255 * shade).round().astype(np.uint8), (_LEFT, _TOP))
    sheet.draw.rectangle((_LEFT, _TOP, _LEFT + columns, _TOP + rows), outline=LINE, width=2)
    told = np.array([(u, v) for v in surface.up for u in surface.across]) if points is None else points
    for (u, v), height in zip(told, surface.at(told), strict=True):
        at = _LEFT + u * scale, _TOP + rows - v * scale
        sheet.draw.ellipse((at[0] - 4, at[1] - 4, at[0] + 4, at[1] + 4), fill=INK)
        beside = np.clip((at[0], at[1] + 8), (_LEFT + 40, _TOP), (_LEFT + columns - 40, _TOP + rows - 24))
        sheet.text((float(beside[0]), float(beside[1])), f"{height * 1000:+.2f}", 18, INK, "ma")
    bar = colormaps["RdYlBu_r"](np.linspace(1, 0, rows))[:, None, :3].repeat(24, 1)
    sheet.paste((255 * bar).round().astype(np.uint8), (_LEFT + columns + 24, _TOP))
    for share, value in ((0.0, most), (0.5, 0.0), (1.0, -most)):
        sheet.text((_LEFT + columns + 56, _TOP + share * rows), f"{value * 1000:+.2f}", 17, SOFT, "lm")
    sheet.text((_LEFT, _TOP + rows + 12), f"{size}; bottom left of the canvas is bottom left here", 17, SOFT)
    return sheet.tensor()
