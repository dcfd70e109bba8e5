"""Virtual studio: a table, a robot and a camera as one easel, all from one seed."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import TypeAdapter
from torch import Tensor

from frida_painter import registry
from frida_painter.calibration import BrushRecord, Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, StorageError
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel, PersonBrush, PersonStroke
from frida_painter.hardware.faults import NO_FAULTS, Faults, PlacementError
from frida_painter.hardware.robot import Reach, Waypoints
from frida_painter.hardware.timing import Timing
from frida_painter.strokes.palette import Palette
from frida_painter.system import images
from frida_painter.virtual.bristles import BristleBrush, Tuft, brush_names, find_brush
from frida_painter.virtual.camera import CameraSpec, VirtualCamera
from frida_painter.virtual.canvas import Canvas
from frida_painter.virtual.paint import absorption_and_scattering, to_linear, to_srgb
from frida_painter.virtual.robot import Arm, Clock, FreeArm, VirtualRobot
from frida_painter.virtual.simulation_log import Entry, Note, SimulationLog, ignore_entry
from frida_painter.virtual.tabletop import (
    Checker,
    HandNoise,
    StudioLayout,
    Table,
    free_layout,
)

# Hand of a person in the studio: own brushes, the robot's paints, and the same canvas.
#
# The person sees the real canvas, so their strokes have no placement error and no noise of an arm. Each brush is a tuft
# like the robot's. It is washed and dipped before each stroke, and takes up wet paint from the canvas during the
# stroke.

_MM = 1000.0
_ABOVE = -0.3  # depth at which the brush is in the air before and after a stroke
_CELLS_PER_STEP, _FINER_LIFT = 0.9, 3.0  # as the robot's tip is moved
_BELLY = 0.5  # share of the hard radius by which the belly of a brush lies beside its tip if it lies flat


class PersonHand:
    """Hand of a person at a table.

    brushes: the brushes in the jar, by name.
    seed: seed of the studio; every tuft and every stroke has random numbers of its own.
    laid: number of the last stroke on the canvas; strokes up to this number are not laid again.
    note: called after each stroke.
    """

    def __init__(self, table: Table, clock: Clock, brushes: Mapping[str, BristleBrush], seed: int) -> None:
        self.note: Note = ignore_entry
        self.laid = 0
        self._table, self._clock, self._brushes, self._seed = table, clock, brushes, seed
        self._tufts: dict[str, Tuft] = {}

    @property
    def brushes(self) -> tuple[PersonBrush, ...]:
        """Brushes in the jar, with the widths of their marks in metres."""
        return tuple(
            PersonBrush(name, 2 * brush.light_radius / _MM, 2 * brush.hard_radius / _MM)
            for name, brush in self._brushes.items()
        )

    @property
    def volume(self) -> float:
        """Paint in all brushes of the person, in microlitres."""
        return sum(tuft.volume for tuft in self._tufts.values())

    def paint(self, stroke: PersonStroke) -> None:
        """Lays a stroke on the canvas, unless it is there already; time passes as the hand moves.

        Raises ConfigError if there is no such brush, or no paint in that well; then nothing is painted.
        """
        if stroke.number <= self.laid:
            return
        if stroke.brush not in self._brushes:
            raise ConfigError(f"There is no brush {stroke.brush[:40]!r} here; take {', '.join(self._brushes)}.")
        wells = len(self._table.paints)
        if not 0 <= stroke.paint < wells:
            raise ConfigError(f"Well {stroke.paint + 1} has no paint; {wells} wells are filled.")
        self._clock.now += max(stroke.seconds, 0.0)
        tuft = self._load(stroke)
        self._table.canvas.touch(tuft, self._fine(_path(stroke, tuft.brush)), self._clock.now)
        tuft.settle()
        self.laid = stroke.number
        self.note(
            {"did": "person", "stroke": stroke.record(), "now": self._clock.now, "brush": tuft.volume}, flush=True
        )

    def relive(self, entry: Entry) -> bool:
        """Lays the stroke of a log entry again; returns False if another amount of paint is left than at its time."""
        stroke = PersonStroke.of(entry["stroke"])
        self.paint(stroke)
        self._clock.now = entry["now"]
        return bool(self._tufts[stroke.brush].volume == entry["brush"])

    def _load(self, stroke: PersonStroke) -> Tuft:
        """Returns the brush, washed and dipped."""
        number = list(self._brushes).index(stroke.brush)
        if stroke.brush not in self._tufts:
            self._tufts[stroke.brush] = Tuft(self._brushes[stroke.brush], self._random(number, 0))
        tuft, paint, table = self._tufts[stroke.brush], self._table.paints[stroke.paint], self._table
        tuft.draw_luck_from(self._random(number, stroke.number))
        table.in_water += tuft.keep(0.0)
        table.drawn += tuft.fill(paint)
        return tuft

    def _random(self, brush: int, stroke: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(1000 + brush, stroke)))

    def _fine(self, path: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns a path [k, 3] in steps as fine as those of the robot's tip."""
        deep = np.array([1, 1, _FINER_LIFT * max(brush.press_depth for brush in self._brushes.values())])
        legs = np.linalg.norm(np.diff(path * deep, axis=0), axis=1)
        count = np.maximum(1, np.ceil(legs / (_CELLS_PER_STEP * self._table.canvas.cell)).astype(int))
        place = np.concatenate([k + np.arange(n) / n for k, n in enumerate(count)] + [[len(path) - 1.0]])
        return np.stack([np.interp(place, np.arange(len(path)), column) for column in path.T], -1)


def _path(stroke: PersonStroke, brush: BristleBrush) -> NDArray[np.float64]:
    """Returns the way of the tip [k, 3]: mm on the canvas, and depth; it begins and ends in the air.

    The bristles of the studio stand upright. A brush that is tilted by an angle lies down: its belly touches the
    canvas beside the tip, on the side of the handle, and more of it than of an upright brush with the same pressure.
    """
    lies = 1 - np.cos(stroke.tilt)  # 0 upright, 1 flat
    depth = stroke.press + 0.5 * lies * (1 - stroke.press)
    beside = _BELLY * brush.hard_radius * np.sin(stroke.tilt)
    lean = np.stack((np.cos(stroke.toward), np.sin(stroke.toward)), -1)
    place = stroke.place * _MM + beside[:, None] * lean
    path = np.c_[place, depth]
    above = np.array([0.0, 0.0, _ABOVE])
    down, up = path[0] * (1, 1, 0) + above, path[-1] * (1, 1, 0) + above
    return np.concatenate([down[None], path, up[None]])


# Operator of the studio: fills the wells, lays paper and the colour checker, and does everything at once.


class StudioOperator:
    """Operator of a table; implements hardware.easel.Operator.

    tufts: tufts of its brushes, by their names on the easel.
    hand: hand of a person who paints too.
    note: called after each action.
    """

    def __init__(
        self,
        table: Table,
        checker: Checker,
        fresh_canvas: Callable[[], Canvas],
        clock: Clock,
        tufts: Mapping[str, Tuft],
        hand: PersonHand,
    ) -> None:
        self.checker, self.hand = checker, hand
        self.note: Note = ignore_entry
        self._table, self._fresh_canvas, self._clock, self._tufts = table, fresh_canvas, clock, tufts

    def fill_wells(self, palette: Palette) -> None:
        """Empties all wells and fills well i with paint i."""
        self.pour(palette.color.detach().cpu().double().numpy())

    def pour(self, color: NDArray[np.float64]) -> None:
        """Fills well i with paint of colour i, sRGB [k, 3]."""
        self._table.paints = tuple(absorption_and_scattering(color))
        self.note({"did": "fill", "color": color.tolist()})

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Tones the canvas in that colour (sRGB) and lets it dry."""
        self._table.canvas.tone(to_linear(np.array(ground)))
        self.note({"did": "tone", "ground": list(ground)})

    def change_brush(self, brush: str) -> None:
        """Puts the brush of that name into the holder if it is not there. Raises ConfigError for an unknown brush."""
        if brush not in self._tufts:
            raise ConfigError(f"The studio was opened with {', '.join(self._tufts)}, not with the brush {brush!r}.")
        if self._table.tuft is not self._tufts[brush]:
            self._table.tuft = self._tufts[brush]
            self.note({"did": "brush", "name": brush})

    def let_dry(self, seconds: float) -> None:
        """Lets time pass and paint dry."""
        self._clock.now += seconds
        self._table.canvas.dry_until(self._clock.now)
        self.note({"did": "wait", "now": self._clock.now})

    def lay_paper(self) -> bool:
        """Puts a fresh canvas at the first one's place."""
        self._table.lay(self._fresh_canvas())
        self.note({"did": "paper"})
        return True

    def place_checker(self, center: tuple[float, float], turn: float, width: float | None) -> None:
        """Lays the colour checker there, and always there from now on. Millimetres on the canvas, radians."""
        self.checker = self.checker.place_at(center, turn, width)
        self.lay_checker()

    def lay_checker(self) -> bool:
        """Lays the colour checker on the canvas."""
        self._put_checker(self.checker)
        return True

    def take_checker_away(self) -> bool:
        """Takes the colour checker away."""
        self._put_checker(None)
        return True

    def paint_stroke(self, stroke: PersonStroke) -> None:
        """Paints a person's stroke, unless one of that number is there already. Raises ConfigError."""
        self.hand.paint(stroke)

    def print_canvas(self) -> NDArray[np.uint8] | None:
        """Returns the canvas as it is [rows, columns, 3], sRGB; None in a studio that is not set up to print."""
        return self._table.canvas.print()

    def _put_checker(self, lying: Checker | None) -> None:
        self._table.checker = lying
        card = self.checker
        place = {"center": list(card.center), "turn": card.turn, "width": card.width}
        self.note({"did": "checker", "lies": lying is not None, **place})


# History of a studio: its logged actions, and their replay.
#
# A studio depends only on its seed and on these actions, so the canvas itself is not saved. The same motions leave
# the same paint in the same cells, byte for byte.


def relive(
    past: Iterable[Entry], clock: Clock, table: Table, robot: VirtualRobot, camera: VirtualCamera,
    operator: StudioOperator,
) -> None:  # fmt: skip
    """Replays the logged actions in a newly opened studio.

    Raises StorageError if the result differs, because the code of brush or paint has changed.
    """
    other = StorageError(
        "The virtual studio's paint no longer does what it did when this was painted (another version of frida-painter "
        "or of its libraries); go on with the version that began the painting."
    )
    for entry in past:
        match entry["did"]:
            case "move":
                clock.now = entry["now"]
                path = np.array(entry["path"])
                table.move(path, clock.now, robot.faults)
                robot.remember(path[-1])
                if table.tuft.volume != entry["brush"]:
                    raise other
            case "person":
                if not operator.hand.relive(entry):
                    raise other
            case "arm":
                robot.arm.remember(entry["state"])
            case "photograph":
                clock.now = entry["now"]
                camera.remember(entry["exposed"])
            case "fill":
                operator.pour(np.array(entry["color"]))
            case "tone":
                operator.tone(entry["ground"])
            case "brush":
                operator.change_brush(entry["name"])
            case "paper":
                operator.lay_paper()
            case "checker":
                x, y = entry["center"]
                operator.checker = operator.checker.place_at((x, y), entry["turn"], entry["width"])
                table.checker = operator.checker if entry["lies"] else None
            case "wait":
                clock.now = entry["now"]
                table.canvas.dry_until(clock.now)
            case "break":
                robot.faults = camera.faults = TypeAdapter(Faults).validate_python(entry["faults"])


_MAX_CELLS = 3_000_000
FREE = "free"
"""Name of the studio's own arm, which follows its way exactly. Other arms come from entry points."""
_MAX_RISE = 0.02
_SLOWEST = 100.0
# Film thickness that sets in the drying time; the rate is the same for all films.
_FILM = 0.06
_PICTURE_ROWS = 700


@dataclass(frozen=True)
class ArmAndTable:
    """Arm with its surroundings: layout, hand noise, reach and timing."""

    layout: StudioLayout
    arm: Arm
    noise: HandNoise
    reach: Reach | None = None
    timing: Timing | None = None


@dataclass(frozen=True)
class StudioArm:
    """Kind of arm for the virtual studio.

    name: registered name.
    easel: name of an easel with this arm in records.
    furnish: returns an arm and its table for a canvas, the brush that presses deepest, and a seed.
    """

    name: str
    easel: str
    furnish: Callable[[CanvasSize, BristleBrush, int], ArmAndTable]


def _find_arm(name: str) -> StudioArm:
    """Returns the kind of arm of that name. Raises PluginError."""
    if name == FREE:
        return StudioArm(
            FREE,
            "virtual studio",
            lambda canvas, brush, _: ArmAndTable(free_layout(canvas, brush), FreeArm(), HandNoise()),
        )
    return registry.parts(registry.STUDIO_ARMS)[name].load(StudioArm)


@dataclass(frozen=True)
class StudioSettings:
    """Setup of the studio.

    cell: side of a canvas cell in mm. None: 0.4, or coarser for a canvas of more than 3 million cells.
    drying_time: seconds until a full film has set.
    ground: sRGB of the primed canvas.
    picture: file of a painting on the canvas, which fills it. None: bare.
    placement_error: None: drawn from the seed.
    rise: height of the canvas above its place in the workspace, in metres.

    arm: arm that holds the brush, FREE or one of registry.STUDIO_ARMS.
    pace: real seconds per second of the robot's motions, 0 as fast as possible.
    noise: noise of the hand. None: that of the arm.
    camera, faults: see CameraSpec and Faults.
    print_pixels: least pixels of the longer side of a print, which takes memory; marks do not depend on it. 0: none.
    Raises ConfigError if a value is out of range.
    """

    cell: float | None = None
    drying_time: float = 300.0
    ground: tuple[float, float, float] = (1.0, 1.0, 1.0)
    picture: Path | None = None
    placement_error: PlacementError | None = None
    rise: float = 0.0
    arm: str = FREE
    pace: float = 0.0
    noise: HandNoise | None = None
    camera: CameraSpec = field(default_factory=CameraSpec)
    faults: Faults = NO_FAULTS
    print_pixels: int = 0

    def __post_init__(self) -> None:
        arms = (FREE, *registry.parts(registry.STUDIO_ARMS))
        if self.arm not in arms:
            raise ConfigError(f"There is no arm {self.arm!r} in the virtual studio; take {' or '.join(arms)}.")
        if self.cell is not None and not 0.1 <= self.cell <= 5:
            raise ConfigError(f"A canvas cell of {self.cell} mm was given; allowed is 0.1 to 5 mm.")
        if not abs(self.rise) <= _MAX_RISE:
            raise ConfigError(
                f"A canvas that lies {self.rise} m higher was given; allowed is {-_MAX_RISE:g} to {_MAX_RISE:g} m."
            )
        if not 0 <= self.pace <= _SLOWEST:
            raise ConfigError(
                f"A pace of {self.pace} was given; it is from 0 (at once) over 1 (as real) to {_SLOWEST:g}."
            )
        if not 0 < self.drying_time < math.inf:
            raise ConfigError(f"A drying time of {self.drying_time} s was given; it is above 0 and finite.")


@dataclass(frozen=True)
class Balance:
    """Amounts of paint in microlitres, by place."""

    drawn: float
    brush: float
    wet: float
    dry: float
    water: float
    rag: float
    carried_away: float = 0.0

    @property
    def missing(self) -> float:
        """Paint drawn from the wells and found nowhere; 0 but for rounding."""
        return self.drawn - (self.brush + self.wet + self.dry + self.water + self.rag + self.carried_away)


class VirtualStudio:
    """Open studio. The painter uses only `easel`; the rest is for tests and films.

    touch_height: robot z (m) at which the tip really touches the canvas.
    person: hand of a person who paints on the canvas too.
    log: log of the studio. Its entries are replayed, and new ones are added.
    """

    def __init__(
        self,
        canvas: CanvasSize,
        brushes: Mapping[str, BristleBrush],
        settings: StudioSettings,
        seed: int,
        log: SimulationLog | None = None,
    ) -> None:
        for_canvas, for_brush, for_hand, for_camera, for_error, for_checker = (
            np.random.default_rng(sequence) for sequence in np.random.SeedSequence(seed).spawn(6)
        )
        name, *others = brushes
        brush = brushes[name]
        area = canvas.width * canvas.height * _MM**2
        self.settings, self.brush = settings, brush
        self.clock = Clock()
        self._fresh_canvas = partial(
            Canvas, canvas.width * _MM, canvas.height * _MM,
            cell=settings.cell or max(0.4, math.sqrt(area / _MAX_CELLS)),
            ground=_first_look(settings, canvas), drying_rate=_FILM / settings.drying_time, random=for_canvas,
            detail=settings.print_pixels,
        )  # fmt: skip
        self.placement_error = settings.placement_error or PlacementError.sample(for_error)
        deepest = max(brushes.values(), key=lambda each: each.press_depth)
        arm = _find_arm(settings.arm)
        here = arm.furnish(canvas, deepest, seed)
        layout = here.layout
        touch_height = layout.workspace.canvas_origin[2]
        self.touch_height = touch_height + settings.rise
        tuft = Tuft(brush, for_brush)
        # Each other brush has its own random generator, so that the first one paints as if it were alone.
        self.tufts = {name: tuft} | {
            each: Tuft(brushes[each], np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(6 + number,))))
            for number, each in enumerate(others)
        }
        self.table = Table(
            self._fresh_canvas(), tuft, layout.workspace, self.touch_height, self.placement_error,
            settings.noise or here.noise, for_hand,
        )  # fmt: skip
        self.robot = VirtualRobot(self.table, layout, here.arm, self.clock, settings.pace)
        self.camera = VirtualCamera(settings.camera, self.table, self.clock, for_camera)
        calibration = Calibration(
            easel=f"{arm.easel} {seed}",
            brush=name,
            corners=self.camera.corners,
            photograph=settings.camera.photograph,
            touch_height=touch_height,
            press_height=touch_height - brush.press_depth / _MM,
            others={
                each: BrushRecord(touch_height, touch_height - brushes[each].press_depth / _MM, 0.0) for each in others
            },
            protrusion=0.0,  # The studio's robot moves the tip itself.
            camera="virtual camera",
            canvas=canvas,
            lens=self.camera.lens,
        )
        checker = Checker.sample(for_checker, self.canvas.width, self.canvas.height)
        self.person = PersonHand(self.table, self.clock, {each: find_brush(each) for each in brush_names()}, seed)
        self._operator = StudioOperator(self.table, checker, self._fresh_canvas, self.clock, self.tufts, self.person)
        self.easel = Easel(
            self.robot, self.camera, self._operator, layout.workspace, calibration, canvas, here.reach, here.timing,
            simulated=True, pace=settings.pace, person_brushes=self.person.brushes,
        )  # fmt: skip
        self._log, self._note = log, ignore_entry
        if log is not None:
            relive(log.past, self.clock, self.table, self.robot, self.camera, self._operator)
            self._note = self.table.note = self.robot.note = self.camera.note = self._operator.note = log.note
            self.person.note = log.note
        self.break_things(settings.faults)

    def close(self) -> None:
        """Closes the log. Raises StorageError if not all entries could be written."""
        if self._log is not None:
            self._log.close()

    @property
    def canvas(self) -> Canvas:
        """Canvas on the easel."""
        return self.table.canvas

    def break_things(self, faults: Faults) -> None:
        """Sets the faults that happen from now on."""
        self.robot.faults = self.camera.faults = faults
        self._note({"did": "break", "faults": TypeAdapter(Faults).dump_python(faults, mode="json")})

    def lay_checker(self, center: tuple[float, float], turn: float, width: float | None = None) -> None:
        """Lays the colour checker on the canvas; the operator uses this place from now on.

        center: canvas metres.
        turn: radians counter-clockwise.
        width: metres of its longer side.
        """
        self._operator.place_checker((center[0] * _MM, center[1] * _MM), turn, None if width is None else width * _MM)

    def wait(self, seconds: float) -> None:
        """Lets time pass and paint dry."""
        self._operator.let_dry(seconds)

    def truth(self, rows: int) -> Tensor:
        """Returns the real canvas, straight on in even light: sRGB [3, rows, columns]. Not for the painter."""
        seen = self.canvas.reflectance()[::-1]  # The canvas's rows go up, a picture's go down.
        columns = max(1, round(rows * self.canvas.width / self.canvas.height))
        shrinks = rows <= seen.shape[0]
        size = cv2.resize(seen, (columns, rows), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        return torch.from_numpy(to_srgb(np.asarray(size, np.float32)).astype(np.float32)).permute(2, 0, 1).contiguous()

    def balance(self) -> Balance:
        """Returns the places of all paint drawn from the wells."""
        table, brushes = self.table, sum(tuft.volume for tuft in self.tufts.values()) + self.person.volume
        return Balance(
            table.drawn, brushes, self.canvas.wet_volume, self.canvas.dry_volume, table.in_water,
            table.on_rag, table.carried_away,
        )  # fmt: skip


def open_studio(
    canvas: CanvasSize | str = "14x11in",
    brush: str | Mapping[str, str] = "broad",
    *,
    seed: int = 0,
    placement_error: PlacementError | None = None,
    faults: Faults | None = None,
    settings: StudioSettings | None = None,
    state: str | Path | None = None,
) -> VirtualStudio:
    """Opens a studio with a blank canvas and a brush; the same seed gives the same bytes.

    canvas: a size, or a text such as "14x11in".
    brush: brush name, or a mapping from names on the easel to brush names; the first brush is in the holder.
    placement_error, faults: replace those of `settings`.
    state: file of the log. If it exists, the studio opens as it was left, with its canvas and wet paint, brush,
    robot and random numbers.
    Raises ConfigError for an unknown brush or a wrong size. Raises StorageError if the file cannot be written, is
    damaged, or belongs to another studio.

        >>> import frida_painter as fp
        >>> studio = fp.open_virtual_studio("12x9cm", "fine", seed=1)
        >>> studio.truth(90).shape  # the real canvas; the painter sees only photographs of it
        torch.Size([3, 90, 120])
    """
    canvas, settings = CanvasSize.of(canvas), settings or StudioSettings()
    if placement_error is not None:
        settings = replace(settings, placement_error=placement_error)
    if faults is not None:
        settings = replace(settings, faults=faults)
    names = {brush: brush} if isinstance(brush, str) else brush
    furnishing = _furnishing(canvas, ",".join(names.values()), settings, seed)
    log = None if state is None else SimulationLog(Path(state), furnishing)
    return VirtualStudio(canvas, {name: find_brush(own) for name, own in names.items()}, settings, seed, log)


def _first_look(settings: StudioSettings, canvas: CanvasSize) -> NDArray[np.float64]:
    """Returns the first linear reflectance of the canvas: [3], or a picture [h, w, 3] with row 0 at the bottom."""
    if settings.picture is None:
        return to_linear(np.array(settings.ground))
    grid = PixelGrid.of_height(canvas, _PICTURE_ROWS)
    picture = images.fit(images.load(settings.picture), grid.rows, grid.columns)
    return np.ascontiguousarray(to_linear(picture.permute(1, 2, 0).numpy())[::-1])


def _furnishing(canvas: CanvasSize, brush: str, settings: StudioSettings, seed: int) -> dict[str, Any]:
    """Returns the setup of a studio in plain values, without faults, which are in its log."""
    changing = ("faults", "pace", "picture", "print_pixels")
    furniture = {name: value for name, value in asdict(settings).items() if name not in changing}
    if settings.picture is not None:
        furniture["picture"] = str(settings.picture)
    return {"canvas": asdict(canvas), "brush": brush, "seed": seed, **furniture}


# Loading of the compiled kernels, before anything depends on a quick answer.


def load_kernels(brush: str) -> None:
    """Loads the kernels: dips, touches and takes a photograph in a small studio.

    This takes half a second, or more without a cache. It blocks all threads of a process, also the one that watches
    for a stop. Raises ConfigError for an unknown brush.
    """
    settings = StudioSettings(cell=2.0, camera=CameraSpec((30, 40)), print_pixels=100)
    easel = open_studio(CanvasSize(0.2, 0.2), brush, settings=settings).easel
    easel.robot.connect()
    easel.camera.connect()
    easel.operator.fill_wells(Palette(torch.full((1, 3), 0.5)))
    x, y, z = easel.workspace.canvas_origin
    down = np.array([[x + 0.01, y + 0.01, z + 0.01], [x + 0.01, y + 0.01, z - 0.001], [x + 0.01, y + 0.02, z - 0.001]])
    easel.robot.follow(Waypoints("dip", np.array([easel.workspace.wells[0]]), 0.1))
    easel.robot.follow(Waypoints("touch", down, 0.1))
    easel.operator.print_canvas()
    easel.camera.capture(0.0)
