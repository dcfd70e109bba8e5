"""A studio that is opened again is the one that was left, byte for byte."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import StorageError
from frida_painter.hardware.faults import Bump, Faults
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, VirtualStudio, open_studio
from virtual.hand import Hand

COLORS = ((0.1, 0.1, 0.1), (0.8, 0.2, 0.1))
SETTINGS = {"camera": CameraSpec((120, 160)), "cell": 0.8, "drying_time": 20.0}


def hand(state: Path | None, *, fill: bool = False, **settings: object) -> Hand:
    return Hand(*(COLORS if fill else ()), brush="fine", seed=4, state=state, **{**SETTINGS, **settings})


def evening() -> list[Callable[[Hand], object]]:
    """What is done in a studio, one thing after another."""
    return [
        lambda here: here.dip(0),
        lambda here: here.stroke(0.02, 0.03, 0.05),
        lambda here: here.easel.camera.capture(0),
        lambda here: here.stroke(0.02, 0.04, 0.05, angle=0.3),
        lambda here: here.clean(),
        lambda here: here.easel.operator.let_dry(5.0),
        lambda here: here.easel.operator.let_dry(5.0),
        lambda here: here.easel.operator.tone((0.784, 0.659, 0.471)),
        lambda here: here.dip(1),
        lambda here: here.easel.operator.lay_checker(),
        lambda here: here.easel.camera.capture(0),
        lambda here: here.easel.operator.take_checker_away(),
        lambda here: here.stroke(0.05, 0.02, 0.05, angle=math.pi / 2, bend=0.01),
        lambda here: here.studio.lay_checker((0.05, 0.04), 0.2, 0.04),
        lambda here: here.easel.robot.home(),
    ]


def looks(studio: VirtualStudio) -> dict[str, object]:
    """Everything that may differ between two studios, the next photograph and the next stroke among it."""
    photograph = studio.camera.capture(0)
    after = {
        "photograph": photograph.image.tobytes(),
        "taken": (photograph.captured_at, photograph.sequence),
        "tip": tuple(studio.robot.pose()),
        "motions": studio.robot.motions,
        "balance": studio.balance(),
    }
    for name in ("wet", "ground", "dry", "settled"):
        after[name] = getattr(studio.canvas, name).tobytes()
    after["brush"] = studio.table.tuft.pigment.tobytes()
    return after


@pytest.mark.parametrize("left_after", range(14))
def test_a_studio_goes_on_as_if_it_had_never_been_left(tmp_path: Path, left_after: int) -> None:
    actions = evening()
    straight = hand(None, fill=True)
    for action in actions:
        action(straight)

    first = hand(tmp_path / "studio.jsonl", fill=True)
    for action in actions[:left_after]:
        action(first)  # ... and then its process is killed: nothing is closed
    again = hand(tmp_path / "studio.jsonl")
    for action in actions[left_after:]:
        action(again)
    again.stroke(0.03, 0.06, 0.04)
    straight.stroke(0.03, 0.06, 0.04)
    assert looks(again.studio) == looks(straight.studio)


def test_brushes_that_were_changed_are_changed_again(tmp_path: Path) -> None:
    def begin(state: Path | None) -> Hand:
        return Hand(*COLORS, brush={"fine": "fine", "broad": "broad"}, seed=4, state=state, **SETTINGS)

    def paint(here: Hand, brush: str, y: float) -> None:
        here.easel.operator.change_brush(brush)
        here.dip(0)
        here.stroke(0.03, y, 0.05)

    straight, first = begin(None), begin(tmp_path / "studio.jsonl")
    for here in (straight, first):
        paint(here, "broad", 0.03)
    again = Hand(brush={"fine": "fine", "broad": "broad"}, seed=4, state=tmp_path / "studio.jsonl", **SETTINGS)
    for here in (straight, again):
        here.stroke(0.03, 0.06, 0.04)
        paint(here, "fine", 0.07)
    assert looks(again.studio) == looks(straight.studio)


def test_a_bumped_canvas_and_dropped_touches_stay_what_they_were(tmp_path: Path) -> None:
    faults = Faults(bumps=(Bump(1, (0.004, 0.0)),), dropped_touches=frozenset({1}), dry_dips=frozenset({1}))

    def paint(here: Hand, strokes: range) -> None:
        for number in strokes:
            here.dip(0)
            here.stroke(0.02, 0.02 + 0.01 * number, 0.05)

    straight = hand(None, fill=True, faults=faults)
    paint(straight, range(4))
    paint(hand(tmp_path / "studio.jsonl", fill=True, faults=faults), range(3))
    mended = hand(tmp_path / "studio.jsonl")  # what went wrong before is no longer asked for, and happened all the same
    paint(mended, range(3, 4))
    assert looks(mended.studio) == looks(straight.studio)


def test_a_log_cut_off_at_any_byte_tells_all_that_came_before(tmp_path: Path) -> None:
    path = tmp_path / "studio.jsonl"
    here = hand(path, fill=True)
    here.easel.robot.home()
    here.easel.camera.capture(0)
    content = path.read_bytes()
    ends = [number + 1 for number, byte in enumerate(content) if byte == ord("\n")]
    told = {end: hand(path).studio.clock.now for end in ends[1:] if path.write_bytes(content[:end])}
    for cut in range(ends[0], len(content), 23):
        path.write_bytes(content[:cut])
        last = max(end for end in ends if end <= cut)
        assert hand(path).studio.clock.now == told.get(last, 0.0)
        assert path.read_bytes().startswith(content[:last])
    for cut in (0, 1, ends[0] - 1):
        path.write_bytes(content[:cut])
        with pytest.raises(StorageError, match=r"studio\.jsonl"):
            hand(path)


def test_a_log_that_was_changed_or_is_anothers_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "studio.jsonl"
    hand(path, fill=True).easel.robot.home()
    content = path.read_bytes()
    with pytest.raises(StorageError, match=r"another brush, .*seed"):
        open_studio(CanvasSize(0.12, 0.09), "broad", seed=5, settings=StudioSettings(**SETTINGS), state=path)
    place = content.index(b'"move"') + 20
    path.write_bytes(content[:place] + b"9" + content[place + 1 :] + content.splitlines(keepends=True)[-1])
    with pytest.raises(StorageError, match="damaged"):
        hand(path)
    path.write_text("not a diary\n")
    with pytest.raises(StorageError, match="damaged"):
        hand(path)


def test_a_full_disk_does_not_stop_the_world_and_is_told_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "studio.jsonl"
    here = hand(path, fill=True)

    def full(descriptor: int, content: bytes, place: int) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr("os.pwrite", full)
        here.dip(0)
        here.stroke(0.02, 0.03, 0.05)
    here.easel.robot.home()
    assert looks(hand(path).studio) == looks(here.studio), "written once there was room again"

    here = hand(path)
    monkeypatch.setattr("os.pwrite", full)
    here.easel.robot.home()
    with pytest.raises(StorageError, match="No space left"):
        here.studio.close()
