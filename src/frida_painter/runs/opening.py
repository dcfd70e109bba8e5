"""Opening what a run needs: its planner, its session at an easel, led by controls, and what records it."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.table_cache import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.calibration import Calibration
from frida_painter.compiled import await_loops
from frida_painter.errors import ConfigError
from frida_painter.goal import Goal
from frida_painter.hardware.easel import Easel
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.palette import Palette
from frida_painter.perception.flatfield import FlatField
from frida_painter.plan import WHITE
from frida_painter.planning.effort import Effort
from frida_painter.planning.layers import FEWEST_FOR_LAYERS
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.planning.settings import PlannerSettings
from frida_painter.report.recorder import Recorder
from frida_painter.runs.fields import AUTO, OF_SCENE, ground_color, rgb
from frida_painter.runs.spec import RunSpec
from frida_painter.session.brushwork import Brushwork, refilled
from frida_painter.session.canvas_observer import CanvasObserver, Timelapse
from frida_painter.session.canvas_start import CanvasStart
from frida_painter.session.events import Notify, Paused
from frida_painter.session.history import History
from frida_painter.session.journal import Journal
from frida_painter.session.loop import PaintingSession
from frida_painter.session.names import TITLES
from frida_painter.session.opening import planning_device
from frida_painter.session.operator import ground_recipe
from frida_painter.session.procedures.dialogue import Answer, Question
from frida_painter.session.replan_policy import EvenlySpaced, ReplanPolicy, replan_policy_named

_FIT = {
    "canvas": "the canvas has the picture's proportions",
    "crop": "the picture was cropped to the canvas",
    "pad": "the picture was padded to the canvas",
}

_DARKEST_OF_STUDIO = "#121212"  # its soot reflects 0.6 % of the light


def _never() -> bool:
    return False


@dataclass(frozen=True)
class Controls:
    """How a painting is led; by default nobody is there: it is neither stopped nor paused, and every doubt is a no.

    stop_asked, pause_asked: looked at after every stroke and planning iteration;
    go_on: waits in a pause for a person, and says whether the painting goes on;
    mixed: waits until the wells are filled, and answers with what was really mixed, None for just what was wanted
    (by default: what the description says);
    answer: leads a dialogue with a person at a real easel, None where nobody is asked;
    paint_on: whether a canvas that is not bare at first, or not as it was left (a sentence, a photograph [3, H, W]),
    is painted on;
    repaint: whether the stroke in doubt (its number, a picture of it) is painted again.
    """

    stop_asked: Callable[[], bool] = _never
    pause_asked: Callable[[], bool] = _never
    go_on: Callable[[Paused], bool] = lambda paused: False
    mixed: Callable[[Palette], Palette | None] | None = None
    answer: Callable[[Question], Answer] | None = None
    paint_on: Callable[[str, Tensor], bool] = lambda difference, photograph: False
    repaint: Callable[[int, Tensor], bool] = lambda number, picture: False


def wanted_ground(spec: RunSpec) -> str:
    """The ground asked for, or the usual one: white, but one that the planner chooses where a simulated operator tones.

    Not settled before there is a planner are AUTO, usual for pictures, and OF_SCENE, for words without a picture.
    """
    if spec.ground is not None:
        return spec.ground
    if not spec.simulated or spec.studio_canvas is not None or spec.on_canvas:
        return "white"
    if spec.is_composed:
        return OF_SCENE
    pictured = not spec.initial and any(item.kind == "image" for item in spec.goal)
    return AUTO if pictured and spec.strokes >= FEWEST_FOR_LAYERS else "white"


def darkest_paint(spec: RunSpec) -> tuple[float, float, float] | None:
    """sRGB of the darkest paint there is: the one told, the virtual studio's, or None where nothing is known of it."""
    told = spec.darkest or (_DARKEST_OF_STUDIO if spec.simulated else None)
    return None if told is None else rgb(told)


def open_planner(
    spec: RunSpec,
    goal: Goal,
    encoders: EncoderRegistry | None = None,
    model: StrokeModel | Sequence[StrokeModel] | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
) -> Planner:
    """The planner that the description means, on the usual ground, or on white if one is to be chosen.

    What the easel's own strokes taught of the brush, by its calibration record, goes before what the project ships.
    encoders: the networks that the goal is seen through, by default those that were fetched; model: what takes the
    place of the description's brushes; tell: hears in a sentence what is waited for. Raises CalibrationError if the
    record is damaged, and WeightsError and ConfigError if there is no such brush, or a network that the goal needs is
    missing.
    """
    device = planning_device()
    networks = encoders or EncoderRegistry(clip=spec.clip, device=device, pictures=spec.pictures)
    planner = Planner(goal, planner_settings(spec, model), encoders=networks, device=device)
    if networks.idle_clip is not None:
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
    """What the planner of a description is told; model: in place of its brushes. Raises as `open_planner` does."""
    known = None if spec.calibration is None else Calibration.load(spec.calibration)
    usual = spec.brushes is None and (spec.strokes < FEWEST_FOR_LAYERS or spec.is_short)
    names = spec.brush_names[:1] if usual else spec.brush_names
    layers = spec.layers if spec.brushes is None or len(names) == 1 else len(names)
    shares = spec.shares if len(names) > 1 else None
    if model is None:
        models = {name: cached_table(load_stroke_model(_source(name, known))) for name in names}
        model = [models[name] for name in names]
    else:
        layers, shares = spec.layers, None
    return PlannerSettings(
        spec.canvas,
        model,
        strokes=spec.strokes,
        colors=spec.colors,
        rows=spec.render_height,
        effort=Effort().scaled(spec.effort),
        seed=spec.seed,
        layers=1 if layers is None and spec.is_short else layers,
        shares=shares,
        new_paints=spec.new_paints is not False and spec.palette is None,
        focus=spec.focus,
        sharpness=spec.sharpness,
        ground=ground_color(wanted_ground(spec)) or WHITE,
        darkest=darkest_paint(spec),
    )


def _source(brush: str, known: Calibration | None) -> str | Path:
    """Where the stroke model of a brush comes from."""
    if known is not None and brush in (known.brush, *known.others):
        learned = known.of_brush(brush).weights
        if learned is not None:
            return Path(learned.path)
    return brush


def replan_policy(spec: RunSpec, layers: tuple[int, ...] = ()) -> ReplanPolicy:
    """When the painter looks, and whether it plans again: as often as `replans` says, unless a policy is named.

    layers: how many strokes each has; the looks where one begins are among the replans.
    """
    return replan_policy_named(spec.replan_policy) if spec.replan_policy else EvenlySpaced(spec.replans, layers)


def open_session(
    spec: RunSpec,
    planner: Planner,
    easel: Easel,
    controls: Controls,
    *,
    mixed: Callable[[Palette], Palette | None],
    paint_on: Callable[[str, Tensor], bool],
    notify: Notify,
    journal: Journal,
    light: FlatField | None = None,
    placement: Placement | None = None,
) -> PaintingSession:
    """A session on an easel whose robot and camera are connected. Raises LibraryError where its library is damaged.

    mixed: asked what was really mixed, and waits; paint_on: asked where something is on the canvas at first; light,
    placement: what an earlier run learned of the room and of where strokes land.
    """
    first, *others = (
        refilled(brush_kind(name), easel.calibration, simulated=easel.simulated) for name in planner.models
    )
    # A person's hand has no heights that could be corrected.
    where = placement or Placement.unknown({} if spec.by_hand else easel.calibration.depths)
    return PaintingSession(
        planner,
        Brushwork(easel, first, where, others=tuple(others), drying=60 * spec.drying),
        CanvasObserver(easel, CanvasStart(planner.ground, spec.on_canvas, paint_on), light),
        replan_policy(spec, planner.layer_sizes(spec.strokes)),
        stop_asked=controls.stop_asked,
        notify=notify,
        journal=journal,
        pause_asked=controls.pause_asked,
        go_on=controls.go_on,
        mixed=mixed,
        timelapse=Timelapse(spec.film_length),
        budget=None if spec.minutes is None else 60 * spec.minutes,
    )


def open_recorder(
    spec: RunSpec, target: Tensor | None, planner: Planner, folder: Path, before: History | None
) -> Recorder:
    """What writes the painting's folder. target [3, H, W]: the goal picture; before: what earlier runs left, if any."""
    encoders, first = planner.encoders, spec.goal[0]
    facts = (
        *spec.goal_facts,
        *((f"{choice.purpose.capitalize()} seen through", choice.used) for choice in encoders.choices),
        *((f"Better for {choice.purpose}", choice.better) for choice in encoders.choices if choice.better),
        *(("Remark", remark) for remark in encoders.remarks),
        ("Canvas", f"{spec.canvas}, painted on before" if spec.on_canvas else str(spec.canvas)),
        *([("Ground", ground_recipe(planner.ground))] if planner.ground != WHITE else []),
        *([("Fit", _FIT[spec.fit])] if target is not None else []),
        ("Brush" if len(planner.models) == 1 else "Brushes", ", ".join(planner.models)),
        ("Looks and replans", str(spec.replans)),
        ("Planned at", f"{spec.render_height} rows"),
        ("Seed", str(spec.seed)),
        ("Robot", TITLES.get(spec.robot, spec.robot)),
    )
    settings = {
        **({"photo": Path(first.value).name} if first.kind == "image" else {}),
        "goal": [list(fact) for fact in spec.goal_facts],
        "encoders": [asdict(choice) for choice in encoders.choices],
        "remarks": list(encoders.remarks),
        **spec.record(),
    }
    return Recorder(folder, spec.heading, target, facts, settings, planner.models, spec.film_length, before)
