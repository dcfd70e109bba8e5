"""Paintings of twelve strokes in a small virtual studio, kept in a folder, with all that resuming them takes."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from frida_painter.brush.kinds import Dip, brush_kind
from frida_painter.brush.table import StrokeTable, TableDetail
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import PaintingPaused
from frida_painter.hardware.faults import NO_FAULTS, Faults
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.session import resuming
from frida_painter.session.events import Event, Paused
from frida_painter.session.fold import PaintingState
from frida_painter.session.hand import Hand
from frida_painter.session.journal import Journal, placement_of
from frida_painter.session.loop import PaintingSession
from frida_painter.session.observer import CanvasObserver
from frida_painter.session.progress import Painting, PaintingProgress
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.strokes.plan import Plan
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, VirtualStudio, open_studio
from support import data
from support.planning import as_it_is, plain

CANVAS = CanvasSize(0.12, 0.09)
STROKES, REPLANS = 12, 2
SETTINGS = StudioSettings(cell=0.8, camera=CameraSpec(photograph=(240, 320)))
RESTS_ON = {"goal": "coffee"}


@dataclass
class VirtualPainting:
    """Everything that a painting in a folder needs; what was planned once is remembered."""

    planner: Planner
    known: dict[bytes, Plan] = field(default_factory=dict)

    @classmethod
    def made(cls, seed: int = 0) -> "VirtualPainting":
        torch.set_num_threads(1)
        model = StrokeTable.of(load_stroke_model("fine"), detail=TableDetail((2, 2, 2), 8))
        coffee = torch.from_numpy(data.coffee().copy()).permute(2, 0, 1).float() / 255
        planner = Planner(as_it_is(coffee), *plain(CANVAS, model, rows=64, effort=Effort().scale(0.05), seed=seed))
        world = cls(planner)
        plan = planner.plan

        def remembered(canvas: Tensor, *rest: Any) -> Plan:
            key = canvas.numpy().tobytes()
            if key not in world.known:
                world.known[key] = plan(canvas, *rest)
            return world.known[key]

        planner.plan = remembered  # type: ignore[method-assign]
        return world

    def session(
        self,
        folder: Path,
        journal: Journal,
        history: PaintingState | None = None,
        *,
        seed: int = 0,
        faults: Faults = NO_FAULTS,
        notify: Callable[[Event], None] = lambda event: None,
        **more: Any,
    ) -> tuple[PaintingSession, VirtualStudio]:
        studio = open_studio(CANVAS, "fine", seed=seed, settings=SETTINGS, faults=faults, state=folder / "studio.diary")
        easel = studio.easel
        easel.robot.connect()
        easel.camera.connect()
        kept = history and resuming.load_kept_plan(folder, history)
        # Short dips, so that it matters little that a brush was cleaned and dipped anew after a crash.
        hand = Hand(easel, replace(brush_kind("fine"), known_dip=Dip(2.6e-4)))
        if kept:
            hand.learn(placement_of(kept.planning))
        session = PaintingSession(
            self.planner,
            hand,
            CanvasObserver(easel, None, history and resuming.light(history), wait=lambda seconds: None),
            EvenlySpaced(REPLANS),
            notify=notify,
            journal=journal,
            **more,
        )
        return session, studio

    def paint(self, folder: Path, kind: type[Journal] = Journal) -> VirtualStudio:
        journal = kind.begin(folder, {"strokes": STROKES}, RESTS_ON)
        session, studio = self.session(folder, journal)
        session.run(STROKES, 3)
        journal.close()
        studio.close()
        return studio

    def pauses(self, folder: Path, faults: Faults, seed: int = 0, plan: Plan | None = None) -> list[Paused]:
        """The pauses of a painting, by a plan that was made before where there is one; nobody has it go on."""
        heard: list[Event] = []
        journal = Journal.begin(folder, {}, {})
        session, studio = self.session(folder, journal, seed=seed, faults=faults, notify=heard.append)
        try:
            assert session.run(STROKES, 3, plan).painted == STROKES
        except PaintingPaused as paused:
            assert "has paused after" in str(paused)
        finally:
            journal.close()
            studio.close()
        return [event for event in heard if isinstance(event, Paused)]

    def refusals(self, folder: Path, seeds: Iterable[int]) -> dict[int, list[Paused]]:
        """Pauses of paintings by one plan in studios of these seeds, of those that paused."""
        plan = self.planner.plan(torch.ones(3, *self.planner.bare.shape[1:]), STROKES, 3, lambda step: None)
        pauses = {seed: self.pauses(folder / str(seed), NO_FAULTS, seed, plan) for seed in seeds}
        return {seed: found for seed, found in pauses.items() if found}

    def resume(self, folder: Path, *, repaint: bool = False) -> tuple[Painting, VirtualStudio, PaintingState]:
        journal, history = Journal.reopen(folder)
        session, studio = self.session(folder, journal, history)
        now = session.look()
        journal.record_resume(repaint=repaint)
        kept = resuming.load_kept_plan(folder, history)
        if kept is None:
            painting = session.run(STROKES, 3)
        else:
            before = resuming.load_seen_canvas(folder, kept, session.observer)
            painting = session.resume(
                PaintingProgress.resume(kept.plan, history.progress.painted, kept.planning.done, before, now)
            )
        journal.close()
        studio.close()
        return painting, studio, history
