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


def settled_ground(
    spec: RunSpec, planner: Planner, notify: Callable[[Step], None] = unheard
) -> tuple[Planner, str, str]:
    """The planner on the ground that the description means, that ground, "white" or a colour, and a sentence on it.

    The sentence is "" if nothing was chosen. notify: hears of every step of quick plans. Raises ConfigError if no
    picture tells colours for "auto".
    """
    wanted = wanted_ground(spec)
    if wanted == AUTO:
        color, said = (
            proposed_ground(planner, spec.strokes, spec.colors, notify),
            "The ground that suits this picture best: {}.",
        )
    elif wanted == OF_SCENE:
        color = ground_around_things(planner)
        said = "" if color == WHITE else "The canvas is toned in the colour around the things of the scene: {}."
    else:
        return planner, wanted, ""
    ground = _named(color)
    return planner.on_ground(color), ground, said.format(ground)


def ground_of(plan: Plan) -> str:
    """The ground of a plan, as --ground has it: what was settled when it was made."""
    return _named(plan.ground)


def _named(color: tuple[float, float, float]) -> str:
    return "white" if color == WHITE else to_hex(torch.tensor(color))
