"""Which photographs a painting trusts: those of normal paintings, and none that shows something else."""

from dataclasses import replace
from pathlib import Path

import pytest

from frida_painter.errors import PaintingPaused
from frida_painter.perception import frame_check
from frida_painter.perception.registration import CanvasShift, Registration, Verdict
from frida_painter.plan import Plan
from frida_painter.session.events import Event, LastLookDoubted, Paused
from frida_painter.session.journal import Journal
from frida_painter.virtual.faults import Bump, Faults, InSight, LightChange, LostFocus
from support.small_world import fine_registration
from support.virtual_painting import STROKES, VirtualPainting

pytestmark = pytest.mark.usefixtures("small_world")


@pytest.fixture(scope="module")
def world() -> VirtualPainting:
    return VirtualPainting.made()


def paint(
    world: VirtualPainting, folder: Path, faults: Faults, seed: int = 0, plan: Plan | None = None
) -> list[Paused]:
    """The pauses of a painting, by a plan that was made before where there is one; nobody has it go on."""
    heard: list[Event] = []
    journal = Journal.begin(folder, {}, {})
    session, studio = world.session(folder, journal, seed=seed, faults=faults, notify=heard.append)
    try:
        assert session.run(STROKES, 3, plan).painted == STROKES
    except PaintingPaused as paused:
        assert "has paused after" in str(paused)
    finally:
        journal.close()
        studio.close()
    return [event for event in heard if isinstance(event, Paused)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "done", "reason"),
    [
        (Faults(in_sight=(InSight("hand", 1),)), 4, "reaches over the edge"),
        (Faults(light_changes=(LightChange(2, (0.02, 0.02, 0.02)),)), 8, "dark"),
        (Faults(in_sight=(InSight("glare", 1),)), 4, "blown out"),
        (Faults(lost_focus=(LostFocus(1, blur=0.015),)), 4, "blurred"),
        (Faults(bumps=(Bump(5, (0.004, 0.003)),)), 8, "no longer where it was"),
        (Faults(frozen_photographs=frozenset(range(1, 9))), 4, "very same photograph"),
        (Faults(stale_photographs=frozenset(range(1, 9))), 4, "no new photograph"),
        (Faults(failed_photographs=frozenset(range(2, 20))), 8, "does not answer"),
    ],
)
def test_what_cannot_be_trusted_is_taken_again_and_then_the_painting_pauses(
    world: VirtualPainting, tmp_path: Path, faults: Faults, done: int, reason: str
) -> None:
    """Faults F21: the camera is gone; F22: the camera repeats an old frame; F23: the photograph cannot be trusted."""
    (paused,) = paint(world, tmp_path, faults)
    assert paused.done == done and reason in paused.reason


@pytest.mark.slow
def test_what_goes_away_by_itself_is_waited_for(world: VirtualPainting, tmp_path: Path) -> None:
    """Fault F23: the photograph cannot be trusted.

    A hand in two photographs, focus lost in one, a frozen one: none is decided by, and nobody is asked.
    """
    faults = Faults(
        in_sight=(InSight("hand", 1, 2),), lost_focus=(LostFocus(4, 4, 0.015),), frozen_photographs=frozenset({6})
    )
    assert paint(world, tmp_path, faults) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "reason"),
    [
        (Faults(in_sight=(InSight("hand", 3),)), "reaches over the edge"),
        (Faults(lost_focus=(LostFocus(3, blur=0.015),)), "blurred"),
        (Faults(light_changes=(LightChange(3, (0.001, 0.001, 0.001)),)), "dark"),
        (Faults(bumps=(Bump(10, (0.004, 0.003)),)), "no longer where it was"),
        (Faults(failed_photographs=frozenset(range(3, 40))), "does not answer"),
    ],
)
def test_a_painting_whose_strokes_are_all_painted_is_finished_whatever_its_last_photograph_says(
    world: VirtualPainting, tmp_path: Path, faults: Faults, reason: str
) -> None:
    """Faults F21 and F23, after the last stroke: nothing is decided any more, and nobody is there to be asked."""
    heard: list[Event] = []
    session, studio = world.session(tmp_path, Journal.nowhere(), faults=faults, notify=heard.append)
    painting = session.run(STROKES, 3)
    studio.close()
    (doubted,) = [event for event in heard if isinstance(event, LastLookDoubted)]
    assert reason in doubted.reason and painting.remark == doubted.sentence
    assert painting.painted == STROKES and painting.photograph.shape[0] == 3
    assert not [event for event in heard if isinstance(event, Paused)]


@pytest.mark.slow
def test_what_is_doubtful_is_looked_at_again_in_the_studio_and_asked_about_once_at_a_real_easel(
    world: VirtualPainting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    doubt = Registration(Verdict.UNSURE, CanvasShift(0.001), CanvasShift(0.001), 1.0)
    monkeypatch.setattr(frame_check, "register", lambda *args: doubt)
    asked: list[Paused] = []
    session, studio = world.session(tmp_path / "studio", Journal.nowhere())
    assert session.run(STROKES, 3).painted == STROKES
    studio.close()
    for go_on, painted in ((True, STROKES), (False, None)):
        asked.clear()
        session, studio = world.session(tmp_path / str(go_on), Journal.nowhere())
        real = replace(studio.easel, simulated=False)
        session.observer.easel = session.hand.easel = real
        session.interruptions._go_on = lambda paused, go_on=go_on: asked.append(paused) or go_on
        if painted is None:
            with pytest.raises(PaintingPaused, match="does not tell whether the canvas is still where it was"):
                session.run(STROKES, 3)
            assert len(asked) == 1
        else:
            assert session.run(STROKES, 3).painted == painted
            assert [paused.done for paused in asked] == [
                4,
                8,
                12,
            ]  # once after every batch, and at the end no second time
        studio.close()


@pytest.mark.slow
def test_no_photograph_of_a_normal_painting_is_refused(world: VirtualPainting, tmp_path: Path) -> None:
    """A dozen studios, with their own light, grain, hand and error of place."""
    paint(world, tmp_path / "first", Faults())
    plan = next(iter(world.known.values()))
    with fine_registration():
        refused = {seed: paint(world, tmp_path / str(seed), Faults(), seed, plan) for seed in range(24)}
    assert {seed: pauses for seed, pauses in refused.items() if pauses} == {}
