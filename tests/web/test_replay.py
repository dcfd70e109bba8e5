"""What the page shows of a painting is a fold of its feed: replayed to any event, it is what was shown then."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from frida_painter.brush.weights import load_stroke_model
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.session import events
from frida_painter.session.events import Event
from frida_painter.session.journal import History, Journal
from frida_painter.session.progress import ResumeState
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.session.resuming import load_kept_plan
from frida_painter.session.time_left import RemainingTime
from frida_painter_studio.commands import GO_ON, LOOK, tell_worker
from frida_painter_studio.painter import PauseController
from frida_painter_studio.painting_state import PaintingState, Truth
from frida_painter_studio.stop import StopWatch
from frida_painter_studio.studio_folder import Feed, FeedReader, PaintingFolder
from frida_painter_studio.telling import Reporter, export
from support.easel import PatientCamera
from support.planning import CANVAS, goal, plain, small_table
from support.plans import in_layers, made_up_plan
from support.session import SessionSetup

STROKES, PAUSE_AFTER, STOP_AFTER = 6, 2, 4


@dataclass
class Page:
    """A page that is open all the time: what it showed, and how long the feed was then."""

    folder: PaintingFolder
    state: PaintingState = field(default_factory=PaintingState)
    shown: list[tuple[int, dict[str, Any]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._reader = FeedReader(self.folder.feed)

    def look(self) -> None:
        for event in self._reader.read():
            self.state.hear(event)
        self.shown.append((self.folder.feed.stat().st_size, self.state.to_plain(Truth(working=True))))


class Sitting(SessionSetup):
    """A painting on the stub easel, planned with a real planner and told to the page."""

    def lead(self, folder: PaintingFolder, planner: Planner, page: Page, feed: Feed) -> None:
        self.page = page
        self.controller = PauseController(folder, feed, StopWatch(folder.stop, folder.path.parent), 0.0)
        time_left = RemainingTime(STROKES, EvenlySpaced(self.replans), 0.0, planning=4, replanning=4)
        self.reporter = Reporter(feed, folder, planner.models, CANVAS, time_left)
        self.controller.opened = lambda: self.session
        self.session.planner = planner

    def _hear(self, event: Event) -> None:
        super()._hear(event)
        self.reporter.hear(event)
        self.controller.hear(event)
        self.page.look()

    def _answer(self, paused: events.Paused) -> bool:
        super()._answer(paused)
        for command in (LOOK, GO_ON):
            tell_worker(self.controller.folder, command, "browser")
        return self.controller.go_on(paused)


def after(stroke: int) -> Any:
    return lambda event: isinstance(event, events.StrokePainted) and event.done == stroke


def test_a_replayed_feed_shows_what_the_page_showed_at_every_moment(tmp_path: Path) -> None:
    (tmp_path / "live").mkdir()
    folder, feed = PaintingFolder(tmp_path), Feed(PaintingFolder(tmp_path))
    page = Page(folder)
    planner = Planner(goal(), plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.02), seed=1))
    bare = torch.ones(3, planner.fine.rows, planner.fine.columns)
    made = planner.plan(bare, STROKES, 1, lambda step: None)

    feed.tell(events.PlanRequested(1, {"strokes": STROKES}))
    feed.tell(events.PaintingStarted(1, STROKES))
    journal = Journal.begin(folder.painting, {}, {})
    first = Sitting(
        STROKES,
        replans=1,
        pause_at=after(PAUSE_AFTER),
        stop_at=after(STOP_AFTER),
        journal=journal,
        camera=PatientCamera(noisy=True),
        simulated=True,  # it shows no strokes, and nobody is there to ask whether its canvas lies still
    )
    first.lead(folder, planner, page, feed)
    first.session.run(STROKES, 1, made)
    journal.close()
    page.look()
    assert page.state.to_plain(Truth(working=False))["painting"]["status"] == "stopped"

    journal, history = Journal.reopen(folder.painting)
    feed.tell(events.TakenUp(history.painted))
    kept = load_kept_plan(folder.painting, history)
    assert kept is not None and history.painted == STOP_AFTER
    journal.record_resume(history, repaint=False)
    second = Sitting(STROKES, replans=1, journal=journal, camera=PatientCamera(noisy=True), simulated=True)
    second.lead(folder, planner, page, feed)
    now = second.session.look()
    where = ResumeState(kept.plan, history.painted, kept.planning.done, None, now)
    assert second.session.resume(where).painted == STROKES
    feed.tell(events.Finishing())
    feed.tell(events.PaintingKept(film=False))
    page.look()
    journal.close()

    states = [shown["painting"]["status"] for _, shown in page.shown if shown["painting"]]
    assert {"mixing", "painting", "planning", "stopped", "finished"} <= set(states)
    assert {"Paused", "WentOn", "Stopped"} <= {type(event).__name__ for event in FeedReader(folder.feed).read()}
    content = folder.feed.read_bytes()
    for length, shown in page.shown:
        (tmp_path / "prefix").write_bytes(content[:length])
        again = PaintingState()
        for event in FeedReader(tmp_path / "prefix").read():
            again.hear(event)
        assert again.to_plain(Truth(working=True)) == shown
    assert page.shown[-1][1]["painting"]["done"] == STROKES
    history = Journal.reopen(folder.painting)[1]
    assert isinstance(history, History) and history.finished and history.painted == STROKES
    assert isinstance(first.heard[-1], events.Stopped)


def test_a_painter_that_takes_up_a_painting_overwrites_no_picture(tmp_path: Path) -> None:
    """What the page shows of a moment stays what it was; a card names the look that it shows."""
    folder = PaintingFolder(tmp_path)
    folder.live.mkdir()
    kept: dict[str, bytes] = {}
    for sitting in (0.2, 0.8):
        time_left = RemainingTime(STROKES, EvenlySpaced(1), 0.0, planning=4, replanning=4)
        reporter = Reporter(Feed(folder), folder, {}, CANVAS, time_left)
        seen = torch.full((3, 24, 32), sitting)
        reporter.hear(events.TimelapseFrame(seen, 2, STROKES, (0.0, 0.0, 0.0)))
        reporter.hear(events.Looked(seen, seen, 2))
        now = {path.name: path.read_bytes() for path in folder.live.iterdir()}
        assert len(now) > len(kept) and kept.items() <= now.items()
        kept = now
    looks = [event for event in FeedReader(folder.feed).read() if isinstance(event, events.LookShown)]
    assert len({look.seen for look in looks}) == 2, "each card has a picture of its own"


def test_a_plan_is_written_for_plotters_and_machines(tmp_path: Path) -> None:
    plan = in_layers(made_up_plan(6, 2), 4, 2)
    export(plan, {"medium": load_stroke_model("broad")}, tmp_path, drying=45)
    assert (tmp_path / "strokes.svg").read_text().startswith("<?xml")
    program = (tmp_path / "strokes.gcode").read_text()
    assert "M0" in program and "dry for 45 minutes" in program
    assert (tmp_path / "strokes.csv").stat().st_size > 100
