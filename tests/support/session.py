"""A painting on the stub easel, whose planner thinks nothing and whose robot only takes notes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from unittest.mock import patch

import torch
from torch import Tensor

from frida_painter.brush.kinds import BrushKind
from frida_painter.calibration import BrushRecord
from frida_painter.hardware.robot import BrushRack
from frida_painter.perception.registration import CanvasShift, Registration, Verdict
from frida_painter.planning.effort import Effort
from frida_painter.planning.forecast import Fading, SimilarityForecast
from frida_painter.planning.optimize import Step
from frida_painter.planning.placement import Placement
from frida_painter.planning.problem import Region
from frida_painter.planning.wet_paint import Wetness
from frida_painter.session.controls import Controls
from frida_painter.session.events import Event, Paused
from frida_painter.session.hand import Hand
from frida_painter.session.journal import Journal
from frida_painter.session.loop import Extent, PaintingSession
from frida_painter.session.observer import CanvasObserver
from frida_painter.session.progress import Painting, PaintingProgress
from frida_painter.session.replan_policy import EvenlySpaced, ReplanPolicy
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from marks import SMALL
from support.easel import NotingRobot, PatientCamera, stub_easel
from support.planning import CANVAS, some_strokes
from support.plans import in_layers

BRUSH = BrushKind("small", SMALL.limits, SMALL.width)


@dataclass
class NotingPlanner:
    """Plans random strokes in two steps, plans again by turning them, and notes how many it was given."""

    ground = (1.0, 1.0, 1.0)
    region = None
    seed = 0
    size = CANVAS
    effort = Effort()
    encoders = None
    layers: tuple[int, ...] = ()
    brushes: tuple[str, ...] = ()
    fresh: list[bool] = field(default_factory=list)
    asked: list[int] = field(default_factory=list)
    canvases: list[Tensor] = field(default_factory=list)
    located: list[int] = field(default_factory=list)
    placements: list[Placement] = field(default_factory=list)
    left_out: list[int] = field(default_factory=list)
    wet: list[Wetness | None] = field(default_factory=list)
    replanned: list[Wetness | None] = field(default_factory=list)
    settled: list[tuple[Wetness, bool]] = field(default_factory=list)

    def keeping_clear(self, region: Region | None) -> "NotingPlanner":
        """Itself: no stroke of it keeps clear of anything."""
        return self

    def plan(self, canvas: Tensor, strokes: int, colors: int, notify: Callable[[Step], None]) -> Plan:
        notify(Step(1, 2, 0.5))
        notify(Step(2, 2, 0.4))
        palette = Palette.sort_light_to_dark(torch.rand(colors, 3, generator=torch.Generator().manual_seed(1)))
        paint = torch.arange(strokes) * colors // strokes
        if self.layers:
            paint = torch.cat([torch.arange(count) * colors // count for count in self.layers])
        plan = Plan.of(some_strokes(strokes), palette, paint, canvas=CANVAS, brush="small", limits=SMALL.limits)
        plan = in_layers(plan, *self.layers) if self.layers else plan
        named = zip(plan.layers, self.brushes or ["small"] * len(plan.layers), strict=True)
        return replace(plan, layers=tuple(replace(layer, brush=brush) for layer, brush in named))

    def bind_to_palette(self, plan: Plan, canvas: Tensor, palette: Palette, notify: Callable[[Step], None]) -> Plan:
        notify(Step(1, 1, 0.35))
        paint = palette.nearest(plan.strokes.color)
        return Plan.of(plan.strokes, palette, paint, canvas=CANVAS, brush="small", limits=SMALL.limits)

    def fading(self, plan: Plan, canvas: Tensor) -> Fading:
        return Fading.none(len(plan))

    def without_weakest(self, plan: Plan, canvas: Tensor, count: int) -> Plan:
        self.left_out.append(count)
        return plan.part(slice(len(plan) - count))

    def replan(
        self,
        rest: Plan,
        canvas: Tensor,
        notify: Callable[[Step], None],
        rounds: int = 1,
        *,
        fresh: bool = False,
        wetness: Wetness | None = None,
    ) -> Plan:
        self.replanned.append(wetness)
        self.asked.append(len(rest))
        self.fresh.append(fresh)
        self.canvases.append(canvas)
        notify(Step(1, 1, 0.3))
        return rest

    def settle_wet(
        self, rest: Plan, canvas: Tensor, wetness: Wetness, notify: Callable[[Step], None], *, mixed: bool
    ) -> Plan:
        self.settled.append((wetness, mixed))
        return rest

    def locate(self, painted: Plan, known: Placement, before: Tensor, seen: Tensor) -> Placement:
        self.located.append(len(painted))
        self.placements.append(replace(known, error=(0.001 * len(self.located), 0.0, 0.0)))
        return self.placements[-1]

    def expected(self, plan: Plan, canvas: Tensor, wetness: Wetness | None = None) -> Tensor:
        return torch.full((3, 48, 64), 1 - len(plan) / 1000)

    def validation_loss(self, picture: Tensor) -> float:
        return float(picture.mean())

    def expected_loss(self, plan: Plan, canvas: Tensor, wetness: Wetness | None = None) -> float:
        return self.validation_loss(self.expected(plan, canvas))

    def forecast(
        self, plan: Plan, canvas: Tensor, placement: Placement, unseen: int, wetness: Wetness | None, painted: int
    ) -> SimilarityForecast:
        self.wet.append(wetness)
        assert 0 <= unseen <= len(plan)
        return SimilarityForecast(20 + len(plan) / 100, 19.0, 25.0)


@contextmanager
def unmoved_canvas() -> Iterator[None]:
    """Nobody looks whether the stub's canvas, which is white, still lies where it lay: that takes half of the time."""
    still = Registration(Verdict.STILL, CanvasShift())
    with patch("frida_painter.perception.frame_check.register", lambda *given: still):
        yield


@dataclass
class SessionSetup:
    """One painting on the stub easel, and everything that was heard of it."""

    strokes: int
    replans: int = 1
    timelapse_frames: int = 0
    colors: int = 1
    stop_at: Callable[[Event], bool] = lambda event: False
    pause_at: Callable[[Event], bool] = lambda event: False
    go_on: Callable[[Paused], bool] = lambda paused: False
    mixed: Callable[[Palette], Palette | None] = lambda wanted: None
    policy: ReplanPolicy | None = None
    journal: Journal = field(default_factory=lambda: Journal(None))
    robot: NotingRobot = field(default_factory=NotingRobot)
    camera: PatientCamera = field(default_factory=PatientCamera)
    planner: NotingPlanner = field(default_factory=NotingPlanner)
    heard: list[Event] = field(default_factory=list)
    budget: float | None = None
    rack: BrushRack | None = None
    simulated: bool = False
    stopping: bool = False
    pausing: bool = False

    def __post_init__(self) -> None:
        self.easel = stub_easel(self.robot, self.camera)
        others = [name for name in dict.fromkeys(self.planner.brushes) if name != BRUSH.name]
        record = self.easel.calibration
        heights = BrushRecord(record.touch_height, record.press_height)
        self.easel = replace(
            self.easel,
            calibration=replace(record, others=dict.fromkeys(others, heights)),
            workspace=replace(self.easel.workspace, rack=self.rack),
            simulated=self.simulated,
        )
        self.observer = CanvasObserver(self.easel)
        self.hand = Hand(self.easel, BRUSH, others=tuple(BrushKind(name, SMALL.limits, SMALL.width) for name in others))
        self.session = PaintingSession(
            self.planner,  # type: ignore[arg-type]
            self.hand,
            self.observer,
            self.policy or EvenlySpaced(self.replans),
            notify=self._hear,
            journal=self.journal,
            controls=Controls(
                stop_asked=lambda: self.stopping,
                pause_cause=lambda: "person" if self.pausing else None,
                go_on=self._answer,
                mixed=self.mixed,
            ),
            extent=Extent(self.budget, frames=self.timelapse_frames),
        )

    def run(self) -> Painting:
        with unmoved_canvas():
            return self.session.run(self.strokes, self.colors)

    def resume(self, where: PaintingProgress) -> Painting:
        with unmoved_canvas():
            return self.session.resume(where)

    @property
    def placements(self) -> list[Placement]:
        return self.planner.placements

    def _answer(self, paused: Paused) -> bool:
        self.pausing = False
        return self.go_on(paused)

    def _hear(self, event: Event) -> None:
        self.heard.append(event)
        self.journal.show(event)  # as the engine does
        self.stopping = self.stopping or self.stop_at(event)
        self.pausing = self.pausing or self.pause_at(event)

    def kinds(self, *leaving_out: type) -> list[str]:
        return [type(event).__name__ for event in self.heard if not isinstance(event, leaving_out)]

    def painted(self) -> list[int]:
        """The strokes that the robot painted, by number."""
        return [int(label.split()[1]) for label in self.robot.labels() if label.startswith("stroke")]
