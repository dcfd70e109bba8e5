"""Settings of a painting, by section: each says its type, limits, default and help here, once, for all interfaces.

Command line, page, TOML files, sweeps, records and the reference are made from these fields. `RunSpec` (spec.py) joins
the sections and refuses what does not fit together. This module loads no tensors.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import VIRTUAL
from frida_painter.objectives import USUAL_FREEDOM
from frida_painter.objectives.word_settings import USUAL, Beginning
from frida_painter.planning.settings import PlannerSettings
from frida_painter.registry import (
    CAMERAS,
    EASELS,
    PLANNERS,
    REPLAN_POLICIES,
    ROBOTS,
    STROKE_FAMILIES,
    STROKE_MODELS,
    names_of_others,
    parts,
)
from frida_painter.runs.fields import (
    Brushes,
    Canvas,
    DarkestPaint,
    Families,
    File,
    Focus,
    Ground,
    InitialItems,
    Items,
    PaintsInUse,
    Placement,
    Policy,
)
from frida_painter.runs.shares import MAX_LAYERS

_PLANNED: Mapping[str, Any] = {field.name: field.default for field in fields(PlannerSettings)}
"""Defaults of the planner's settings."""


def setting(
    default: Any,
    *,
    value: str = "",
    usual: str = "",
    names: tuple[str, ...] = (),
    of: tuple[str, ...] = (),
    adds: tuple[str, ...] = (),
    common: bool = False,
    **limits: Any,
) -> Any:
    """Returns a field of a section; the docstring below it is its help.

    value: word for its value in the help. "": one by its type.
    usual: the default in words. "": the default itself.
    names: options for it, if they are not named after the field.
    of: groups of parts that it is one of; the help lists them all.
    adds: groups to which other packages may add; the help lists what they add.
    common: True if the short help shows it.
    limits: as in pydantic's Field.
    """
    more: dict[str, Any] = {"value": value, "usual": usual, "names": names, "of": of, "adds": adds, "common": common}
    return Field(default, json_schema_extra=more, **limits)


def about(field: Any) -> Mapping[str, Any]:
    """Returns what `setting` was told of a field beside its help, its default and its limits."""
    return field.json_schema_extra or {}


def help_of(field: Any) -> str:
    """Returns the help of a setting, with the parts that are registered now."""
    more, told = about(field), [" ".join(field.description.split())]
    if known := [name for group in more["of"] for name in parts(group)]:
        told.append(f"Available: {', '.join(known)}.")
    if added := [name for group in more["adds"] for name in names_of_others(group)]:
        told.append(f"Installed packages add {', '.join(added)}.")
    return " ".join(told)


def usual_of(field: Any) -> str:
    """Returns the default of a setting, in words."""
    default = field.default
    plain = ("yes" if default else "no") if isinstance(default, bool) else default
    return about(field)["usual"] or ("none" if plain in (None, "", ()) else str(plain))


class SettingSection(BaseModel):
    """Some settings of a painting, with a panel of their own in the help."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        arbitrary_types_allowed=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
    )
    panel: ClassVar[str] = ""


class GoalSettings(SettingSection):
    """Goal of a painting, and the way from words to a picture."""

    panel: ClassVar[str] = "What to paint"

    goal: Items = setting(())
    """Goals: a list of things to paint, each with its kind and weight."""
    initial: InitialItems = setting(())
    """Things to begin with, in the same form: image, text or style."""
    clip: str | None = setting(
        None, value="NAME|FOLDER", usual="clip-vit-b-32 if it was downloaded, else smaller networks", min_length=1
    )
    """The CLIP model for text and meaning: a name on the hub, a folder or its file of weights."""
    pictures: File = setting(None, value="FOLDER", usual="the libraries that were downloaded")
    """A folder with your own pictures of things, named by them (red-fox.png, or a text beside each). Text prompts use
    them first."""
    beginning: Beginning = setting(USUAL.beginning)
    """First picture of a painting of words alone. scene: pictures of its things; colors: a coarse picture, coloured
    by a CLIP; nothing: none. auto: what a CLIP likes best of the two, or a scene."""
    avoid: str = setting(USUAL.avoid, value="WORDS", usual="no words", max_length=200)
    """Words that a painting of words should not look like."""
    freedom: float = setting(USUAL_FREEDOM, ge=0, le=1)
    """Freedom of the colours of a painting by content (--semantic) from those of the picture: 0 is faithful, 1 is
    wild."""


class CanvasSettings(SettingSection):
    """The canvas and its paints."""

    panel: ClassVar[str] = "Canvas and paints"

    canvas: Canvas = setting(CanvasSize(14 * 0.0254, 11 * 0.0254), value="SIZE", usual="14x11in", common=True)
    """Canvas size: width x height in in, cm or mm, like 14x11in or 297x210mm, or a name from A6 to A0, letter, legal
    or tabloid, like A3 or 'A3 landscape'. It is rotated to match the picture."""
    fit: Literal["canvas", "crop", "pad"] = setting("canvas")
    """Way to fit a picture with another aspect ratio onto the canvas. canvas: the canvas takes the aspect ratio of the
    picture, within its size. crop: the picture is cropped. pad: white is added. A real canvas keeps its shape;
    there, canvas means crop."""
    ground: Ground = setting(
        None,
        value="auto|white|#RRGGBB",
        usual="white; in the studio, auto for a picture of 100 strokes or more, and for words alone and styles the "
        "commonest colour around the things",
    )
    """The colour in which the bare canvas is toned before the painting begins. auto takes the one that suits the
    picture. A person tones it; the recipe is told, and the camera looks before anything is planned."""
    colors: int = setting(_PLANNED["colors"], common=True, ge=1, le=24)
    """Number of paints to mix."""
    new_paints: bool | None = setting(None, usual="new paints")
    """Mix new paints for each layer, --colors of them, or keep those of the first. With --palette they are kept."""
    paints: PaintsInUse = setting(_PLANNED["paints"], value="acrylics|any|FILE", min_length=1)
    """The paints that you mix from. acrylics: six common ones; FILE: your own, as for mix --paints. A colour that
    they cannot give becomes the nearest one that they can, and colours with one recipe become one. any: every
    colour, for pens, screens and paints that are not mixed. A --palette is never changed."""
    darkest: DarkestPaint = setting(None, value="#RRGGBB", usual="in the studio #121212, otherwise #000000")
    """The colour of your darkest paint once it is dry. No darker paint is planned, and the forecast is right where
    the picture is darker."""
    palette: File = setting(None, value="FILE", usual="the paints of the plan")
    """The paints that you really mixed: a palette of GIMP (.gpl) or Adobe (.ase), a list of colours like #f2e9dc,
    JSON like {"paints": ["#f2e9dc", ...]}, a picture of them, or a photograph of a strip with bare paper and one
    swatch of each paint."""


class PlanSettings(SettingSection):
    """The strokes, and how they are planned."""

    panel: ClassVar[str] = "Strokes"

    strokes: int = setting(_PLANNED["strokes"], common=True, ge=1, le=20_000)
    """Number of brush strokes. Exactly this number is painted, unless --minutes has fewer."""
    brushes: Brushes = setting(
        None,
        value="NAME,...|auto",
        usual="in the studio, for a picture, broad:30%,medium:35%,fine:35% from 200 strokes on and "
        "broad:50%,medium:50% from 100 on; for words alone, from 100 on, broad:50%,fine:50%; otherwise broad",
        names=("--brushes", "--brush"),
        adds=(STROKE_MODELS,),
        common=True,
        min_length=1,
    )
    """The brush: fine, medium or broad, or a file of stroke model weights that you trained. Several paint a layer
    each, like broad,medium, with shares of the strokes like broad:60%,medium:40%. auto tries some with quick plans,
    and takes what suits the picture best."""
    strokes_of: Families = setting(
        None, value="FAMILY,...", usual="strokes of the brushes alone", adds=(STROKE_FAMILIES,), min_length=1
    )
    """Families of strokes that a person taught, each in a layer of the last brush: comma, zigzag, flourish, or a
    file that teach wrote. With shares of the strokes like comma:20%,flourish:30%; without them families get 40%
    together."""
    layers: int | None = setting(
        None,
        usual="as many as brushes; of one brush 2 for a picture of 100 strokes or more, otherwise 1; 1 if drying "
        "takes a third of --minutes",
        ge=1,
        le=MAX_LAYERS,
    )
    """Number of layers of strokes. Each is painted from light to dark on the dry paint of the one before, and
    planned for the canvas as it is then. The first has most of the strokes."""
    focus: Focus = setting(_PLANNED["focus"])
    """Part of a picture that matters most. faces: faces, if there are any; none: every place is worth the same."""
    render_height: int = setting(_PLANNED["rows"], ge=64, le=2048)
    """Height of the planning image in pixels. Higher is finer and slower."""
    effort: float = setting(_PLANNED["effort"], ge=0.05, le=20)
    """Planning effort. 2 plans twice as long, 0.5 half as long; a CLIP looks more, or less."""
    planner: str = setting(_PLANNED["planner"], value="NAME", adds=(PLANNERS,), min_length=1)
    """Way to make the plan. Your own packages can add planners."""
    seed: int = setting(_PLANNED["seed"], common=True, ge=0, le=2**31 - 1)
    """Random seed. The same seed gives the same painting, another seed a different one."""


class MachineSettings(SettingSection):
    """The machine; its settings do not change the picture."""

    panel: ClassVar[str] = "On which machine"

    robot: str = setting(VIRTUAL, value="NAME", of=(EASELS, ROBOTS), common=True, min_length=1)
    """The robot that paints, like virtual or xarm:192.168.1.10. `doctor` shows how to write each name. sawyer-sim is
    a physical simulation of the paper's arm."""
    camera: str = setting("", value="NAME", usual="the virtual studio's own", of=(CAMERAS,), common=True)
    """The camera of a real easel, like opencv:0 or folder:PATH. `doctor` shows how to write each name."""
    workspace: File = setting(None, value="FILE", usual="the virtual studio's own", common=True)
    """The workspace file of a real robot (TOML): the places of canvas, wells, water and rag."""
    calibration: File = setting(None, value="FILE", usual="the virtual studio's own", common=True)
    """The calibration record of the easel."""
    placement_error: Placement = setting(None, value="X,Y,TURN", usual="about 2mm and 0.4deg, by the seed")
    """Calibration error of the virtual studio: the offset and rotation between its canvas and where its robot
    expects the canvas, like 4mm,2deg or 3mm,-2mm,1.5deg."""
    pace: float = setting(0.0, ge=0, le=100)
    """Seconds that a second of the virtual robot takes. 1 is real time, 0.1 ten times as fast, 0 as fast as
    possible."""
    on_canvas: bool = setting(False)
    """Begin on the canvas as it is: a toned ground, an old painting, or what you have painted. The light is known
    from the canvas calibration, which saw a bare canvas."""
    studio_canvas: File = setting(None, value="FILE", usual="a bare canvas")
    """A picture of the canvas of the virtual studio at first."""


class PaintingSettings(SettingSection):
    """The course of the painting, and what is kept of it."""

    panel: ClassVar[str] = "While it paints"

    title: str = setting("", max_length=80)
    """Title of the painting on its page."""
    together: bool = setting(False)
    """Paint without a goal: you begin, and the robot answers each of your turns in the spirit of your strokes, with
    at most --strokes in all."""
    minutes: float | None = setting(None, usual="as many as it takes", common=True, ge=1, le=10_000)
    """Minutes that the robot may take, with dips, looks, film and drying. The strokes that would be missed least are
    left out until the painting fits."""
    replans: int = setting(4, ge=0)
    """Number of looks at the canvas, each with a replan of the rest: after the first ten strokes, which tell where the
    robot paints, then evenly spaced, and where a layer begins."""
    replan_policy: Policy = setting(
        None, value="NAME:VALUE", usual="evenly spaced, --replans times", adds=(REPLAN_POLICIES,), min_length=1
    )
    """Rule for replans, instead of --replans. every:75 replans after every 75 strokes. when-off-by:0.02 looks after
    every 10 strokes and replans only if the canvas differs more than that from the expected one. when-it-pays looks
    as often as replanning improves the plan by 0.05 dB. Your own packages can add policies."""
    drying: float = setting(20.0, value="MINUTES", ge=0, le=1440)
    """Minutes that a layer dries before the next one is painted on it. Thin acrylic paint needs 10 to 30; 0 is for
    colours that dry at once, such as pens. The virtual studio does not wait, unless --pace says so."""
    film: bool = setting(True)
    """Make a timelapse film of the painting."""


OF_PLANS = (GoalSettings, CanvasSettings, PlanSettings)
"""Sections that decide a plan."""
OF_PAINTINGS = (*OF_PLANS, MachineSettings, PaintingSettings)
