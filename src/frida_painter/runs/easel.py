"""The easel of a run: which one its description means, and the person beside it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.runs.placement_error import millimetres_and_degrees
from frida_painter.runs.spec import RunSpec
from frida_painter.session.by_hand import ByHand
from frida_painter.session.easel_order import EaselOrder
from frida_painter.session.names import SAWYER_SIM, state_folder
from frida_painter.session.operator import PersonAsOperator
from frida_painter.session.procedures.calibration_status import NEEDED
from frida_painter.session.procedures.dialogue import Answer, Question
from frida_painter.virtual.sawyer.meshes import Meshes
from frida_painter.virtual.table import PlacementError


def order(spec: RunSpec, brush: str, folder: Path | None, state: Path | None = None) -> EaselOrder:
    """The easel that the description means, for a painting in `folder`.

    brush: the name of the brush in it; state: where stops are latched and robots locked, by default one place for all.
    """
    error = millimetres_and_degrees(spec.placement_error)
    shapes = spec.arm_meshes if spec.arm_meshes is not None and spec.arm_meshes.is_dir() else None
    return EaselOrder(
        robot=spec.robot,
        canvas=spec.canvas,
        brush=brush,
        seed=spec.seed,
        state=state or state_folder(),
        folder=None if folder is None else folder.absolute(),
        pace=spec.pace if spec.simulated else 0.0,
        placement_error=None if error is None else PlacementError(error[:2], error[2]),
        workspace=None if spec.workspace is None else spec.workspace.absolute(),
        camera=spec.camera,
        film=spec.films_arm,
        meshes=None if shapes is None else shapes.absolute(),
    )


def needed_calibrations(spec: RunSpec) -> tuple[str, ...]:
    """The calibrations without which nothing is painted there: a person's hand needs none of its own."""
    return ("canvas",) if spec.by_hand else NEEDED


def workspace_canvas(spec: RunSpec) -> RunSpec:
    """The description with the canvas of its workspace file, where no other was asked for. Raises ConfigError."""
    if spec.workspace is None or "canvas" in spec.model_fields_set:
        return spec
    size = WorkcellConfig.load(spec.workspace).canvas
    return spec.changed(canvas=f"{size.width * 1000:.3f}x{size.height * 1000:.3f}mm")


def require_possible(spec: RunSpec, *, asked: bool) -> None:
    """Raises ConfigError where a person is to paint and not to be `asked` anything, or shapes of an arm do not fit."""
    if spec.by_hand and not asked:
        raise ConfigError("--yes is for scripts, and a person who paints is asked for every stroke; leave it out.")
    if spec.arm_meshes is None:
        return
    if spec.robot != SAWYER_SIM:
        raise ConfigError(f"--arm-meshes is for the film of --robot {SAWYER_SIM}; leave it out.")
    Meshes.in_folder(spec.arm_meshes)


def require_sensible(spec: RunSpec) -> None:
    """Raises ConfigError where something is said of a real easel that is simulated, or of a simulated one that is not.

    For new paintings: whoever goes on with an old one is not told that it was begun with more than it needs.
    """
    if spec.simulated:
        said: dict[str, object] = {"--camera": spec.camera, "--workspace": spec.workspace}
        whose, is_a = "real", "simulated"
    else:
        said = {"--pace": spec.pace, "--placement-error": spec.placement_error}
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
