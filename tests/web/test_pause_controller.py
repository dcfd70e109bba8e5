import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import pytest
import torch

from frida_painter import images
from frida_painter.planning.layers import Effort
from frida_painter.planning.planner import Planner
from frida_painter.runs.painting_folder import read_goal
from frida_painter.session import resuming
from frida_painter.session.events import (
    Event,
    GoalChanged,
    Paused,
    Planned,
    RegionProtected,
    Remark,
    StrokePainted,
    WentOn,
)
from frida_painter.session.journal import Journal
from frida_painter.web.commands import tell_painter
from frida_painter.web.painter import PauseController
from frida_painter.web.stop import StopPressed, StopWatch
from frida_painter.web.studio_folder import Feed, FeedReader, PaintingFolder, PaintingRequest
from support.planning import CANVAS, goal, picture, plain, small_table
from support.session import SessionSetup

PICTURE = "a" * 32
Told = TypeVar("Told")


@pytest.fixture
def folder(tmp_path: Path) -> PaintingFolder:
    (tmp_path / "live").mkdir()
    return PaintingFolder(tmp_path)


class Table:
    """A painting on the stub easel with a person who answers its pauses, one command after another."""

    def __init__(
        self, folder: PaintingFolder, strokes: int, *, pause_after: int = 2, journal: Journal | None = None
    ) -> None:
        self.folder = folder
        self.feed = Feed(folder)
        self.stop = StopWatch(folder.stop, folder.path.parent)
        self.controller = PauseController(folder, self.feed, self.stop, 0.0)
        self.setup = SessionSetup(
            strokes,
            replans=0,
            pause_at=self._pauses(pause_after),
            go_on=self._go_on,
            journal=journal or Journal.nowhere(),
        )
        self.setup.session.interruptions.pause_asked = self._pause_asked
        self.controller.opened = lambda: self.setup.session
        self.says: list[tuple[str, dict[str, int]]] = []
        deadline = threading.Timer(30, folder.stop.touch)  # a pause that nobody ends is not waited for
        deadline.daemon = True
        deadline.start()

    def told(self, kind: type[Told]) -> list[Told]:
        return [event for event in FeedReader(self.folder.feed).read() if isinstance(event, kind)]

    def _pauses(self, after: int) -> Any:
        def pause_at(event: Event) -> bool:
            self.controller.hear(event)
            return isinstance(event, StrokePainted) and event.done == after

        return pause_at

    def _pause_asked(self) -> bool:
        return self.controller.pause_asked() or self.setup.pausing

    def _go_on(self, paused: Paused) -> bool:
        def answer() -> None:
            for kind, more in self.says:
                tell_painter(self.folder, kind, "browser", **more)  # type: ignore[arg-type]

        threading.Timer(0.05, answer).start()
        return self.controller.go_on(paused)


@pytest.mark.slow
def test_in_a_pause_strokes_are_left_out_and_the_painting_goes_on(folder: PaintingFolder) -> None:
    table = Table(folder, 8)
    table.says = [("look", {}), ("leave out", {"count": 3}), ("pause", {}), ("go on", {})]
    assert table.setup.run().painted == 5
    assert len(table.told(Paused)) == 4 and len(table.told(WentOn)) == 1
    assert "let it look" in table.told(Paused)[0].reason


@pytest.mark.slow
def test_turns_are_taken(folder: PaintingFolder) -> None:
    table = Table(folder, 7)
    table.says = [("turns", {"count": 2}), ("go on", {})]
    assert table.setup.run().painted == 7
    turns = [event for event in table.told(Paused) if event.turn]
    assert len(turns) >= 2 and "your turn" in turns[0].reason


@pytest.mark.slow
def test_what_cannot_be_done_is_told_and_nothing_goes_on(folder: PaintingFolder) -> None:
    table = Table(folder, 4)
    table.setup.planner.size = CANVAS  # type: ignore[attr-defined]
    images.save(torch.zeros(3, 40, 50), folder.region(1))
    table.says = [("spare", {"record": 1}), ("spare", {"record": 2}), ("goal", {"record": 9}), ("go on", {})]
    assert table.setup.run().painted == 4
    sentences = [event.sentence for event in table.told(Remark)]
    assert "Nothing was drawn" in sentences[0] and len(sentences) == 3
    assert not any(str(folder.path) in sentence for sentence in sentences)


def test_why_it_has_paused_is_told_without_a_path(folder: PaintingFolder) -> None:
    feed = Feed(folder)
    controller = PauseController(folder, feed, StopWatch(folder.stop, folder.path.parent), 0.0)
    tell_painter(folder, "go on", "browser")
    assert controller.go_on(Paused(f"{folder.painting}/journal cannot be written; make room.", 3))
    reasons = [event.reason for event in FeedReader(folder.feed).read() if isinstance(event, Paused)]
    assert reasons == ["its folder/painting/journal cannot be written; make room."]


def test_what_was_asked_after_a_pause_is_done_in_that_pause(folder: PaintingFolder) -> None:
    controller = PauseController(folder, Feed(folder), StopWatch(folder.stop, folder.path.parent), 0.0)
    for name, about in (("turns", {"count": 5}), ("pause", {}), ("go on", {})):
        tell_painter(folder, name, "browser", **about)
    while not controller.pause_asked():
        time.sleep(0.01)
    assert not controller.pause_asked()  # there is one pause, and nothing is lost: it goes on
    assert controller.go_on(Paused("You asked for a pause.", 3, asked=True))


@pytest.mark.slow
def test_a_region_and_another_goal_reach_the_planner(folder: PaintingFolder, tmp_path: Path) -> None:
    folder.painting.mkdir()
    table = Table(folder, 4, journal=Journal.begin(folder.painting, {}, {}))
    planner = Planner(goal(), plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.02), seed=1))
    white = torch.ones(3, planner.fine.rows, planner.fine.columns)
    made = planner.plan(white, 4, 1, lambda step: None)
    table.setup.session.planner = planner
    drawn = torch.zeros(3, 60, 80)
    drawn[:, :, :30] = 1
    images.save(drawn, folder.region(1))
    (tmp_path / "pictures").mkdir()
    images.save(picture(60, 80), tmp_path / "pictures" / f"{PICTURE}.png")
    request = PaintingRequest.model_validate({"terms": [{"kind": "image", "picture": PICTURE, "weight": 2}]})
    assert folder.begin_change(request, tmp_path / "pictures") == 1
    table.says = [("spare", {"record": 1}), ("goal", {"record": 1}), ("go on", {})]
    table.setup.session.run(4, 1, made)
    table.setup.session.journal.close()
    after = table.setup.session.planner
    assert after is not planner and after.region is not None and planner.region is None
    assert after.goal.terms[0].weight == 2
    assert table.told(RegionProtected) == [RegionProtected("regions/1.png", False, "region-1.png")]
    history = Journal.reopen(folder.painting)[1]
    kept_region = resuming.region(folder.painting, history)
    assert kept_region is not None and torch.equal(kept_region.forbidden, after.region.forbidden)
    assert read_goal(folder.painting / history.goal)["goal"][0]["weight"] == 2
    assert table.told(GoalChanged)[0].wish["terms"][0]["weight"] == 2
    assert sum(isinstance(event, Planned) for event in table.setup.heard) >= 3


@pytest.fixture
def stopped(folder: PaintingFolder) -> Iterator[StopWatch]:
    stop = StopWatch(folder.stop, folder.path.parent)
    stop.heed()
    folder.stop.touch()
    deadline = time.monotonic() + 20
    while not stop.asked and time.monotonic() < deadline:
        time.sleep(0.005)
    yield stop


def test_stop_ends_a_pause_and_whatever_heeds_it(folder: PaintingFolder, stopped: StopWatch) -> None:
    with pytest.raises(StopPressed):
        stopped.heed()
    assert (
        PauseController(folder, Feed(folder), stopped, 0.0).go_on(Paused("You asked for a pause.", 3, asked=True))
        is False
    )
