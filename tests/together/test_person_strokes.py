"""Strokes of a person: what is kept of a pen's points, what is refused, and how a painting goes on with them."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.session import resuming
from frida_painter.session.controls import Controls
from frida_painter.session.events import Event, PauseCause, Paused, Planned, StrokeOfPerson, TimelapseFrame
from frida_painter.session.fold import PaintingState
from frida_painter.session.journal import Journal
from frida_painter.session.loop import PaintingSession
from frida_painter.session.progress import PaintingProgress
from frida_painter.strokes.plan import Plan
from frida_painter.system.event_log import EventLog
from frida_painter_together.policies import TurnTaken, find_turn_policy
from frida_painter_together.turns import PenStroke, thin
from killing import kill_when
from support.virtual_painting import RESTS_ON, STROKES, VirtualPainting

WAYS = arrays(np.float64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.floats(-20, 20))


@given(WAYS)
def test_thinning_changes_no_point_by_more_than_its_error(way: np.ndarray) -> None:
    kept = thin(way)
    assert kept[0] == 0 and kept[-1] == len(way) - 1 and (np.diff(kept) > 0).all()
    for first, last in itertools.pairwise(kept):
        along = way[last] - way[first]
        for point in way[first + 1 : last]:
            shares = np.linspace(0, 1, 2001)[:, None]
            nearest = np.linalg.norm(way[first] + shares * along - point, axis=1).min()
            assert nearest <= 1 + np.linalg.norm(along) / 2000


def test_a_pen_with_a_thousand_points_a_second_leaves_as_many_as_its_mark_needs() -> None:
    t = np.linspace(0, 1, 4000)
    points = np.c_[0.1 + 0.8 * t, 0.5 + 0.1 * np.sin(6 * t), 0.3 + 0.4 * t, 0 * t, 0 * t, 4 * t]
    stroke = PenStroke("fine", 0, points.tolist()).on_canvas(CanvasSize(0.3, 0.2), 1)
    assert 5 < len(stroke.place) < 80 and stroke.seconds == 4
    np.testing.assert_allclose(stroke.place[0], (0.03, 0.1), atol=1e-9)
    x = 0.3 * (0.1 + 0.8 * t)
    np.testing.assert_allclose(np.interp(x, *stroke.place.T), 0.2 * (0.5 - 0.1 * np.sin(6 * t)), atol=2e-4)


POINT = [0.5, 0.5, 0.5, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        ([], "no points"),
        ([POINT, [0.5, 0.5, math.nan, 0, 0, 1]], "Point 2 of the stroke has a press of nan"),
        ([POINT, [1.3, 0.5, 0.5, 0, 0, 1]], "leaves the canvas by 90 mm at point 2"),
        ([[0.0, 0.5, 0.5, 0, 0, 0], [1.0, 0.5, 0.5, 0, 0, 1]] * 8, "4.5 m long, and one stroke is at most 3 m"),
    ],
)
def test_what_cannot_be_a_stroke_is_refused_with_one_sentence(points: list[list[float]], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        PenStroke("fine", 0, points).on_canvas(CanvasSize(0.3, 0.2), 1)


def test_the_handle_leans_on_the_canvas_as_on_the_page() -> None:
    points = [[0.5, 0.5, 0.5, 0.6, math.pi / 2, 0.0]]  # towards the lower edge of the page
    stroke = PenStroke("fine", 0, points).on_canvas(CanvasSize(0.3, 0.2), 1)
    assert stroke.toward == pytest.approx([-math.pi / 2]) and stroke.tilt == pytest.approx([0.6])


@pytest.fixture(scope="module")
def world() -> VirtualPainting:
    return VirtualPainting.made(seed=7)


def pen(y: float, *, paint: int = 0, brush: str = "fine") -> PenStroke:
    t = np.linspace(0, 1, 40)
    return PenStroke(brush, paint, np.c_[0.1 + 0.8 * t, y + 0 * t, 0.5 + 0 * t, 0 * t, 0 * t, t].tolist())


class Together:
    """A painting in a folder that pauses after some strokes for a person, who then paints."""

    def __init__(self, world: VirtualPainting, folder: Path, pens: list[PenStroke], after: int = 4) -> None:
        self.heard: list[Event] = []
        self.turns: list[TurnTaken] = []
        self.world, self.folder, self.pens, self.after = world, folder, pens, after

    def answer(self, turn: TurnTaken) -> Plan | None:
        """Replans for the goal; keeps what the session found out about the turn."""
        self.turns.append(turn)
        return None

    def paint(self) -> None:
        journal = Journal.begin(self.folder, {"strokes": STROKES}, RESTS_ON)
        session, self.studio = self.world.session(self.folder, journal, **self.controls(lambda: session))
        session.run(STROKES, 3)
        journal.close()
        self.studio.close()

    def controls(self, session: Callable[[], PaintingSession]) -> dict[str, Any]:
        asked = iter([True])

        def pause_cause() -> PauseCause | None:
            return "person" if session()._progress.painted == self.after and next(asked, False) else None

        def go_on(paused: Paused) -> bool:
            for each in self.pens:
                session().person.paint(each)
            session().person.answer(self.answer)
            return True

        def hear(event: Event) -> None:
            self.heard.append(event)
            session().journal.show(event)

        return {"controls": Controls(pause_cause=pause_cause, go_on=go_on), "notify": hear}


def test_a_person_paints_in_a_pause_and_the_robot_answers_also_after_it_was_killed(
    world: VirtualPainting, tmp_path: Path
) -> None:
    pens = [pen(0.3), pen(0.6, paint=1)]
    whole = Together(world, tmp_path / "whole", pens)
    whole.paint()
    kinds = [type(event) for event in whole.heard]
    painted = [event for event in whole.heard if isinstance(event, StrokeOfPerson)]
    assert [(each.number, each.painted) for each in painted] == [(1, True), (2, True)]
    first = kinds.index(StrokeOfPerson)
    assert TimelapseFrame in kinds[first : first + 2], "the canvas is shown after the stroke"
    assert Planned in kinds[first:], "the rest is planned again from what was seen"
    (turn,) = whole.turns
    assert [each.number for each in turn.strokes] == [1, 2] and turn.colors[0] != turn.colors[1]
    rows, _ = np.nonzero(turn.painted)
    near = np.minimum(abs(rows / len(turn.painted) - 0.3), abs(rows / len(turn.painted) - 0.6))
    assert len(rows) > 500 and (near < 0.1).mean() > 0.95, "only the person's paint is found between the two looks"
    journal = list(EventLog.read(tmp_path / "whole/journal"))
    history = PaintingState.of_journal(journal, tmp_path)
    assert history.end.finished and len(history.people.strokes) == 2 and history.people.in_doubt is None
    looked = [record["kind"] for record in journal]
    assert "canvas_picture" in looked[looked.index("paused") : looked.index("stroke_of_person")]

    def in_doubt(record: dict[str, Any]) -> bool:
        return record["kind"] == "stroke_of_person" and record["number"] == 2

    killed = Together(world, tmp_path / "killed", pens)
    kill_when(tmp_path / "killed/journal", in_doubt, killed.paint)
    journal_again, history = Journal.reopen(tmp_path / "killed")
    begun = history.people.in_doubt
    assert begun is not None and begun.number == 2 and history.people.seen == 0
    session, studio = world.session(tmp_path / "killed", journal_again, history)
    before = studio.canvas.wet.copy()
    session.person.finish(begun)
    canvas = studio.canvas.wet.tobytes()
    assert canvas != before.tobytes()
    session.person.finish(begun)
    assert studio.canvas.wet.tobytes() == canvas, "it is not painted twice"
    kept = resuming.load_kept_plan(tmp_path / "killed", history)
    assert kept is not None
    now = session.look()
    where = PaintingProgress.resume(kept.plan, history.progress.painted, kept.planning.done, None, now)
    where.person, where.person_unseen = len(history.people.strokes), True
    assert session.resume(where).painted == STROKES
    journal_again.close()
    studio.close()
    robot = [entry for entry in EventLog.read(tmp_path / "killed/studio.diary") if entry.get("did") == "person"]
    assert [entry["stroke"]["number"] for entry in robot] == [1, 2]
    assert robot == [entry for entry in EventLog.read(tmp_path / "whole/studio.diary") if entry.get("did") == "person"]


def test_the_robot_continues_in_the_spirit_of_the_strokes_to_the_end(world: VirtualPainting, tmp_path: Path) -> None:
    class Spirit(Together):
        def answer(self, turn: TurnTaken) -> Plan | None:
            return find_turn_policy("continue").answer(turn).rest

    Spirit(world, tmp_path, [pen(0.3), pen(0.5, paint=1)]).paint()
    painted = Plan.load(tmp_path)
    assert len(painted) == STROKES
    answers = painted.strokes.angle[4:].numpy()
    assert np.abs(np.sin(answers)).max() < 0.5, "all along the person's strokes, which no later look replans"


def test_what_cannot_be_painted_is_refused_before_anything_is_noted(world: VirtualPainting, tmp_path: Path) -> None:
    refusals: list[str] = []

    class Refused(Together):
        def controls(self, session: Callable[[], PaintingSession]) -> dict[str, Any]:
            def go_on(paused: Paused) -> bool:
                for each in (pen(0.3, paint=7), pen(0.3, brush="mop"), pen(2.0)):
                    with pytest.raises(ConfigError) as refused:
                        session().person.paint(each)
                    refusals.append(str(refused.value))
                return False

            led = super().controls(session)
            return {**led, "controls": replace(led["controls"], go_on=go_on)}

    with pytest.raises(Exception, match="has paused after 2 strokes"):
        Refused(world, tmp_path, [], after=2).paint()
    assert ["Well 8" in refusals[0], "'mop'" in refusals[1], "leaves the canvas" in refusals[2]] == [True] * 3
    kinds = {record["kind"] for record in EventLog.read(tmp_path / "journal")}
    assert "stroke_of_person" not in kinds
