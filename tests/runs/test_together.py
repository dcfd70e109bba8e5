"""Paintings without a goal: a person begins, the robot continues, and nothing is lost if the painter is killed."""

import math
from pathlib import Path

import numpy as np
import pytest

from frida_painter.errors import ConfigError, PaintingPaused
from frida_painter.runs.painting_folder import history_of
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.controls import Controls
from frida_painter.session.events import Event, Paused, StrokePainted
from frida_painter.strokes.plan import Plan
from frida_painter.system.event_log import EventLog
from frida_painter_together.turns import PenStroke

SMALL = {"canvas": "120x90mm", "render_height": 64, "brush": "fine", "colors": 3}
LENGTH = 0.03 * math.hypot(1, 0.5)


class Killed(BaseException):
    """Stands for a process that ends in the middle of its work."""


class Person:
    """Paints four strokes in each of their turns, all of one kind, and ends the drawing after some turns."""

    def __init__(self, run: PaintingRun, turns: int, kill_at: int = 0) -> None:
        self.run, self.turns, self.kill_at = run, turns, kill_at
        self.paused: list[Paused] = []
        run.controls = Controls(go_on=self.go_on)

    def go_on(self, paused: Paused) -> bool:
        session = self.run.session
        assert session is not None
        self.paused.append(paused)
        if len(self.paused) > self.turns:
            session.person.end_here()
            return True
        for number in range(4):
            x, y = 0.1 + 0.2 * number, 0.2 + 0.3 * (len(self.paused) - 1)
            way = [[x + 0.25 * t, y + 0.5 * 0.03 / 0.09 * t, 0.4, 0.0, 0.0, t] for t in np.linspace(0, 1, 9)]
            session.person.paint(PenStroke("fine", 1, way))
        if len(self.paused) == self.kill_at:
            raise Killed
        return True


def spec(strokes: int = 12) -> RunSpec:
    return RunSpec.of(together=True, strokes=strokes, film=False, **SMALL)


def kinds(folder: Path) -> list[str]:
    return [entry["kind"] for entry in EventLog.read(folder / "journal")]


def test_the_robot_continues_what_a_person_begins_until_they_end_it(tmp_path: Path) -> None:
    with PaintingRun(spec(), tmp_path / "drawn") as run:
        person = Person(run, turns=2)
        outcome = run.start()
    assert outcome.trouble is None and outcome.painting is not None and outcome.painting.painted == 8
    assert [paused.done for paused in person.paused] == [0, 4, 8]
    drawn = Plan.load(tmp_path / "drawn")
    assert drawn.paint.tolist() == [1] * 8, "in the person's paint"
    assert drawn.strokes.length.numpy() == pytest.approx(LENGTH, abs=2e-3)
    assert np.abs(drawn.strokes.angle.numpy() - math.atan2(-0.5, 1)).max() < 0.6, "in their direction"
    history = history_of(tmp_path / "drawn")
    assert history.end.finished and len(history.people.strokes) == 8


def test_killed_in_a_turn_of_the_person_it_answers_them_when_it_is_resumed(tmp_path: Path) -> None:
    with pytest.raises(Killed), PaintingRun(spec(), tmp_path / "drawn") as run:
        Person(run, turns=9, kill_at=2)
        run.start()
    known = history_of(tmp_path / "drawn")
    assert (known.progress.painted, len(known.people.strokes), known.people.seen) == (4, 8, 4)
    with PaintingRun.reopen(tmp_path / "drawn") as run:
        person = Person(run, turns=0)
        outcome = run.resume()
    assert outcome.trouble is None and outcome.painting is not None and outcome.painting.painted == 8
    assert [paused.done for paused in person.paused] == [8], "as many strokes as the person painted in that turn"
    drawn = Plan.load(tmp_path / "drawn")
    assert drawn.strokes.length.numpy() == pytest.approx(LENGTH, abs=2e-3), "also after the kill in their spirit"


def test_killed_in_its_answer_it_paints_the_rest_of_the_answer(tmp_path: Path) -> None:
    def hear(event: Event) -> None:
        if isinstance(event, StrokePainted) and event.done == 2:
            raise Killed

    with pytest.raises(Killed), PaintingRun(spec(), tmp_path / "drawn", listeners=[hear]) as run:
        Person(run, turns=9)
        run.start()
    begun = Plan.load(tmp_path / "drawn")
    with PaintingRun.reopen(tmp_path / "drawn") as run:
        person = Person(run, turns=0)
        outcome = run.resume()
    assert outcome.painting is not None and outcome.painting.painted == 4
    assert [paused.done for paused in person.paused] == [4] and Plan.load(tmp_path / "drawn").digest == begun.digest
    adopted = [entry["answers"] for entry in EventLog.read(tmp_path / "drawn/journal") if "answers" in entry]
    assert True in adopted and history_of(tmp_path / "drawn").end.finished


def test_if_nobody_paints_it_waits_and_can_be_resumed(tmp_path: Path) -> None:
    with PaintingRun(spec(), tmp_path / "drawn") as run:
        run.controls = Controls(go_on=lambda paused: True)
        outcome = run.start()
    assert isinstance(outcome.trouble, PaintingPaused) and "Nobody painted anything" in str(outcome.trouble)
    assert not history_of(tmp_path / "drawn").end.finished


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"goal": [{"image": "photo.jpg"}]}, "without a goal, and a goal was given"),
        ({"minutes": 20.0}, "--minutes was given"),
        ({"brushes": "fine,medium"}, "several brushes was given"),
        ({"strokes_of": "comma:50%"}, "--strokes-of was given"),
        ({"ground": "auto"}, "--ground auto was given"),
        ({"robot": "axidraw", "camera": "none"}, "nobody sees it; name a camera"),
    ],
)
def test_what_only_a_goal_can_use_is_refused(more: dict[str, object], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        RunSpec.of(together=True, **more)
