"""Settling of a description: it fits pictures and canvas, chooses open settings, and opens planner and session."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from frida_painter import images, registry
from frida_painter.brush.kinds import StrokeModel, brush_kind
from frida_painter.brush.table import cached_table
from frida_painter.brush.weights import AnyBrush, load_stroke_model
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.compiled import await_loops
from frida_painter.easel.kinds import easel_kind
from frida_painter.easel.operator import ground_recipe
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.images import AnyPicture
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import ANY_PAINTS, PaintSet
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.objective import (
    Goal,
    Term,
)
from frida_painter.palette import Palette, from_hex, to_hex
from frida_painter.perception.flatfield import FlatField
from frida_painter.plan import WHITE, Plan
from frida_painter.planning.effort import Effort
from frida_painter.planning.ground import ground_around_things, proposed_ground
from frida_painter.planning.mixable import make_mixable
from frida_painter.planning.optimize import Step
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner, stroke_models
from frida_painter.planning.problem import Region
from frida_painter.planning.settings import FEWEST_FOR_LAYERS, PlannerSettings
from frida_painter.report.recorder import Recorder
from frida_painter.runs.fields import OF_SCENE, ground_color, rgb
from frida_painter.runs.goal_item import making_facts
from frida_painter.runs.goals import OF_PICTURES, make_goal, picture_of, tell_terms
from frida_painter.runs.shares import AUTO, brush_shares, family_shares
from frida_painter.runs.spec import RunSpec
from frida_painter.session.controls import Controls
from frida_painter.session.events import Notify
from frida_painter.session.hand import Hand, with_measured_dip
from frida_painter.session.journal import History, Journal
from frida_painter.session.loop import Extent, PaintingSession
from frida_painter.session.observer import PHOTOGRAPH_ROWS, CanvasObserver, CanvasStart
from frida_painter.session.opening import planning_device
from frida_painter.session.replan_policy import EvenlySpaced, NeverLooks, ReplanPolicy, parse_replan_policy
from frida_painter.strokes import Strokes

_TOLD = 0.01  # share of a picture that may be cut off without a remark, because pixels are whole numbers


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
    remark = "" if picture is None or spec.fit == "pad" else _describe_crop(picture, spec.canvas)
    grid = PixelGrid.of_height(spec.canvas, max(PHOTOGRAPH_ROWS, spec.render_height))
    place = images.pad if spec.fit == "pad" else images.fit
    target = None if picture is None else place(picture, grid.rows, grid.columns)
    return Fitted(spec, goal.fit_to(*_planning_size(spec), pad=spec.fit == "pad"), target, remark)


def _planning_size(spec: RunSpec) -> tuple[int, int]:
    """Returns rows and columns of the pictures for a planner: a multiple of its planning image.

    The planner's pixels are then exact means of whole pixels, and no detail is lost before.
    """
    grid = PixelGrid.of_height(spec.canvas, spec.render_height)
    times = math.ceil(PHOTOGRAPH_ROWS / grid.rows)
    return times * grid.rows, times * grid.columns


def _describe_crop(picture: Tensor, canvas: CanvasSize) -> str:
    """Returns a sentence about the part that a crop removes; "" if it is tiny."""
    share = (picture.shape[2] / picture.shape[1]) / (canvas.width / canvas.height)
    lost, side = (1 - 1 / share, "width") if share > 1 else (1 - share, "height")
    if lost <= _TOLD:
        return ""
    return (
        f"The picture is cropped to the canvas: {100 * lost:.0f} % of its {side} is left out. "
        "To paint all of it, give --fit pad, or a canvas in its proportions."
    )


# Opening of a run's parts: its planner, its session at an easel, and its recorder.

_FIT = {
    "canvas": "the canvas has the picture's proportions",
    "crop": "the picture was cropped to the canvas",
    "pad": "the picture was padded to the canvas",
}

_DARKEST_OF_STUDIO = "#121212"  # its soot reflects 0.6 % of the light


_load_family = registry.Later("frida_painter_calibration.teaching.families:load_family")
_ON_GPU = 100.0  # work of a network on a GPU in the time of a processor, at least


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
    if spec.is_composed or "style" in kinds:
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
    if device.type == "cpu":
        await_loops(tell)
    return planner


def planner_settings(spec: RunSpec, model: StrokeModel | Sequence[StrokeModel] | None = None) -> PlannerSettings:
    """Returns the planner's settings for a description. Raises like `open_planner`.

    model: stroke models instead of the description's brushes.
    """
    known = None if spec.calibration is None else Calibration.load(spec.calibration)
    names, shares = spec.brush_names, spec.shares
    layers = spec.layers if len(names) == 1 or not spec.names_brushes else len(names)
    if model is None:
        models = {name: cached_table(load_stroke_model(_source(name, known))) for name in names}
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
        "ground": ground_color(wanted_ground(spec)) or WHITE,
        "darkest": darkest_paint(spec),
        "paints": spec.paints if spec.palette is None else ANY_PAINTS,
    }
    return PlannerSettings(spec.canvas, model, **told)


def _source(brush: str, known: Calibration | None) -> str | Path:
    """Returns the source of a brush's stroke model: the file in the calibration record, or the brush name."""
    if known is not None and brush in (known.brush, *known.others):
        learned = known.of_brush(brush).weights
        if learned is not None:
            return Path(learned.path)
    return brush


def replan_policy(spec: RunSpec, layers: tuple[int, ...] = ()) -> ReplanPolicy:
    """Returns the named replan policy; without one, evenly spaced looks, `replans` times; none without camera or goal.

    layers: strokes of each layer; the looks at their starts are among the replans.
    """
    if not spec.has_camera or spec.together:
        return NeverLooks()
    return parse_replan_policy(spec.replan_policy) if spec.replan_policy else EvenlySpaced(spec.replans, layers)


def open_session(
    spec: RunSpec,
    planner: Planner,
    easel: Easel,
    controls: Controls,
    *,
    notify: Notify,
    journal: Journal,
    light: FlatField | None = None,
    placement: Placement | None = None,
) -> PaintingSession:
    """Opens a session on an easel with connected robot and camera.

    Raises LibraryError if the stroke library is damaged.

    light, placement: light and placement learned in an earlier run.
    """
    first, *others = (
        with_measured_dip(brush_kind(name), easel.calibration, simulated=easel.simulated) for name in planner.brushes
    )
    # A person's hand has no heights to correct.
    where = placement or Placement.unknown({} if spec.by_hand else easel.calibration.depths)
    return PaintingSession(
        planner,
        Hand(easel, first, where, others=tuple(others), drying=60 * spec.drying),
        CanvasObserver(easel, CanvasStart(planner.ground, spec.on_canvas, controls.paint_on), light),
        replan_policy(spec, planner.layer_sizes(spec.strokes)),
        notify=notify,
        journal=journal,
        controls=controls,
        extent=Extent(
            None if spec.minutes is None else 60 * spec.minutes,
            spec.strokes if spec.together else None,
            spec.film_length,
        ),
    )


def open_recorder(
    spec: RunSpec, target: Tensor | None, planner: Planner, folder: Path, before: History | None
) -> Recorder:
    """Returns the recorder of the painting's folder.

    target [3, H, W]: goal picture.
    before: history of earlier runs, if any.
    """
    encoders, first = planner.encoders, next(iter(spec.goal), None)
    kind = easel_kind(spec.robot)
    facts = (
        *spec.goal_facts,
        *making_facts(*spec.goal, *spec.initial),
        *((f"{choice.purpose.capitalize()} seen through", choice.used) for choice in encoders.choices),
        *((f"Better for {choice.purpose}", choice.better) for choice in encoders.choices if choice.better),
        *(("Remark", remark) for remark in encoders.remarks),
        ("Canvas", f"{spec.canvas}, painted on before" if spec.on_canvas else str(spec.canvas)),
        *([("Ground", ground_recipe(planner.ground))] if planner.ground != WHITE else []),
        *([("Fit", _FIT[spec.fit])] if target is not None else []),
        ("Brush" if len(planner.models) == 1 else "Brushes", ", ".join(planner.models)),
        ("Looks and replans", _describe_looks(spec)),
        ("Planned at", f"{spec.render_height} rows"),
        ("Seed", str(spec.seed)),
        ("Robot", kind.title if kind is not None and kind.simulated else spec.robot),
    )
    settings = {
        **({"photo": Path(first.value).name} if first is not None and first.kind == "image" else {}),
        "goal": [list(fact) for fact in (*spec.goal_facts, *making_facts(*spec.goal, *spec.initial))],
        "encoders": [asdict(choice) for choice in encoders.choices],
        "remarks": list(encoders.remarks),
        **spec.record(),
    }
    pictured = before is not None and before.is_pictured
    return Recorder(
        folder,
        spec.heading,
        target,
        facts,
        settings,
        planner.models,
        spec.film_length,
        before,
        has_camera=spec.has_camera,
        watched=spec.has_camera or pictured,
        owned=paints_for_recipes(spec),
    )


def _describe_looks(spec: RunSpec) -> str:
    if spec.together:
        return "a look after every turn"
    return str(spec.replans) if spec.has_camera else "no camera; only at pictures of a person"


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
    wanted = wanted_ground(spec)
    if wanted == AUTO:
        color, said = (
            proposed_ground(planner, spec.strokes, spec.colors, notify),
            "The ground that suits this picture best: {}.",
        )
    elif wanted == OF_SCENE:
        color = ground_around_things(planner)
        said = "" if color == WHITE else "The canvas is toned in the commonest colour around what is shown: {}."
    else:
        return planner, wanted, ""
    ground = _name_colors(color)
    return planner.on_ground(color), ground, said.format(ground)


def ground_of(plan: Plan) -> str:
    """Returns the ground of a plan in the form of --ground."""
    return _name_colors(plan.ground)


def _name_colors(color: tuple[float, float, float]) -> str:
    return "white" if color == WHITE else to_hex(torch.tensor(color))


# Choice of the brushes for a picture, by quick plans with several of them.

IN_ONE_LAYER = ("broad", "medium", "fine")
IN_LAYERS = ("broad:30%,medium:35%,fine:35%", "broad:50%,medium:50%", "medium:50%,fine:25%,fine:25%")
_TRYING = 0.25  # factor of the effort
_MIN_EFFORT = 0.05


def choose_brushes(
    spec: RunSpec,
    goal: Goal,
    encoders: EncoderRegistry | None = None,
    notify: Callable[[Step], None] = lambda step: None,
) -> str:
    """Returns the brushes, in the form of --brushes, whose quick plan has the least expected loss.

    A real easel offers the brushes of its calibration record.
    notify: called at every step.
    Raises ConfigError if the record has none of these brushes, and the errors of `open_planner`.
    """

    def expected_loss(brushes: str) -> float:
        effort = max(_MIN_EFFORT, _TRYING * spec.effort)
        planner = open_planner(spec.model_copy(update={"brushes": brushes, "effort": effort}), goal, encoders)
        return planner.expected_loss(planner.plan(planner.bare, spec.strokes, spec.colors, notify), planner.bare)

    return min(choices(spec), key=expected_loss)


def name_families(spec: RunSpec) -> RunSpec:
    """Returns the description with its stroke families among its brushes. Raises FamilyError for an unknown one."""
    if spec.strokes_of is None:
        return spec
    for source, _ in family_shares(spec.strokes_of):
        _load_family(source)
    return spec.model_copy(update={"brushes": spec.layer_brushes, "strokes_of": None})


def choices(spec: RunSpec) -> Sequence[str]:
    """Returns the brushes to choose from, in the form of --brushes.

    Raises ConfigError if the calibration record has none of them.
    """
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
    """Returns the brushes of a plan's layers with their shares, in the form of --brushes."""
    shares = [(layer.kind, 100 * layer.strokes / len(plan)) for layer in plan.layers if layer.strokes]
    return ",".join(f"{brush}:{share:.4f}%" for brush, share in shares)


# Settling of a description: open settings are chosen once, and the planner is opened.

_SETTLING_KINDS: dict[type[Term], str] = {term: name for name, term in OF_PICTURES.items()}


@dataclass(frozen=True)
class SettledRun:
    """Painting with all settings chosen.

    spec: description with its canvas, brushes and ground.
    planner: its planner on that ground.
    remarks: sentences for the person about the choices.
    """

    spec: RunSpec
    planner: Planner
    remarks: tuple[str, ...]


def settle(
    made: Fitted,
    encoders: EncoderRegistry | None = None,
    *,
    region: Region | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
    heed: Callable[[], None] = lambda: None,
) -> SettledRun:
    """Chooses open brushes and an open ground by quick plans, and opens the planner.

    made: description and goal, fitted to each other.
    encoders: networks that judge the goal. None: the fetched ones.
    region: part of the canvas that strokes keep clear of.
    tell: receives a sentence about each wait.
    heed: called often in waits; may raise to end them.
    Raises like `open_planner`.
    """
    spec, remarks = made.spec, []
    said: set[str] = set()

    def choosing(what: str) -> None:
        heed()
        if what not in said:
            said.add(what)
            tell(f"Choosing the {what}, by quick plans.")

    if spec.brushes == AUTO:
        brushes = choose_brushes(spec, made.goal, encoders, notify=lambda step: choosing("brushes"))
        spec = spec.model_copy(update={"brushes": brushes})
        remarks.append(f"The brushes that suit this picture best: {brushes}.")
    spec = name_families(spec)
    planner = open_planner(spec, made.goal, encoders, tell=tell, heed=heed)
    planner, ground, remark = settle_ground(spec, planner, lambda step: choosing("ground"))
    if spec.ground != ground:
        spec = spec.model_copy(update={"ground": ground})
    remarks += [remark] if remark else []
    return SettledRun(spec, planner if region is None else planner.keeping_clear(region), tuple(remarks))


def check(made: Fitted, encoders: EncoderRegistry | None = None) -> Planner:
    """Returns a planner of this description. Raises what `settle` would raise; makes no quick plans."""
    spec = made.spec
    if spec.brushes == AUTO:
        spec = spec.model_copy(update={"brushes": choices(spec)[0]})
    planner = open_planner(name_families(spec), made.goal, encoders)
    planner.layer_sizes(spec.strokes)
    return planner


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
    described = {"goal": _describe_terms(wanted.terms), "initial": _describe_terms(wanted.initial)}
    if "goal" in settings or "initial" in settings:
        raise ConfigError("make_planner takes its goal first, and it was given as a setting; use make_goal for it.")
    settings.update(described)
    made = fit_canvas(RunSpec.of(**settings), wanted)
    if model is None:
        return settle(made, encoders).planner
    planner = open_planner(made.spec, made.goal, encoders, stroke_models(model))
    return settle_ground(made.spec, planner)[0]


def _describe_terms(terms: Sequence[Term]) -> list[dict[str, object]]:
    """Returns terms in the form of a description, without pictures; the defaults depend only on their kinds."""
    kinds = [(term, _SETTLING_KINDS.get(type(term), None if term.words is None else "text")) for term in terms]
    return [{kind: term.words or "given as a picture"} for term, kind in kinds if kind is not None]
