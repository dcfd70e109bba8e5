"""Which brushes suit a picture: found by quick plans with several."""

from collections.abc import Callable, Sequence

from frida_painter.calibration import Calibration
from frida_painter.errors import ConfigError
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.plan import Plan
from frida_painter.planning.layers import FEWEST_FOR_LAYERS
from frida_painter.planning.optimize import Step
from frida_painter.planning.step_count import unheard
from frida_painter.runs.fields import brush_shares
from frida_painter.runs.opening import open_planner
from frida_painter.runs.spec import RunSpec

IN_ONE_LAYER = ("broad", "medium", "fine")
IN_LAYERS = ("broad:30%,medium:35%,fine:35%", "broad:50%,medium:50%", "medium:50%,fine:25%,fine:25%")
_TRYING = 0.25  # of the effort
_LEAST_EFFORT = 0.05


def suited_brushes(
    spec: RunSpec,
    goal: Goal,
    encoders: EncoderRegistry | None = None,
    notify: Callable[[Step], None] = unheard,
) -> str:
    """The brushes with which a quick plan leaves the least expected loss, as --brushes has them.

    A real easel has those of its calibration record. notify: hears of every step. Raises ConfigError where none of
    these is to be chosen, and what `open_planner` raises.
    """

    def expected_loss(brushes: str) -> float:
        effort = max(_LEAST_EFFORT, _TRYING * spec.effort)
        planner = open_planner(spec.model_copy(update={"brushes": brushes, "effort": effort}), goal, encoders)
        return planner.expected_loss(planner.plan(planner.bare, spec.strokes, spec.colors, notify), planner.bare)

    return min(choices(spec), key=expected_loss)


def choices(spec: RunSpec) -> Sequence[str]:
    """What there is to choose from, as --brushes has it."""
    several = spec.strokes >= FEWEST_FOR_LAYERS and not spec.is_short
    named = (*(IN_LAYERS if several else ()), *([] if several and spec.simulated else IN_ONE_LAYER))
    if spec.simulated or spec.calibration is None:
        return named
    known = Calibration.load(spec.calibration)
    there = {known.brush, *known.others}
    found = [brushes for brushes in named if there.issuperset(brush for brush, _ in brush_shares(brushes))]
    if not found:
        raise ConfigError(
            f"--brushes auto chooses among {', '.join(IN_ONE_LAYER)}, and the calibration record knows "
            f"{', '.join(sorted(there))}; name the brush, or calibrate another one: calibrate brush --brush medium."
        )
    return found


def brushes_of(plan: Plan) -> str:
    """The brushes of a plan's layers with their shares, as --brushes has them."""
    shares = [(layer.brush, 100 * layer.strokes / len(plan)) for layer in plan.layers if layer.strokes]
    return ",".join(f"{brush}:{share:.4f}%" for brush, share in shares)
