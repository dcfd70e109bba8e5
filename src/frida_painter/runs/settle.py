"""Settling of a description: it fits pictures and canvas, chooses open settings, and opens planner and session."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import torch
from torch import Tensor

from frida_painter import registry
from frida_painter.brush.weights import AnyBrush
from frida_painter.calibration import Calibration
from frida_painter.easel.kinds import easel_kind
from frida_painter.easel.operator import ground_recipe
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import PaintSet
from frida_painter.objectives.drawing import draws
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.objective import Goal, Term
from frida_painter.planning.fields import AUTO, OF_SCENE, family_shares
from frida_painter.planning.ground import ground_around_things, proposed_ground
from frida_painter.planning.materials import Materials
from frida_painter.planning.planner import Planner
from frida_painter.report.recorder import Description, Recorder
from frida_painter.runs.goal_item import making_facts
from frida_painter.runs.goals import OF_PICTURES, make_goal, picture_of, tell_terms
from frida_painter.runs.spec import RunSpec
from frida_painter.session.fold import PaintingState
from frida_painter.session.observer import PHOTOGRAPH_ROWS
from frida_painter.session.opening import planning_device
from frida_painter.session.replan_policy import EvenlySpaced, EveryNth, ReplanPolicy, parse_replan_policy
from frida_painter.strokes.palette import to_hex
from frida_painter.strokes.plan import WHITE, Plan
from frida_painter.system import images
from frida_painter.system.images import AnyPicture

if TYPE_CHECKING:
    from frida_painter.runs.setting_types import Settings

_TOLD = 0.01  # share of a picture that may be cut off without a remark, because pixels are whole numbers
_FIT = {
    "canvas": "the canvas has the picture's proportions",
    "crop": "the picture was cropped to the canvas",
    "pad": "the picture was padded to the canvas",
}
_ON_GPU = 100.0  # work of a network on a GPU in the time of a processor, at least
_load_family = registry.Later("frida_painter_calibration.teaching.families:load_family")


@dataclass(frozen=True)
class Fitted:
    """Description and goal whose canvas and pictures have one shape.

    spec: description with its final canvas.
    goal: goal with pictures that fill the canvas.
    target [3, H, W]: first picture of the goal, if any.
    remark: sentence about a lost part of the picture, else "".
    """

    spec: RunSpec
    goal: Goal
    target: Tensor | None
    remark: str = ""


def fit_canvas(spec: RunSpec, goal: Goal, *, canvas_is_fixed: bool = False) -> Fitted:
    """Fits canvas and pictures together as `spec.fit` says.

    canvas_is_fixed: True for the canvas of a painting that has begun; it keeps its size.
    Raises ConfigError if a canvas in the picture's proportions would be too narrow.
    """
    picture, canvas = picture_of(goal), spec.canvas
    fixed = canvas_is_fixed or not spec.simulated or spec.calibration is not None  # then it lies on an easel
    shaped = picture is not None and spec.fit == "canvas" and not fixed
    if picture is not None and (shaped or not (canvas_is_fixed or "canvas" in spec.model_fields_set)):
        canvas = canvas.orient_like(*picture.shape[1:])
    if picture is not None and shaped:
        canvas = canvas.crop_like(*picture.shape[1:])
    spec = spec.model_copy(update={"canvas": canvas}).as_kept
    pads = spec.fit == "pad"
    fine, planned = (
        PixelGrid.of_height(spec.canvas, rows)
        for rows in (max(PHOTOGRAPH_ROWS, spec.render_height), spec.render_height)
    )
    # a multiple of the planning image, whose pixels are then exact means of whole pixels, and no detail is lost before
    times = math.ceil(PHOTOGRAPH_ROWS / planned.rows)
    goal = goal.fit_to(times * planned.rows, times * planned.columns, pad=pads)
    if picture is None:
        return Fitted(spec, goal, None)
    target = (images.pad if pads else images.fit)(picture, fine.rows, fine.columns)
    share = (picture.shape[2] / picture.shape[1]) / (spec.canvas.width / spec.canvas.height)
    lost, side = (1 - 1 / share, "width") if share > 1 else (1 - share, "height")
    cropped = (
        f"The picture is cropped to the canvas: {100 * lost:.0f} % of its {side} is left out. "
        "To paint all of it, give --fit pad, or a canvas in its proportions."
    )
    return Fitted(spec, goal, target, "" if pads or lost <= _TOLD else cropped)


def paints_for_recipes(spec: RunSpec) -> PaintSet:
    """Returns the paints for recipes: those of the description, or six common acrylics. Raises ConfigError."""
    darkest = spec.darkest_paint
    return PaintSet.of(spec.paints, darkest) or PaintSet(usual_paints(), darkest=darkest)


def open_networks(
    spec: RunSpec, tell: Callable[[str], None] = lambda sentence: None, heed: Callable[[], None] = lambda: None
) -> EncoderRegistry:
    """Returns the networks that judge the goal of a description; each is loaded when it is needed.

    tell: receives a sentence about each wait.
    heed: called often in waits; may raise to end them.
    """
    return EncoderRegistry(clip=spec.clip, device=planning_device(), pictures=spec.pictures, tell=tell, heed=heed)


def open_planner(
    spec: RunSpec,
    goal: Goal,
    encoders: EncoderRegistry | None = None,
    brushes: AnyBrush | Sequence[AnyBrush] | None = None,
) -> Planner:
    """Returns the planner of a description, on its ground, or on white if the ground is to be chosen.

    A stroke model in the calibration record is preferred to that of the project.
    encoders: networks that judge the goal. None: those of the description.
    brushes: stroke models instead of the description's brushes.
    Raises CalibrationError if the record is damaged, WeightsError if a brush or a network is missing, ConfigError
    if --clip or --pictures has no use.
    """
    device, networks = planning_device(), encoders or open_networks(spec)
    work = spec.effort * (_ON_GPU if device.type == "cuda" else 1.0)
    told = tell_terms(goal, replace(spec.words, effort=work), spec.freedom)
    materials = Materials.of(spec, brushes, _learned_brushes(spec))
    planner = Planner(told, spec, materials, encoders=networks, device=device)
    chosen_by_clip = making_facts(*spec.goal, *spec.initial)
    if networks.idle_clip is not None and not chosen_by_clip:
        raise ConfigError(
            f"--clip was given {networks.idle_clip[:60]!r}, and nothing of this goal is seen through a CLIP; leave it "
            "out, or give words (--text) or a meaning (--semantic)."
        )
    if networks.idle_pictures is not None:
        raise ConfigError(
            f"--pictures was given {networks.idle_pictures}, and nothing of this goal is made of pictures of things; "
            "leave it out, or give words alone (--text)."
        )
    return planner


def _learned_brushes(spec: RunSpec) -> dict[str, Path]:
    """Returns the weights that the calibration record has for brushes of the description."""
    known = None if spec.calibration is None else Calibration.load(spec.calibration)
    if known is None:
        return {}
    there = {name: known.of_brush(name).weights for name in spec.brush_names if name in (known.brush, *known.others)}
    return {name: Path(weights.path) for name, weights in there.items() if weights is not None}


def replan_policy(spec: RunSpec, layers: tuple[int, ...] = ()) -> ReplanPolicy:
    """Returns the named replan policy; without one, evenly spaced looks, `replans` times; none without camera or goal.

    layers: strokes of each layer; the looks at their starts are among the replans.
    """
    if not spec.has_camera or spec.together:
        return EveryNth.never()
    return parse_replan_policy(spec.replan_policy) if spec.replan_policy else EvenlySpaced(spec.replans, layers)


def open_recorder(
    spec: RunSpec, target: Tensor | None, planner: Planner, folder: Path, state: PaintingState, *, is_mixed: bool
) -> Recorder:
    """Returns the recorder of the painting's folder.

    target [3, H, W]: goal picture.
    state, is_mixed: of the painting, with its earlier sittings; False if nobody mixes paints meanwhile.
    """
    encoders, first = planner.encoders, next(iter(spec.goal), None)
    kind = easel_kind(spec.robot)
    goal_facts = (*spec.goal_facts, *making_facts(*spec.goal, *spec.initial))
    looks = str(spec.replans) if spec.has_camera else "no camera; only at pictures of a person"
    facts = (
        *goal_facts,
        *((f"{choice.purpose.capitalize()} seen through", choice.used) for choice in encoders.choices),
        *((f"Better for {choice.purpose}", choice.better) for choice in encoders.choices if choice.better),
        *(("Remark", remark) for remark in encoders.remarks),
        ("Canvas", f"{spec.canvas}, painted on before" if spec.on_canvas else str(spec.canvas)),
        *([("Ground", ground_recipe(planner.ground))] if planner.ground != WHITE else []),
        *([("Fit", _FIT[spec.fit])] if target is not None else []),
        ("Brush" if len(planner.models) == 1 else "Brushes", ", ".join(planner.models)),
        ("Looks and replans", "a look after every turn" if spec.together else looks),
        ("Planned at", f"{spec.render_height} rows"),
        ("Seed", str(spec.seed)),
        ("Robot", kind.title if kind is not None and kind.simulated else spec.robot),
    )
    settings = {
        **({"photo": Path(first.value).name} if first is not None and first.kind == "image" else {}),
        "goal": [list(fact) for fact in goal_facts],
        "encoders": [asdict(choice) for choice in encoders.choices],
        "remarks": list(encoders.remarks),
        **spec.record(),
    }
    owned = planner.materials.paints or paints_for_recipes(spec)  # the planner's know most of the recipes
    described = Description(spec.heading, target, facts, settings, spec.film_length, spec.has_camera, owned, is_mixed)
    return Recorder(folder, described, planner.models, state)


def ground_of(plan: Plan) -> str:
    """Returns the ground of a plan in the form of --ground."""
    return "white" if plan.ground == WHITE else to_hex(torch.tensor(plan.ground))


def name_families(spec: RunSpec) -> RunSpec:
    """Returns the description with its stroke families among its brushes. Raises FamilyError for an unknown one."""
    if spec.strokes_of is None:
        return spec
    for source, _ in family_shares(spec.strokes_of):
        _load_family(source)
    return spec.model_copy(update={"brushes": spec.layer_brushes, "strokes_of": None})


def settle(
    made: Fitted, encoders: EncoderRegistry | None = None, brushes: AnyBrush | Sequence[AnyBrush] | None = None
) -> tuple[RunSpec, Planner, str]:
    """Chooses an open ground; returns the description with brushes and ground, and its planner.

    Also returns a sentence for the person about the choice, "" if nothing was chosen.
    made: description and goal, fitted to each other.
    encoders, brushes: as for `open_planner`.
    Raises like `open_planner`, and ConfigError if the ground is "auto" and the goal has no picture.
    """
    spec = name_families(made.spec)
    chosen = brushes is not None or spec.brushes is not None or spec.layers is not None
    if not chosen and spec.simulated and not spec.together and draws(made.goal):
        spec = spec.model_copy(update={"brushes": "fine"})
    planner = open_planner(spec, made.goal, encoders, brushes)
    if spec.wanted_ground == AUTO and not planner.draws:
        color = proposed_ground(planner)
        said = "The ground that suits this picture best: {}."
    elif spec.wanted_ground in (AUTO, OF_SCENE):
        color = ground_around_things(planner)
        said = "" if color == WHITE else "The canvas is toned in the commonest colour around what is shown: {}."
    else:
        return spec.model_copy(update={"ground": spec.wanted_ground}), planner, ""
    ground = "white" if color == WHITE else to_hex(torch.tensor(color))
    return spec.model_copy(update={"ground": ground}), planner.on_ground(color), said.format(ground)


def make_planner(
    goal: Goal | AnyPicture,
    /,
    *,
    model: AnyBrush | Sequence[AnyBrush] | None = None,
    encoders: EncoderRegistry | None = None,
    **settings: "Unpack[Settings]",
) -> Planner:
    """Returns the planner that `frida-painter plan` uses for a goal or a picture; equal settings make an equal plan.

    model: own stroke models instead of the brushes of the settings, one for all layers or one for each.
    settings: fields of RunSpec, such as strokes=300, seed=1, canvas="A3", brushes="fine" or focus="none". The
    planner's settings show the choices.
    Raises ConfigError, ImageError and WeightsError.

        >>> import frida_painter as fp
        >>> planner = fp.make_planner("photo.jpg", canvas="12x9cm", strokes=10, colors=3, render_height=64)
        >>> plan = planner.plan()
        >>> fp.save_picture(planner.expected(plan), "plan.png")
        >>> len(plan), plan.brushes
        (10, ('broad',))
    """
    wanted = goal if isinstance(goal, Goal) else make_goal(goal)
    if "goal" in settings or "initial" in settings:
        raise ConfigError("make_planner takes its goal first, and it was given as a setting; use make_goal for it.")
    settings["goal"], settings["initial"] = _describe_terms(wanted.terms), _describe_terms(wanted.initial)
    return settle(fit_canvas(RunSpec.of(**settings), wanted), encoders, model)[1]


def _describe_terms(terms: Sequence[Term]) -> list[dict[str, object]]:
    """Returns terms in the form of a description, without pictures; the defaults depend only on their kinds."""
    names = {term.target: name for name, term in OF_PICTURES.items()}
    usual = [(term, None if term.words is None else "text") for term in terms]
    kinds = [(term, names.get(f"{type(term).__module__}:{type(term).__name__}", kind)) for term, kind in usual]
    return [{kind: term.words or "given as a picture"} for term, kind in kinds if kind is not None]
