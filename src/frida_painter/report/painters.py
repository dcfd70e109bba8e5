"""Painters of a painting: the painter and the stroke of every pixel.

The robot's strokes are known from journal and plan: each covers the pixels on which its mark has at least a third of
its paint. A person's part is the difference of two looks, one before and one after they painted. Later paint covers
earlier paint. On the canvas of a simulated easel, the journal also tells each stroke of the person; a pixel then
belongs to the last of them that passes it.
"""

import csv
import io
import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import StrokeModel
from frida_painter.easel.kinds import JOURNAL
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import PersonStroke
from frida_painter.perception.frame_check import find_painted
from frida_painter.render import render
from frida_painter.session.events import (
    CanvasPicture,
    Event,
    StrokeOfPerson,
    StrokePainted,
    events_of,
)
from frida_painter.session.fold import PaintingState
from frida_painter.session.resuming import load_canvas
from frida_painter.strokes.palette import to_hex
from frida_painter.strokes.plan import Plan
from frida_painter.system import images, storage
from frida_painter.system.event_log import EventLog

PAINTERS = "painters"
"""Stem of the files: a picture, a table and the data."""
BARE, ROBOT, PERSON = "bare", "robot", "person"
_ROWS = 432
_COVERED = 0.35  # share of the paint in the middle of a mark; at its rim the camera still sees paint
_REACH = 0.009  # metres beside the path of a person's stroke within which its paint lies
_COLORS = {ROBOT: (0.16, 0.42, 0.72), PERSON: (0.86, 0.42, 0.12)}


@dataclass(frozen=True)
class PaintedStroke:
    """Stroke on the canvas.

    painter: ROBOT or PERSON.
    number: of its painter, from 1.
    color: sRGB of its paint as "#rrggbb", "" if it is unknown.
    pixels: number of pixels that it still shows.
    """

    painter: str
    number: int
    color: str
    pixels: int


@dataclass(frozen=True)
class Painters:
    """Painter and stroke of every pixel of a painting.

    owner [H, W]: 0 for bare canvas, n for the robot's stroke n, -n for the person's stroke n.
    strokes: strokes in the order in which they were painted.
    """

    owner: NDArray[np.int32]
    strokes: tuple[PaintedStroke, ...] = field(default=())

    def of(self, painter: str) -> tuple[PaintedStroke, ...]:
        """Returns the strokes of a painter."""
        return tuple(each for each in self.strokes if each.painter == painter)

    def share(self, painter: str) -> float:
        """Returns the share of the picture that this painter painted, or that is bare."""
        chosen = {BARE: self.owner == 0, ROBOT: self.owner > 0, PERSON: self.owner < 0}[painter]
        return float(chosen.mean())

    def picture(self, canvas: Tensor) -> Tensor:
        """Returns the painting [3, H, W] with the robot's part tinted blue and the person's part orange."""
        rows, columns = self.owner.shape
        gray = images.fit(canvas, rows, columns).mean(0, keepdim=True).expand(3, -1, -1)
        shown = 0.35 + 0.65 * gray
        for painter, mask in ((ROBOT, self.owner > 0), (PERSON, self.owner < 0)):
            tint = torch.tensor(_COLORS[painter])[:, None, None] * (0.55 + 0.45 * gray)
            shown = torch.where(torch.from_numpy(mask), tint, shown)
        return shown.contiguous()

    def record(self) -> dict[str, Any]:
        """Returns the result as plain values: shares, strokes, and the owners of the pixels as runs of each row."""
        return {
            "rows": self.owner.shape[0],
            "columns": self.owner.shape[1],
            "shares": {painter: round(self.share(painter), 4) for painter in (BARE, ROBOT, PERSON)},
            "strokes": [
                {"painter": each.painter, "number": each.number, "color": each.color, "pixels": each.pixels}
                for each in self.strokes
            ],
            "owner": [_runs(row) for row in self.owner],
        }

    def save(self, folder: Path, canvas: Tensor) -> None:
        """Writes painters.png, painters.json and painters.csv into a folder. Raises StorageError."""
        images.save(self.picture(canvas), folder / f"{PAINTERS}.png")
        storage.write_text(folder / f"{PAINTERS}.json", json.dumps(self.record(), separators=(",", ":")))
        table = io.StringIO()
        rows = csv.writer(table, lineterminator="\n")
        rows.writerow(("painter", "stroke", "color", "pixels", "share"))
        for each in self.strokes:
            rows.writerow((each.painter, each.number, each.color, each.pixels, round(each.pixels / self.owner.size, 5)))
        storage.write_text(folder / f"{PAINTERS}.csv", table.getvalue())


def find_painters(folder: Path, models: Mapping[str, StrokeModel], rows: int = _ROWS) -> Painters:
    """Returns who painted what in a painting's folder, from its journal, plan and photographs.

    models: stroke models by kind of stroke.
    Raises StorageError and PlanError if journal or plan are damaged.
    """
    records = list(EventLog.read(folder / JOURNAL))
    state, plan = PaintingState.of_journal(records, folder), Plan.load(folder)
    grid = PixelGrid.of_height(plan.canvas, rows)
    ledger = _Ledger(folder, state, plan, models, grid)
    for record in records:
        for event in events_of(record):
            ledger.hear(event)
    return ledger.result()


class _Ledger:
    """Owner of each pixel while the strokes of a journal are painted."""

    def __init__(
        self, folder: Path, state: PaintingState, plan: Plan, models: Mapping[str, StrokeModel], grid: PixelGrid
    ) -> None:
        self._folder, self._state, self._plan, self._models, self._grid = folder, state, plan, models, grid
        self._owner = np.zeros((grid.rows, grid.columns), np.int32)
        self._order: list[int] = []
        self._look: str | None = None
        self._painted: dict[int, StrokeOfPerson] = {}
        self._unseen: list[StrokeOfPerson] = []

    def hear(self, event: Event) -> None:
        match event:
            case StrokePainted(done=done) if done <= len(self._plan):
                self._owner[self._robot_mark(done)] = done
                self._order.append(done)
            case StrokeOfPerson(number, painted=True):
                self._painted[number] = event
                self._unseen.append(event)
                self._order.append(-number)
            case CanvasPicture(str(photograph), by="camera"):
                if self._unseen and self._look is not None:
                    self._enter_person(self._look, photograph)
                self._unseen, self._look = [], photograph
            case _:
                pass

    def result(self) -> Painters:
        count = dict(zip(*np.unique(self._owner, return_counts=True), strict=True))
        strokes = [
            PaintedStroke(
                ROBOT if number > 0 else PERSON, abs(number), to_hex(self._color(number)), int(count.get(number, 0))
            )
            for number in dict.fromkeys(self._order)
        ]
        return Painters(self._owner, tuple(strokes))

    def _color(self, number: int) -> Tensor:
        return self._plan.strokes.color[number - 1] if number > 0 else torch.tensor(self._painted[-number].color)

    def _robot_mark(self, done: int) -> NDArray[np.bool_]:
        ((kind, stroke),) = self._plan.part(slice(done - 1, done)).by_kind()
        white = stroke.with_groups(color=torch.ones(1, 3))
        black = torch.zeros(3, self._grid.rows, self._grid.columns)
        model = self._models[kind]
        with torch.no_grad():
            coverage = render(white, model, black, self._plan.canvas)[0].numpy()
        return np.asarray(coverage >= _COVERED)

    def _enter_person(self, before: str, after: str) -> None:
        """Enters the strokes that the person painted between two photographs."""
        pictures = [self._canvas(name) for name in (before, after)]
        if pictures[0] is None or pictures[1] is None:
            return
        mask = find_painted(pictures[0], pictures[1])
        self._owner[mask] = -self._unseen[-1].number
        metre = self._grid.rows / self._plan.canvas.height
        for begun in self._unseen:
            place = self._plan.canvas.on_page(torch.from_numpy(PersonStroke.of(begun.stroke).place)).numpy()
            near = _near(place, metre, self._owner.shape)
            self._owner[mask & near] = -begun.number

    def _canvas(self, photograph: str) -> Tensor | None:
        record = self._folder / "calibration.json"
        canvas = load_canvas(self._folder, photograph, self._state, self._plan.canvas, record)
        return None if canvas is None else images.fit(canvas, self._grid.rows, self._grid.columns)


def _near(place: NDArray[np.float64], metre: float, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Returns the pixels [H, W] in reach of a path [k, 2], metres from the top-left corner; metre: in pixels."""
    places = place * metre
    drawn = np.zeros(shape, np.uint8)
    cv2.polylines(drawn, [np.round(places).astype(np.int32)], False, 1, max(1, round(2 * _REACH * metre)))
    return drawn.astype(np.bool_)


def _runs(row: NDArray[np.int32]) -> list[list[int]]:
    """Returns a row of owners as (owner, number of pixels)."""
    edges = np.r_[0, np.flatnonzero(np.diff(row)) + 1, len(row)]
    return [[int(row[first]), int(last - first)] for first, last in itertools.pairwise(edges)]
