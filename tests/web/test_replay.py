"""What the page shows of a painting is a fold of its journal: replayed to any event, it is what was shown then."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from frida_painter.easel.kinds import LIVE
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.session import events
from frida_painter.session.events import Event
from frida_painter.session.journal import Journal
from frida_painter.session.progress import PaintingProgress
from frida_painter.session.resuming import load_kept_plan
from frida_painter.system.event_log import LogReader
from frida_painter_studio.painting_state import PaintingPage, Truth
from frida_painter_studio.studio_folder import read_events
from frida_painter_together.commands import GO_ON, LOOK
from frida_painter_together.conductor import Conductor
from frida_painter_together.inbox import send
from frida_painter_together.plan_pictures import PlanPictures
from support.easel import PatientCamera
from support.planning import CANVAS, goal, plain, small_table
from support.session import SessionSetup

STROKES, PAUSE_AFTER, STOP_AFTER = 6, 2, 4


@dataclass
class Viewer:
    """A page that is open all the time: what it showed, and how long the journal was then."""

    journal: Path
    page: PaintingPage = field(default_factory=PaintingPage)
    shown: list[tuple[int, dict[str, Any]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._log = LogReader(self.journal)

    def look(self) -> None:
        for event, at in read_events(self._log):
            self.page.hear_painting(event, at)
        self.shown.append((self.journal.stat().st_size, self.page.to_plain(Truth(working=True))))


class Sitting(SessionSetup):
    """A painting on the stub easel, planned with a real planner and shown on the page."""

    def lead(self, folder: Path, planner: Planner, viewer: Viewer) -> None:
        self.viewer = viewer
        self.controller = Conductor(folder, self._hear, lambda: False, 0.0, opened=lambda: self.session)
        self.pictures = PlanPictures(folder / LIVE, planner.bare, planner.models, CANVAS)
        self.session.planner = planner

    def _hear(self, event: Event) -> None:
        super()._hear(self.pictures.hear(event))
        self.controller.hear(event)
        self.viewer.look()

    def _answer(self, paused: events.Paused) -> bool:
        super()._answer(paused)
        for command in (LOOK, GO_ON):
            send(self.controller.folder, command)
        return self.controller.go_on(paused)


def after(stroke: int) -> Any:
    return lambda event: isinstance(event, events.StrokePainted) and event.done == stroke


def test_a_replayed_journal_shows_what_the_page_showed_at_every_moment(tmp_path: Path) -> None:
    planner = Planner(goal(), *plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.02), seed=1))
    bare = torch.ones(3, planner.fine.rows, planner.fine.columns)
    made = planner.plan(bare, STROKES, 1, lambda step: None)

    journal = Journal.begin(tmp_path, {}, {})
    viewer = Viewer(tmp_path / "journal")
    first = Sitting(
        STROKES,
        replans=1,
        pause_at=after(PAUSE_AFTER),
        stop_at=after(STOP_AFTER),
        journal=journal,
        camera=PatientCamera(noisy=True),
        simulated=True,  # it shows no strokes, and nobody is there to ask whether its canvas lies still
    )
    first.lead(tmp_path, planner, viewer)
    first.session.run(STROKES, 1, made)
    journal.close()
    viewer.look()
    assert viewer.shown[-1][1]["painting"]["status"] == "stopped"

    journal, state = Journal.reopen(tmp_path)
    kept = load_kept_plan(tmp_path, state)
    assert kept is not None and state.progress.painted == STOP_AFTER
    journal.record_resume(repaint=False)
    second = Sitting(STROKES, replans=1, journal=journal, camera=PatientCamera(noisy=True), simulated=True)
    second.lead(tmp_path, planner, viewer)
    now = second.session.look()
    where = PaintingProgress.resume(kept.plan, state.progress.painted, kept.planning.done, None, now)
    assert second.session.resume(where).painted == STROKES
    for event in (events.Began("results"), events.ResultFound("results", detail={"film": False})):
        second._hear(event)
    journal.close()

    statuses = [shown["painting"]["status"] for _, shown in viewer.shown]
    assert {"mixing", "painting", "planning", "stopped", "finished"} <= set(statuses)
    assert any(shown["painting"]["planning"]["replanned"] for _, shown in viewer.shown)
    content = viewer.journal.read_bytes()
    for length, shown in viewer.shown:
        (tmp_path / "prefix").write_bytes(content[:length])
        again = PaintingPage()
        for event, at in read_events(LogReader(tmp_path / "prefix")):
            again.hear_painting(event, at)
        assert again.to_plain(Truth(working=True)) == shown
    assert viewer.shown[-1][1]["painting"]["progress"]["painted"] == STROKES
    assert state.end.finished and Journal.reopen(tmp_path)[1].end.finished
    assert isinstance(first.heard[-1], events.Stopped)
