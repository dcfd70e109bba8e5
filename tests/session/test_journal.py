"""What the journal tells while a painting is made, and what is to be learned from it afterwards."""

import json
import math
import os
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from frida_painter.errors import StorageError
from frida_painter.planning.placement import Placement
from frida_painter.session.events import Looked, MotionBegan, Paused, Planned, PlanningStep, StrokePainted
from frida_painter.session.fold import PaintingState
from frida_painter.session.journal import Journal, placement_of
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter.system.event_log import EventLog, LogReader
from frida_painter_cli.leading import follow
from support.plans import made_up_plan
from support.session import SessionSetup

RESTS_ON = {"goal": "abc", "brush": "none"}


def begun(folder: Path) -> Journal:
    return Journal.begin(folder, {"strokes": 6}, RESTS_ON)


def read(folder: Path) -> PaintingState:
    return PaintingState.of_journal(EventLog.read(folder / "journal"), folder)


def test_every_stroke_is_noted_before_and_after_it_is_painted(tmp_path: Path) -> None:
    noted: list[tuple[int, int | None]] = []

    def look(event: object) -> bool:
        if isinstance(event, StrokePainted):
            told = read(tmp_path)
            noted.append((told.progress.painted, told.progress.in_doubt))
        return False

    setup = SessionSetup(6, replans=2, colors=2, stop_at=look, journal=begun(tmp_path))
    follow = setup.robot.follow

    def watched(waypoints):  # type: ignore[no-untyped-def]
        told = read(tmp_path)
        if waypoints.label.startswith("stroke"):
            assert told.progress.in_doubt == int(waypoints.label.split()[1]) == told.progress.painted + 1
        return follow(waypoints)

    setup.robot.follow = watched  # type: ignore[method-assign]
    setup.run()
    assert noted == [(number, None) for number in range(1, 7)]


def test_every_motion_is_noted_with_who_and_when(tmp_path: Path) -> None:
    setup = SessionSetup(6, replans=1, colors=2, timelapse_frames=3, journal=begun(tmp_path))
    setup.run()
    records = EventLog.read(tmp_path / "journal")
    told = [label for record in records if record["kind"] == "motion_began" for label in record["what"]]
    assert told == [motion.label for motion in setup.robot.motions]
    assert records[0]["by"] and records[0]["process"] and records[0]["program"]
    times = [record["at"] for record in records]
    assert times == sorted(times) and all(time.endswith("+00:00") for time in times)


def test_the_plan_in_the_folder_is_the_one_that_is_painted(tmp_path: Path) -> None:
    digests: list[tuple[str, str]] = []

    def look(event: object) -> bool:
        if isinstance(event, StrokePainted):
            digests.append((Plan.load(tmp_path).digest, read(tmp_path).planning.adopted[-1].plan))
        return False

    SessionSetup(6, replans=2, stop_at=look, journal=begun(tmp_path)).run()
    assert all(kept == noted for kept, noted in digests) and len(digests) == 6
    assert [planning.done for planning in read(tmp_path).planning.adopted] == [0, 2, 4]


def test_what_is_seen_and_learned_is_kept(tmp_path: Path) -> None:
    setup = SessionSetup(6, replans=2, journal=begun(tmp_path))
    setup.run()
    told = read(tmp_path)
    placed = placement_of(told.planning.adopted[-1])
    assert placed == setup.placements[-2], "the last batch was not planned after"
    assert told.pictures.light == setup.observer.light.logarithm.tolist()
    assert told.pictures.count == 5, "the bare canvas, three looks, the last photograph"
    kept = [images.load_exactly(tmp_path / str(planning.photograph)) for planning in told.planning.adopted]
    assert all((photograph == 240).all() for photograph in kept)
    seen = setup.observer.see(kept[0], 45)
    assert torch.equal(seen, setup.observer.look(1e9, 45)), "the photograph as it was kept shows the same"
    assert told.end.finished and told.progress.painted == 6 and told.sittings.count == 1 and told.sittings.seconds >= 0


def test_at_which_heights_brushes_touch_is_known_again_when_it_is_resumed(tmp_path: Path) -> None:
    learned = Placement.unknown({"small": 0.01, "large": 0.005})
    learned = replace(learned, touch=learned.touch.after("large", 0.001, 0.0003))
    plan = made_up_plan(4, 2)
    journal = begun(tmp_path)
    journal.record_plan(plan, 0, Placement.unknown())
    journal.record_plan(plan, 2, learned, kept=True)
    journal.close()
    found = [placement_of(planning) for planning in read(tmp_path).planning.adopted]
    assert found == [Placement.unknown(), learned]


@pytest.mark.parametrize("painted", [0, 1, 3, 5])
def test_a_stop_is_noted_and_is_not_the_end(tmp_path: Path, painted: int) -> None:
    setup = SessionSetup(6, stop_at=lambda event: getattr(event, "done", 0) == painted, journal=begun(tmp_path))
    setup.run()
    told = read(tmp_path)
    assert (told.progress.painted, told.progress.in_doubt, told.end.finished) == (painted, None, False)
    assert told.end.stopped and told.progress.doing == "stopped"


def test_a_stroke_in_doubt_that_is_painted_again_is_in_doubt_again(tmp_path: Path) -> None:
    journal = begun(tmp_path)
    journal.tell(MotionBegan(("stroke 1",), 1))
    journal.close()
    again, told = Journal.reopen(tmp_path)
    assert (told.progress.painted, told.progress.in_doubt) == (0, 1)
    again.record_resume(repaint=True)
    assert (told.progress.painted, told.progress.in_doubt) == (0, None)
    assert (read(tmp_path).progress.painted, read(tmp_path).progress.in_doubt) == (0, None)
    again.tell(MotionBegan(("stroke 1",), 1))
    assert (read(tmp_path).progress.painted, read(tmp_path).progress.in_doubt) == (0, 1)


def test_the_one_in_doubt_is_given_up_where_it_is_skipped(tmp_path: Path) -> None:
    journal = begun(tmp_path)
    journal.tell(MotionBegan(("stroke 1",), 1))
    journal.record_resume(repaint=False)
    told = read(tmp_path)
    assert journal.state.progress.given_up == [1]
    assert (told.progress.painted, told.progress.in_doubt, told.progress.given_up, told.sittings.count) == (
        1,
        None,
        [1],
        2,
    )


def test_a_folder_without_a_journal_is_no_painting(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="not the folder of a painting"):
        Journal.reopen(tmp_path)
    with pytest.raises(StorageError, match="not the folder of a painting"):
        Journal.reopen(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"version": 2}, "version 2; this program reads version 3: finish it with frida-painter 0.3"),
        ({"format": "a diary"}, "not a painting's"),
        ({"settings": None, "rests_on": 3, "at": "yesterday"}, "undamaged copy"),
    ],
)
def test_a_journal_of_another_kind_is_refused_and_left_alone(
    tmp_path: Path, change: dict[str, object], says: str
) -> None:
    begun(tmp_path / "one").close()
    first = EventLog.read(tmp_path / "one" / "journal")[0]
    EventLog.begin(tmp_path / "journal", {**first, **change}).close()
    content = (tmp_path / "journal").read_bytes()
    with pytest.raises(StorageError, match=says):
        Journal.reopen(tmp_path)
    assert (tmp_path / "journal").read_bytes() == content
    with pytest.raises(StorageError, match=says):
        Journal.reopen(tmp_path)


def test_cut_at_every_byte_a_journal_is_the_same_for_all_who_read_it_and_goes_on(tmp_path: Path) -> None:
    journal = begun(tmp_path)
    for done in (1, 2):
        journal.tell(MotionBegan((f"stroke {done}",), done))
        journal.show(PlanningStep("plan", done, 2, 0.5))
        journal.tell(StrokePainted(done, 6))
    journal.close()
    content, tally = ((tmp_path / name).read_bytes() for name in ("journal", ".journal-tally"))
    records = EventLog.read(tmp_path / "journal")
    ends = [number for number, byte in enumerate(content, 1) if byte == ord("\n")]
    for length in range(len(content) + 1):
        (tmp_path / "journal").write_bytes(content[:length])
        (tmp_path / ".journal-tally").write_bytes(tally)
        whole = records[: sum(end <= length for end in ends)]
        if not whole:
            for use in (read, Journal.reopen, follow):
                with pytest.raises(StorageError):
                    use(tmp_path)
            continue
        painted = sum(each["kind"] == "stroke_painted" for each in whole)
        begun_last = whole[-1]["kind"] != "stroke_painted" and len(whole) > 1
        watched = PaintingState.of_journal(LogReader(tmp_path / "journal").stream(), tmp_path)
        assert (watched.progress.painted, watched.progress.in_doubt) == (painted, painted + 1 if begun_last else None)
        if min(abs(length - end) for end in ends) > 1:  # each byte is opened in test_event_log.py
            continue
        again, told = Journal.reopen(tmp_path)
        assert (told.progress.painted, told.progress.in_doubt, told.sittings.missing) == (
            painted,
            watched.progress.in_doubt,
            len(records) - len(whole),
        )
        again.record_resume(repaint=True)
        again.tell(StrokePainted(painted + 1, 6))
        again.close()
        assert (read(tmp_path).progress.painted, read(tmp_path).progress.given_up) == (painted + 1, [])


def test_a_photograph_is_rather_left_out_than_the_painting_broken_off(tmp_path: Path) -> None:
    journal = begun(tmp_path)
    (tmp_path / "photographs").write_text("in the way")
    SessionSetup(4, replans=1, journal=journal).run()
    told = read(tmp_path)
    assert told.end.finished and all(planning.photograph is None for planning in told.planning.adopted)


def test_a_journal_nowhere_leaves_no_traces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    SessionSetup(4, journal=Journal(None)).run()
    assert list(tmp_path.iterdir()) == []


def test_the_journal_can_be_read_by_people(tmp_path: Path) -> None:
    begun(tmp_path).close()
    line = (tmp_path / "journal").read_text().splitlines()[0]
    assert json.loads(line.split(" ", 2)[2])["settings"] == {"strokes": 6}


def test_what_resuming_needs_is_flushed_and_what_is_only_shown_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal, flushed = begun(tmp_path), []
    monkeypatch.setattr(os, "fsync", flushed.append)
    journal.show(Paused("You asked."))
    assert not flushed and journal.state.wishes.paused
    journal.tell(StrokePainted(1, 6))
    assert len(flushed) == 1 and read(tmp_path).progress.painted == 1


def test_the_state_keeps_no_pixels_and_what_cannot_be_written_is_only_shown(tmp_path: Path) -> None:
    journal, pixels = begun(tmp_path), torch.zeros(3, 2, 2)
    journal.show(Looked(1, {}, pixels, pixels))
    journal.show(Planned(1, 2, 0.5, 0.4, shown={"prefix": ""}, expected=pixels))
    for planned in (journal.state.pictures.looks[-1].planned, journal.state.planning.replanned):
        assert planned is not None and planned.expected is None, "each look would keep megabytes"
    journal.show(PlanningStep("plan", 1, 2, math.inf))
    shown = journal.state.sittings.version
    assert read(tmp_path).sittings.version == shown - 1
