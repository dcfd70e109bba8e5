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

from frida_painter import storage
from frida_painter.calibration import MAX_LINES, MAX_UNEVENNESS, Calibration, SurfaceMap
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Answer, Confirm, Jog, JogMove, Procedure, Question
from frida_painter.errors import CalibrationError, ConfigError, WorkspaceViolation
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Feeler, Sense, Waypoints, Workspace
from frida_painter.sheet import CREAM, INK, LINE, SOFT, Sheet

POINTS = 3
"""Default number of points along each side."""
_INSET = 0.010  # metres between the outer points and the edge of the canvas
_FLAT = 0.0006  # metres that five touched points may be off their plane, for a canvas that counts as flat
_SLOW = 0.005  # m/s of a touch
_JOGGING = 0.02  # m/s
_MAX_BYTES = 2**20


HOW_IT_FEELS: Mapping[Sense, str] = {
    "contact": "The machine can feel the canvas by itself; for that, a probe's contact must be fastened to brush and "
    "canvas.",
    "force": "The arm can feel the canvas by itself, by its force; a soft brush with wet hairs must be in its hand.",
}
"""Sentence for the person beside a robot that feels."""


@dataclass(frozen=True)
class SurfaceFinding:
    """Result of the surface procedure.

    surface: height map of the canvas
    points: positions [k, 2] that were measured, canvas metres
    off_plane: greatest distance in metres of a point from the plane that is the map; None if the map is no plane
    """

    surface: SurfaceMap
    points: NDArray[np.float64]
    off_plane: float | None = None

    @property
    def sentence(self) -> str:
        """Range of the heights, in plain words."""
        low, high = 1000 * self.surface.lowest, 1000 * self.surface.highest
        flat = "" if self.off_plane is None else f", in a plane within {1000 * self.off_plane:.2f} mm"
        return (
            f"the canvas lies {low:+.2f} to {high:+.2f} mm around its lightest touch ({len(self.points)} points{flat})"
        )

    @property
    def picture(self) -> Tensor:
        """Picture of the height map."""
        return surface_sheet(self.surface, self.points)

    def enter(self, record: Calibration) -> Calibration:
        """Returns the calibration with this height map."""
        return record.with_surface(self.surface)


def surface(easel: Easel, *, points: int = POINTS, felt: bool = True) -> Procedure[SurfaceFinding]:
    """Measures the canvas at `points` x `points` places, or at five if an arm feels by its force that it is flat.

    felt: True to use the robot's sense of touch, if it has one; otherwise a person lowers the brush at each place
    Raises CalibrationError if nothing is felt, or if the map cannot be true. Raises RobotError and its subclasses.
    """
    if not 2 <= points <= 9:
        raise ConfigError(f"{points} points along each side were wanted; there are 2 to 9.")
    feeler = easel.robot if felt and isinstance(easel.robot, Feeler) else None
    sense = feeler.feels() if feeler is not None else None
    if sense is not None and not (
        yield Confirm(f"{HOW_IT_FEELS[sense]} Shall it touch the canvas? (n: you lower it at each point)")
    ):
        sense = None
    visit = _Visit(easel, feeler if sense is not None else None)
    across, up = (_spread(side, points) for side in (easel.canvas.width, easel.canvas.height))
    if sense == "force":
        flat = yield from _plane(visit, across, up)
        if flat is not None:
            require_room(flat.surface, easel)
            return flat
    for row, y in enumerate(up):
        for x in across if row % 2 == 0 else across[::-1]:  # there and back, the shortest way
            yield from visit.measure(x, y, f"Point {len(visit.found) + 1} of {visit.count(across, up)}")
    offset = np.array([[visit.found[x, y] for x in across] for y in up])
    measured = SurfaceMap.of_points(easel.canvas, across, up, offset, _today())
    require_room(measured, easel)
    return SurfaceFinding(measured, np.array(list(visit.found)))


def _plane(visit: "_Visit", across: list[float], up: list[float]) -> Generator[Question, Answer, SurfaceFinding | None]:
    """Touches the corners and the middle; returns the plane through them, or None if they are in none."""
    canvas = visit.easel.canvas
    middle = (across[len(across) // 2], up[len(up) // 2]) if len(across) % 2 else (canvas.width / 2, canvas.height / 2)
    five = [(across[0], up[0]), (across[-1], up[0]), middle, (across[-1], up[-1]), (across[0], up[-1])]
    for number, (x, y) in enumerate(five, 1):
        yield from visit.measure(x, y, f"Point {number} of 5")
    here, height = np.array(five), np.array([visit.found[place] for place in five])
    known = np.c_[here, np.ones(len(here))]
    plane = np.linalg.lstsq(known, height, rcond=None)[0]
    off = float(np.abs(known @ plane - height).max())
    if off > _FLAT:
        return None
    lines = (0.0, canvas.width), (0.0, canvas.height)
    offset = tuple(tuple(round(float(plane @ (x, y, 1.0)), 6) for x in lines[0]) for y in lines[1])
    return SurfaceFinding(SurfaceMap(*lines, offset, _today()), here, off)


class _Visit:
    """Visits places of a canvas and keeps the heights that were found.

    feeler: robot that feels the canvas; None if a person lowers the brush
    found: offsets in metres from the lightest touch, by x and y in canvas metres
    """

    def __init__(self, easel: Easel, feeler: Feeler | None) -> None:
        self.easel, self._feeler = easel, feeler
        flat = replace(easel, calibration=easel.calibration.with_surface(None))  # heights are measured without a map
        self._gateway = RobotGateway(flat, lowest=easel.workspace.lower[2])
        self._motion = Motion(easel.workspace, flat.calibration)
        self.found: dict[tuple[float, float], float] = {}

    def count(self, across: list[float], up: list[float]) -> int:
        """Returns the number of places that a grid needs, with those that were found before."""
        return len({*self.found, *((x, y) for x in across for y in up)})

    def measure(self, x: float, y: float, told: str) -> Generator[Question, Answer, None]:
        """Measures a place that was not measured before. Raises CalibrationError, RobotError and its subclasses."""
        if (x, y) in self.found:
            return
        workspace, motion, gateway = self.easel.workspace, self._motion, self._gateway
        place = np.array([[x, y]])
        above = workspace.to_robot(motion.calibration.place(place), np.array([motion.travel_height]))[0]
        gateway.perform([_over(gateway.pose(), above, workspace, told)])
        if self._feeler is not None:
            height = feel(self._feeler, workspace.lower[2], told)
        else:
            touch = self.easel.calibration.touch_height
            text = f"{told}: lower the brush until its tip just touches the canvas."
            lowest = max(workspace.lower[2], touch - MAX_UNEVENNESS)
            known = touch if self.easel.simulated else None
            height = yield from lower(gateway, text, lowest, workspace.upper[2], known=known)
        gateway.perform([Waypoints("rise", np.array([above]), workspace.travel_speed)])
        self.found[x, y] = height - self.easel.calibration.touch_height


def _today() -> str:
    return datetime.now(UTC).date().isoformat()


def require_room(surface: SurfaceMap, easel: Easel) -> None:
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


def _spread(side: float, points: int) -> list[float]:
    inset = min(_INSET, side / 6)
    return [float(place) for place in np.linspace(inset, side - inset, points)]


def _over(tip: NDArray[np.float64], above: NDArray[np.float64], workspace: Workspace, label: str) -> Waypoints:
    """Returns the way up and across to above a place."""
    path = np.array([(*tip[:2], max(tip[2], above[2])), (*above[:2], max(tip[2], above[2])), above])
    return Waypoints(label, path, workspace.travel_speed)


def feel(feeler: Feeler, lowest: float, told: str) -> float:
    """Lowers the brush until it is felt, and returns the height. Raises CalibrationError if nothing is felt."""
    found = float(feeler.touch(lowest, _SLOW).reached[2])
    if found <= lowest + 1e-6:
        raise CalibrationError(
            f"{told}: nothing was felt down to {lowest * 1000:.1f} mm. Look at the brush, at a probe's contact and at "
            "the canvas, then repeat this, or lower the brush yourself."
        )
    return found


def lower(
    gateway: RobotGateway, text: str, lowest: float, highest: float, speed: float = _JOGGING, known: float | None = None
) -> Generator[Question, Answer, float]:
    """Lets a person lower the tip where it stands, and returns the height that was settled.

    known: height that is proposed; None if only a person can tell
    """
    again, remark = False, ""
    while True:
        x, y, z = (float(metres) for metres in gateway.pose())
        proposal = None if known is None else JogMove(known - z) if z - known > 1e-6 else JogMove(settled=True)
        answer = yield Jog(text, z, lowest, highest, proposal=proposal, remark=remark, again=again)
        if not isinstance(answer, JogMove):
            raise TypeError(f"A jog is answered with a JogMove, not {answer!r}.")
        if answer.settled:
            return z
        again, remark = True, ""
        try:
            gateway.perform([Waypoints("jog", np.array([(x, y, z + answer.step)]), speed)])
        except WorkspaceViolation as refused:
            remark = f"Not moved: {refused}"


# Height maps from files, for maps that another program measured.

Number = Annotated[float, Field(strict=True)]
Row = Annotated[tuple[Number, ...], Field(max_length=MAX_LINES)]


@dataclass(frozen=True)
class _MapFile:
    __pydantic_config__ = ConfigDict(extra="forbid")

    across: Row
    up: Row
    height: Annotated[tuple[Row, ...], Field(max_length=MAX_LINES)]


def read_surface(path: Path, easel: Easel) -> SurfaceFinding:
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
        _require_spread(path, lines, side)
    offset = np.array(read.height) - easel.calibration.touch_height
    wide = SurfaceMap.of_points(easel.canvas, read.across, read.up, offset, datetime.now(UTC).date().isoformat())
    require_room(wide, easel)
    return SurfaceFinding(wide, np.array([(x, y) for y in read.up for x in read.across]))


def _require_spread(path: Path, lines: tuple[float, ...], side: float) -> None:
    """Raises CalibrationError if the points do not span the canvas: heights beyond them would be guessed."""
    most = max(0.15 * side, 0.02)
    if not (np.diff(lines) > 0).all() or not (0 <= lines[0] <= most and side - most <= lines[-1] <= side + 1e-6):
        raise CalibrationError(
            f"{path}: the points reach from {lines[0] * 1000:.0f} to {lines[-1] * 1000:.0f} mm of a side of "
            f"{side * 1000:.0f} mm; they ascend, and begin and end at most {most * 1000:.0f} mm inside the edges. "
            "Measure a map of this canvas."
        )


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
