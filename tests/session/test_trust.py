"""Which photographs a painting trusts: those of normal paintings, and none that shows something else."""

from dataclasses import replace
from pathlib import Path

import pytest

from frida_painter.errors import PaintingPaused
from frida_painter.hardware.faults import Bump, Faults, InSight, LostFocus
from frida_painter.perception import frame_check
from frida_painter.perception.registration import CanvasShift, Registration, Verdict
from frida_painter.session.events import Event, Paused, Remark
from frida_painter.session.journal import Journal
from support.small_world import fine_registration
from support.virtual_painting import STROKES, VirtualPainting


@pytest.fixture(scope="module")
def world() -> VirtualPainting:
    return VirtualPainting.made()


@pytest.mark.parametrize(
    ("faults", "done", "reason"),
    [
        (Faults(in_sight=(InSight("hand", 1),)), 4, "reaches over the edge"),
        (Faults(bumps=(Bump(5, (0.005, -0.004)),)), 8, "no longer where it was"),
        (Faults(frozen_photographs=frozenset(range(1, 9))), 4, "very same photograph"),
        (Faults(stale_photographs=frozenset(range(1, 9))), 4, "no new photograph"),
        (Faults(failed_photographs=frozenset(range(2, 20))), 8, "does not answer"),
    ],
)
def test_what_cannot_be_trusted_is_taken_again_and_then_the_painting_pauses(
    world: VirtualPainting, tmp_path: Path, faults: Faults, done: int, reason: str
) -> None:
    """Faults F21: the camera is gone; F22: the camera repeats an old frame; F23: the photograph cannot be trusted.

    perception/test_frame_check.py has all that may be wrong with a photograph.
    """
    (paused,) = world.pauses(tmp_path, faults)
    assert paused.done == done and reason in paused.reason


def test_what_goes_away_by_itself_is_waited_for(world: VirtualPainting, tmp_path: Path) -> None:
    """Fault F23: the photograph cannot be trusted.

    A hand in two photographs, focus lost in one, a frozen one: none is decided by, and nobody is asked.
    """
    faults = Faults(
        in_sight=(InSight("hand", 1, 2),), lost_focus=(LostFocus(4, 4, 0.015),), frozen_photographs=frozenset({6})
    )
    assert world.pauses(tmp_path, faults) == []


@pytest.mark.parametrize(
    ("faults", "reason"),
    [
        (Faults(in_sight=(InSight("hand", 3),)), "reaches over the edge"),
        (Faults(failed_photographs=frozenset(range(3, 40))), "does not answer"),
    ],
)
def test_a_painting_whose_strokes_are_all_painted_is_finished_whatever_its_last_photograph_says(
    world: VirtualPainting, tmp_path: Path, faults: Faults, reason: str
) -> None:
    """Faults F21 and F23, after the last stroke: nothing is decided any more, and nobody is there to be asked."""
    heard: list[Event] = []
    session, studio = world.session(tmp_path, Journal(None), faults=faults, notify=heard.append)
    painting = session.run(STROKES, 3)
    studio.close()
    (doubted,) = [event for event in heard if isinstance(event, Remark)]
    assert reason in doubted.sentence and doubted.about == "last look" and painting.remark == doubted.sentence
    assert painting.painted == STROKES and painting.photograph.shape[0] == 3
    assert not [event for event in heard if isinstance(event, Paused)]


def test_what_is_doubtful_is_looked_at_again_in_the_studio_and_asked_about_once_at_a_real_easel(
    world: VirtualPainting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    doubt = Registration(Verdict.UNSURE, CanvasShift(0.001))
    monkeypatch.setattr(frame_check, "register", lambda *args: doubt)
    asked: list[Paused] = []
    session, studio = world.session(tmp_path / "studio", Journal(None))
    assert session.run(STROKES, 3).painted == STROKES
    studio.close()
    for go_on, painted in ((True, STROKES), (False, None)):
        asked.clear()
        session, studio = world.session(tmp_path / str(go_on), Journal(None))
        real = replace(studio.easel, simulated=False)
        session.observer.easel = session.hand.easel = real
        session.interruptions._go_on = lambda paused, go_on=go_on: asked.append(paused) or go_on
        if painted is None:
            with pytest.raises(PaintingPaused, match="does not tell whether the canvas is still where it was"):
                session.run(STROKES, 3)
            assert len(asked) == 1
        else:
            assert session.run(STROKES, 3).painted == painted
            assert [paused.done for paused in asked] == [4, 8, 12], "after every batch, and at the end no second time"
        studio.close()


def test_no_photograph_of_a_normal_painting_is_refused(world: VirtualPainting, tmp_path: Path) -> None:
    """A studio with its own light, grain, hand and error of place; tests/stress/claims.py has two dozen."""
    with fine_registration():
        assert world.refusals(tmp_path, range(1)) == {}
