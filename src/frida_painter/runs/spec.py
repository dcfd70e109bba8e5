"""RunSpec: everything that makes a painting what it is, with one set of defaults and limits for all faces.

Command line, page, TOML files, experiments and notebooks describe a painting by it. It loads without any tensor.
"""

import json
from collections.abc import Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from frida_painter import storage
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.planning.settings import PlannerSettings
from frida_painter.quantities import count_of
from frida_painter.runs.faults import sentence_on
from frida_painter.runs.fields import (
    AUTO,
    MOST_LAYERS,
    Brushes,
    Canvas,
    DarkestPaint,
    File,
    Focus,
    Ground,
    Placement,
    Policy,
    brush_shares,
    canvas_of,
    paints_of,
)
from frida_painter.runs.goal_item import GoalItem
from frida_painter.session.names import HUMAN, SAWYER_SIM, SIMULATED, VIRTUAL

VERSION = 1
SETTLED = ("strokes", "layers", "colors", "canvas", "brushes", "new_paints", "ground")
"""What a painting's plan rests on: it cannot be changed once there is a plan."""
EASEL = (
    "robot", "camera", "workspace", "calibration", "placement_error", "pace", "arm_meshes", "studio_canvas", "on_canvas"
)  # fmt: skip
"""What says where a painting is painted rather than what."""
FILES = ("palette", "pictures", "workspace", "calibration", "arm_meshes", "studio_canvas")
"""Fields that name files other than those of the goal."""
USUAL_BRUSHES = "broad:30%,medium:35%,fine:35%"
"""Of a picture in the virtual studio; other goals, and few strokes, have the first one only."""
FEWER_BRUSHES = "broad:50%,medium:50%"
"""The same of a picture with less than 200 strokes, or where drying twice would take a third of the minutes."""
_FEWEST_FOR_ALL = 200  # strokes
WORDS_BRUSHES = "broad:50%,fine:50%"
"""The same of words alone: a thing is recognised by its outline and its small parts."""
_OF_PLANS: dict[str, Any] = {field.name: field.default for field in fields(PlannerSettings)}
"""Defaults of the planner's settings, which are those of all faces."""
_MOST_BYTES = 2**20


def _goal_items(value: Any) -> Any:
    """Goal items as tables of a TOML file have them ({"text": "a lemon", "weight": 2}), or as they are."""
    return tuple(map(GoalItem.of, value)) if isinstance(value, list | tuple) else value


def _plain(items: tuple[GoalItem, ...], *, beginning: bool) -> tuple[GoalItem, ...]:
    try:
        return tuple(item.plain(beginning=beginning) for item in items)
    except ConfigError as error:
        raise ValueError(str(error)) from error


Items = Annotated[tuple[GoalItem, ...], BeforeValidator(_goal_items), AfterValidator(partial(_plain, beginning=False))]
InitialItems = Annotated[
    tuple[GoalItem, ...], BeforeValidator(_goal_items), AfterValidator(partial(_plain, beginning=True))
]


class RunSpec(BaseModel):
    """One painting, described. Raises ConfigError, naming every fault at once, through `of`, `from_toml` and `read`.

    goal, initial: what to paint, and what to begin with; canvas: the size asked for, which `fit` may change;
    brushes: names or files of learned weights, one or a layer each, "broad:60%,fine:40%", or "auto";
    clip: a CLIP to see words through, None: what was fetched;
    pictures: a folder of the person's own pictures, for what words name;
    palette: a file with the paints that were really mixed; timelapse_frames: pictures of the film at the most;
    workspace, calibration: files of a real easel; placement_error: of the virtual studio, like "4mm,2deg";
    on_canvas: whether it begins on what is on the canvas; studio_canvas: a picture of that in the virtual studio.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True)

    version: Literal[1] = 1
    title: str = Field("", max_length=80)
    goal: Items = ()
    initial: InitialItems = ()
    strokes: int = Field(
        _OF_PLANS["strokes"],
        ge=1,
        le=20_000,
        description="Number of brush strokes. Exactly this number is painted, unless --minutes has fewer.",
    )
    minutes: float | None = Field(
        None,
        ge=1,
        le=10_000,
        allow_inf_nan=False,
        description="Minutes that the robot may take, with dips, looks, film and drying. The strokes that would be "
        "missed least are left out until the painting fits.",
        json_schema_extra={"metavar": "X", "default": "as many as it takes"},
    )
    layers: int | None = Field(
        None,
        ge=1,
        le=MOST_LAYERS,
        description="Number of layers of strokes. Each is painted from light to dark on the dry paint of the one "
        "before, and planned for the canvas as it is then. The first has most of the strokes.",
        json_schema_extra={
            "default": "as many as brushes; of one brush 2 for a picture of 100 strokes or more, otherwise 1; 1 where "
            "drying takes a third of --minutes"
        },
    )
    colors: int = Field(_OF_PLANS["colors"], ge=1, le=24, description="Number of paints to mix.")
    canvas: Canvas = Field(
        CanvasSize(14 * 0.0254, 11 * 0.0254),
        description="Canvas size: width x height in in, cm or mm, like 14x11in or 297x210mm, or a name from A6 to A0, "
        "letter, legal or tabloid, like A3 or 'A3 landscape'. It is rotated to match the picture.",
        json_schema_extra={"metavar": "SIZE", "default": "14x11in"},
    )
    fit: Literal["canvas", "crop", "pad"] = Field(
        "canvas",
        description="How a picture with another aspect ratio fits onto the canvas. canvas: the canvas takes the aspect "
        "ratio of the picture, within its size. crop: the picture is cropped. pad: white is added. A real canvas "
        "keeps its shape; there, canvas means crop.",
        json_schema_extra={"metavar": "canvas|crop|pad"},
    )
    brushes: Brushes = Field(
        None,
        min_length=1,
        description="The brush: fine, medium or broad, or a file of stroke model weights that you trained. Several "
        "paint a layer each, like broad,medium, with shares of the strokes like broad:60%,medium:40%. auto tries some "
        "with quick plans, and takes what suits the picture best.",
        json_schema_extra={
            "metavar": "NAME,...|auto",
            "names": ["--brushes", "--brush"],
            "default": "in the studio, for a picture, broad:30%,medium:35%,fine:35% from 200 strokes on and "
            "broad:50%,medium:50% from 100 on; for words alone, from 100 on, broad:50%,fine:50%; otherwise broad",
        },
    )
    new_paints: bool | None = Field(
        None,
        description="Mix new paints for each layer, --colors of them, or keep those of the first. With --palette they "
        "are kept.",
    )
    render_height: int = Field(
        _OF_PLANS["rows"],
        ge=64,
        le=2048,
        description="Height of the planning image in pixels. Higher is finer and slower.",
    )
    replans: int = Field(
        4,
        ge=0,
        description="How many times to look at the canvas and replan the rest: after the first ten strokes, which tell "
        "where the robot paints, then evenly spaced, and where a layer begins.",
    )
    replan_policy: Policy = Field(
        None,
        min_length=1,
        description="When to replan, instead of --replans. every:75 replans after every 75 strokes. when-off-by:0.02 "
        "looks after every 10 strokes and replans only if the canvas differs more than that from the expected one. "
        "when-it-pays looks as often as replanning improves the plan by 0.05 dB. Your own packages can add policies.",
        json_schema_extra={"metavar": "NAME:VALUE", "default": "evenly spaced, --replans times"},
    )
    ground: Ground = Field(
        None,
        description="The colour in which the bare canvas is toned before the painting begins. auto takes the one that "
        "suits the picture. A person tones it; the recipe is told, and the camera looks before anything is planned.",
        json_schema_extra={
            "metavar": "auto|white|#RRGGBB",
            "default": "white; in the studio, auto for a picture of 100 strokes or more, and for words alone the "
            "commonest colour around the things of their scene",
        },
    )
    darkest: DarkestPaint = Field(
        None,
        description="The colour of your darkest paint once it is dry. No darker paint is planned, and the forecast is "
        "right where the picture is darker.",
        json_schema_extra={"metavar": "#RRGGBB", "default": "in the studio #121212, otherwise #000000"},
    )
    focus: Focus = Field(
        _OF_PLANS["focus"],
        description="What matters most in a picture. faces: faces, where there are any; subject: what the picture "
        "shows, as networks see it, and edges; none: every place is worth the same.",
        json_schema_extra={"metavar": "faces|subject|none"},
    )
    sharpness: float = Field(
        _OF_PLANS["sharpness"],
        ge=0,
        le=2,
        allow_inf_nan=False,
        description="How much sharper than the picture the plan is, because a painting comes out softer than its plan. "
        "0 plans towards the picture as it is.",
    )
    drying: float = Field(
        20.0,
        ge=0,
        le=1440,
        allow_inf_nan=False,
        description="Minutes that a layer dries before the next one is painted on it. Thin acrylic paint needs 10 to "
        "30; 0 is for what dries at once, such as pens. The virtual studio does not wait, unless --pace says so.",
        json_schema_extra={"metavar": "MINUTES"},
    )
    effort: float = Field(
        _OF_PLANS["effort"],
        ge=0.05,
        le=20,
        allow_inf_nan=False,
        description="Planning effort. 2 plans twice as long, 0.5 half as long.",
    )
    seed: int = Field(
        _OF_PLANS["seed"],
        ge=0,
        le=2**31 - 1,
        description="Random seed. The same seed gives the same painting, another seed a different one.",
    )
    clip: str | None = Field(None, min_length=1)
    pictures: File = None
    palette: File = None
    film: bool = True
    timelapse_frames: int = Field(120, ge=0, le=2000, description="Maximum number of frames in the timelapse film.")
    robot: str = Field(VIRTUAL, min_length=1)
    camera: str = ""
    workspace: File = None
    calibration: File = None
    placement_error: Placement = None
    pace: float = Field(0.0, ge=0, le=100, allow_inf_nan=False)
    arm_meshes: File = None
    on_canvas: bool = False
    studio_canvas: File = None

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        given = self.model_fields_set
        if "colors" in given and self.colors > self.strokes:
            raise ValueError(f"{self.colors} colors for {self.strokes} strokes; give at most as many colors as strokes")
        if self.layers is not None and len(self.brush_names) > 1 and self.layers != len(self.brush_names):
            raise ValueError(f"{self.layers} layers and {len(self.brush_names)} brushes; leave out --layers")
        if self.brushes == AUTO and self.layers is not None:
            raise ValueError(f"--brushes {AUTO} says how many layers there are, and --layers too; leave out one")
        if self._names_brushes and len(self.brush_names) > self.strokes:
            raise ValueError(
                f"{len(self.brush_names)} layers for {count_of(self.strokes, 'stroke')}; give at most as many brushes"
            )
        for name, share in zip(self.brush_names, self.shares or (), strict=False):
            if self._names_brushes and round(self.strokes * share) == 0:
                raise ValueError(
                    f"{name} gets {100 * share:g} % of {count_of(self.strokes, 'stroke')}, which is not one stroke; "
                    "give it a larger share, or leave it out"
                )
        if self.new_paints and self.palette is not None:
            raise ValueError("--palette tells of one palette, and --new-paints mixes one for each layer; leave one out")
        if self.layers is not None and self.layers > self.strokes:
            raise ValueError(f"{self.layers} layers for {self.strokes} strokes; give at most as many layers as strokes")
        if "replans" in given and self.replans >= self.strokes:
            raise ValueError(
                f"{self.replans} replans for {self.strokes} strokes; "
                f"there is a look between strokes only, so give at most {self.strokes - 1}"
            )
        if self.on_canvas and self.ground not in (None, "white"):
            raise ValueError(
                f"--on-canvas paints on what is there, and --ground {self.ground} tones a bare canvas; leave out one"
            )
        if self.minutes is not None and self.by_hand:
            raise ValueError(f"--minutes is the robot's time, and with --robot {HUMAN} a person paints; leave it out")
        if self.minutes is not None and self._dryings * self.drying >= self.minutes:
            raise ValueError(
                f"--minutes is {self.minutes:g}, and between {self._dryings + 1} layers paint dries for "
                f"{self._dryings * self.drying:g} minutes; give more minutes, fewer brushes or --layers, or less drying"
            )
        if self.arm_meshes is not None and self.robot != SAWYER_SIM:
            raise ValueError(f"--arm-meshes is for the film of --robot {SAWYER_SIM}; leave it out")
        return self

    @classmethod
    def of(cls, **values: Any) -> Self:
        """A checked description, with what fits where nothing was asked for.

        That is: the canvas of the workspace file, as many colors as the palette file has, and of few strokes as few
        colors and replans.
        """
        if "brush" in values:  # one brush has always been said so
            if "brushes" in values:
                raise ConfigError("A brush was given, and brushes as well; give --brushes alone.")
            values["brushes"] = values.pop("brush")
        try:
            chosen = cls(**values)
        except ValidationError as error:
            raise ConfigError(
                "; ".join(sentence_on(fault, cls.model_fields) for fault in error.errors()) + "."
            ) from error
        if chosen.palette is not None and "colors" not in values:
            return cls.of(**values, colors=paints_of(chosen.palette))
        fitting: dict[str, Any] = {
            "colors": min(chosen.colors, chosen.strokes),
            "replans": min(chosen.replans, chosen.strokes - 1),
        }
        if chosen.workspace is not None and not chosen.simulated and "canvas" not in values:
            fitting["canvas"] = canvas_of(chosen.workspace)
        return chosen.model_copy(
            update={
                name: fits for name, fits in fitting.items() if name not in values and fits != getattr(chosen, name)
            }
        )

    @classmethod
    def from_toml(cls, path: Path, **overrides: Any) -> Self:
        """A description from a TOML file, with `overrides` on top; files in it are named relative to it."""
        values = storage.read_toml(path, "a settings file (TOML)", _MOST_BYTES, "write lines such as: strokes = 300")
        for name in FILES:
            if isinstance(values.get(name), str):
                values[name] = path.parent / values[name]
        return cls.of(**{**values, **overrides})

    def changed(self, **values: Any) -> Self:
        """The same with other values, checked. Raises ConfigError."""
        if "brush" in values:
            values["brushes"] = values.pop("brush")
        kept = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self).of(**{**kept, **values})

    @property
    def as_kept(self) -> Self:
        """The same to the last digit as it will be read again from its folder."""
        return type(self).of(**self.record(), goal=self.goal, initial=self.initial)

    def record(self) -> dict[str, Any]:
        """As plain values, for people and programs to read; the goal, whose pictures are copied, is kept beside it."""
        return self.model_dump(mode="json", exclude={"goal", "initial"})

    @classmethod
    def read(cls, path: Path) -> Self:
        """A description as it lies in a painting's folder, also as versions before 0.2 wrote it."""
        content = storage.read_bytes(path, "the settings of a painting", _MOST_BYTES, ConfigError)
        try:
            plain = json.loads(content)
            if not isinstance(plain, dict) or not {"strokes", "film", "calibration"} <= set(plain):
                raise KeyError("strokes, film and calibration are needed")
            return cls.of(**upgraded(plain))
        except (ValueError, KeyError, RecursionError) as cause:
            raise ConfigError(f"{path} does not hold the settings of a painting ({cause}); bring it back.") from cause

    @property
    def heading(self) -> str:
        """Its title, or one made from the first thing to paint."""
        return self.title or (self.goal[0].title if self.goal else "Untitled")

    @property
    def name(self) -> str:
        """A name for its folder, from the first thing to paint. Raises IndexError where there is none."""
        return self.goal[0].name

    @property
    def goal_facts(self) -> tuple[tuple[str, str], ...]:
        """What is painted, as its page and its record tell it: (label, what)."""
        return (
            *((item.label, item.described) for item in self.goal),
            *((f"Begun with {item.kind}", item.described) for item in self.initial),
        )

    @property
    def _names_brushes(self) -> bool:
        """Whether it says which brushes there are, and leaves them neither to the program nor to the planner."""
        return self.brushes not in (None, AUTO)

    @property
    def _brushes(self) -> str:
        """Those asked for, or the usual ones: several where they change by themselves."""
        if self.brushes is not None and self._names_brushes:
            return self.brushes
        if self.layers is not None or not self.simulated:
            return "broad"
        if self.is_words:
            return WORDS_BRUSHES
        hurried = self.minutes is not None and self.minutes < 6 * self.drying
        return FEWER_BRUSHES if self.strokes < _FEWEST_FOR_ALL or hurried else USUAL_BRUSHES

    @property
    def _dryings(self) -> int:
        """How often a layer dries before the next one, of the layers that were asked for."""
        return max(len(self.brush_names) if self._names_brushes else 1, self.layers or 1) - 1

    @property
    def is_words(self) -> bool:
        """Whether words alone say what to paint."""
        return bool(self.goal) and not self.initial and all(item.kind == "text" for item in self.goal)

    @property
    def is_composed(self) -> bool:
        """Whether words say what to paint, alone or with a sketch or a style: it begins with things on a ground."""
        kinds = {item.kind for item in self.goal}
        return "text" in kinds and not self.initial and kinds <= {"text", "sketch", "style"}

    @property
    def brush_names(self) -> tuple[str, ...]:
        """The brush, or that of each layer: names, or files of learned weights."""
        return tuple(name for name, _ in brush_shares(self._brushes))

    @property
    def shares(self) -> tuple[float, ...] | None:
        """The share of the strokes that each layer gets; None where they are the usual ones."""
        shares = [share for _, share in brush_shares(self._brushes) if share is not None]
        return tuple(shares) if len(shares) > 1 else None

    @property
    def simulated(self) -> bool:
        """Whether no real robot is moved."""
        return self.robot in SIMULATED

    @property
    def by_hand(self) -> bool:
        """Whether a person paints."""
        return self.robot == HUMAN

    @property
    def is_short(self) -> bool:
        """Whether drying once would take more than a third of the time that the robot has."""
        return self.minutes is not None and self.minutes < 3 * self.drying

    @property
    def films_arm(self) -> bool:
        """Whether a simulated arm is filmed at work."""
        return self.film and self.robot == SAWYER_SIM

    @property
    def film_length(self) -> int:
        """Timelapse frames of the film: none by hand, for nobody wants to step aside after every stroke."""
        return min(self.strokes, self.timelapse_frames) if self.film and not self.by_hand else 0


def upgraded(plain: Mapping[str, Any]) -> dict[str, Any]:
    """The plain values of a description of any version as those of this one. Raises ConfigError for a newer one."""
    version = plain.get("version", 0)
    if type(version) is not int or not 0 <= version <= VERSION:
        raise ConfigError(
            f"The settings are of version {version!r}, and this program reads versions up to {VERSION}; use the "
            "program that the painting was begun with, or a newer one."
        )
    # What was not said yet was always so; before 0.2 there was no version either, and pictures were cropped.
    known = {"ground": "white", "focus": "none", "sharpness": 0.0, **plain}
    return known if version == VERSION else {**known, "version": VERSION, "fit": "crop"}
