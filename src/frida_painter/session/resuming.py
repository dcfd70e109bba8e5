"""Resuming of a painting: reads the state from its folder, and lists changes since its beginning."""

import contextlib
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Answer, Question
from frida_painter.easel.kinds import NO_CAMERA, REGIONS, SIMULATION_LOG
from frida_painter.easel.operator import brush_in_hand
from frida_painter.errors import CalibrationError, FrameRejected, ImageError, PlanError, StorageError
from frida_painter.frames import PixelGrid
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.frame_check import Expected
from frida_painter.perception.rectify import rectify
from frida_painter.planning.planner import Planner
from frida_painter.planning.problem import Region, region_of
from frida_painter.session.events import PlanAdopted
from frida_painter.session.fold import PaintingState
from frida_painter.session.hand import Hand
from frida_painter.session.journal import A_PHOTOGRAPH, PHOTOGRAPHS, PLAN
from frida_painter.session.observer import PHOTOGRAPH_ROWS, CanvasObserver
from frida_painter.session.open_loop import Models, bare_paper, paint_on_paper
from frida_painter.strokes.plan import Plan
from frida_painter.system import images, storage


@dataclass(frozen=True)
class KeptPlan:
    """Plan in a painting's folder, and its entry in the journal.

    foreign: True if the journal names another plan.
    """

    plan: Plan
    planning: PlanAdopted
    foreign: bool = False


def load_kept_plan(folder: Path, state: PaintingState) -> KeptPlan | None:
    """Returns the plan to go on with; None if the painting broke off before the first plan.

    Raises PlanError if the plan is damaged, or if all its strokes are already painted.
    """
    if not state.planning.adopted or (state.progress.painted == 0 and not (folder / PLAN).exists()):
        return None
    plan = Plan.load(folder)
    last = state.planning.adopted[-1]
    if plan.digest == last.plan:
        return KeptPlan(plan, last)
    # The painting broke off after the journal's note of a replan and before the plan was saved.
    earlier = [planning for planning in state.planning.adopted if planning.plan != last.plan]
    unpainted = state.progress.painted == last.done and state.progress.in_doubt is None
    if earlier and unpainted and plan.digest == earlier[-1].plan:
        return KeptPlan(plan, earlier[-1])
    if len(plan) <= state.progress.painted:
        raise PlanError(
            f"{folder / PLAN} has {len(plan)} strokes, of which {state.progress.painted} are painted already; "
            "bring the plan of this painting back."
        )
    return KeptPlan(plan, replace(last, plan=plan.digest, answers=False), foreign=True)


def changes(
    folder: Path,
    state: PaintingState,
    settings: Mapping[str, Any],
    rests_on: Mapping[str, str],
    kept: KeptPlan | None,
    log_records_missing: int = 0,
) -> list[str]:
    """Returns all changes since the painting began or broke off, one line each with the old and the new value.

    log_records_missing: number of records lost at the end of a simulated studio's log.
    """
    lines = [
        f"{name}: it was {state.sittings.settings.get(name)!r}, and is {settings.get(name)!r}"
        for name in sorted({*state.sittings.settings, *settings})
        if state.sittings.settings.get(name) != settings.get(name)
    ]
    lines += [
        f"{name}: it was {_short(state.sittings.rests_on.get(name))}, and is {_short(rests_on.get(name))}"
        for name in sorted({*state.sittings.rests_on, *rests_on})
        if state.sittings.rests_on.get(name) != rests_on.get(name)
    ]
    lines += [
        f"{name}: it is {fault}" for name in state.pictures.files if (fault := _fault(folder, name, state)) is not None
    ]
    if state.sittings.missing:
        gone = _records(state.sittings.missing)
        lines.append(f"journal: its last {gone} gone, and their strokes would be painted again")
    if log_records_missing:
        lines.append(
            f"{SIMULATION_LOG}: its last {_records(log_records_missing)} gone, and what they put on the virtual canvas"
        )
    if kept is not None and kept.foreign:
        noted = state.planning.adopted[-1].plan
        lines.append(f"plan: it was {_short(noted)}, and is {_short(kept.plan.digest)}, of {len(kept.plan)} strokes")
    return lines


def _fault(folder: Path, name: str, state: PaintingState) -> str | None:
    """Returns the fault of a photograph that the painting relies on; None if it is unchanged."""
    if not storage.exists(folder / name):
        return "gone"
    try:
        content = storage.sha256(folder / name, A_PHOTOGRAPH)
    except StorageError:
        return "no file that can be read"
    return None if state.pictures.files[name] in (None, content) else "another one than was taken"


def recall_brush(hand: Hand, state: PaintingState, answer: Callable[[Question], Answer] | None) -> None:
    """Restores the brush that a robot with a rack held when the painting broke off; if unknown, asks a person.

    Call it before anything moves. Raises Interrupted if nobody answers, and the errors of `Hand.require_rack`.
    """
    if hand.has_rack:
        hand.require_rack()
        names = [kind.name for kind in (hand.brush, *hand.others)]
        hand.held = brush_in_hand(names, answer) if state.brush.held is None else state.brush.held


def light(state: PaintingState) -> FlatField | None:
    """Returns the light of the room from the journal; None before the first look."""
    return None if state.pictures.light is None else FlatField.of(state.pictures.light)


def region(folder: Path, state: PaintingState) -> Region | None:
    """Returns the protected region that a person drew; None if there is none. Raises ImageError."""
    if (drawn := state.wishes.region) is None:
        return None
    return region_of(images.load(folder / REGIONS / str(drawn.drawing)), only_inside=drawn.only)


BARE = f"{PHOTOGRAPHS}/look-0000.png"
"""First photograph, with which later ones are compared."""


def load_photograph(folder: Path, name: str | None) -> NDArray[np.uint8] | None:
    """Returns a photograph [H, W, 3] of the painting; None if there is none, or if it is lost."""
    try:
        return None if name is None else images.load_exactly(folder / name)
    except ImageError:
        return None


def expect_canvas(kept: KeptPlan, state: PaintingState, planner: Planner, before: Tensor) -> Expected:
    """Returns the expected canvas: `before` with the strokes painted since, including the stroke in doubt."""
    until = state.progress.painted if state.progress.in_doubt is None else state.progress.in_doubt
    since = kept.plan.part(slice(kept.planning.done, until))
    return Expected(before, planner.expected(since, before) if len(since) else before)


def last_canvas(folder: Path, state: PaintingState, size: CanvasSize, calibration: Path) -> Tensor:
    """Returns the canvas [3, H, W] of the last photograph, or of the saved picture if that photograph is lost.

    calibration: record that it was painted with.
    Without a camera, returns the canvas as it was last assumed.
    Raises ImageError if both are lost.
    """
    if state.pictures.assumed is not None and storage.exists(folder / state.pictures.assumed):
        return images.load(folder / state.pictures.assumed)
    seen = load_canvas(folder, state.pictures.last, state, size, calibration)
    known = folder / "canvas.png"  # a folder of an older version has only the painting
    return images.load(known if known.exists() else folder / "painting.png") if seen is None else seen


def load_canvas(
    folder: Path, name: str | None, state: PaintingState, size: CanvasSize, calibration: Path
) -> Tensor | None:
    """Returns the canvas [3, H, W] in a photograph of the painting.

    None if the photograph, the record or the light is unknown.
    """
    known_light = light(state)
    if (taken := load_photograph(folder, name)) is None:
        return None
    try:
        known = Calibration.load(calibration)
    except CalibrationError:
        return None
    if known.camera == NO_CAMERA:  # its pictures show the canvas alone, in true colours
        return images.from_uint8(taken)
    if known_light is None:
        return None
    return true_color(known_light.correct(rectify(taken, known, PixelGrid.of_height(size, PHOTOGRAPH_ROWS))), known)


def load_seen_canvas(folder: Path, kept: KeptPlan, observer: CanvasObserver) -> Tensor | None:
    """Returns the canvas [3, H, W] that the plan was made for, from its photograph; None if that is lost."""
    photograph = load_photograph(folder, kept.planning.photograph)
    with contextlib.suppress(FrameRejected):
        return None if photograph is None else observer.see(photograph, PHOTOGRAPH_ROWS)
    return None


def resume_open_loop(
    folder: Path, kept: KeptPlan, painted: int, left_out: Set[int], models: Models
) -> tuple[Tensor, Tensor]:
    """Returns the canvas [3, H, W] that the plan was made for, and the canvas as it should be after `painted` strokes.

    left_out: indices of strokes that are not on the canvas.
    If the picture of the first one is lost, it is rendered from the strokes before.
    """
    done, before = kept.planning.done, None
    if kept.planning.photograph is not None:
        with contextlib.suppress(ImageError):
            before = images.load(folder / kept.planning.photograph)

    def paint(first: int, last: int, canvas: Tensor) -> Tensor:
        there = [index for index in range(first, last) if index not in left_out]
        return paint_on_paper(kept.plan.part(there), models, canvas)

    bare = bare_paper(kept.plan.canvas, kept.plan.ground)
    if before is None:
        before = paint(0, done, bare)
    return before, paint(0, painted, bare) if painted < done else paint(done, painted, before)


def _records(count: int) -> str:
    return "record is" if count == 1 else f"{count} records are"


def _short(digest: str | None) -> str:
    """Returns the beginning of a hash, enough for people to tell two hashes apart."""
    return "none" if digest is None else digest[:12]
