import time
from dataclasses import replace

import numpy as np
import pytest

from frida_painter.brush.library import Flaw, StrokeLibrary
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Confirm, lead
from frida_painter.errors import CalibrationError, ConfigError, FrameRejected, FridaError, RobotError
from frida_painter.hardware.faults import Bump, Faults, LightChange, LostFocus
from frida_painter_calibration.procedures.paper import sample_strokes
from frida_painter_calibration.procedures.strokes import RecordedStrokes, strokes, unfinished_folder
from killing import ForkedProcess
from papers import KIND, PLACES, dark_bar, paper_studio, proposed, spoiled

COUNT = 7


def paint(easel, out=None, *, count=COUNT, answer=proposed, **kwargs) -> RecordedStrokes:
    return lead(strokes(easel, KIND, out, count=count, seed=4, **kwargs), answer)


@pytest.fixture(scope="module")
def undisturbed():
    progress = []
    return paint(paper_studio().easel, notify=progress.append), progress


def test_each_stroke_is_painted_photographed_and_told(undisturbed):
    finding, progress = undisturbed
    assert len(finding.library) == COUNT
    assert not finding.library.flaws.any()
    assert [step.done for step in progress] == list(range(1, COUNT + 1))
    assert progress[-1].sheet == -(-COUNT // PLACES)
    assert "7 strokes of brush fine, all of them clean" in finding.sentence


def test_shapes_are_drawn_from_the_seed_within_the_brushs_limits(undisturbed):
    library = undisturbed[0].library
    wanted = sample_strokes(KIND, COUNT, 4)
    np.testing.assert_array_equal(library.length_m, wanted.length.numpy())
    np.testing.assert_array_equal(library.thickness, wanted.thickness.numpy())
    assert ((library.length_m >= 0.010) & (library.length_m <= 0.030)).all()
    assert (np.abs(library.bend_m) <= 0.010).all()


def test_marks_are_opaque_lie_along_their_paths_and_leave_the_paper_clean(undisturbed):
    library = undisturbed[0].library
    x, y = library.frame.cell_centers().numpy().transpose(2, 0, 1)
    for mark, length, bend in zip(library.magnitude / 255, library.length_m, library.bend_m, strict=True):
        fraction = np.linspace(0, 1, 60)[:, None, None]
        away = np.hypot(x - fraction * length, y - 3 * fraction * (1 - fraction) * bend).min(0)
        assert mark[away < 0.0008].mean() > 0.7
        assert mark[away > 0.013].mean() < 0.002


def test_a_crop_holds_the_whole_frame_of_the_brush(undisturbed):
    frame, wanted = undisturbed[0].library.frame, KIND.frame
    assert frame.left <= wanted.left < wanted.right <= frame.right
    assert frame.bottom <= wanted.bottom < wanted.top <= frame.top


def test_a_paper_that_was_moved_costs_one_stroke_and_is_given_up():
    progress = []
    easel = paper_studio(Faults(bumps=(Bump(2, (0.003, 0.0)),))).easel
    finding = paint(easel, notify=progress.append, count=4)
    assert finding.library.flaws.tolist() == [0, Flaw.MOVED, 0, 0]
    assert [step.sheet for step in progress] == [1, 1, 2, 2]
    assert "1 is left out (1 paper moved)" in finding.sentence


def shadow(image, number):
    if number >= 2:
        image[:, 294:] = (0.9 * image[:, 294:]).astype(np.uint8)
    return image


def arm(image, number):
    return dark_bar(image) if number >= 2 else image


SEEN = {
    "strokes without paint": (Faults(dropped_touches=frozenset({1, 3})), None, [0, Flaw.EMPTY, 0, Flaw.EMPTY]),
    "another light": (Faults(light_changes=(LightChange(2, (0.85, 0.8, 0.65), lean=(0.15, -0.1)),)), None, [0, 0, 0]),
    "out of focus, and taken again": (Faults(lost_focus=(LostFocus(2, 3),)), None, [0, 0]),
    "a shadow with an edge": (Faults(), shadow, [0, Flaw.LIGHT]),
    "a hand that goes away": (Faults(), lambda image, number: dark_bar(image) if number == 2 else image, [0, 0]),
    "an arm that stays": (
        Faults(),
        lambda image, number: dark_bar(image) if number >= 2 else image,
        [0, Flaw.DISTURBED],
    ),
}


@pytest.mark.parametrize("name", SEEN)
def test_what_is_no_paint_is_taken_out_or_spoils_its_stroke_alone(name, undisturbed):
    faults, spoil, flaws = SEEN[name]
    studio = paper_studio(faults)
    library = paint(studio.easel if spoil is None else spoiled(studio, spoil), count=len(flaws)).library
    assert library.flaws.tolist() == flaws
    if not any(flaws):
        apart = library.magnitude.astype(float) - undisturbed[0].library.magnitude[: len(flaws)]
        assert np.abs(apart).mean() / 255 < 0.004


def test_a_camera_that_stays_out_of_focus_is_refused_and_the_strokes_are_kept(tmp_path):
    out = tmp_path / "library.npz"
    with pytest.raises(FrameRejected, match=r"out of focus.*mm"):
        paint(paper_studio(Faults(lost_focus=(LostFocus(3),))).easel, out, count=4)
    assert len(list(unfinished_folder(out).glob("stroke-*"))) == 2
    assert len(paint(paper_studio().easel, out, count=4).library) == 4


def test_no_sheet_begins_with_something_dark_on_it():
    with pytest.raises(FridaError, match="bare"):
        paint(spoiled(paper_studio(), arm))


def test_a_paper_elsewhere_than_calibrated_is_refused():
    easel = paper_studio().easel
    beside = tuple((x + 20.0, y) for x, y in easel.calibration.corners)
    with pytest.raises(CalibrationError, match="mm beside"):
        paint(replace(easel, calibration=replace(easel.calibration, corners=beside)))


def test_without_any_paint_it_stops_soon_and_forgets_the_empty_strokes(tmp_path):
    out = tmp_path / "library.npz"
    told = []
    with pytest.raises(CalibrationError, match=r"all dirty.*paint"):
        paint(paper_studio(Faults(dropped_touches=frozenset(range(2, 99)))).easel, out, count=20, notify=told.append)
    assert len(told) == 10
    assert len(list(unfinished_folder(out).glob("stroke-*"))) == 2


def test_mostly_dirty_strokes_are_kept_and_refused(tmp_path):
    out = tmp_path / "library.npz"
    with pytest.raises(CalibrationError, match="Most strokes are dirty"):
        paint(paper_studio(Faults(dropped_touches=frozenset({0, 1, 3}))).easel, out, count=4)
    assert (StrokeLibrary.load(out).flaws > 0).sum() >= 3


class Operator:
    """A person, who is asked for paper."""

    def __init__(self, studio):
        self.studio = studio.easel.operator

    def fill_wells(self, palette):
        self.studio.fill_wells(palette)

    def lay_paper(self):
        return False


def test_a_person_is_asked_for_every_paper_and_told_why():
    studio = paper_studio(Faults(bumps=(Bump(1, (0.003, 0.0)),)))
    asked = []

    def answer(question):
        asked.append(question)
        studio.easel.operator.lay_paper()
        return True

    paint(replace(studio.easel, operator=Operator(studio)), count=2, answer=answer)
    assert all(isinstance(question, Confirm) and "fresh white paper" in question.text for question in asked)
    assert len(asked) == 2 and "moved by 3" in asked[1].text


def test_a_person_who_forgets_to_change_the_paper_is_asked_again_and_may_give_up(tmp_path):
    studio = paper_studio()
    asked = []

    def answer(question):
        asked.append(question.text)
        if len(asked) == 3:
            studio.easel.operator.lay_paper()
        return len(asked) < 4

    with pytest.raises(CalibrationError, match=r"No fresh paper.*8 strokes are kept"):
        paint(replace(studio.easel, operator=Operator(studio)), tmp_path / "library.npz", count=9, answer=answer)
    assert "bare" in asked[2]


def test_the_brush_is_refilled_as_often_as_was_asked():
    studio = paper_studio()
    library = paint(studio.easel, count=5, refill_every=2).library
    assert library.since_dip is not None
    np.testing.assert_array_equal(library.since_dip > 0, [False, True, False, True, False])
    np.testing.assert_allclose(
        library.since_dip[1], KIND.width * library.length_m[0] * (0.25 + 0.75 * library.thickness[0])
    )
    assert studio.table.tuft.volume < 1  # rinsed and wiped at the end
    assert studio.table.dips == 3  # before strokes 0 and 2, and before 4, which is the first on the second paper


def test_after_a_robot_died_the_rest_is_painted_on_fresh_paper(tmp_path, undisturbed):
    out = tmp_path / "library.npz"
    with pytest.raises(RobotError, match="does not answer"):
        paint(paper_studio(Faults(dead_from_motion=11)).easel, out)
    with pytest.raises(ConfigError, match="count 7 and not 9"):  # another recording is not mixed in
        paint(paper_studio().easel, out, count=9)
    *kept, damaged = sorted(unfinished_folder(out).glob("stroke-*"))
    damaged.write_bytes(damaged.read_bytes()[:50])  # a stroke that is damaged on the disk is painted again
    assert kept and not out.exists()
    told = []
    again = paint(paper_studio().easel, out, notify=told.append).library
    assert len(told) == COUNT - len(kept)
    assert not unfinished_folder(out).exists()
    np.testing.assert_array_equal(again.length_m, undisturbed[0].library.length_m)
    np.testing.assert_array_equal(again.bend_m, undisturbed[0].library.bend_m)
    assert not again.flaws.any()
    np.testing.assert_array_equal(again.magnitude[: len(kept)], undisturbed[0].library.magnitude[: len(kept)])


class Crash(Exception):
    pass


def test_a_crash_at_any_stage_loses_at_most_the_stroke_that_it_hit(tmp_path, monkeypatch):
    """Fault F26: a crash in the middle of a calibration, again and again."""
    out, count, told = tmp_path / "library.npz", 9, []
    stages = [("lay_paper", 1), ("fill_wells", 0), ("capture", 0), ("capture", 2), ("follow", 1), ("home", 3)]
    for stage, call in stages:
        studio = paper_studio()
        part = {"capture": studio.camera, "follow": studio.robot, "home": studio.robot}.get(
            stage, studio.easel.operator
        )
        really, calls = getattr(part, stage), []

        def crashing(*args, really=really, calls=calls, call=call):
            calls.append(args)
            if len(calls) > call:
                raise Crash
            return really(*args)

        with monkeypatch.context() as patch, pytest.raises(Crash):
            patch.setattr(part, stage, crashing)
            paint(studio.easel, out, count=count, notify=told.append)
        assert len(list(unfinished_folder(out).glob("stroke-*"))) == len(told), stage
    assert len(told) < count
    assert len(paint(paper_studio().easel, out, count=count).library) == count


def test_a_killed_process_leaves_whole_strokes(tmp_path):
    """Fault F26: a crash in the middle of a calibration."""
    out = tmp_path / "library.npz"
    process = ForkedProcess(lambda: paint(paper_studio().easel, out))
    until = time.monotonic() + 60
    while len(list(unfinished_folder(out).glob("stroke-*"))) < 2 and time.monotonic() < until:
        time.sleep(0.005)
    process.kill()
    process.wait()
    kept = len(list(unfinished_folder(out).glob("stroke-*")))
    assert 2 <= kept < COUNT and not out.exists()
    told = []
    finding = paint(paper_studio().easel, out, notify=told.append)
    assert len(finding.library) == COUNT and len(told) == COUNT - kept
    assert [path.name for path in tmp_path.iterdir()] == ["library.npz"]


def test_a_paper_that_is_too_small_is_refused():
    with pytest.raises(ConfigError, match="no room"):
        paint(paper_studio(size=CanvasSize(0.04, 0.03)).easel, count=1)


@pytest.mark.parametrize("wrong", [{"count": 0}, {"count": -1}, {"count": 10**6}, {"refill_every": 0}])
def test_arguments_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError, match=str(next(iter(wrong.values())))):
        paint(paper_studio().easel, **wrong)
