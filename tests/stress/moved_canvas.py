"""How often a canvas that nobody touched is said to have moved, and how often one that was moved is found.

    python tests/stress/moved_canvas.py [--seed 100] [--canvas 14x11in] [--moves 3] [--json figures.json]

Pictures with dark, white, patterned, framed, vignetted and striped edges are painted in the virtual studio by rough
plans that come of no planner, on every ground that the planner could choose. At every stage of each, three cameras in
three lights photograph the canvas as it lies, and moved and turned by known amounts; each photograph is judged against
that of the stage before. In some paintings the canvas was moved between two strokes. A rough plan smears wet paint as
no planner would: looks that are refused because of that, and not as moved, are counted beside.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from measure import Table, arguments, publish
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import FrameDoubtful, FrameRejected
from frida_painter.frames import PixelGrid
from frida_painter.hardware.faults import Bump, Faults, LightChange, PlacementError
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.frame_check import Expected, FrameCheck
from frida_painter.perception.rectify import rectify
from frida_painter.perception.registration import Verdict
from frida_painter.planning.ground import mean_color
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.planning.settings import PlannerSettings
from frida_painter.session.hand import Hand
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import WHITE, Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images
from frida_painter.virtual.camera import CameraSpec, VirtualCamera
from frida_painter.virtual.robot import Clock
from frida_painter.virtual.studio import VirtualStudio, open_studio

EDGES: tuple[str, ...] = ("dark", "white", "patterned", "framed", "vignetted", "striped")
STAGES = (0, 0.06, 0.5, 1.0)
"""Shares of the strokes that are on the canvas when it is looked at; before the first, it is seen bare."""
CAMERAS = (
    CameraSpec(),
    CameraSpec(tilt=math.radians(9), side=math.radians(-10), roll=math.radians(-1.5), lens=0.012, falloff=0.4),
    CameraSpec(photograph=(960, 1280), tilt=math.radians(22), side=0.0, roll=math.radians(2), noise=0.012),
)
_ROWS = 432
_STILL = PlacementError((0.0, 0.0), 0.0)


def picture_with(edge: str, random: np.random.Generator) -> Tensor:
    """A picture [3, 220, 280] with such edges, and something else in it for every state of the generator."""
    rows, columns = 220, 280
    down, across = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    tones = random.uniform(0.1, 0.95, (4, 3))
    image = tones[0] + (tones[1] - tones[0]) * down[..., None]
    for color in tones[2:]:
        center, axes = random.uniform(0.25, 0.75, 2), random.uniform(0.08, 0.25, 2)
        image[((across - center[0]) / axes[0]) ** 2 + ((down - center[1]) / axes[1]) ** 2 < 1] = color
    near = np.minimum(np.minimum(across, 1 - across) * columns, np.minimum(down, 1 - down) * rows)  # pixels
    width = random.uniform(4, 30)
    rim = (near < width)[..., None]
    if edge == "dark":
        image = np.where(rim, random.uniform(0.02, 0.12, 3), image)
    elif edge == "white":
        image = np.where(rim, 1.0, image)
    elif edge == "patterned":
        size = random.uniform(8, 24)
        checks = (np.floor(across * columns / size) + np.floor(down * rows / size)) % 2
        image = np.where(rim, np.where(checks[..., None] > 0, tones[0], tones[3]), image)
    elif edge == "framed":
        image = np.where(rim, np.where((near < 0.4 * width)[..., None], 0.03, tones[2]), image)
    elif edge == "vignetted":
        image = image * np.clip(1.15 - 1.3 * ((across - 0.5) ** 2 + (down - 0.5) ** 2) * 2, 0.03, 1)[..., None]
    else:
        stripes = np.floor((across + 0.3 * down) * columns / random.uniform(10, 30)) % 2
        image = np.where(stripes[..., None] > 0, image, random.uniform(0.02, 1, 3))
    return torch.from_numpy(np.ascontiguousarray(image.clip(0, 1).transpose(2, 0, 1))).float()


def rough_plan(picture: Tensor, size: CanvasSize, ground: tuple[float, ...], count: int, seed: int) -> Plan:
    """Strokes all over the canvas in the colours of a picture, many along its edges, in no wise order."""
    random = np.random.default_rng(seed)
    limits = brush_kind("broad").limits
    around = count // 3
    place = random.uniform(0, 1, (count, 2)) * (size.width, size.height)
    angle = random.uniform(-math.pi, math.pi, count)
    for number in range(around):  # along an edge, as near to it as a brush is wide, or not quite
        side, near = number % 4, random.uniform(0.001, 0.012)
        along = random.uniform(0, 1)
        place[number] = [(along * size.width, near), (along * size.width, size.height - near),
                         (near, along * size.height), (size.width - near, along * size.height)][side]  # fmt: skip
        angle[number] = 0.0 if side < 2 else math.pi / 2
    order = random.permutation(count)
    place, angle = place[order], angle[order]
    grid = PixelGrid.of_height(size, 220)
    fitted = images.fit(picture, grid.rows, grid.columns)
    length = random.uniform(0.5 * limits.length[1], limits.length[1], count)
    strokes = Strokes(
        position=torch.from_numpy(place).float(),
        angle=torch.from_numpy(angle).float(),
        length=torch.from_numpy(length).float(),
        bend=torch.from_numpy(random.uniform(*limits.bend, count) * 0.3).float(),
        thickness=torch.from_numpy(random.uniform(0.5, 1, count)).float(),
        color=torch.zeros(count, 3),
    ).project(limits, size)
    middle = strokes.path(torch.tensor([0.5]))[:, 0]
    column, row = grid.to_pixels(middle).round().long().T
    color = fitted[:, row.clamp(0, grid.rows - 1), column.clamp(0, grid.columns - 1)].T
    palette = Palette.cluster(color, torch.ones(count), 8, seed)
    paint = torch.cdist(color, palette.color).argmin(1)
    dealt = torch.argsort(paint, stable=True)
    chunks = [dealt[start::4] for start in range(4)]  # every quarter in the order of its paints
    chosen = torch.cat(chunks)
    return Plan.of(strokes[chosen], palette, paint[chosen], brush="broad", limits=limits, canvas=size, ground=ground)


@dataclass(frozen=True)
class Look:
    """One camera's look at a stage of a painting.

    first, before, seen: photographs of the bare canvas, of the stage before, and of this one; expected: what strokes
    were to make of it; shift, turn: metres and degrees by which the canvas or the camera was moved since.
    """

    edge: str
    ground: str
    stage: str
    camera: int
    how: str
    shift: float
    turn: float
    first: NDArray[np.uint8]
    before: NDArray[np.uint8]
    seen: NDArray[np.uint8]
    expected: Expected | None
    calibration: Calibration
    size: CanvasSize

    @property
    def moved(self) -> bool:
        return self.how != "still"


class Painter:
    """Paints a rough plan in a studio of its own, and has every camera look at each stage."""

    def __init__(
        self, edge: str, ground: tuple[float, float, float], size: CanvasSize, seed: int, strokes: int, moves: int
    ) -> None:
        self._random = np.random.default_rng((seed, EDGES.index(edge), int(255 * sum(ground))))
        self._edge, self._ground, self._size, self._moves, self._seed = edge, ground, size, moves, seed
        picture = picture_with(edge, np.random.default_rng((seed, EDGES.index(edge))))
        self.plan = rough_plan(picture, size, ground, strokes, seed)
        settings = PlannerSettings.of(
            canvas=size, brushes="broad", render_height=128, effort=0.05, seed=seed, layers=1, new_paints=False,
            focus="none",
        )  # fmt: skip
        self._planner = Planner(Goal((ImageTerm(picture, wanted=picture),)), settings)
        self.studio = open_studio(size, "broad", seed=seed)
        self.studio.easel.robot.connect()
        self._cameras = [_camera(self.studio, spec, seed + number) for number, spec in enumerate(CAMERAS)]
        self._hand = Hand(
            self.studio.easel, brush_kind("broad"), Placement.unknown(self.studio.easel.calibration.depths)
        )

    def looks(self, bumps: tuple[Bump, ...] = ()) -> Iterator[Look]:
        """Those at every stage, the canvas lying still and moved in a few ways; after a bump, one look and no more."""
        self.studio.easel.robot.home()
        table = self.studio.table
        first = [_photograph(camera) for camera in self._cameras]
        light = _light(first[0], self._record(0), self._size)
        before = first
        if self._ground != WHITE:
            self.studio.easel.operator.tone(self._ground)
        self.studio.easel.operator.fill_wells(self.plan.palette)
        seen = self._seen(light)
        done = 0
        ends = [round(share * len(self.plan)) for share in STAGES]
        self.studio.break_things(replace(Faults(), bumps=bumps))
        for stage, end in zip(("bare", "begun", "half", "finished"), ends, strict=True):
            expected = None
            if end > done:
                batch = self.plan.part(slice(done, end))
                for action in self._hand.prepare(batch, done, len(self.plan)):
                    self._hand.perform(action)
                self._hand.step_aside()
                expected = Expected(seen, self._planner.expected(batch, seen))
                done = end
            name = stage if stage != "bare" or self._ground == WHITE else "toned"
            knocked = table.knock
            if knocked != _STILL:
                yield from self._by_cameras(name, "in between", knocked, first, before, expected)
                return
            now = []
            for camera in self._cameras:
                lamps = self._random.uniform(0.93, 1.07)
                camera.faults = Faults(light_changes=(LightChange(0, (lamps,) * 3),))
                now.append(_photograph(camera))
            yield from self._looks_of(name, "still", _STILL, first, before, now, expected)
            for way, motion in _motions(self._random, self._moves):
                table.knock = motion
                yield from self._by_cameras(name, way, motion, first, before, expected)
            table.knock = _STILL
            if self._moves:
                yield from self._by_turned_camera(name, first, before, expected)
            placement = self._hand.placement
            canvas = self._seen(light)
            if expected is not None:
                self._hand.learn(self._planner.locate(batch, placement, seen, canvas))
            before, seen = now, canvas

    def _by_cameras(self, name: str, way: str, motion: PlacementError, first: Any, before: Any, expected: Any) -> Any:
        number = int(self._random.integers(len(self._cameras)))  # one of them
        now: list[NDArray[np.uint8] | None] = [None] * len(self._cameras)
        now[number] = _photograph(self._cameras[number])
        yield from self._looks_of(name, way, motion, first, before, now, expected)

    def _by_turned_camera(self, name: str, first: Any, before: Any, expected: Any) -> Iterator[Look]:
        """One of the cameras, turned by half a degree or a whole one about its axis."""
        number = int(self._random.integers(len(self._cameras)))
        turn = math.radians(self._random.choice((0.5, 1.0))) * self._random.choice((-1, 1))
        spec = CAMERAS[number]
        turned = _camera(self.studio, replace(spec, roll=spec.roll + turn), self._seed + number)
        now: list[NDArray[np.uint8] | None] = [None] * len(self._cameras)
        now[number] = _photograph(turned)
        yield from self._looks_of(name, "camera turned", PlacementError((0.0, 0.0), turn), first, before, now, expected)

    def _looks_of(
        self, name: str, way: str, motion: PlacementError, first: Any, before: Any, now: Any, expected: Any
    ) -> Any:
        ground = "white" if self._ground == WHITE else "mean" if self._ground[0] else "dark"
        for number, photograph in enumerate(now):
            if photograph is not None:
                yield Look(
                    self._edge, ground, name, number, way, math.hypot(*motion.shift), math.degrees(motion.turn),
                    first[number], before[number], photograph, expected, self._record(number), self._size,
                )  # fmt: skip

    def _record(self, number: int) -> Calibration:
        camera = self._cameras[number]
        return replace(
            self.studio.easel.calibration,
            corners=camera.corners, photograph=CAMERAS[number].photograph, lens=camera.lens,
        )  # fmt: skip

    def _seen(self, light: FlatField) -> Tensor:
        record = self._record(0)
        picture = rectify(_photograph(self._cameras[0]), record, PixelGrid.of_height(self._size, _ROWS))
        return true_color(light.correct(picture), record)


def _light(photograph: NDArray[np.uint8], record: Calibration, size: CanvasSize) -> FlatField:
    return FlatField.learn(rectify(photograph, record, PixelGrid.of_height(size, _ROWS)), WHITE)


def _camera(studio: VirtualStudio, spec: CameraSpec, seed: int) -> VirtualCamera:
    camera = VirtualCamera(spec, studio.table, Clock(), np.random.default_rng(seed))
    camera.connect()
    return camera


def _photograph(camera: VirtualCamera) -> NDArray[np.uint8]:
    return camera.capture(-1.0).image


def _motions(random: np.random.Generator, count: int) -> list[tuple[str, PlacementError]]:
    """Shifts from 1.5 to 6 mm in any direction, and turns from 0.5 to 2 degrees."""
    found = []
    for number in range(count):
        if number % 2 == 0:
            far, angle = random.choice((0.0015, 0.0015, 0.002, 0.003, 0.006)), random.uniform(0, 2 * math.pi)
            found.append(("shifted", PlacementError((far * math.cos(angle), far * math.sin(angle)), 0.0)))
        else:
            turn = math.radians(random.choice((0.5, 0.5, 0.7, 1.0, 2.0))) * random.choice((-1, 1))
            found.append(("turned", PlacementError((0.0, 0.0), float(turn))))
    return found


def grounds_of(edge: str, seed: int) -> list[tuple[float, float, float]]:
    """Those that the planner would choose among, and black."""
    picture = picture_with(edge, np.random.default_rng((seed, EDGES.index(edge))))
    return [WHITE, mean_color(picture), (0.0, 0.0, 0.0)]


@dataclass
class Count:
    """Of so many looks at canvases, how many verdicts were which."""

    still: int = 0
    unsure: int = 0
    moved: int = 0
    refused: int = 0

    @property
    def looks(self) -> int:
        return self.still + self.unsure + self.moved

    def add(self, verdict: str, *, refused: bool) -> None:
        setattr(self, verdict, getattr(self, verdict) + 1)
        self.refused += refused


def verdict_on(look: Look, known: dict[int, tuple[FrameCheck, FlatField]]) -> tuple[str, bool]:
    """As a painting judges every photograph, and whether it refuses this one for another reason than that it moved."""
    if id(look.first) not in known:
        known[id(look.first)] = (
            FrameCheck.learn(look.first, look.calibration, look.size),
            _light(look.first, look.calibration, look.size),
        )
    learned, light = known[id(look.first)]
    good = replace(learned, last=learned.view.light(look.before))
    picture = rectify(look.seen, look.calibration, PixelGrid.of_height(look.size, _ROWS))
    try:
        good.require(look.seen, true_color(light.correct(picture), look.calibration), look.expected)
    except FrameDoubtful:
        return "unsure", False
    except FrameRejected as reason:
        if "no longer where it was" in str(reason):
            return "moved", False
        found = {Verdict.STILL: "still", Verdict.UNSURE: "unsure", Verdict.MOVED: "moved"}
        return found[good.register(look.seen, look.expected).verdict], True
    return "still", False


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--canvas", default="14x11in")
    parser.add_argument("--strokes", type=int, default=120)
    parser.add_argument("--moves", type=int, default=3, help="at every stage")
    parser.add_argument("--grounds", type=int, default=3, help="of each picture")
    options = parser.parse_args()
    torch.set_num_threads(1)
    edges, strokes = EDGES, options.strokes
    if options.quick:
        edges, strokes, options.grounds, options.moves = ("framed",), 60, 2, 2
    size, random = CanvasSize.of(options.canvas), np.random.default_rng(options.seed)
    counts: dict[tuple[str, str], Count] = {}
    missed: list[str] = []
    for number, edge in enumerate(edges):
        for ground in grounds_of(edge, options.seed + number)[: options.grounds]:
            seed = options.seed + number
            bump = Bump(int(random.integers(8, strokes)), tuple(0.0015 * _way(random)))
            painters = (
                (Painter(edge, ground, size, seed, strokes, options.moves), ()),
                (Painter(edge, ground, size, seed, strokes, 0), (bump,)),
            )
            for painter, bumps in painters:
                known: dict[int, tuple[FrameCheck, FlatField]] = {}
                for look in painter.looks(bumps):
                    if bumps and not look.moved:
                        continue  # seen before
                    verdict, refused = verdict_on(look, known)
                    counts.setdefault((look.stage, look.how), Count()).add(verdict, refused=refused)
                    if verdict != ("moved" if look.moved else "still"):
                        missed.append(
                            f"{verdict}: {look.edge}, ground {look.ground}, {look.stage}, camera {look.camera}, "
                            f"{look.how} {1000 * look.shift:.1f} mm {look.turn:.2f} degrees"
                        )
                        print(missed[-1], flush=True)
    still, moved = (
        _sum([each for (_, how), each in counts.items() if (how == "still") is quiet]) for quiet in (True, False)
    )
    rows = [(*key, *_row(count)) for key, count in sorted(counts.items(), key=lambda item: item[0][1] != "still")]
    table = Table(
        f"Looks at canvases of {options.canvas}, seed {options.seed}",
        ("stage", "canvas or camera", "looks", "lies still", "cannot tell", "was moved", "refused otherwise"),
        [*rows, ("all", "still", *_row(still)), ("all", "moved", *_row(moved))],
        [
            f"False alarms: {still.looks - still.still} of {still.looks}. Found: {moved.looks - moved.still} of "
            f"{moved.looks} ({100 * (moved.looks - moved.still) / max(1, moved.looks):.1f} %), surely {moved.moved}."
        ],
    )
    publish([table], {"false": still.looks - still.still, "still": still.looks, "missed": missed}, options)


def _way(random: np.random.Generator) -> NDArray[np.float64]:
    angle = random.uniform(0, 2 * math.pi)
    return np.array([math.cos(angle), math.sin(angle)])


def _row(count: Count) -> tuple[str, ...]:
    return tuple(map(str, (count.looks, count.still, count.unsure, count.moved, count.refused)))


def _sum(counts: list[Count]) -> Count:
    whole = Count()
    for count in counts:
        for name in ("still", "unsure", "moved", "refused"):
            setattr(whole, name, getattr(whole, name) + getattr(count, name))
    return whole


if __name__ == "__main__":
    main()
