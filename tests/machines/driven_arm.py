"""A real driver with its simulated machine as an arm of the virtual studio: what it does leaves paint on a canvas.

The studio sends ways to the arm; the driver drives them; the true positions of the tip come from the machine's
simulation, and the studio's brush goes there. The whole closed loop then paints with that driver: camera, looks, plans.

    with studio_arm("so101", furnish): open_studio(canvas, "fine", settings=StudioSettings(arm="so101"))
"""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch

from frida_painter import registry
from frida_painter.brush.kinds import brush_kind
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.faults import PlacementError
from frida_painter.hardware.robot import Waypoints, Workspace
from frida_painter.hardware.timing import Timing
from frida_painter.session.events import Event, Looked
from frida_painter.session.hand import Hand
from frida_painter.session.journal import Journal
from frida_painter.session.loop import PaintingSession
from frida_painter.session.observer import CanvasObserver
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.virtual.robot import Course, Way
from frida_painter.virtual.studio import ArmAndTable, HandNoise, StudioArm, StudioSettings, open_studio
from frida_painter.virtual.tabletop import StudioLayout
from support.virtual_painting import CANVAS, VirtualPainting

FURNISHED: dict[str, StudioArm] = {}
"""Arms of the studio while they are used, by name."""


def __getattr__(name: str) -> StudioArm:  # as the registry loads them
    if name not in FURNISHED:
        raise AttributeError(name)
    return FURNISHED[name]


@dataclass
class DrivenArm:
    """Arm of the studio that a driver moves. Implements virtual.robot.Arm.

    robot: the driver
    tips: returns the true positions of the tip [n, 3] until now
    now: returns the machine's time, seconds
    went: each way that it was sent, and the true positions on it
    """

    robot: Any
    tips: Callable[[], np.ndarray]
    now: Callable[[], float]
    went: list[tuple[Way, np.ndarray]] = field(default_factory=list)

    def connect(self, tip: np.ndarray) -> None:
        self.robot.connect()
        self.robot.home()

    def move(self, way: Way, stopped: threading.Event, pace: float) -> Course:
        since, began = len(self.tips()), self.now()
        report = self.robot.follow(Waypoints(way.label, way.path[1:], way.speed))
        places = self.tips()[max(0, since - 1) :]
        self.went.append((way, places))
        # The studio takes the end of the course for the report of the robot, which does not know of its play.
        return Course(np.concatenate([places, report.reached[None]]), self.now() - began)

    def state(self) -> Sequence[float]:
        return ()

    def remember(self, state: Sequence[float]) -> None:
        pass

    def close(self) -> None:
        self.robot.close()

    def off(self, below: float) -> tuple[float, float]:
        """Returns how far the tip was from its strokes where it was below that height: rms and worst, metres."""
        away = []
        for way, places in self.went:
            low = places[places[:, 2] < below]
            if way.label.startswith("stroke") and len(low):
                away.append(np.min([to_segment(low, one, other) for one, other in pairwise(way.path)], 0))
        found = np.concatenate(away)
        return float(np.sqrt((found**2).mean())), float(found.max())


def to_segment(places: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Returns the distance of places [n, 3] from the segment between two points."""
    along = end - start
    share = np.clip((places - start) @ along / max(float(along @ along), 1e-18), 0, 1)
    return np.linalg.norm(places - start - share[:, None] * along, axis=1)


@contextmanager
def studio_arm(name: str, furnish: Callable[[CanvasSize, Any, int], ArmAndTable]) -> Iterator[None]:
    """Registers an arm of the studio, as an entry point of a package would, and forgets it."""
    FURNISHED[name] = StudioArm(name, f"{name} in the studio", furnish)
    known = {**registry.OUR_PARTS, registry.STUDIO_ARMS: {name: f"{__name__}:{name}"}}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "OUR_PARTS", known)
        yield
    del FURNISHED[name]


def before_the_arm(left: float, near: float, height: float, press: float) -> StudioLayout:
    """Returns the layout of a small canvas before an arm: wells on its left, water and rag on its right.

    left, near: y of the canvas's left edge and x of its lower edge in the arm's frame; height: of the canvas; press:
    of the brush; metres
    """
    wells = tuple((near + 0.01 + 0.035 * i, left + 0.04, height) for i in range(3))
    right = left - CANVAS.width - 0.04
    home = (near + 0.03, left + 0.04, height + 0.04)
    workspace = Workspace(
        lower=(near - 0.03, right - 0.03, height - press - 0.004),
        upper=(near + CANVAS.height + 0.03, left + 0.07, height + 0.08),
        canvas_origin=(near, left, height),
        canvas_angle=-np.pi / 2,
        wells=wells,
        water=(near + 0.02, right, height),
        rag=(near + 0.06, right, height),
        rag_width=0.03,
        hover=0.02,
        painting_speed=0.03,
        travel_speed=0.08,
        home=home,
    )
    return StudioLayout(workspace, home)


@dataclass(frozen=True)
class DrivenPainting:
    """Result: strokes painted, looks at the canvas, the true canvas [3, h, w], root mean square and worst error (m)."""

    strokes: int
    looks: int
    canvas: torch.Tensor
    rms: float
    worst: float


def paint(
    arm: DrivenArm, layout: StudioLayout, strokes: int, replans: int, world: VirtualPainting, colors: int = 3
) -> DrivenPainting:
    """Paints a picture in the studio with a driven arm, in the closed loop."""
    table = ArmAndTable(layout, arm, HandNoise(0.0, 0.0), timing=Timing(0.3, 0.1, 0.02))
    settings = replace(StudioSettings(), placement_error=PlacementError((0.0, 0.0), 0.0), noise=HandNoise(0.0, 0.0))
    looks = 0

    def notify(event: Event) -> None:
        nonlocal looks
        looks += isinstance(event, Looked)

    with studio_arm("driven", lambda *_: table):
        studio = open_studio(CANVAS, "fine", settings=replace(settings, arm="driven"))
        easel = studio.easel
        easel.robot.connect()
        easel.camera.connect()
        session = PaintingSession(
            world.planner,
            Hand(easel, brush_kind("fine")),
            CanvasObserver(easel, None, None, wait=lambda seconds: None),
            EvenlySpaced(replans),
            notify=notify,
            journal=Journal(None),
        )
        painting = session.run(strokes, colors)
        easel.robot.close()
    rms, worst = arm.off(layout.workspace.canvas_origin[2] + 0.0005)
    return DrivenPainting(painting.painted, looks, studio.truth(360), rms, worst)
