"""RunSpec: the full description of a painting, with the settings of goal, machine and painting.

Those of canvas, paints and strokes are the planner's (planning/settings.py). This module loads no tensors.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import astuple, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, Unpack

from pydantic import AfterValidator

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import HUMAN, NO_CAMERA, SAWYER_SIM, VIRTUAL, is_simulated
from frida_painter.errors import ConfigError, ImageError
from frida_painter.objectives import USUAL_FREEDOM
from frida_painter.objectives.word_settings import USUAL, Beginning, WordSettings
from frida_painter.planning.fields import AUTO, NAMED_PAINTS, OF_SCENE, File, parse_field, rgb
from frida_painter.planning.form_control import TENTHS, Control
from frida_painter.planning.settings import (
    FEWEST_FOR_LAYERS,
    CanvasSettings,
    PlannerSettings,
    PlanSettings,
    SettingSection,
    setting,
)
from frida_painter.runs.goal_item import InitialItems, Items
from frida_painter.session.replan_policy import parse_replan_policy
from frida_painter.strokes.palette_file import is_palette_file, read_colors
from frida_painter.system import storage

if TYPE_CHECKING:
    from frida_painter.runs.setting_types import Settings

_FURTHEST, _MAX_TURNED = 0.05, 15.0  # metres and degrees


def millimetres_and_degrees(text: str | None) -> tuple[float, float, float] | None:
    """Parses a placement error: "4mm,2deg" is right and turn, "3mm,-2mm,1deg" is right, up and turn.

    The turn is counter-clockwise. Returns metres right, metres up and radians; None for None.
    Raises ConfigError.
    """
    if text is None:
        return None
    number = r"\s*([+-]?(?:\d+(?:\.\d+)?|\.\d+))\s*"
    match = re.fullmatch(rf"{number}mm\s*(?:,{number}mm\s*)?,{number}deg\s*", str(text).lower())
    if match is None:
        raise ConfigError(
            f"--placement-error was given {str(text)[:40]!r}; it is millimetres to the right, millimetres up and "
            "degrees, like 4mm,2deg or 3mm,-2mm,1.5deg."
        )
    x, y, turn = float(match[1]) / 1000, float(match[2] or 0) / 1000, float(match[3])
    if not (math.hypot(x, y) <= _FURTHEST and abs(turn) <= _MAX_TURNED):
        raise ConfigError(
            f"--placement-error was given {text[:40]!r}; at most {_FURTHEST * 1000:g} mm and {_MAX_TURNED:g} degrees "
            "can be corrected."
        )
    return x, y, math.radians(turn)


def _allow(parse: Callable[[str], object], text: str | None) -> str | None:
    """Returns the text as it is, if it can be parsed."""
    if text is not None:
        parse_field(parse, text)
    return text


Policy = Annotated[str | None, AfterValidator(partial(_allow, parse_replan_policy))]
Placement = Annotated[str | None, AfterValidator(partial(_allow, millimetres_and_degrees))]


class GoalSettings(SettingSection):
    """Goal of a painting, and the way from words to a picture."""

    panel: ClassVar[str] = "What to paint"

    goal: Items = setting(())
    """Goals: a list of things to paint, each with its kind and weight."""
    initial: InitialItems = setting((), form=Control("Start from another picture or text", widget="goals"))
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
    freedom: float = setting(
        USUAL_FREEDOM, ge=0, le=1,
        form=Control("Freedom of colours", TENTHS, {0: "faithful", 0.4: "bold", 0.7: "wild"}, beside="semantic"),
    )  # fmt: skip
    """Freedom of the colours of a painting by content (--semantic) from those of the picture: 0 is faithful, 1 is
    wild."""


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
    refill: float | None = setting(
        None, value="MM", usual="as the brush's stroke library shows, else 4 strokes", ge=5, le=10_000
    )
    """Millimetres that one dip paints with the whole width of a brush; lighter strokes go on longer."""
    placement_error: Placement = setting(None, value="X,Y,TURN", usual="about 2mm and 0.4deg, by the seed")
    """Calibration error of the virtual studio: the offset and rotation between its canvas and where its robot
    expects the canvas, like 4mm,2deg or 3mm,-2mm,1.5deg."""
    pace: float = setting(0.0, ge=0, le=100)
    """Seconds that a second of the virtual robot takes. 1 is real time, 0.1 ten times as fast, 0 as fast as
    possible."""
    on_canvas: bool = setting(False, form=Control())
    """Begin on the canvas as it is: a toned ground, an old painting, or what you have painted. The light is known
    from the canvas calibration, which saw a bare canvas."""
    studio_canvas: File = setting(None, value="FILE", usual="a bare canvas")
    """A picture of the canvas of the virtual studio at first."""


class PaintingSettings(SettingSection):
    """The course of the painting, and what is kept of it."""

    panel: ClassVar[str] = "While it paints"

    title: str = setting("", max_length=80)
    """Title of the painting on its page."""
    together: bool = setting(False, form=Control())
    """Paint without a goal: you begin, and the robot answers each of your turns in the spirit of your strokes, with
    at most --strokes in all."""
    minutes: float | None = setting(
        None, usual="as many as it takes", common=True, ge=1, le=10_000,
        form=Control(
            "Robot's time", (None, 10, 15, 20, 30, 45, 60, 90, 120, 180, 240),
            {None: "as long as it takes", 0: "at most {:g} minutes"}, needs="robot",
        ),
    )  # fmt: skip
    """Minutes that the robot may take, with dips, looks, film and drying. The strokes that would be missed least are
    left out until the painting fits."""
    replans: int = setting(
        4, ge=0,
        form=Control(
            "Replans", range(13), {0: "none", 1: "once it looks and replans", 2: "{:g} times it looks and replans"},
            needs="camera",
        ),
    )  # fmt: skip
    """Number of looks at the canvas, each with a replan of the rest: after the first ten strokes, which tell where the
    robot paints, then evenly spaced, and where a layer begins."""
    replan_policy: Policy = setting(
        None, value="NAME:VALUE", usual="evenly spaced, --replans times", adds=(registry.REPLAN_POLICIES,), min_length=1
    )
    """Rule for replans, instead of --replans. every:75 replans after every 75 strokes. when-off-by:0.02 looks after
    every 10 strokes and replans only if the canvas differs more than that from the expected one. when-it-pays looks
    as often as replanning improves the plan by 0.05 dB. Your own packages can add policies."""
    drying: float = setting(
        20.0, value="MINUTES", ge=0, le=1440,
        form=Control("Drying", range(5, 61), {0: "{:g} minutes between two layers"}, needs="real paint"),
    )  # fmt: skip
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
_DARKEST_OF_STUDIO = "#121212"  # its soot reflects 0.6 % of the light
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


class RunSpec(PaintingSettings, MachineSettings, PlannerSettings, GoalSettings):
    """Description of a painting. `of`, `from_toml` and `read` raise ConfigError, which names all faults at once.

    Its fields are the settings of its sections; `docs/reference/settings.md` lists them.

        >>> import frida_painter as fp
        >>> spec = fp.RunSpec.of(goal=[{"image": "photo.jpg"}], strokes=50, canvas="A4")
        >>> spec.strokes, str(spec.canvas), spec.seed
        (50, '210 x 297 mm', 0)
    """

    version: Literal[1] = setting(1)
    """Version of these settings in a file."""

    def _misfits(self) -> Iterator[str]:
        """Yields a sentence for each setting that another one rules out."""
        given = self.model_fields_set
        kinds = {item.kind for item in (*self.goal, *self.initial)}
        if kinds and "text" not in kinds and self.words != USUAL:
            said = zip(fields(WordSettings), astuple(self.words), astuple(USUAL), strict=True)
            option = next(field.name for field, mine, usual in said if mine != usual)
            yield f"--{option} is for words, and the goal has none; leave it out, or give --text"
        if self.together:
            yield from self._misfits_together()
        yield from super()._misfits()
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
        dryings = (self.wanted_layers or 1) - 1
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
        names = ("camera", "workspace") if self.simulated else ("pace", "placement_error", "studio_canvas")
        given = [name for name in names if getattr(self, name) and (name != "camera" or self.has_camera)]
        named = [f"--{name.replace('_', '-')}" for name in given]
        if named:
            whose, is_a = ("real", "simulated") if self.simulated else ("simulated", "real")
            verb, them = ("is", "it") if len(named) == 1 else ("are", "them")
            raise ConfigError(
                f"{' and '.join(named)} {verb} for {whose} robots, and --robot {self.robot[:60]} is a {is_a} one; "
                f"leave {them} out, or name another robot."
            )

    @classmethod
    def of(cls, **settings: "Unpack[Settings]") -> Self:  # type: ignore[override]
        """Returns a checked description, with defaults that fit the given values.

        These defaults are the canvas of the workspace file, and the number of colours of the palette file. A plan
        with few strokes gets fewer colours and replans. `brush` is another word for `brushes`.
        Raises ConfigError.
        """
        if "brush" in settings:
            if "brushes" in settings:
                raise ConfigError("A brush was given, and brushes as well; give --brushes alone.")
            settings["brushes"] = settings.pop("brush")
        chosen = super().of(**settings)
        for name, value in settings.items():
            fault = storage.path_fault(value) if isinstance(value, str | Path) and name != "avoid" else ""
            if fault:
                raise ConfigError(f"{name} was given {str(value)[:40]!r}, which can be no name and no path ({fault}).")
        if chosen.palette is not None and "colors" not in settings:
            settings["colors"] = paints_of(chosen.palette)
            return cls.of(**settings)
        fitting: dict[str, Any] = {
            "colors": min(chosen.colors, chosen.strokes),
            "replans": min(chosen.replans, chosen.strokes - 1) if chosen.has_camera else 0,
        }
        if chosen.workspace is not None and not chosen.simulated and "canvas" not in settings:
            from frida_painter.hardware.workcell import WorkcellConfig  # loads tensors

            size = WorkcellConfig.load(chosen.workspace).canvas
            fitting["canvas"] = CanvasSize.parse(f"{size.width * 1000:.3f}x{size.height * 1000:.3f}mm")
        fitting = {name: fits for name, fits in fitting.items() if name not in settings}
        return chosen.model_copy(update={name: fits for name, fits in fitting.items() if fits != getattr(chosen, name)})

    @classmethod
    def from_toml(cls, path: str | Path, **overrides: "Unpack[Settings]") -> Self:
        """Reads a description from TOML, or from JSON of the studio, with `overrides`; file names are relative to it.

        Raises ConfigError.
        """
        path = Path(path)
        example = "write lines such as: strokes = 300"
        if path.suffix.lower() == ".json":
            values = storage.read_json(path, f"settings of the studio (your own are TOML: {example})", ConfigError)
        else:
            values = storage.read_toml(path, "a settings file (TOML)", _MAX_SPEC_BYTES, example)
        for name in (*FILES, "paints"):
            if isinstance(values.get(name), str) and values[name] not in NAMED_PAINTS:
                values[name] = path.parent / values[name]
        return cls.of(**{**without_former(values), **overrides})

    def with_values(self, **settings: "Unpack[Settings]") -> Self:
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
    def usual_brushes(self) -> str:
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
    def wanted_layers(self) -> int | None:
        """Number of layers, as for a planner; one if paint would dry too long, or if a person paints along."""
        return super().wanted_layers or (1 if self.is_short or self.together else None)

    @property
    def wanted_ground(self) -> str:
        """Named ground, or the default one.

        The default is white. If a simulated operator tones, it is AUTO for pictures and their content of 100 strokes
        or more, and OF_SCENE for words without a picture and for styles. A planner chooses the colour for these.
        """
        if self.ground is not None or not self.simulated or self.studio_canvas is not None or self.on_canvas:
            return super().wanted_ground
        kinds = {item.kind for item in self.goal}
        composed = "text" in kinds and not self.initial and kinds <= {"text", "sketch", "style"}
        if composed or "style" in kinds:
            return OF_SCENE
        pictured = not self.initial and not kinds.isdisjoint(("image", "semantic"))
        return AUTO if pictured and self.strokes >= FEWEST_FOR_LAYERS else "white"

    @property
    def darkest_paint(self) -> tuple[float, float, float] | None:
        """sRGB of the darkest available paint: the named one, that of the virtual studio, or None if unknown."""
        return super().darkest_paint or (rgb(_DARKEST_OF_STUDIO) if self.simulated else None)

    @property
    def is_short(self) -> bool:
        """True if drying once would take more than a third of the robot's time."""
        return self.minutes is not None and self.minutes < 3 * self.drying

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


def paints_of(palette: Path) -> int:
    """Returns the number of paints in a palette file or picture.

    Raises ConfigError for a photograph of any other thing.
    """
    if is_palette_file(palette):
        return len(read_colors(palette))
    from frida_painter.perception.color import read_palette  # loads tensors

    try:
        return len(read_palette(palette, None))
    except ImageError as error:
        raise ConfigError(str(error)) from error


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
