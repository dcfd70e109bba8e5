"""The easel of a run: which one its description means, and the person beside it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import Easel
from frida_painter.runs.fields import millimetres_and_degrees
from frida_painter.runs.spec import RunSpec
from frida_painter.session.by_hand import ByHand
from frida_painter.session.easel_order import EaselOrder
from frida_painter.session.names import state_folder
from frida_painter.session.operator import PersonAsOperator
from frida_painter.session.procedures.calibration_status import NEEDED
from frida_painter.session.procedures.dialogue import Answer, Question
from frida_painter.virtual.sawyer.meshes import Meshes
from frida_painter.virtual.table import PlacementError


def order(spec: RunSpec, brushes: Sequence[str], folder: Path | None, state: Path | None = None) -> EaselOrder:
    """The easel that the description means, for a painting in `folder`.

    brushes: by their names, the first of them in its holder;
    state: where stops are latched and robots locked, by default one place for all.
    Raises ConfigError where the folder of --arm-meshes holds no arm.
    """
    error = millimetres_and_degrees(spec.placement_error)
    if spec.arm_meshes is not None:
        Meshes.in_folder(spec.arm_meshes)
    return EaselOrder(
        robot=spec.robot,
        canvas=spec.canvas,
        brushes=tuple(brushes),
        seed=spec.seed,
        state=state or state_folder(),
        folder=None if folder is None else folder.absolute(),
        pace=spec.pace if spec.simulated else 0.0,
        placement_error=None if error is None else PlacementError(error[:2], error[2]),
        workspace=None if spec.workspace is None else spec.workspace.absolute(),
        camera=spec.camera,
        film=spec.films_arm,
        canvas_picture=None if spec.studio_canvas is None else spec.studio_canvas.absolute(),
        meshes=None if spec.arm_meshes is None else spec.arm_meshes.absolute(),
    )


def needed_calibrations(spec: RunSpec) -> tuple[str, ...]:
    """The calibrations without which nothing is painted there: a person's hand needs none of its own."""
    return ("canvas",) if spec.by_hand else NEEDED


def require_sensible(spec: RunSpec) -> None:
    """Raises ConfigError where something is said of a real easel that is simulated, or of a simulated one that is not.

    For new paintings: whoever goes on with an old one is not told that it was begun with more than it needs.
    """
    if spec.simulated:
        said: dict[str, object] = {"--camera": spec.camera, "--workspace": spec.workspace}
        whose, is_a = "real", "simulated"
        if spec.on_canvas and spec.studio_canvas is None:
            raise ConfigError(
                "--on-canvas was given, and the canvas of the virtual studio is bare; leave it out, or give a picture "
                "of what is on the canvas: --studio-canvas FILE"
            )
    else:
        said = {
            "--pace": spec.pace,
            "--placement-error": spec.placement_error,
            "--studio-canvas": spec.studio_canvas,
        }
        whose, is_a = "simulated", "real"
    named = [option for option, value in said.items() if value]
    them = "it" if len(named) == 1 else "them"
    if named:
        raise ConfigError(
            f"{' and '.join(named)} {'is' if len(named) == 1 else 'are'} for {whose} robots, and --robot "
            f"{spec.robot[:60]} is a {is_a} one; leave {them} out, or name another robot."
        )


def with_operator(easel: Easel, spec: RunSpec, answer: Callable[[Question], Answer] | None) -> Easel:
    """A real easel with the person beside it, or painting on it, who answers questions; a simulated one as it is."""
    if easel.simulated or answer is None:
        return easel
    if not spec.by_hand:
        return replace(easel, operator=PersonAsOperator(answer))
    hand = ByHand(easel, answer)
    return replace(easel, robot=hand, camera=hand.camera, operator=hand, foretell=hand.foretell)
