"""Robots that take their brushes from a rack: what they do, what is noted of it, and what comes of a break."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from frida_painter.easel.dialogue import Confirm, Question
from frida_painter.easel.operator import brush_in_hand
from frida_painter.errors import ConfigError, Interrupted, PoseMismatch, WorkspaceViolation
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import BrushRack
from frida_painter.session.choreography import BrushLoad, Choreography, reckon
from frida_painter.session.events import BrushInHand, LayerBegun, Stopped
from frida_painter.session.fold import PaintingState
from frida_painter.session.journal import Journal
from frida_painter.session.progress import PaintingProgress
from frida_painter.session.rehearsal import rehearse
from frida_painter.system.event_log import EventLog
from support.easel import CALIBRATION, WORKSPACE
from support.session import BRUSH, NotingPlanner, SessionSetup

RACK = BrushRack({"small": (0.4, -0.2, 0.1), "large": (0.45, -0.2, 0.1)}, (0.0, 0.06), 0.05)
SMALL_TAKEN, SMALL_BACK = "take the small brush", "put the small brush back"
LARGE_TAKEN, LARGE_BACK = "take the large brush", "put the large brush back"


def setup(*brushes: str, rack: BrushRack = RACK, **rest: Any) -> SessionSetup:
    """Layers of two strokes each."""
    planner = NotingPlanner(layers=(2,) * len(brushes), brushes=brushes)
    return SessionSetup(2 * len(brushes), 1, colors=2, planner=planner, rack=rack, **rest)


def changes(painted: SessionSetup) -> list[str]:
    return [label for label in painted.robot.labels() if "brush" in label]


def journal_of(folder: Path) -> tuple[PaintingState, list[dict[str, Any]]]:
    records = EventLog.read(folder / "journal")
    return PaintingState.of_journal(records, folder), records


def test_a_brush_is_drawn_out_of_its_fork_and_put_back_on_the_same_way() -> None:
    motion = Motion(replace(WORKSPACE, rack=RACK), CALIBRATION)
    high = motion.travel_height
    assert high == pytest.approx(0.1 + 0.05 + WORKSPACE.hover), "the empty hand passes over brushes that stand there"
    way = [(0.4, -0.2, high), (0.4, -0.2, 0.15), (0.4, -0.2, 0.1), (0.4, -0.14, 0.1), (0.4, -0.14, high)]
    assert np.allclose(motion.take("small").position, way)
    assert np.allclose(motion.put_back("small").position, way[::-1])
    assert [each.label for each in motion.change("small", "large")] == [SMALL_BACK, LARGE_TAKEN]
    assert [each.label for each in motion.change("", "large")] == [LARGE_TAKEN]


@pytest.mark.parametrize("change", [("", "broad"), ("broad", "small")])
def test_a_brush_that_the_rack_lacks_is_named_and_so_are_those_that_it_has(change: tuple[str, str]) -> None:
    motion = Motion(replace(WORKSPACE, rack=RACK), CALIBRATION)
    with pytest.raises(ConfigError, match=r"no brush 'broad'; it has small, large: add it to \[rack\]"):
        motion.change(*change)
    with pytest.raises(ConfigError, match="it has no brush: add it"):
        Motion(replace(WORKSPACE, rack=replace(RACK, places={})), CALIBRATION).take("small")


def test_every_layer_is_painted_with_its_brush_and_all_stand_in_the_rack_in_the_end(tmp_path: Path) -> None:
    painted = setup("small", "large", "large", journal=Journal.begin(tmp_path, {}, {}))
    assert painted.run().painted == 6
    assert changes(painted) == [SMALL_TAKEN, SMALL_BACK, LARGE_TAKEN, LARGE_BACK]
    assert painted.easel.operator.brushes == [], "nobody was asked"
    labels = painted.robot.labels()
    first = next(index for index, label in enumerate(labels) if label.startswith("dip"))
    assert labels.index(SMALL_TAKEN) < first
    back = labels.index(SMALL_BACK)
    assert labels[:back].count("stroke 2") == 1 and "stroke 3" not in labels[:back]
    cleaned = max(index for index, label in enumerate(labels[:back]) if label == "wipe")
    assert not any(label.startswith(("dip", "stroke")) for label in labels[cleaned:back]), "it is put back clean"
    last = labels.index(LARGE_BACK)
    assert labels[last - 4 : last] == 2 * ["rinse", "wipe"] and labels[last + 1 :] == ["home"]
    painted.journal.close()
    history, records = journal_of(tmp_path)
    assert history.brush.held == "" and history.end.finished
    held = [record["brush"] for record in records if record["kind"] == "brush_in_hand"]
    assert held == [None, "small", None, "", None, "large", None, ""]
    noted = [
        record["what"][0] for record in records if record["kind"] == "motion_began" and "brush" in record["what"][0]
    ]
    assert noted == changes(painted)
    told = [event.brush for event in painted.heard if isinstance(event, BrushInHand)]
    assert told == ["small", "large", ""]
    assert [event.brush for event in painted.heard if isinstance(event, LayerBegun)] == ["small", "large", "large"]


def test_one_brush_for_all_is_taken_from_the_rack_as_well() -> None:
    painted = SessionSetup(3, rack=RACK)
    painted.run()
    assert changes(painted) == [SMALL_TAKEN, SMALL_BACK]


def test_without_a_rack_the_page_is_told_which_brush_is_in_the_hand() -> None:
    painted = SessionSetup(3)
    painted.run()
    assert [event for event in painted.heard if isinstance(event, BrushInHand)] == [BrushInHand("small")]


@pytest.mark.parametrize(
    ("rack", "error", "says"),
    [
        (
            replace(RACK, places={"small": (0.4, -0.2, 0.1)}),
            ConfigError,
            "rack of the workspace holds small, and .* large",
        ),
        (replace(RACK, places={**RACK.places, "large": (0.7, 0, 0.1)}), WorkspaceViolation, "brush back: x = 0.7000 m"),
        (replace(RACK, lift=0.4), WorkspaceViolation, "brush back: z = 0.5300 m"),
    ],
)
def test_a_brush_that_is_not_there_or_out_of_reach_is_refused_before_anything_moves(
    rack: BrushRack, error: type[Exception], says: str
) -> None:
    painted = setup("small", "large", rack=rack)
    with pytest.raises(error, match=says):
        painted.run()
    assert painted.robot.motions == [] and painted.camera.asked == []


def test_a_stop_between_two_motions_of_a_change_is_heeded_and_nothing_is_held_then() -> None:
    stopping = setup("small", "large")
    follow = stopping.robot.follow

    def stop_when_put_back(motion: Any) -> Any:
        stopping.stopping |= motion.label == SMALL_BACK
        return follow(motion)

    stopping.robot.follow = stop_when_put_back  # type: ignore[method-assign]
    assert stopping.run().painted == 2
    assert changes(stopping) == [SMALL_TAKEN, SMALL_BACK] and any(isinstance(one, Stopped) for one in stopping.heard)


@pytest.mark.parametrize(("broken", "held"), [(SMALL_TAKEN, None), (SMALL_BACK, None), ("stroke 1", "small")])
def test_whoever_resumes_knows_what_is_in_the_hand_or_that_nobody_does(
    tmp_path: Path, broken: str, held: str | None
) -> None:
    """Fault F3: the robot loses its place in a motion."""
    painted = setup("small", "large", journal=Journal.begin(tmp_path, {}, {}))
    follow = painted.robot.follow

    def lost(motion: Any) -> Any:
        report = follow(motion)
        return replace(report, reached=report.reached + 0.01) if motion.label == broken else report

    painted.robot.follow = lost  # type: ignore[method-assign]
    with pytest.raises(PoseMismatch):
        painted.run()
    painted.journal.close()
    history, _ = journal_of(tmp_path)
    assert history.brush.held == held


@pytest.mark.parametrize(
    ("held", "done"),
    [("small", [SMALL_BACK, LARGE_TAKEN, LARGE_BACK]), ("", [LARGE_TAKEN, LARGE_BACK]), ("large", [LARGE_BACK])],
)
def test_resumed_it_goes_on_with_the_brush_in_the_hand(held: str, done: list[str]) -> None:
    resumed = setup("small", "large")
    plan = resumed.planner.plan(torch.ones(3, 8, 8), 4, 2, lambda step: None)
    resumed.hand.held = held
    resumed.resume(PaintingProgress.resume(plan, 2, 2, None, torch.ones(3, 48, 64), 0.0))
    assert changes(resumed) == done and resumed.painted() == [3, 4]
    assert (resumed.robot.labels()[0] == "rinse") == bool(held), "an empty hand has nothing to clean"


def test_a_person_says_which_brush_is_in_the_hand_or_nothing_moves() -> None:
    asked: list[str] = []

    def answering(*answers: bool) -> Any:
        left = list(answers)

        def answer(question: Question) -> bool:
            assert isinstance(question, Confirm) and question.proposal is False
            asked.append(question.text)
            return left.pop(0)

        return answer

    assert brush_in_hand(("small", "large"), answering(False, True)) == "large"
    assert "changed its brush" in asked[0] and asked[1] == "Is the large brush in the robot's hand?"
    assert brush_in_hand(("small", "large"), answering(False, False, True)) == ""
    for answer in (answering(False, False, False), None):
        with pytest.raises(Interrupted, match="nothing was moved"):
            brush_in_hand(("small", "large"), answer)


def test_the_timetable_and_the_rehearsal_know_the_rack() -> None:
    here = setup("small", "large")
    workspace = here.easel.workspace
    plan = here.planner.plan(torch.ones(3, 8, 8), 4, 2, lambda step: None)
    record = here.easel.calibration
    motion = Motion(workspace, record)
    choreography = Choreography(motion, BRUSH, {"large": Choreography(motion, replace(BRUSH, name="large"))})
    there = reckon(plan, choreography, BrushLoad())
    three = motion.take("small").length * 2 + motion.take("large").length
    assert there.changes == pytest.approx(three / workspace.painting_speed)
    held = reckon(plan, choreography, BrushLoad(), held="small")
    assert held.changes == pytest.approx(there.changes * 2 / 3) and held.total < there.total
    assert there.after[0] > held.after[0]
    assert rehearse(plan, workspace, here.easel.canvas, record).passed
    none = rehearse(
        plan, replace(workspace, rack=replace(RACK, places={"small": (0.4, -0.2, 0.1)})), here.easel.canvas, record
    )
    assert not none.passed and "needs the large brush, and the rack holds small" in none.mismatches[0]
    far = replace(workspace, rack=replace(RACK, slide=(0.4, 0.0)))
    refused = rehearse(plan, far, here.easel.canvas, record).others
    assert refused[0].label == SMALL_BACK
