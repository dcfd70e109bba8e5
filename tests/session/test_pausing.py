"""Paintings that pause: because a person asks, the disk is full, or the camera sees nothing that can be trusted."""

import errno
import os
import shutil
import time
from pathlib import Path

import pytest

from frida_painter.errors import CameraError, PaintingPaused, StorageError
from frida_painter.hardware.robot import Frame, MotionReport, Waypoints
from frida_painter.session.events import Event, Paused, PlanningStep, StrokePainted
from frida_painter.session.fold import PaintingState
from frida_painter.session.journal import Journal
from frida_painter.system.event_log import EventLog
from support.easel import NotingRobot, PatientCamera
from support.session import SessionSetup

WASHED = 2 * ["rinse", "wipe"]


def after(stroke: int) -> object:
    return lambda event: isinstance(event, StrokePainted) and event.done == stroke


def begun(folder: Path) -> Journal:
    return Journal.begin(folder, {}, {})


def told(folder: Path) -> PaintingState:
    return PaintingState.of_journal(EventLog.read(folder / "journal"), folder)


def pauses(setup: SessionSetup) -> list[Paused]:
    return [event for event in setup.heard if isinstance(event, Paused)]


@pytest.mark.parametrize("stroke", [1, 4, 6])
def test_a_pause_in_a_stroke_lets_it_be_finished_and_the_arm_is_aside_with_a_clean_brush(stroke: int) -> None:
    """Fault F11: a pause while planning or within a stroke."""
    seen: list[list[str]] = []

    def answer(paused: Paused) -> bool:
        seen.append(setup.robot.labels())
        return True

    setup = SessionSetup(9, replans=1, pause_at=after(stroke), go_on=answer)
    assert setup.run().painted == 9
    assert [paused.done for paused in pauses(setup)] == [stroke]
    assert seen[0][-6:] == [f"stroke {stroke}", *WASHED, "home"]
    going_on = setup.robot.labels()[len(seen[0]) :]
    assert going_on[0] == "home" or going_on[0].startswith("dip"), "a clean brush takes paint before it paints"
    assert setup.painted() == list(range(1, 10)), "and every stroke is painted once"


def test_a_pause_while_planning_is_heeded_at_the_next_step_and_planning_goes_on() -> None:
    """Fault F11: a pause while planning or within a stroke."""
    setup = SessionSetup(
        5, pause_at=lambda event: isinstance(event, PlanningStep) and event.iteration == 1, go_on=lambda paused: True
    )
    assert setup.run().painted == 5
    kinds = setup.kinds()
    assert kinds[:3] == ["PlanningStep", "Paused", "PlanningStep"]


def test_a_pause_that_nobody_ends_ends_the_painting_resumably(tmp_path: Path) -> None:
    """Fault F11: a pause while planning or within a stroke."""
    setup = SessionSetup(9, pause_at=after(4), journal=begun(tmp_path))
    with pytest.raises(PaintingPaused, match=r"You asked for a pause: .* The painting has paused after 4 strokes"):
        setup.run()
    assert (told(tmp_path).progress.painted, told(tmp_path).progress.in_doubt, told(tmp_path).end.finished) == (
        4,
        None,
        False,
    )
    assert setup.robot.labels()[-3:] == ["rinse", "wipe", "home"]


class FullDisk:
    """Refuses to write to the journal from one record on, until there is room again."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
        self.full = False
        write = os.pwrite

        def writing(descriptor: int, content: bytes, place: int) -> int:
            if self.full:
                (folder / ".journal-reserve").unlink(missing_ok=True)
                raise OSError(errno.ENOSPC, "No space left on device")
            return write(descriptor, content, place)

        monkeypatch.setattr(os, "pwrite", writing)


def test_on_a_full_disk_it_pauses_before_the_next_stroke_and_goes_on_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fault F5: the disk is full in mid-painting."""
    disk = FullDisk(monkeypatch, tmp_path)

    def fill(event: Event) -> bool:
        if isinstance(event, StrokePainted) and event.done == 3:
            disk.full = True
        return False

    def make_room(paused: Paused) -> bool:
        assert setup.robot.labels()[-6:] == ["stroke 3", *WASHED, "home"]
        disk.full = False
        return True

    setup = SessionSetup(7, replans=1, pause_at=fill, go_on=make_room, journal=begun(tmp_path))
    setup.run()
    assert setup.painted() == list(range(1, 8))
    (paused,) = pauses(setup)
    assert paused.done == 3 and "No space left on device" in paused.reason
    assert told(tmp_path).end.finished and told(tmp_path).progress.painted == 7


def test_where_nobody_makes_room_it_ends_and_can_be_resumed_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fault F5: the disk is full in mid-painting."""
    disk = FullDisk(monkeypatch, tmp_path)

    def fill(event: Event) -> bool:
        if isinstance(event, StrokePainted) and event.done == 3:
            disk.full = True
        return False

    setup = SessionSetup(7, pause_at=fill, journal=begun(tmp_path))
    with pytest.raises(PaintingPaused, match=r"No space left.*paused after 3 strokes"):
        setup.run()
    assert setup.painted() == [1, 2, 3] and setup.robot.labels()[-1] == "home"
    disk.full = False
    setup.session.journal.close()
    journal, history = Journal.reopen(tmp_path)
    assert (history.progress.painted, history.progress.in_doubt) == (3, None)
    journal.record_resume(repaint=False)


def test_a_folder_that_vanishes_pauses_it_as_a_full_disk_does(tmp_path: Path) -> None:
    """Fault F7: the painting's folder vanishes or becomes read-only."""
    folder = tmp_path / "painting"

    def vanish(event: Event) -> bool:
        if isinstance(event, StrokePainted) and event.done == 2:
            shutil.move(folder, tmp_path / "elsewhere")
        return False

    def bring_back(paused: Paused) -> bool:
        shutil.move(tmp_path / "elsewhere", folder)
        return True

    setup = SessionSetup(5, pause_at=vanish, go_on=bring_back, journal=begun(folder))
    setup.run()
    assert [paused.done for paused in pauses(setup)] == [2] and setup.painted() == [1, 2, 3, 4, 5]
    assert told(folder).end.finished


def test_photographs_are_given_up_before_the_journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fault F6: the disk is nearly full."""

    def full(pixels: object, path: Path) -> None:
        raise StorageError(f"{path} cannot be written (No space left on device)")

    monkeypatch.setattr("frida_painter.system.images.save_exactly", full)
    setup = SessionSetup(6, replans=2, journal=begun(tmp_path))
    setup.run()
    assert pauses(setup) == [] and told(tmp_path).end.finished
    assert [planning.photograph for planning in told(tmp_path).planning.adopted] == [None] * 3


class Blind(PatientCamera):
    """Does not answer for some captures."""

    def __init__(self, failures: set[int]) -> None:
        super().__init__()
        self.failures = failures

    def capture(self, newer_than: float) -> Frame:
        frame = super().capture(newer_than)
        if len(self.asked) in self.failures:
            raise CameraError("The camera does not answer.")
        return frame


def test_a_camera_that_answers_at_the_third_time_of_asking_is_no_reason_to_pause() -> None:
    """Fault F21: the camera is gone."""
    setup = SessionSetup(4, replans=1, camera=Blind({2, 3}))
    assert setup.run().painted == 4 and pauses(setup) == []


def test_without_a_camera_it_pauses_with_the_arm_aside_and_plans_nothing_again() -> None:
    """Fault F21: the camera is gone."""
    asked: list[int] = []

    def answer(paused: Paused) -> bool:
        asked.append(len(setup.planner.asked))
        assert setup.robot.labels()[-1] == "home"
        return True

    setup = SessionSetup(6, replans=1, camera=Blind({2, 3, 4}), go_on=answer)
    assert setup.run().painted == 6
    assert asked == [0], "asked before anything was planned again"
    assert [paused.reason for paused in pauses(setup)] == ["The camera does not answer."]
    with pytest.raises(PaintingPaused, match="does not answer"):
        SessionSetup(6, replans=1, camera=Blind({2, 3, 4})).run()


def test_a_glimpse_for_the_film_is_rather_left_out() -> None:
    """Fault F21: the camera is gone."""
    setup = SessionSetup(4, replans=0, timelapse_frames=2, camera=Blind({2, 3, 4}))
    assert setup.run().painted == 4 and pauses(setup) == []
    assert setup.kinds().count("TimelapseFrame") == 1


def test_an_old_frame_is_asked_for_again_and_then_it_pauses() -> None:
    """Fault F22: the camera repeats an old frame."""
    stale = (0.5, 1)
    camera = PatientCamera([(100.0, 1), stale, stale, stale])
    setup = SessionSetup(4, replans=1, camera=camera, robot=NotingRobot(now=50.0), go_on=lambda paused: True)
    assert setup.run().painted == 4
    assert len(pauses(setup)) == 1 and "no new photograph" in pauses(setup)[0].reason


class ButtonRobot(NotingRobot):
    """A robot whose board has a pause button, which somebody presses during some motions."""

    def __init__(self, *pressed_in: str) -> None:
        super().__init__()
        self.pressed_in, self.pressed, self.asked = list(pressed_in), False, 0

    def follow(self, waypoints: Waypoints) -> MotionReport:
        self.pressed = self.pressed or (bool(self.pressed_in) and waypoints.label == self.pressed_in[0])
        if self.pressed and self.pressed_in:
            self.pressed_in.pop(0)
        return super().follow(waypoints)

    def wants_pause(self) -> bool:
        self.asked += 1
        pressed, self.pressed = self.pressed, False
        return pressed


def test_the_pause_button_of_a_machine_pauses_after_the_stroke_and_ends_the_pause(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("frida_painter.session.executor._BETWEEN_PRESSES", 0.0)
    robot = ButtonRobot("stroke 3")

    def answer(paused: Paused) -> bool:
        assert setup.robot.labels()[-6:] == ["stroke 3", *WASHED, "home"] and not setup.session.is_button_pressed()
        robot.pressed = True
        return setup.session.is_button_pressed()

    setup = SessionSetup(5, replans=0, go_on=answer, robot=robot)
    assert setup.run().painted == 5 and setup.painted() == [1, 2, 3, 4, 5]
    (paused,) = pauses(setup)
    assert (paused.done, paused.cause) == (3, "button") and "pressed the pause button of the machine" in paused.reason


def test_a_machine_is_asked_about_its_button_a_few_times_a_second_at_most() -> None:
    robot = ButtonRobot()
    setup = SessionSetup(30, replans=0, robot=robot)
    began = time.monotonic()
    setup.run()
    assert 1 <= robot.asked <= 2 + (time.monotonic() - began) / 0.2
