"""RunSpec: the full description of a painting; a setting is spelled here once, with its limits, default and help.

Command line, page, TOML files, sweeps, records, notebooks and the reference are made from its fields. This module
loads no tensors.
"""

from collections.abc import Iterator, Mapping
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from frida_painter import registry, storage
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import HUMAN, NO_CAMERA, SAWYER_SIM, VIRTUAL, is_simulated
from frida_painter.errors import ConfigError
from frida_painter.objectives import USUAL_FREEDOM
from frida_painter.objectives.word_settings import USUAL, Beginning, WordSettings
from frida_painter.planning.settings import FEWEST_FOR_LAYERS, PlannerSettings
from frida_painter.runs.fields import (
    AUTO,
    MAX_LAYERS,
    NAMED_PAINTS,
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
    brush_shares,
    canvas_of,
    family_shares,
    paints_of,
    sentence_on,
)
from frida_painter.storage import count_of

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
    if known := [name for group in more["of"] for name in registry.parts(group)]:
        told.append(f"Available: {', '.join(known)}.")
    adding = [part for group in more["adds"] for part in registry.parts(group).values()]
    if added := [part.name for part in adding if not part.is_ours]:
        told.append(f"Installed packages add {', '.join(added)}.")
    return " ".join(told)


def usual_of(field: Any) -> str:
    """Returns the default of a setting, in words."""
    default = field.default
    plain = ("yes" if default else "no") if isinstance(default, bool) else default
    plain = f"{plain:g}" if isinstance(plain, float) else plain
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

    @classmethod
    def accept(cls, values: Mapping[str, Any]) -> Self:
        """Returns the settings with these values. Raises ConfigError, which names all faults at once."""
        try:
            return cls(**values)
        except ValidationError as error:
            faults = [sentence_on(fault, cls.model_fields) for fault in error.errors()]
            raise ConfigError(f"{'; '.join(faults)}.") from error


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
    """Colour of the ground. A person tones the bare canvas with it before the painting begins; the recipe is told, and
    the camera looks before anything is planned. auto takes the colour that suits the picture."""
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
        value="NAME,...",
        usual="in the studio, for a picture, broad:30%,medium:35%,fine:35% from 200 strokes on and "
        "broad:50%,medium:50% from 100 on; for words alone, from 100 on, broad:50%,fine:50%; otherwise broad",
        names=("--brushes", "--brush"),
        adds=(registry.STROKE_MODELS,),
        common=True,
        min_length=1,
    )
    """The brush: fine, medium or broad, or a file of stroke model weights that you trained. Several paint a layer
    each, like broad,medium, with shares of the strokes like broad:60%,medium:40%."""
    strokes_of: Families = setting(
        None, value="FAMILY,...", usual="strokes of the brushes alone", adds=(registry.STROKE_FAMILIES,), min_length=1
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
    planner: str = setting(_PLANNED["planner"], value="NAME", adds=(registry.PLANNERS,), min_length=1)
    """Way to make the plan. Your own packages can add planners."""
    seed: int = setting(_PLANNED["seed"], common=True, ge=0, le=2**31 - 1)
    """Random seed. The same seed gives the same painting, another seed a different one."""


class MachineSettings(SettingSection):
    """The machine; its settings do not change the picture."""

    panel: ClassVar[str] = "On which machine"

    robot: str = setting(VIRTUAL, value="NAME", of=(registry.EASELS, registry.ROBOTS), common=True, min_length=1)
    """The robot that paints, like virtual or xarm:192.168.1.10. `doctor` shows how to write each name. sawyer-sim is
    a physical simulation of the paper's arm."""
    camera: str = setting("", value="NAME", usual="the virtual studio's own", of=(registry.CAMERAS,), common=True)
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
        None, value="NAME:VALUE", usual="evenly spaced, --replans times", adds=(registry.REPLAN_POLICIES,), min_length=1
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

VERSION = 1
SETTLED = ("strokes", "layers", "colors", "canvas", "brushes", "new_paints", "ground", "paints")
"""Settings that a plan depends on; they cannot change once there is a plan."""
USUAL_BRUSHES = "broad:30%,medium:35%,fine:35%"
"""Default brushes of a picture in the virtual studio."""
FEWER_BRUSHES = "broad:50%,medium:50%"
"""Default brushes of a picture with less than 200 strokes, or if drying twice takes a third of the minutes."""
_FEWEST_FOR_ALL = 200  # strokes
WORDS_BRUSHES = "broad:50%,fine:50%"
"""Default brushes of words alone; people recognise a thing by its outline and its small parts."""
FILM_FRAMES = 120
"""Largest number of frames of a film."""
_MAX_SPEC_BYTES = 2**20
FORMER = {
    "tilt": 0,
    "sharpness": 0.3,
    "timelapse_frames": FILM_FRAMES,
    "phrases": "{}",
    "initialiser": "growth",
    "listener": None,
    "arm_meshes": None,
    "guide": None,
}
"""Settings of 0.3 that are fixed now, each with the value that it is fixed at."""


class RunSpec(PaintingSettings, MachineSettings, PlanSettings, CanvasSettings, GoalSettings):
    """Description of a painting. `of`, `from_toml` and `read` raise ConfigError, which names all faults at once.

    Its fields are the settings of its sections; `docs/reference/settings.md` lists them.

        >>> import frida_painter as fp
        >>> spec = fp.RunSpec.of(goal=[{"image": "photo.jpg"}], strokes=50, canvas="A4")
        >>> spec.strokes, str(spec.canvas), spec.seed
        (50, '210 x 297 mm', 0)
    """

    version: Literal[1] = setting(1)
    """Version of these settings in a file."""

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        for fault in self._misfits():
            raise ValueError(fault)
        return self

    def _misfits(self) -> Iterator[str]:
        """Yields a sentence for each setting that another one rules out."""
        given, strokes, layers = self.model_fields_set, count_of(self.strokes, "stroke"), self.layers or 1
        kinds = {item.kind for item in (*self.goal, *self.initial)}
        if kinds and "text" not in kinds and self.words != USUAL:
            said = zip(fields(WordSettings), astuple(self.words), astuple(USUAL), strict=True)
            option = next(field.name for field, mine, usual in said if mine != usual)
            yield f"--{option} is for words, and the goal has none; leave it out, or give --text"
        if self.together:
            yield from self._misfits_together()
        if "colors" in given and self.colors > self.strokes:
            yield f"{self.colors} colors for {self.strokes} strokes; give at most as many colors as strokes"
        if self.layers is not None and len(self.brush_names) > 1 and layers != len(self.brush_names):
            yield f"{layers} layers and {len(self.brush_names)} brushes; leave out --layers"
        if self.strokes_of is not None and self.layers is not None:
            yield "--strokes-of adds a layer for each family; leave out --layers"
        if self.names_brushes and len(self.brush_names) > self.strokes:
            yield f"{len(self.brush_names)} layers for {strokes}; give at most as many brushes"
        for name, share in zip(self.brush_names, self.shares or (), strict=False):
            if self.names_brushes and round(self.strokes * share) == 0:
                yield (
                    f"{name} gets {100 * share:g} % of {strokes}, which is not one stroke; give it a larger share, or "
                    "leave it out"
                )
        if self.new_paints and self.palette is not None:
            yield "--palette tells of one palette, and --new-paints mixes one for each layer; leave one out"
        if layers > self.strokes:
            yield f"{layers} layers for {self.strokes} strokes; give at most as many layers as strokes"
        if "replans" in given and self.replans >= self.strokes:
            yield (
                f"{self.replans} replans for {self.strokes} strokes; there is a look between strokes only, so give at "
                f"most {self.strokes - 1}"
            )
        if self.on_canvas and self.ground not in (None, "white"):
            yield f"--on-canvas paints on what is there, and --ground {self.ground} tones a bare canvas; leave out one"
        if not self.has_camera and (self.replan_policy or ("replans" in given and self.replans)):
            option = f"--replan-policy {self.replan_policy}" if self.replan_policy else f"--replans {self.replans}"
            yield (
                f"{option} was given, and with --camera {NO_CAMERA} nobody looks at the canvas; leave it out, or name "
                "a camera. A picture that you take counts as a look: frida-painter look FOLDER PICTURE"
            )
        if not self.has_camera and self.on_canvas:
            yield (
                f"--on-canvas begins on what a camera sees, and with --camera {NO_CAMERA} nobody looks; leave it out "
                "and put up a bare canvas, or name a camera"
            )
        if self.minutes is not None and self.by_hand:
            yield f"--minutes is the robot's time, and with --robot {HUMAN} a person paints; leave it out"
        dryings = max(len(self.brush_names) if self.names_brushes else 1, layers) - 1
        if self.minutes is not None and dryings * self.drying >= self.minutes:
            yield (
                f"--minutes is {self.minutes:g}, and between {dryings + 1} layers paint dries for "
                f"{dryings * self.drying:g} minutes; give more minutes, fewer brushes or --layers, or less drying"
            )

    def _misfits_together(self) -> Iterator[str]:
        """Yields a sentence for each setting that only a goal can use."""
        useless = {
            "a goal": self.goal or self.initial, "--minutes": self.minutes, "--layers": (self.layers or 1) > 1,
            "--strokes-of": self.strokes_of, "--replan-policy": self.replan_policy,
            "--ground auto": self.ground == AUTO, "several brushes": self.brushes and len(self.brush_names) > 1,
        }  # fmt: skip
        for name, value in useless.items():
            if value:
                yield (
                    f"--together paints without a goal, and {name} was given; leave out one of them. With --together, "
                    "name one brush, and a ground if you like"
                )
        if not self.has_camera:
            yield f"--together answers what you paint, and with --camera {NO_CAMERA} nobody sees it; name a camera"

    def require_sensible(self) -> None:
        """Raises ConfigError if options for a real easel are given for a simulated one, or the other way round.

        It is only for new paintings; a resumed one may have been begun with unnecessary options.
        """
        if self.simulated and self.on_canvas and self.studio_canvas is None:
            raise ConfigError(
                "--on-canvas was given, and the canvas of the virtual studio is bare; leave it out, or give a picture "
                "of what is on the canvas: --studio-canvas FILE"
            )
        if self.simulated:
            said: dict[str, object] = {"--camera": self.has_camera and self.camera, "--workspace": self.workspace}
        else:
            said = {
                "--pace": self.pace,
                "--placement-error": self.placement_error,
                "--studio-canvas": self.studio_canvas,
            }
        named = [option for option, value in said.items() if value]
        if named:
            whose, is_a = ("real", "simulated") if self.simulated else ("simulated", "real")
            verb, them = ("is", "it") if len(named) == 1 else ("are", "them")
            raise ConfigError(
                f"{' and '.join(named)} {verb} for {whose} robots, and --robot {self.robot[:60]} is a {is_a} one; "
                f"leave {them} out, or name another robot."
            )

    @classmethod
    def of(cls, **settings: Any) -> Self:
        """Returns a checked description, with defaults that fit the given values.

        These defaults are the canvas of the workspace file, and the number of colours of the palette file. A plan
        with few strokes gets fewer colours and replans. `brush` is another word for `brushes`.
        Raises ConfigError.
        """
        if "brush" in settings:
            if "brushes" in settings:
                raise ConfigError("A brush was given, and brushes as well; give --brushes alone.")
            settings["brushes"] = settings.pop("brush")
        chosen = cls.accept(settings)
        for name, value in settings.items():
            fault = storage.path_fault(value) if isinstance(value, str | Path) and name != "avoid" else ""
            if fault:
                raise ConfigError(f"{name} was given {str(value)[:40]!r}, which can be no name and no path ({fault}).")
        if chosen.palette is not None and "colors" not in settings:
            return cls.of(**settings, colors=paints_of(chosen.palette))
        fitting: dict[str, Any] = {
            "colors": min(chosen.colors, chosen.strokes),
            "replans": min(chosen.replans, chosen.strokes - 1) if chosen.has_camera else 0,
        }
        if chosen.workspace is not None and not chosen.simulated and "canvas" not in settings:
            fitting["canvas"] = canvas_of(chosen.workspace)
        fitting = {name: fits for name, fits in fitting.items() if name not in settings}
        return chosen.model_copy(update={name: fits for name, fits in fitting.items() if fits != getattr(chosen, name)})

    @classmethod
    def from_toml(cls, path: str | Path, **overrides: Any) -> Self:
        """Reads a description from a TOML file, with `overrides`; its file names are relative to it.

        Raises ConfigError.
        """
        path = Path(path)
        example = "write lines such as: strokes = 300"
        values = storage.read_toml(path, "a settings file (TOML)", _MAX_SPEC_BYTES, example)
        for name in (*FILES, "paints"):
            if isinstance(values.get(name), str) and values[name] not in NAMED_PAINTS:
                values[name] = path.parent / values[name]
        return cls.of(**{**without_former(values), **overrides})

    def with_values(self, **settings: Any) -> Self:
        """Returns a checked copy with other values. Raises ConfigError."""
        replaced = {"brushes"} if "brush" in settings else set()
        kept = {name: getattr(self, name) for name in self.model_fields_set - replaced}
        return type(self).of(**{**kept, **settings})

    @property
    def as_kept(self) -> Self:
        """Description with exactly the values that are read again from its folder."""
        return type(self).of(**self.record(), goal=self.goal, initial=self.initial)

    def record(self) -> dict[str, Any]:
        """Returns the description as plain values, without the goal, which is kept beside it."""
        return self.model_dump(mode="json", exclude={"goal", "initial"})

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Reads a description from a painting's folder, if version 0.3 or newer wrote it. Raises ConfigError."""
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
        """Settings of the words."""
        return WordSettings(self.beginning, self.avoid)

    @property
    def names_brushes(self) -> bool:
        """True if the description names its brushes, instead of leaving them to the defaults."""
        return self.brushes is not None or self.strokes_of is not None

    @property
    def layer_brushes(self) -> str:
        """Named brushes, or the default ones, with a layer for each named family, in the form of --brushes."""
        if self.strokes_of is None:
            return self._own_brushes
        families, own = family_shares(self.strokes_of), brush_shares(self._own_brushes)
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
        if self.brushes is not None:
            return self.brushes
        if self.together and self.simulated and self.layers is None:
            return "medium"
        if self.layers is not None or not self.simulated or self.is_short or self.strokes < FEWEST_FOR_LAYERS:
            return "broad"
        if self.goal and not self.initial and all(item.kind == "text" for item in self.goal):
            return WORDS_BRUSHES
        hurried = self.minutes is not None and self.minutes < 6 * self.drying
        return FEWER_BRUSHES if self.strokes < _FEWEST_FOR_ALL or hurried else USUAL_BRUSHES

    @property
    def is_short(self) -> bool:
        """True if drying once would take more than a third of the robot's time."""
        return self.minutes is not None and self.minutes < 3 * self.drying

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
        return is_simulated(self.robot)

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
        return min(self.strokes, FILM_FRAMES) if self.film and not self.by_hand else 0


FILES = tuple(name for name, field in RunSpec.model_fields.items() if field.annotation == Path | None)
"""Settings that name files, other than those of the goal."""


def without_former(values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns settings without those of 0.3 that have the value at which they are fixed now."""
    return {name: value for name, value in values.items() if (name, value) not in FORMER.items()}


def upgrade_record(plain: Mapping[str, Any]) -> dict[str, Any]:
    """Returns plain values of a description in the current form. Raises ConfigError for another version."""
    version = plain.get("version")
    if type(version) is not int or version != VERSION:
        raise ConfigError(
            f"The settings are of version {version!r}, and this program reads version {VERSION}; use the program that "
            "the painting was begun with, or a newer one."
        )
    kept = without_former(plain)
    for name in kept.keys() & FORMER.keys():
        raise ConfigError(
            f"The settings say {name} = {str(plain[name])[:20]}, and it is always {FORMER[name]} now; use the program "
            "that the painting was begun with, or delete it there and plan anew."
        )
    return kept
