"""RunSpec: the full description of a painting, with one set of defaults and limits for all interfaces.

Command line, page, TOML files, experiments and notebooks use it. This module loads no tensors.
"""

from collections.abc import Mapping
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any, Literal, Self, Unpack

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from frida_painter import storage
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import HUMAN, NO_CAMERA, SAWYER_SIM, SIMULATED, VIRTUAL
from frida_painter.errors import ConfigError
from frida_painter.objectives.semantic import USUAL_FREEDOM
from frida_painter.objectives.word_settings import USUAL, Beginning, WordSettings
from frida_painter.planning.settings import PlannerSettings
from frida_painter.registry import (
    INITIALISERS,
    LISTENERS,
    PLANNERS,
    REPLAN_POLICIES,
    STROKE_FAMILIES,
    STROKE_MODELS,
)
from frida_painter.runs.fields import (
    NAMED_PAINTS,
    Brushes,
    Canvas,
    DarkestPaint,
    Families,
    File,
    Focus,
    Ground,
    Guide,
    InitialItems,
    Items,
    PaintsInUse,
    Placement,
    Policy,
    canvas_of,
    paints_of,
    sentence_on,
)
from frida_painter.runs.run_settings import RunSettings
from frida_painter.runs.shares import AUTO, MAX_LAYERS, brush_shares, family_shares
from frida_painter.storage import count_of

VERSION = 1
SETTLED = ("strokes", "layers", "colors", "canvas", "brushes", "new_paints", "ground", "paints")
"""Settings that a plan depends on; they cannot change once there is a plan."""
EASEL = (
    "robot", "camera", "workspace", "calibration", "placement_error", "pace", "arm_meshes", "studio_canvas", "on_canvas"
)  # fmt: skip
"""Settings of the easel, which do not change the picture."""
_LONG_TEXTS = ("avoid", "phrases")
FILES = ("palette", "pictures", "workspace", "calibration", "arm_meshes", "studio_canvas")
"""Settings that name files, other than those of the goal."""
USUAL_BRUSHES = "broad:30%,medium:35%,fine:35%"
"""Default brushes of a picture in the virtual studio; plans for other goals, or with few strokes, use the first one."""
FEWER_BRUSHES = "broad:50%,medium:50%"
"""Default brushes of a picture with less than 200 strokes, or if drying twice takes a third of the minutes."""
_FEWEST_FOR_ALL = 200  # strokes
_FEWEST_WITH_SEVERAL = 100  # strokes
WORDS_BRUSHES = "broad:50%,fine:50%"
"""Default brushes of words alone; people recognise a thing by its outline and its small parts."""
_OF_PLANS: dict[str, Any] = {field.name: field.default for field in fields(PlannerSettings)}
"""Defaults of the planner's settings, shared by all interfaces."""
_WORDS = tuple(field.name for field in fields(WordSettings))
_MAX_SPEC_BYTES = 2**20


class RunSpec(BaseModel):
    """Description of a painting. `of`, `from_toml` and `read` raise ConfigError, which names all faults at once.

    goal, initial: goals of the painting, and goals for its start.
    together: True if there is no goal: a person begins, and the robot continues the drawing.
    canvas: wanted size, which `fit` may change.
    brushes: names or weight files, one for all layers or one each, "broad:60%,fine+comma:40%", or "auto".
    strokes_of: families for further layers, "comma:40%", or "auto".

    clip: CLIP network for words. None: the fetched one.
    pictures: folder of the person's own pictures of things that words name.
    palette: file with the really mixed paints.
    timelapse_frames: largest number of frames of the film.
    workspace, calibration: files of a real easel.
    placement_error: error of the virtual studio's robot, such as "4mm,2deg".
    on_canvas: True if the painting begins on an existing painting.
    studio_canvas: picture of that painting in the virtual studio.

        >>> import frida_painter as fp
        >>> spec = fp.RunSpec.of(goal=[{"image": "photo.jpg"}], strokes=50, canvas="A4")
        >>> spec.strokes, str(spec.canvas), spec.seed
        (50, '210 x 297 mm', 0)
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
    together: bool = Field(
        False,
        description="Paint without a goal: you begin, and the robot answers each of your turns in the spirit of your "
        "strokes, with at most --strokes in all.",
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
        le=MAX_LAYERS,
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
            "group": STROKE_MODELS,
            "names": ["--brushes", "--brush"],
            "default": "in the studio, for a picture, broad:30%,medium:35%,fine:35% from 200 strokes on and "
            "broad:50%,medium:50% from 100 on; for words alone, from 100 on, broad:50%,fine:50%; otherwise broad",
        },
    )
    strokes_of: Families = Field(
        None,
        min_length=1,
        description="Families of strokes that a person taught, each in a layer of the last brush: comma, zigzag, "
        "flourish, or a file that teach wrote. With shares of the strokes like comma:20%,flourish:30%; without them "
        "families get 40% together. auto tries each with a quick plan, and takes one if it comes nearer.",
        json_schema_extra={
            "metavar": "FAMILY,...|auto",
            "group": STROKE_FAMILIES,
            "names": ["--strokes-of"],
            "default": "strokes of the brushes alone",
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
        json_schema_extra={
            "group": REPLAN_POLICIES,
            "metavar": "NAME:VALUE",
            "default": "evenly spaced, --replans times",
        },
    )
    ground: Ground = Field(
        None,
        description="The colour in which the bare canvas is toned before the painting begins. auto takes the one that "
        "suits the picture. A person tones it; the recipe is told, and the camera looks before anything is planned.",
        json_schema_extra={
            "metavar": "auto|white|#RRGGBB",
            "default": "white; in the studio, auto for a picture of 100 strokes or more, and for words alone and "
            "styles the commonest colour around the things",
        },
    )
    darkest: DarkestPaint = Field(
        None,
        description="The colour of your darkest paint once it is dry. No darker paint is planned, and the forecast is "
        "right where the picture is darker.",
        json_schema_extra={"metavar": "#RRGGBB", "default": "in the studio #121212, otherwise #000000"},
    )
    paints: PaintsInUse = Field(
        _OF_PLANS["paints"],
        min_length=1,
        description="The paints that you mix from. acrylics: six common ones; FILE: your own, as for mix --paints. A "
        "colour that they cannot give becomes the nearest one that they can, and colours with one recipe become one. "
        "any: every colour, for pens, screens and paints that are not mixed. A --palette is never changed.",
        json_schema_extra={"metavar": "acrylics|any|FILE"},
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
    freedom: float = Field(
        USUAL_FREEDOM,
        ge=0,
        le=1,
        allow_inf_nan=False,
        description="How far the colours of a painting by content (--semantic) may leave those of the picture: 0 is "
        "faithful, 1 is wild.",
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
        description="Planning effort. 2 plans twice as long, 0.5 half as long; a CLIP looks more, or less.",
    )
    planner: str = Field(
        _OF_PLANS["planner"],
        min_length=1,
        description="How the plan is made. Your own packages can add planners.",
        json_schema_extra={"group": PLANNERS, "metavar": "NAME"},
    )
    initialiser: str = Field(
        _OF_PLANS["initialiser"],
        min_length=1,
        description="How first strokes are placed: growth or uniform. Your own packages can add ways.",
        json_schema_extra={"group": INITIALISERS, "metavar": "NAME"},
    )
    listener: str | None = Field(
        None,
        min_length=1,
        description="Who hears the events. events:FILE writes them as JSON. Your own packages can add listeners.",
        json_schema_extra={"group": LISTENERS, "metavar": "NAME:TEXT", "default": "nobody"},
    )
    seed: int = Field(
        _OF_PLANS["seed"],
        ge=0,
        le=2**31 - 1,
        description="Random seed. The same seed gives the same painting, another seed a different one.",
    )
    clip: str | None = Field(None, min_length=1)
    beginning: Beginning = Field(
        USUAL.beginning,
        description="First picture of a painting of words alone. scene: pictures of its things; colors: a coarse "
        "picture, coloured by a CLIP; nothing: none. auto: what a CLIP likes best of the two, or a scene.",
        json_schema_extra={"metavar": "auto|scene|colors|nothing"},
    )
    avoid: str = Field(
        USUAL.avoid,
        max_length=200,
        description="Words that a painting of words should not look like.",
        json_schema_extra={"metavar": "WORDS", "default": "no words"},
    )
    phrases: str = Field(
        "; ".join(USUAL.phrases),
        max_length=1000,
        description="How the words are said to a network: sentences with {} in the place of the words, divided by ; as "
        'in "a painting of {}; a drawing of {}".',
        json_schema_extra={"metavar": "SENTENCES", "default": "the words alone"},
    )
    guide: Guide = Field(
        None,
        min_length=1,
        description="A diffusion pipeline that leads the plan of words, by score distillation: diffusers:NAME is a "
        "folder, or a name on the hub, fetched once. diffusers:NAME,scale=X says how strongly the words count, 100 by "
        "default.",
        json_schema_extra={"metavar": "diffusers:NAME", "default": "a CLIP alone, if there is one"},
    )
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
        self._require_words()
        self._require_no_goal()
        if "colors" in given and self.colors > self.strokes:
            raise ValueError(f"{self.colors} colors for {self.strokes} strokes; give at most as many colors as strokes")
        if self.layers is not None and len(self.brush_names) > 1 and self.layers != len(self.brush_names):
            raise ValueError(f"{self.layers} layers and {len(self.brush_names)} brushes; leave out --layers")
        if self.strokes_of is not None and (self.layers is not None or self.brushes == AUTO):
            raise ValueError("--strokes-of adds a layer for each family; leave out --layers, and name the --brushes")
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
        if not self.has_camera and (self.replan_policy or ("replans" in given and self.replans)):
            option = f"--replan-policy {self.replan_policy}" if self.replan_policy else f"--replans {self.replans}"
            raise ValueError(
                f"{option} was given, and with --camera {NO_CAMERA} nobody looks at the canvas; leave it out, or name "
                "a camera. A picture that you take counts as a look: frida-painter look FOLDER PICTURE"
            )
        if not self.has_camera and self.on_canvas:
            raise ValueError(
                f"--on-canvas begins on what a camera sees, and with --camera {NO_CAMERA} nobody looks; leave it out "
                "and put up a bare canvas, or name a camera"
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

    def _require_words(self) -> None:
        """Raises ValueError if settings of words are wrong, or given without words."""
        try:
            settings = self.words
        except ConfigError as error:
            raise ValueError(f"--phrases: {error}") from error
        kinds = {item.kind for item in (*self.goal, *self.initial)}
        if self.guide is not None and all(item.kind != "text" for item in self.goal) and (self.goal or self.together):
            raise ValueError("--guide follows words, and the goal has none; leave it out, or give --text")
        if kinds and "text" not in kinds and settings != USUAL:
            option = next(
                name
                for name, mine, usual in zip(_WORDS, astuple(settings), astuple(USUAL), strict=True)
                if mine != usual
            )
            raise ValueError(f"--{option} is for words, and the goal has none; leave it out, or give --text")

    def _require_no_goal(self) -> None:
        """Raises ValueError if a painting without a goal has something that only a goal can use."""
        if not self.together:
            return
        useless = {
            "a goal": self.goal or self.initial, "--minutes": self.minutes, "--layers": (self.layers or 1) > 1,
            "--strokes-of": self.strokes_of, "--replan-policy": self.replan_policy,
            "--ground auto": self.ground == AUTO, "--brushes auto": self.brushes == AUTO,
            "several brushes": self.brushes not in (None, AUTO) and len(self.brush_names) > 1,
        }  # fmt: skip
        found = [name for name, value in useless.items() if value]
        if found:
            raise ValueError(
                f"--together paints without a goal, and {found[0]} was given; leave out one of them. With --together, "
                "name one brush, and a ground if you like"
            )
        if not self.has_camera:
            raise ValueError(
                f"--together answers what you paint, and with --camera {NO_CAMERA} nobody sees it; name a camera"
            )

    @classmethod
    def of(cls, **settings: Unpack[RunSettings]) -> Self:
        """Returns a checked description, with defaults that fit the given values.

        These defaults are the canvas of the workspace file, and the number of colours of the palette file. A plan
        with few strokes gets fewer colours and replans.
        Raises ConfigError.
        """
        values: dict[str, Any] = {**settings}
        if "brush" in values:  # the usual word for one brush
            if "brushes" in values:
                raise ConfigError("A brush was given, and brushes as well; give --brushes alone.")
            values["brushes"] = values.pop("brush")
        try:
            chosen = cls(**values)
        except ValidationError as error:
            raise ConfigError(
                "; ".join(sentence_on(fault, cls.model_fields) for fault in error.errors()) + "."
            ) from error
        for name, value in values.items():
            fault = storage.path_fault(value) if isinstance(value, str | Path) and name not in _LONG_TEXTS else ""
            if fault:
                raise ConfigError(f"{name} was given {str(value)[:40]!r}, which can be no name and no path ({fault}).")
        if chosen.palette is not None and "colors" not in values:
            return cls.of(**values, colors=paints_of(chosen.palette))
        fitting: dict[str, Any] = {
            "colors": min(chosen.colors, chosen.strokes),
            "replans": min(chosen.replans, chosen.strokes - 1) if chosen.has_camera else 0,
        }
        if chosen.workspace is not None and not chosen.simulated and "canvas" not in values:
            fitting["canvas"] = canvas_of(chosen.workspace)
        return chosen.model_copy(
            update={
                name: fits for name, fits in fitting.items() if name not in values and fits != getattr(chosen, name)
            }
        )

    @classmethod
    def from_toml(cls, path: str | Path, **overrides: Unpack[RunSettings]) -> Self:
        """Reads a description from a TOML file, with `overrides`; its file names are relative to it.

        Raises ConfigError.
        """
        path = Path(path)
        values = storage.read_toml(
            path, "a settings file (TOML)", _MAX_SPEC_BYTES, "write lines such as: strokes = 300"
        )
        for name in (*FILES, "paints"):
            if isinstance(values.get(name), str) and values[name] not in NAMED_PAINTS:
                values[name] = path.parent / values[name]
        return cls.of(**{**values, **overrides})

    def with_values(self, **settings: Unpack[RunSettings]) -> Self:
        """Returns a checked copy with other values. Raises ConfigError."""
        values: dict[str, Any] = {**settings}
        if "brush" in values:
            values["brushes"] = values.pop("brush")
        kept = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self).of(**{**kept, **values})

    @property
    def as_kept(self) -> Self:
        """Description with exactly the values that are read again from its folder."""
        return type(self).of(**self.record(), goal=self.goal, initial=self.initial)

    def record(self) -> dict[str, Any]:
        """Returns the description as plain values, without the goal, which is kept beside it."""
        return self.model_dump(mode="json", exclude={"goal", "initial"})

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Reads a description from a painting's folder, if version 0.2 or newer wrote it. Raises ConfigError."""
        path = Path(path)
        content = storage.read_bytes(path, "the settings of a painting", _MAX_SPEC_BYTES, ConfigError)
        try:
            plain = storage.parse_json(content)
            if not isinstance(plain, dict) or not {"strokes", "film", "calibration"} <= set(plain):
                raise KeyError("strokes, film and calibration are needed")
            return cls.of(**upgrade_record(plain))
        except (ValueError, KeyError) as cause:
            raise ConfigError(f"{path} does not hold the settings of a painting ({cause}); bring it back.") from cause

    @property
    def heading(self) -> str:
        """Title, or one from the first goal."""
        usual = "Drawn together" if self.together else "Untitled"
        return self.title or (self.goal[0].title if self.goal else usual)

    @property
    def name(self) -> str:
        """Folder name from the first goal. Raises IndexError if there is no goal, and it is not painted together."""
        return "together" if self.together else self.goal[0].name

    @property
    def goal_facts(self) -> tuple[tuple[str, str], ...]:
        """Goals for page and record, as (label, description)."""
        return (
            *([("Goal", "none: drawn together")] if self.together else []),
            *((item.label, item.described) for item in self.goal),
            *((f"Begun with {item.kind}", item.described) for item in self.initial),
        )

    @property
    def words(self) -> WordSettings:
        """Settings of the words. Raises ConfigError if a phrase has no place for them."""
        return WordSettings(
            self.beginning,
            self.avoid,
            tuple(part.strip() for part in self.phrases.split(";")),
        )

    @property
    def _names_brushes(self) -> bool:
        """True if the description names its brushes, instead of leaving them to the defaults or the planner."""
        return self.brushes not in (None, AUTO) or self._names_families

    @property
    def _names_families(self) -> bool:
        """True if the description names stroke families."""
        return self.strokes_of not in (None, AUTO)

    @property
    def layer_brushes(self) -> str:
        """Named brushes, or the default ones, with a layer for each named family, in the form of --brushes."""
        return self._with_families(self._own_brushes) if self._names_families else self._own_brushes

    def _with_families(self, brushes: str) -> str:
        """Returns the brushes in the form of --brushes, with a layer of the last brush for each named family."""
        assert self.strokes_of is not None
        families, own = family_shares(self.strokes_of), brush_shares(brushes)
        if self.brushes is None and self.strokes < _FEWEST_WITH_SEVERAL:
            own = own[:1]  # few strokes are not divided among brushes
        left = 1 - sum(share for _, share in families)
        shares = [share for _, share in own]
        usual = (1.0,) if len(own) == 1 else (0.6, *[0.4 / (len(own) - 1)] * (len(own) - 1))
        given = [usual[number] if share is None else share for number, share in enumerate(shares)]
        last = own[-1][0]
        layers = [(name, left * share / sum(given)) for (name, _), share in zip(own, given, strict=True) if left > 1e-9]
        layers += [(f"{last}+{name}", share) for name, share in families]
        return ",".join(f"{name}:{100 * share:.6f}%" for name, share in layers)

    @property
    def _own_brushes(self) -> str:
        """Named brushes, or the default ones; several only if the robot changes brushes itself."""
        if self.brushes is not None and self.brushes != AUTO:
            return self.brushes
        if self.layers is not None or not self.simulated:
            return "broad"
        if self.together:
            return "medium"
        if self.is_words:
            return WORDS_BRUSHES
        hurried = self.minutes is not None and self.minutes < 6 * self.drying
        return FEWER_BRUSHES if self.strokes < _FEWEST_FOR_ALL or hurried else USUAL_BRUSHES

    @property
    def _dryings(self) -> int:
        """Number of times that a layer dries before the next one, for the requested layers."""
        return max(len(self.brush_names) if self._names_brushes else 1, self.layers or 1) - 1

    @property
    def is_words(self) -> bool:
        """True if the goal consists of words alone."""
        return bool(self.goal) and not self.initial and all(item.kind == "text" for item in self.goal)

    @property
    def is_composed(self) -> bool:
        """True if the goal is words, alone or with a sketch or a style.

        Painting then begins with things on a ground.
        """
        kinds = {item.kind for item in self.goal}
        return "text" in kinds and not self.initial and kinds <= {"text", "sketch", "style"}

    @property
    def brush_names(self) -> tuple[str, ...]:
        """Brush of all layers, or of each layer: names or weight files."""
        return tuple(name for name, _ in brush_shares(self.layer_brushes))

    @property
    def shares(self) -> tuple[float, ...] | None:
        """Share of the strokes for each layer; None for the default shares."""
        shares = [share for _, share in brush_shares(self.layer_brushes) if share is not None]
        return tuple(shares) if len(shares) > 1 else None

    @property
    def simulated(self) -> bool:
        """True if no real robot moves."""
        return self.robot in SIMULATED

    @property
    def by_hand(self) -> bool:
        """True if a person paints."""
        return self.robot == HUMAN

    @property
    def has_camera(self) -> bool:
        """False if nobody looks at the canvas: the plan is then painted as it is."""
        return self.camera != NO_CAMERA

    @property
    def films_arm(self) -> bool:
        """True if a simulated arm is filmed at work."""
        return self.film and self.robot == SAWYER_SIM

    @property
    def film_length(self) -> int:
        """Number of timelapse frames: 0 by hand, because nobody wants to step aside after every stroke."""
        return min(self.strokes, self.timelapse_frames) if self.film and not self.by_hand else 0


def upgrade_record(plain: Mapping[str, Any]) -> dict[str, Any]:
    """Returns plain values of a description in the current form. Raises ConfigError for another version."""
    if "version" not in plain:
        raise ConfigError(storage.refuse_first_version("The description of this painting"))
    version = plain["version"]
    if type(version) is not int or version != VERSION:
        raise ConfigError(
            f"The settings are of version {version!r}, and this program reads version {VERSION}; use the program that "
            "the painting was begun with, or a newer one."
        )
    if plain.get("tilt", 0) != 0:  # of 0.3
        raise ConfigError(
            f"The settings say tilt = {str(plain['tilt'])[:20]}, and brushes are upright now; use the program that the "
            "painting was begun with, or delete it there and plan anew."
        )
    plain = {name: value for name, value in plain.items() if name != "tilt"}
    return {"ground": "white", "focus": "none", "sharpness": 0.0, **plain}  # 0.2 may lack these, which were fixed then
