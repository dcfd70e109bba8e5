"""Which ground a painting has, where its description leaves that to the planner."""

from collections.abc import Callable

import torch

from frida_painter.palette import to_hex
from frida_painter.plan import WHITE, Plan
from frida_painter.planning.ground import ground_around_things, proposed_ground
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Planner
from frida_painter.planning.step_count import unheard
from frida_painter.runs.fields import AUTO, OF_SCENE
from frida_painter.runs.opening import wanted_ground
from frida_painter.runs.spec import RunSpec


def settled_ground(spec: RunSpec, planner: Planner, notify: Callable[[Step], None] = unheard) -> tuple[str, str]:
    """The ground, "white" or a colour, which the planner has from then on, and a sentence on it or "".

    notify: hears of every step of quick plans. Raises ConfigError where no picture tells colours for "auto".
    """
    wanted = wanted_ground(spec)
    if wanted == AUTO:
        planner.ground = proposed_ground(planner, spec.strokes, spec.colors, notify)
        said = "The ground that suits this picture best: {}."
    elif wanted == OF_SCENE:
        planner.ground = ground_around_things(planner)
        said = (
            "" if planner.ground == WHITE else "The canvas is toned in the colour around the things of the scene: {}."
        )
    else:
        return wanted, ""
    ground = _named(planner.ground)
    return ground, said.format(ground)


def ground_of(plan: Plan) -> str:
    """The ground of a plan, as --ground has it: what was settled when it was made."""
    return _named(plan.ground)


def _named(color: tuple[float, float, float]) -> str:
    return "white" if color == WHITE else to_hex(torch.tensor(color))
