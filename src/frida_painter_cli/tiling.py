"""Work of `tiles`: one plan of a picture that is larger than the machine, as ordinary plans of parts that overlap.

A tile is a sheet of its own, or the part of one large canvas that lies under the machine at a time. Its folder holds
all that `paint` needs; its painting stands below it. `tiles.json` says how the tiles lie, and joins the paintings.
"""

import itertools
import math
import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from frida_painter.brush.weights import load_models_of
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, PlanError
from frida_painter.frames import PixelGrid
from frida_painter.render.painting import render_plan
from frida_painter.report.vector import plan_widths
from frida_painter.runs.painting_folder import RunRecord, read_goal
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.settle import ground_of
from frida_painter.runs.spec import SETTLED, GoalSettings, RunSpec, upgrade_record
from frida_painter.strokes.plan import Plan
from frida_painter.system import images, storage
from frida_painter.system.devices import prepare_process
from frida_painter.system.sheet import INK, PAPER, WARNING, Sheet, scale
from frida_painter.system.storage import count_of

LAYOUT = "tiles.json"
"""File of a folder of tiles that says how they lie."""
_PAINTING = "painting"  # folder of a tile's painting, in the folder of the tile
_ROWS = 720  # of a tile's picture
_MAX_ALONG = 9  # tiles along a side
_WIDE, _MARGIN, _HEAD = 1000, 60, 150  # pixels of the sheet
_ON_SHEETS = """Paint each sheet, let it dry, cut it along the red lines, and lay all edge to edge.
Numbers: mm from the sheet's left and lower edge to its cuts."""
_ON_ONE_CANVAS = """Mark the corners of all tiles on the canvas; lay one after another where the easel's canvas lies, by
its markers or corners. Numbers: mm from the canvas's left and lower edge."""
Span = tuple[float, float]


def divide(whole: float, tile: float, overlap: float) -> list[Span]:
    """Returns begin and end of the fewest tiles along a side, in metres; they overlap evenly, by `overlap` at least."""
    if whole <= tile + 1e-6:
        return [(0.0, whole)]
    if not 0 <= overlap < tile:
        size = f"{1000 * tile:.0f} mm"
        raise ConfigError(
            f"Tiles of {size} cannot overlap by {1000 * overlap:.0f} mm; give from 0 to less than {size}."
        )
    count = math.ceil((whole - overlap) / (tile - overlap) - 1e-9)
    starts = [number * (whole - tile) / (count - 1) for number in range(count)]
    return [(start, start + tile) for start in starts]


def cut(spans: list[Span]) -> list[Span]:
    """Returns the part of each tile that is shown: it ends in the middle of each overlap."""
    seams = [(end + begin) / 2 for (_, end), (begin, _) in itertools.pairwise(spans)]
    return list(itertools.pairwise([spans[0][0], *seams, spans[-1][1]]))


@dataclass(frozen=True)
class Tile:
    """Part of a picture.

    name: letter of its column and number of its row, from the top left: "A1"
    x, y: begin and end on the whole canvas, in metres
    shown_x, shown_y: begin and end of its visible part, beside its neighbours
    """

    name: str
    x: Span
    y: Span
    shown_x: Span
    shown_y: Span

    def find_shown(self) -> "Tile":
        """Returns the visible part alone."""
        return replace(self, x=self.shown_x, y=self.shown_y)

    def crop(self, whole: Tensor, canvas: CanvasSize) -> Tensor:
        """Returns its part of a picture [3, H, W] of the whole canvas."""
        left, right = (round(each * whole.shape[2] / canvas.width) for each in self.x)
        bottom, top = (whole.shape[1] - round(each * whole.shape[1] / canvas.height) for each in self.y)
        return whole[:, top:bottom, left:right]

    def ends(self) -> tuple[Tensor, Tensor]:
        """Returns its lower left and upper right corner, [2] in metres."""
        begin, end = torch.tensor([self.x, self.y], dtype=torch.float64).unbind(1)
        return begin, end


def tiles_of(canvas: CanvasSize, size: CanvasSize, overlap: float) -> list[Tile]:
    """Returns the tiles of a canvas, row by row from the top left. Raises ConfigError."""
    across, up = divide(canvas.width, size.width, overlap), divide(canvas.height, size.height, overlap)
    if not max(len(across), len(up)) <= _MAX_ALONG:
        raise ConfigError(f"{len(across)} x {len(up)} tiles would be made; at most {_MAX_ALONG} lie along a side.")
    return [
        Tile(f"{chr(65 + column)}{row}", x, y, shown_x, shown_y)
        for row, (y, shown_y) in enumerate(reversed([*zip(up, cut(up), strict=True)]), 1)
        for column, (x, shown_x) in enumerate(zip(across, cut(across), strict=True))
    ]


def deal(plan: Plan, tiles: list[Tile], widths: Tensor, *, once: bool) -> tuple[list[list[int]], int]:
    """Returns the indices of the strokes of each tile, and how many end at a cut because a neighbour cannot hold them.

    A stroke is painted on each tile that shows paint of it and holds all of its path. once: on one of them, if
    possible where its middle is shown, because the tiles are parts of one canvas.
    widths: of the strokes [n] in metres
    Raises PlanError if a stroke fits on no tile.
    """
    points, around = plan.strokes.extremes().double(), widths[:, None] / 2
    least, most = points.amin(1), points.amax(1)
    whole, shown = [tile.ends() for tile in tiles], [tile.find_shown().ends() for tile in tiles]
    holds = torch.stack([((least >= low - 1e-6) & (most <= high + 1e-6)).all(1) for low, high in whole])
    shows = torch.stack([((least - around < high) & (most + around > low)).all(1) for low, high in shown])
    lost = ~holds.any(0)
    if lost.any():
        longest, count = math.ceil(1000 * float((most - least)[lost].max())), count_of(int(lost.sum()), "stroke")
        raise PlanError(f"No tile can hold {count}, of up to {longest} mm; give --overlap {longest}, or larger tiles.")
    ends = 0 if once else int((shows & ~holds).any(0).sum())
    if once:
        middle = (least + most) / 2
        inside = torch.stack([((middle >= low) & (middle <= high)).all(1) for low, high in shown])
        shows = torch.zeros_like(shows).scatter_(0, (holds.int() * (1 + inside.int())).argmax(0)[None], True)
    return [row.nonzero().flatten().tolist() for row in shows & holds], ends


def plan_of(plan: Plan, tile: Tile, which: list[int]) -> Plan:
    """Returns the plan of a tile from the indices of its strokes."""
    part = plan.part(which)
    corner = part.strokes.position.new_tensor((tile.x[0], tile.y[0]))
    strokes = part.strokes.with_groups(position=part.strokes.position - corner)
    size = CanvasSize(*((tile.ends()[1] - tile.ends()[0]).tolist()))
    return replace(part, strokes=strokes, canvas=size, about=(*plan.about, ("tile", tile.name)))


def write_tiles(source: Path, size: CanvasSize, overlap: float, out: Path, *, once: bool) -> list[str]:
    """Writes the folders of all tiles of a plan's folder, and a sheet of how they lie; returns lines for people.

    Raises ConfigError, PlanError and StorageError; then nothing is written.
    """
    prepare_process()
    folder, plan = source if source.is_dir() else source.parent, Plan.load(source)
    spec = RunSpec.of(**{**upgrade_record(RunRecord.load(folder).settings), **read_goal(folder)})
    tiles = tiles_of(plan.canvas, size, overlap)
    dealt, ends = deal(plan, tiles, plan_widths(plan, load_models_of(plan)), once=once)
    picture = render_plan(plan, min(10_000, round(_ROWS * plan.canvas.height / min(size.height, plan.canvas.height))))
    goal = PaintingRun(spec).target if [item.kind for item in spec.goal] == ["image"] else None
    storage.new_folder(out)
    told = []
    for tile, which in zip(tiles, dealt, strict=True):
        place = out / tile.name
        images.save(tile.crop(picture, plan.canvas), place / "plan.png")
        if not which:
            told.append(f"{tile.name}: stays bare")
            continue
        images.save(tile.crop(picture if goal is None else goal, plan.canvas), place / "goal.png")
        part = plan_of(plan, tile, which)
        part.save(place / "plan.json")
        own = _settings(spec, plan, part, f"{spec.heading[:70]}, {tile.name}")
        storage.write_json(
            place / "settings.json", own.model_dump(mode="json", include=own.model_fields_set - {"goal"})
        )
        words = ["--settings", str(place / "settings.json"), "--plan", str(place), "--out", str(place / _PAINTING)]
        command = shlex.join(["frida-painter", "paint", str(place / "goal.png"), *words])
        told.append(f"{tile.name}: {count_of(len(which), 'stroke')}: {command}")
    sizes = {"canvas_m": [plan.canvas.width, plan.canvas.height], "tile_m": [size.width, size.height]}
    storage.write_json(out / LAYOUT, {**sizes, "overlap_m": overlap, "once": once})
    images.save(_draw_layout(plan.canvas, picture, tiles, once=once), out / "tiles.png")
    told += [f"Cut off, as a neighbour cannot hold them: {count_of(ends, 'stroke')}; overlap more for fewer."] * bool(
        ends
    )
    return [*told, f"How they lie: {out / 'tiles.png'}", f"All together: frida-painter render {shlex.quote(str(out))}"]


def _settings(spec: RunSpec, plan: Plan, part: Plan, title: str) -> RunSpec:
    """Returns the settings of a tile: those of the whole, for its canvas, strokes and paints."""
    kept = spec.model_fields_set - {
        *GoalSettings.model_fields,
        "minutes",
        "version",
        "on_canvas",
        "studio_canvas",
        *SETTLED,
    }
    size = f"{1000 * part.canvas.width!r}x{1000 * part.canvas.height!r}mm"
    own: dict[str, Any] = {name: getattr(spec, name) for name in kept}
    own |= {"goal": [{"image": "goal.png"}], "title": title, "canvas": size, "fit": "crop", "ground": ground_of(plan)}
    own |= {"strokes": len(part), "colors": min(spec.colors, len(part)), "replans": min(spec.replans, len(part) - 1)}
    layers = spec.layers if len(plan.brushes) == 1 else None
    return RunSpec.of(**own, brushes=",".join(plan.brushes), layers=layers, paints=spec.paints)


def _draw_layout(canvas: CanvasSize, picture: Tensor, tiles: list[Tile], *, once: bool) -> Tensor:
    """Returns the plan's picture with its tiles and, on sheets, the cuts between them: [3, H, W] in [0, 1]."""
    pixels = _WIDE / canvas.width
    high = round(pixels * canvas.height)
    sheet = Sheet(_WIDE + 2 * _MARGIN, high + _HEAD + _MARGIN)
    sheet.paste(scale(picture, _WIDE, high), (_MARGIN, _HEAD))
    sheet.text((_MARGIN, 24), f"{canvas} on {count_of(len(tiles), 'tile')}", 36)
    sheet.lines((_MARGIN, 76), (_ON_ONE_CANVAS if once else _ON_SHEETS).split("\n"), 20, 28)
    labels: list[tuple[float, float, tuple[str, ...]]] = []
    for tile in tiles:
        x = [_MARGIN + pixels * each for each in tile.x + tile.shown_x]
        y = [_HEAD + high - pixels * each for each in tile.y + tile.shown_y]
        sheet.draw.rectangle((x[0], y[1], x[1], y[0]), outline=INK, width=2)
        if not once:
            sheet.draw.rectangle((x[2], y[3], x[3], y[2]), outline=WARNING, width=3)
        measured = ((tile.x, 0.0), (tile.y, 0.0)) if once else ((tile.shown_x, tile.x[0]), (tile.shown_y, tile.y[0]))
        spans = (" to ".join(f"{1000 * (end - zero):.0f}" for end in span) for span, zero in measured)
        labels.append(((x[2] + x[3]) / 2, (y[2] + y[3]) / 2, (tile.name, *spans)))
    for across, down, texts in labels:
        sheet.draw.rectangle((across - 54, down - 42, across + 54, down + 42), fill=PAPER)
        for text, size, below in zip(texts, (30, 17, 17), (-22, 8, 29), strict=True):
            sheet.text((across, down + below), text, size, INK, "mm")
    return sheet.tensor()


def join_tiles(folder: Path, rows: int) -> tuple[Tensor, list[str]]:
    """Returns the joined picture [3, rows, W] of a folder of tiles, and the names of those that are painted.

    Others are shown as planned. Raises StorageError if the layout is damaged, ImageError.
    """
    path, what, painted = folder / LAYOUT, "the layout of tiles", []
    record = storage.read_json(path, what)
    with storage.understanding(path, what):
        canvas, once = CanvasSize(*record["canvas_m"]), record["once"] is True
        tiles = tiles_of(canvas, CanvasSize(*record["tile_m"]), record["overlap_m"])
    grid = PixelGrid.of_height(canvas, rows)
    joined = torch.ones(3, grid.rows, grid.columns)
    for tile in tiles:
        done, alone = folder / tile.name / _PAINTING / "painting.png", torch.zeros_like(joined)
        painted += [tile.name] if done.exists() else []
        place, seen = tile.crop(alone, canvas), images.load(done if done.exists() else folder / tile.name / "plan.png")
        place.copy_(images.fit(seen, *place.shape[1:]))
        kept = tile if once else tile.find_shown()  # of one canvas, the last photograph shows all
        kept.crop(joined, canvas).copy_(kept.crop(alone, canvas))
    return joined, painted
