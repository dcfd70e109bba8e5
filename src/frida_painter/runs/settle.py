"""Settling of a description: it fits pictures and canvas, chooses open settings, and opens planner and session."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from frida_painter import images, registry
from frida_painter.brush.kinds import StrokeModel
from frida_painter.brush.table import cached_table
from frida_painter.brush.weights import AnyBrush, load_stroke_model
from frida_painter.calibration import Calibration
from frida_painter.easel.kinds import easel_kind
from frida_painter.easel.operator import ground_recipe
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.images import AnyPicture
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import ANY_PAINTS, PaintSet
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.objective import Goal, Term
from frida_painter.palette import Palette, from_hex, to_hex
from frida_painter.plan import WHITE, Plan
from frida_painter.planning.effort import Effort
from frida_painter.planning.ground import ground_around_things, proposed_ground
from frida_painter.planning.mixable import make_mixable
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Planner, stroke_models
from frida_painter.planning.problem import Region
from frida_painter.planning.settings import FEWEST_FOR_LAYERS, PlannerSettings
from frida_painter.report.recorder import Recorder
from frida_painter.runs.fields import AUTO, OF_SCENE, family_shares, rgb
from frida_painter.runs.goal_item import making_facts
from frida_painter.runs.goals import OF_PICTURES, make_goal, picture_of, tell_terms
from frida_painter.runs.spec import RunSpec
from frida_painter.session.fold import PaintingState
from frida_painter.session.observer import PHOTOGRAPH_ROWS
from frida_painter.session.opening import planning_device
from frida_painter.session.replan_policy import EvenlySpaced, NeverLooks, ReplanPolicy, parse_replan_policy
from frida_painter.strokes import Strokes

_TOLD = 0.01  # share of a picture that may be cut off without a remark, because pixels are whole numbers
_FIT = {
    "canvas": "the canvas has the picture's proportions",
    "crop": "the picture was cropped to the canvas",
    "pad": "the picture was padded to the canvas",
}
_DARKEST_OF_STUDIO = "#121212"  # its soot reflects 0.6 % of the light
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
    if pads or lost <= _TOLD:
        return Fitted(spec, goal, target)
    return Fitted(
        spec,
        goal,
        target,
        f"The picture is cropped to the canvas: {100 * lost:.0f} % of its {side} is left out. "
        "To paint all of it, give --fit pad, or a canvas in its proportions.",
    )


def wanted_ground(spec: RunSpec) -> str:
    """Returns the ground of the description, or the default one.

    The default is white. If a simulated operator tones, it is AUTO for pictures and their content of 100 strokes or
    more, and OF_SCENE for words without a picture and for styles. The planner later replaces AUTO and OF_SCENE by a
    colour.
    """
    if spec.ground is not None:
        return spec.ground
    if not spec.simulated or spec.studio_canvas is not None or spec.on_canvas:
        return "white"
    kinds = {item.kind for item in spec.goal}
    composed = "text" in kinds and not spec.initial and kinds <= {"text", "sketch", "style"}
    if composed or "style" in kinds:
        return OF_SCENE
    pictured = not spec.initial and not kinds.isdisjoint(("image", "semantic"))
    return AUTO if pictured and spec.strokes >= FEWEST_FOR_LAYERS else "white"


def darkest_paint(spec: RunSpec) -> tuple[float, float, float] | None:
    """Returns sRGB of the darkest available paint: the given one, that of the virtual studio, or None if unknown."""
    told = spec.darkest or (_DARKEST_OF_STUDIO if spec.simulated else None)
    return None if told is None else rgb(told)


def paints_for_recipes(spec: RunSpec) -> PaintSet:
    """Returns the paints for recipes: those of the description, or six common acrylics. Raises ConfigError."""
    darkest = darkest_paint(spec)
    return PaintSet.of(spec.paints, darkest) or PaintSet(usual_paints(), darkest=darkest)


def open_planner(
    spec: RunSpec,
    goal: Goal,
    encoders: EncoderRegistry | None = None,
    model: StrokeModel | Sequence[StrokeModel] | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
    heed: Callable[[], None] = lambda: None,
) -> Planner:
    """Returns the planner of a description, on its ground, or on white if the ground is to be chosen.

    A stroke model in the calibration record is preferred to that of the project.
    encoders: networks that judge the goal. None: the fetched ones.
    model: stroke models instead of the description's brushes.
    tell: receives a sentence about each wait.
    heed: called often in waits; may raise to end them.
    Raises CalibrationError if the record is damaged, WeightsError if a brush or a network is missing, ConfigError
    if --clip or --pictures has no use.
    """
    device = planning_device()
    networks = encoders or EncoderRegistry(clip=spec.clip, device=device, pictures=spec.pictures, tell=tell, heed=heed)
    work = spec.effort * (_ON_GPU if device.type == "cuda" else 1.0)
    told = tell_terms(goal, replace(spec.words, effort=work), spec.freedom)
    planner = Planner(told, planner_settings(spec, model), encoders=networks, device=device)
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


def planner_settings(spec: RunSpec, model: StrokeModel | Sequence[StrokeModel] | None = None) -> PlannerSettings:
    """Returns the planner's settings for a description. Raises like `open_planner`.

    model: stroke models instead of the description's brushes.
    """
    known = None if spec.calibration is None else Calibration.load(spec.calibration)
    names, shares = spec.brush_names, spec.shares
    layers = spec.layers if len(names) == 1 or not spec.names_brushes else len(names)
    if model is None:
        models: dict[str, StrokeModel] = {}
        for name in dict.fromkeys(names):
            is_known = known is not None and name in (known.brush, *known.others)
            learned = known.of_brush(name).weights if known is not None and is_known else None
            models[name] = cached_table(load_stroke_model(name if learned is None else Path(learned.path)))
        model = [models[name] for name in names]
    else:
        layers, shares = spec.layers, None
    told: dict[str, Any] = {
        one.name: getattr(spec, one.name) for one in fields(PlannerSettings) if one.name in RunSpec.model_fields
    }
    told |= {
        "rows": spec.render_height,
        "effort": Effort().scale(spec.effort),
        "layers": 1 if layers is None and (spec.is_short or spec.together) else layers,
        "shares": shares,
        "new_paints": spec.new_paints is not False and spec.palette is None,
        "ground": WHITE if (ground := wanted_ground(spec)) in (AUTO, OF_SCENE) else rgb(ground),
        "darkest": darkest_paint(spec),
        "paints": spec.paints if spec.palette is None else ANY_PAINTS,
    }
    return PlannerSettings(spec.canvas, model, **told)


def replan_policy(spec: RunSpec, layers: tuple[int, ...] = ()) -> ReplanPolicy:
    """Returns the named replan policy; without one, evenly spaced looks, `replans` times; none without camera or goal.

    layers: strokes of each layer; the looks at their starts are among the replans.
    """
    if not spec.has_camera or spec.together:
        return NeverLooks()
    return parse_replan_policy(spec.replan_policy) if spec.replan_policy else EvenlySpaced(spec.replans, layers)


def open_recorder(
    spec: RunSpec, target: Tensor | None, planner: Planner, folder: Path, state: PaintingState
) -> Recorder:
    """Returns the recorder of the painting's folder.

    target [3, H, W]: goal picture.
    state: of the painting, with its earlier sittings.
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
    return Recorder(
        folder,
        spec.heading,
        target,
        facts,
        settings,
        planner.models,
        spec.film_length,
        state,
        has_camera=spec.has_camera,
        watched=spec.has_camera or state.is_pictured,
        owned=paints_for_recipes(spec),
    )


# Beginning of a painting without a goal: the paints in the wells, and a plan without strokes.

_COLORS = ("#26262b", "#b23a2e", "#2f5f96", "#e3ab2f", "#f3efe4", "#3f7d4e", "#8a5636", "#7a4c8f")
_APART = 5.0  # CIEDE2000 between two paints


def begin_together(planner: Planner, colors: int, mixed: Palette | None = None) -> Plan:
    """Returns a plan without strokes, to which each answer to a person adds some.

    colors: greatest number of paints: ink, red, blue, yellow, cream, green, brown and violet, in this order.
    mixed: really mixed paints; None for those, as the paints of the planner mix them.
    """
    color = torch.stack([from_hex(each) for each in _COLORS[:colors]])
    if planner.paints is not None:
        color = make_mixable(color, torch.ones(len(color)), planner.paints, _APART).color
    palette = mixed or Palette.sort_light_to_dark(color)
    model, no_paint = planner.models[planner.kinds[0]], torch.zeros(0, dtype=torch.long)
    limits = model.limits.within(planner.size)
    return Plan.of(
        Strokes.empty(), palette, no_paint, brush=model.brush, limits=limits, canvas=planner.size, ground=planner.ground
    )


# Choice of the ground, if the description leaves it to the planner.


def settle_ground(
    spec: RunSpec, planner: Planner, notify: Callable[[Step], None] = lambda step: None
) -> tuple[Planner, str, str]:
    """Chooses the ground; returns the planner on it, its name ("white" or a colour), and a sentence about the choice.

    The sentence is "" if nothing was chosen.
    notify: called at every step of quick plans.
    Raises ConfigError if the ground is "auto" and the goal has no picture.
    """
    wanted, said = wanted_ground(spec), ""
    if wanted == AUTO:
        color = proposed_ground(planner, spec.strokes, spec.colors, notify)
        said = "The ground that suits this picture best: {}."
    elif wanted == OF_SCENE:
        color = ground_around_things(planner)
        said = "" if color == WHITE else "The canvas is toned in the commonest colour around what is shown: {}."
    else:
        return planner, wanted, ""
    ground = _name_color(color)
    return planner.on_ground(color), ground, said.format(ground)


def ground_of(plan: Plan) -> str:
    """Returns the ground of a plan in the form of --ground."""
    return _name_color(plan.ground)


def _name_color(color: tuple[float, float, float]) -> str:
    return "white" if color == WHITE else to_hex(torch.tensor(color))


def name_families(spec: RunSpec) -> RunSpec:
    """Returns the description with its stroke families among its brushes. Raises FamilyError for an unknown one."""
    if spec.strokes_of is None:
        return spec
    for source, _ in family_shares(spec.strokes_of):
        _load_family(source)
    return spec.model_copy(update={"brushes": spec.layer_brushes, "strokes_of": None})


# Settling of a description: open settings are chosen once, and the planner is opened.


def settle(
    made: Fitted,
    encoders: EncoderRegistry | None = None,
    *,
    region: Region | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
    heed: Callable[[], None] = lambda: None,
) -> tuple[RunSpec, Planner, str]:
    """Chooses an open ground by quick plans; returns the description with brushes and ground, and its planner.

    Also returns a sentence for the person about the choice, "" if nothing was chosen.
    made: description and goal, fitted to each other.
    encoders: networks that judge the goal. None: the fetched ones.
    region: part of the canvas that strokes keep clear of.
    tell: receives a sentence about each wait.
    heed: called often in waits; may raise to end them.
    Raises like `open_planner`.
    """
    said: list[str] = []

    def choosing(step: Step) -> None:
        heed()
        if not said:
            said.append("Choosing the ground, by quick plans.")
            tell(said[0])

    spec = name_families(made.spec)
    planner = open_planner(spec, made.goal, encoders, tell=tell, heed=heed)
    planner, ground, remark = settle_ground(spec, planner, choosing)
    spec = spec.model_copy(update={"ground": ground})
    return spec, planner if region is None else planner.keeping_clear(region), remark


def make_planner(
    goal: Goal | AnyPicture,
    /,
    *,
    model: AnyBrush | Sequence[AnyBrush] | None = None,
    encoders: EncoderRegistry | None = None,
    **settings: Any,
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
    settings |= {"goal": _describe_terms(wanted.terms), "initial": _describe_terms(wanted.initial)}
    made = fit_canvas(RunSpec.of(**settings), wanted)
    if model is None:
        return settle(made, encoders)[1]
    planner = open_planner(made.spec, made.goal, encoders, stroke_models(model))
    return settle_ground(made.spec, planner)[0]


def _describe_terms(terms: Sequence[Term]) -> list[dict[str, object]]:
    """Returns terms in the form of a description, without pictures; the defaults depend only on their kinds."""
    names: dict[type[Term], str] = {term: name for name, term in OF_PICTURES.items()}
    kinds = [(term, names.get(type(term), None if term.words is None else "text")) for term in terms]
    return [{kind: term.words or "given as a picture"} for term, kind in kinds if kind is not None]
