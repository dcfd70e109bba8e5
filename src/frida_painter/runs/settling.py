"""A painting's description is settled, once: what it leaves to the planner is chosen, and there is a planner for it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.goal import Goal, Term
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.semantic import SemanticTerm
from frida_painter.objectives.kinds.sketch import SketchTerm
from frida_painter.objectives.kinds.style import StyleTerm
from frida_painter.planning.planner import Planner
from frida_painter.planning.region import Region
from frida_painter.runs.brush_choice import suited_brushes
from frida_painter.runs.fields import AUTO
from frida_painter.runs.fitting import Fitted, fitted
from frida_painter.runs.goals import Picture, make_goal
from frida_painter.runs.ground_choice import settled_ground
from frida_painter.runs.opening import open_planner
from frida_painter.runs.spec import RunSpec

_KINDS: dict[type[Term], str] = {
    ImageTerm: "image",
    SemanticTerm: "semantic",
    SketchTerm: "sketch",
    StyleTerm: "style",
}


@dataclass(frozen=True)
class SettledRun:
    """A painting of which nothing is left open.

    spec: with its canvas, brushes and ground; planner: what plans it, on that ground; remarks: sentences for the
    person, on what was chosen.
    """

    spec: RunSpec
    planner: Planner
    remarks: tuple[str, ...]


def settle(
    made: Fitted,
    encoders: EncoderRegistry | None = None,
    *,
    region: Region | None = None,
    choosing: Callable[[str], None] = lambda what: None,
    tell: Callable[[str], None] = lambda sentence: None,
) -> SettledRun:
    """Chooses the brushes and the ground that a description leaves open, by quick plans, and opens the planner.

    made: the description and its goal, which fit each other; encoders: the networks that the goal is seen through, by
    default those that were fetched; region: what strokes keep clear of; choosing: hears at every step of quick plans
    what they choose, "brushes" or "ground", and may raise to end them. Raises what `open_planner` does.
    """
    spec, remarks = made.spec, []
    if spec.brushes == AUTO:
        brushes = suited_brushes(spec, made.goal, encoders, notify=lambda step: choosing("brushes"))
        spec = spec.model_copy(update={"brushes": brushes})
        remarks.append(f"The brushes that suit this picture best: {brushes}.")
    planner = open_planner(spec, made.goal, encoders, tell=tell)
    planner, ground, remark = settled_ground(spec, planner, lambda step: choosing("ground"))
    if spec.ground != ground:
        spec = spec.model_copy(update={"ground": ground})
    remarks += [remark] if remark else []
    return SettledRun(spec, planner if region is None else planner.keeping_clear(region), tuple(remarks))


def make_planner(
    goal: Goal | Picture,
    *,
    model: StrokeModel | Sequence[StrokeModel] | None = None,
    encoders: EncoderRegistry | None = None,
    **settings: Any,
) -> Planner:
    """The planner that `frida-painter plan` has for a goal or a picture: the same settings make the same plan.

    model: stroke models of one's own in place of the brushes that the settings name, one for all layers or one each;
    settings: fields of RunSpec, such as strokes=300, seed=1, canvas="A3", brushes="fine" or focus="none". The planner's
    settings say what was chosen. Raises ConfigError, ImageError and WeightsError.
    """
    wanted = goal if isinstance(goal, Goal) else make_goal(goal)
    described = {"goal": _described(wanted.terms), "initial": _described(wanted.initial)}
    made = fitted(RunSpec.of(**described, **settings), wanted)
    if model is None:
        return settle(made, encoders).planner
    planner = open_planner(made.spec, made.goal, encoders, model)
    return settled_ground(made.spec, planner)[0]


def _described(terms: Sequence[Term]) -> list[dict[str, object]]:
    """Terms as a description names them, without their pictures: what is usual depends on their kinds."""
    kinds = [(term, _KINDS.get(type(term), None if term.words is None else "text")) for term in terms]
    return [{kind: term.words or "given as a picture"} for term, kind in kinds if kind is not None]
