"""A long painting, with the clock running fast: nothing piles up, and nothing is lost."""

import ctypes
import gc
import os
import resource
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import torch

from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.table import StrokeTable
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.session.events import Event, Planned, StrokePainted
from frida_painter.session.fold import PaintingState
from frida_painter.session.hand import Hand
from frida_painter.session.journal import Journal
from frida_painter.session.loop import PaintingSession
from frida_painter.session.observer import CanvasObserver
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system.event_log import EventLog
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, open_studio
from marks import coarse_table
from support.planning import picture, plain

PAINTS = 8
CANVAS = CanvasSize(0.24, 0.18)
SETTINGS = StudioSettings(cell=2.0, camera=CameraSpec(photograph=(120, 160)))
EFFORT = Effort().scale(0.001)


@dataclass
class Gauge:
    """Reads what a process holds after every twentieth stroke."""

    strokes: list[int] = field(default_factory=list)
    plans: int = 0
    memory: list[float] = field(default_factory=list)
    handles: list[int] = field(default_factory=list)

    def hear(self, event: Event) -> None:
        if isinstance(event, Planned):
            self.plans += 1
        if isinstance(event, StrokePainted):
            self.strokes.append(event.done)
            if event.done % 20 == 0:
                gc.collect()
                if hasattr(library := ctypes.CDLL(None), "malloc_trim"):  # else gaps between what is held count too
                    library.malloc_trim(0)
                pages = int(Path("/proc/self/statm").read_text().split()[1])
                self.memory.append(pages * resource.getpagesize() / 2**20)
                self.handles.append(len(os.listdir("/proc/self/fd")))  # noqa: PTH208


def made_up(model: StrokeTable, count: int) -> Plan:
    """Random strokes from light to dark."""
    random = torch.Generator().manual_seed(0)
    limits = model.limits.within(CANVAS)
    strokes = Strokes(
        torch.rand(count, 2, generator=random) * torch.tensor([CANVAS.width, CANVAS.height]),
        6 * torch.rand(count, generator=random),
        limits.length[0] + 0.02 * torch.rand(count, generator=random),
        torch.zeros(count),
        torch.rand(count, generator=random),
        torch.zeros(count, 3),
    ).project(limits, CANVAS)
    palette = Palette.sort_light_to_dark(torch.rand(PAINTS, 3, generator=random))
    paint = torch.arange(count) * PAINTS // count
    return Plan.of(strokes, palette, paint, canvas=CANVAS, brush=model.brush, limits=limits)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory and handles are read from /proc")
def test_many_strokes_and_replans_leave_memory_and_handles_as_they_are(tmp_path: Path) -> None:
    """tests/stress/claims.py paints 2000 strokes with 40 replans."""
    soak(tmp_path, 320, 12, growth=16)


def soak(folder: Path, strokes: int, replans: int, growth: float) -> None:
    """Paints so many strokes. growth: MB that may stay taken over the last quarter of them"""
    torch.set_num_threads(1)
    model = coarse_table(load_stroke_model("fine"))
    # A goal that is begun with something else spares looking for better places, which takes most of the time.
    goal = Goal((ImageTerm(picture(120, 160)),), initial=(ImageTerm(picture(120, 160)),))
    planner = Planner(goal, *plain(CANVAS, model, rows=64, effort=EFFORT, seed=0))
    studio = open_studio(CANVAS, "fine", settings=SETTINGS, state=folder / "studio.diary")
    easel = studio.easel
    easel.robot.connect()
    easel.camera.connect()
    gauge = Gauge()
    session = PaintingSession(
        planner,
        Hand(easel, brush_kind("fine")),
        CanvasObserver(easel),
        EvenlySpaced(replans),
        notify=gauge.hear,
        journal=Journal.begin(folder, {}, {}),
    )
    painting = session.run(strokes, PAINTS, made_up(model, strokes))
    assert painting.painted == strokes and gauge.strokes == list(range(1, strokes + 1))
    assert gauge.plans == 1 + replans
    history = PaintingState.of_journal(EventLog.read(folder / "journal"), folder)
    assert history.end.finished and history.progress.painted == strokes and len(history.planning.adopted) == 1 + replans
    half, last = len(gauge.memory) // 2, 3 * len(gauge.memory) // 4
    # What is taken for a moment and given back comes and goes; what stays is the least of each quarter.
    grown = min(gauge.memory[last:]) - min(gauge.memory[half:last])
    assert grown < growth, f"{grown:.1f} MB more over the last {strokes // 4} strokes"
    assert min(gauge.handles[last:]) <= min(gauge.handles[half:last]), "handles stay open"
    assert len(list(folder.glob("plan-*.safetensors"))) == 1 + replans, "copies of plan.json may name any of them"
