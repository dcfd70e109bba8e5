"""Easel of a run: the one that its description names, and the person beside it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from frida_painter.easel.dialogue import Answer, Question
from frida_painter.easel.kinds import state_folder
from frida_painter.easel.operator import PersonAsOperator
from frida_painter.easel.order import EaselOrder, SimulationOrder
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.faults import PlacementError
from frida_painter.registry import Later
from frida_painter.runs.spec import RunSpec, millimetres_and_degrees
from frida_painter.session.opening import NEEDED

_paint_by_hand = Later("frida_painter.session.human:ByHand")


def order(spec: RunSpec, brushes: Sequence[str], folder: Path | None, state: Path | None = None) -> EaselOrder:
    """Returns the order for the easel of a description, for a painting in `folder`.

    brushes: brush names; the first brush is in the holder.
    state: folder for latched stops and robot locks. None: one default place for all.
    """
    error = millimetres_and_degrees(spec.placement_error)
    return EaselOrder(
        robot=spec.robot,
        canvas=spec.canvas,
        brushes=tuple(brushes),
        state=state or state_folder(),
        folder=None if folder is None else folder.absolute(),
        workspace=None if spec.workspace is None else spec.workspace.absolute(),
        camera=spec.camera,
        simulation=SimulationOrder(
            spec.seed,
            spec.pace if spec.simulated else 0.0,
            None if error is None else PlacementError(error[:2], error[2]),
            canvas_picture=None if spec.studio_canvas is None else spec.studio_canvas.absolute(),
            film=spec.films_arm,
        ),
    )


def needed_calibrations(spec: RunSpec) -> tuple[str, ...]:
    """Returns the calibration procedures that painting needs; by hand only one.

    Without a camera, none is needed: the workspace tells where the canvas is, and the heights of the brush.
    """
    if not spec.has_camera:
        return ()
    return ("canvas",) if spec.by_hand else NEEDED


def with_operator(easel: Easel, spec: RunSpec, answer: Callable[[Question], Answer] | None) -> Easel:
    """Returns a real easel with its person, as operator or painter, who answers questions; a simulated one as it is."""
    if easel.simulated or answer is None:
        return easel
    if not spec.by_hand:
        return replace(easel, operator=PersonAsOperator(answer))
    hand = _paint_by_hand(easel, answer)
    return replace(easel, robot=hand, camera=hand.camera, operator=hand, foretell=hand.foretell)
