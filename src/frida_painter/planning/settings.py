"""Settings of the planner, and how a setting is spelled: once, with its limits, default and help.

RunSpec adds the settings of goal, machine and painting. Command line, page, TOML files, sweeps, records, notebooks and
the reference are made from these fields. This module loads no tensors.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.planning.fields import (
    FACES,
    MAX_LAYERS,
    Brushes,
    Canvas,
    DarkestPaint,
    Families,
    File,
    Focus,
    Ground,
    PaintsInUse,
    brush_shares,
    family_shares,
    limits_of,
    rgb,
)
from frida_painter.planning.form_control import TENTHS, Control
from frida_painter.system.storage import count_of


def setting(
    default: Any,
    *,
    value: str = "",
    usual: str = "",
    of: tuple[str, ...] = (),
    adds: tuple[str, ...] = (),
    common: bool = False,
    form: Control | None = None,
    **limits: Any,
) -> Any:
    """Returns a field of a section; the docstring below it is its help.

    value: word for its value in the help. "": one by its type.
    usual: the default in words. "": the default itself.
    of: groups of parts that it is one of; the help lists them all.
    adds: groups to which other packages may add; the help lists what they add.
    common: True if the short help shows it.
    form: how a form asks for it. None: no form does.
    limits: as in pydantic's Field.
    """
    more: dict[str, Any] = {"value": value, "usual": usual, "of": of, "adds": adds, "common": common}
    return Field(default, json_schema_extra=more | {"form": form}, **limits)


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


def sentence_on(fault: Any, fields: Mapping[str, FieldInfo]) -> str:
    """Returns a fault of pydantic in the words of the command line."""
    message = fault["msg"].removeprefix("Value error, ").removesuffix(".")
    if not fault["loc"]:
        return message
    name = str(fault["loc"][0])
    if fault["type"] == "extra_forbidden":
        near = get_close_matches(name, fields, 3)
        known = f"near it is {' or '.join(near)}" if near else "there are " + ", ".join(sorted({*fields} - {"version"}))
        return f"{name[:40]!r} is not a setting; {known}"
    option = f"--{name.replace('_', '-')}"
    if fault["type"] == "value_error":
        return message if name in ("goal", "initial") or message.startswith(option) else f"{option}: {message}"
    if name not in fields or len(fault["loc"]) > 1:
        return f"{option}: {message}"
    given = repr(fault["input"])
    given = given if len(given) <= 40 else f"{given[:37]}..."
    return f"{option} was given {given}; it is {_list_allowed(fields[name])}"


def _list_allowed(field: FieldInfo) -> str:
    """Returns the allowed values of a setting, in words."""
    bounds = limits_of(field)
    if "Literal" in str(field.annotation):
        return f"one of {', '.join(map(str, getattr(field.annotation, '__args__', ())))}"
    if not bounds:
        return "true or false" if field.annotation in (bool, bool | None) else "a name or a path"
    kind = "a number" if field.annotation in (float, float | None) else "a whole number"
    return f"{kind} from {bounds['ge']} to {bounds['le']}" if "le" in bounds else f"{kind} of at least {bounds['ge']}"


class SettingSection(BaseModel):
    """Some settings of a painting, with a panel of their own in the help."""

    model_config = ConfigDict(
        defer_build=True,
        extra="forbid",
        frozen=True,
        strict=True,
        arbitrary_types_allowed=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
    )
    panel: ClassVar[str] = ""

    @classmethod
    def of(cls, **settings: Any) -> Self:
        """Returns the settings with these values. Raises ConfigError, which names all faults at once."""
        try:
            return cls(**settings)
        except ValidationError as error:
            faults = [sentence_on(fault, cls.model_fields) for fault in error.errors()]
            raise ConfigError(f"{'; '.join(faults)}.") from error


class CanvasSettings(SettingSection):
    """The canvas and its paints."""

    panel: ClassVar[str] = "Canvas and paints"

    canvas: Canvas = setting(
        CanvasSize(14 * 0.0254, 11 * 0.0254),
        value="SIZE",
        usual="14x11in",
        common=True,
        form=Control("Canvas", widget="canvas"),
    )
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
        form=Control("Canvas at the start", widget="ground"),
    )
    """Colour of the ground. A person tones the bare canvas with it before the painting begins; the recipe is told, and
    the camera looks before anything is planned. auto takes the colour that suits the picture."""
    colors: int = setting(12, common=True, form=Control("Paints to mix", range(1, 25)), ge=1, le=24)
    """Number of paints to mix."""
    new_paints: bool | None = setting(None, usual="new paints")
    """Mix new paints for each layer, --colors of them, or keep those of the first. With --palette they are kept."""
    paints: PaintsInUse = setting(
        "acrylics", value="acrylics|any|FILE", min_length=1,
        form=Control("Colours", options={
            "acrylics": ("that acrylics mix", "A colour that six common acrylics cannot give becomes the nearest one"),
            "any": ("any", "For pens, screens and paints that are not mixed"),
        }),
    )  # fmt: skip
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

    panel: ClassVar[str] = "Strokes and brushes"

    strokes: int = setting(
        300, common=True, ge=1, le=20_000,
        form=Control("Strokes", (15, 30, 50, 80, 120, 160, 200, 250, 300, 400, 500, 650, 800, 1000)),
    )  # fmt: skip
    """Number of brush strokes. Exactly this number is painted, unless --minutes has fewer."""
    brushes: Brushes = setting(
        None,
        value="NAME,...",
        usual="in the studio, for a picture, broad:30%,medium:35%,fine:35% from 200 strokes on and broad:50%,medium:50%"
        " from 100 on; for a drawing, fine; for words alone, from 100 on, broad:50%,fine:50%; otherwise broad",
        adds=(registry.STROKE_MODELS,),
        common=True,
        form=Control("Brush", widget="brushes"),
        min_length=1,
    )
    """The brush: fine, medium or broad, or a file of stroke model weights that you trained. Several paint a layer
    each, like broad,medium, with shares of the strokes like broad:60%,medium:40%."""
    strokes_of: Families = setting(
        None, value="FAMILY,...", usual="strokes of the brushes alone", adds=(registry.STROKE_FAMILIES,), min_length=1,
        form=Control("Shape of the marks", widget="families"),
    )  # fmt: skip
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
    focus: Focus = setting(FACES, value="faces|none|X,Y,R", form=Control("Most careful with", widget="words"))
    """Part of a picture that matters most. faces: faces, if there are any; none: every place is worth the same; X,Y,R:
    a place, such as the head of an animal, with shares of the picture's width from the left, of its height from the
    top, and of its shorter side as the radius. May be repeated."""
    form: float = setting(
        1.0, form=Control("Follow the form", TENTHS, {0: "{:g}, none", 0.1: "{:g}", 1: "{:g}, all"}),
        ge=0, le=1,
    )  # fmt: skip
    """Share of strokes that follow the form of a photograph: its edges, hair and grain. 0 is none, 1 is all."""
    render_height: int = setting(256, ge=64, le=2048)
    """Height of the planning image in pixels. Higher is finer and slower."""
    effort: float = setting(1.0, form=Control(), ge=0.05, le=20)
    """Planning effort. 2 plans twice as long, 0.5 half as long; a CLIP looks more, or less."""
    planner: str = setting("layers", value="NAME", adds=(registry.PLANNERS,), min_length=1)
    """Way to make the plan. Your own packages can add planners."""
    seed: int = setting(0, common=True, form=Control("Seed"), ge=0, le=2**31 - 1)
    """Random seed. The same seed gives the same painting, another seed a different one."""


class PlannerSettings(PlanSettings, CanvasSettings):
    """Settings that a planner takes of those of a painting: canvas, paints and strokes.

    A RunSpec is one, and chooses what is left open by the goal and the machine as well.

        >>> import frida_painter as fp
        >>> settings = fp.PlannerSettings.of(canvas="A5", brushes="broad", strokes=50)
        >>> settings.strokes, settings.colors
        (50, 12)
    """

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        for fault in self._misfits():
            raise ValueError(fault)
        return self

    def _misfits(self) -> Iterator[str]:
        """Yields a sentence for each setting that another one rules out."""
        strokes, layers = count_of(self.strokes, "stroke"), self.layers or 1
        if "colors" in self.model_fields_set and self.colors > self.strokes:
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

    @property
    def names_brushes(self) -> bool:
        """True if the description names its brushes, instead of leaving them to the defaults."""
        return self.brushes is not None or self.strokes_of is not None

    @property
    def layer_brushes(self) -> str:
        """Named brushes, or the default ones, with a layer for each named family, in the form of --brushes."""
        if self.strokes_of is None:
            return self.usual_brushes
        families, own = family_shares(self.strokes_of), brush_shares(self.usual_brushes)
        left = 1 - sum(share for _, share in families)
        shares = [share for _, share in own]
        usual = (1.0,) if len(own) == 1 else (0.6, *[0.4 / (len(own) - 1)] * (len(own) - 1))
        given = [usual[number] if share is None else share for number, share in enumerate(shares)]
        last = own[-1][0]
        layers = [(name, left * share / sum(given)) for (name, _), share in zip(own, given, strict=True) if left > 1e-9]
        layers += [(f"{last}+{name}", share) for name, share in families]
        return ",".join(f"{name}:{100 * share:.6f}%" for name, share in layers)

    @property
    def usual_brushes(self) -> str:
        """Named brushes, or the default ones."""
        return self.brushes or "broad"

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
    def wanted_layers(self) -> int | None:
        """Number of layers, if it is known before the number of strokes: one for each named brush, or the named one."""
        return len(self.brush_names) if self.names_brushes and len(self.brush_names) > 1 else self.layers

    @property
    def mixes_anew(self) -> bool:
        """True if each layer has a palette of its own."""
        return self.new_paints is not False and self.palette is None

    @property
    def wanted_ground(self) -> str:
        """Named ground, or white."""
        return self.ground or "white"

    @property
    def darkest_paint(self) -> tuple[float, float, float] | None:
        """sRGB of the darkest available paint; None if it is unknown."""
        return None if self.darkest is None else rgb(self.darkest)


# Layers: later strokes go on the dry paint of earlier ones, and start light again, as painters work.
#
# The strokes of later layers are a reserve. When a later layer begins, the replan moves its strokes to the places
# where the seen canvas differs most from the goal. There, light paint may cover dark paint.

LAYERS = 2
"""Default number of layers of a plan towards a picture."""
FEWEST_FOR_LAYERS = 100  # strokes
RESERVE = 0.4
"""Default share of the strokes that later layers get together."""


def usual_layers(strokes: int, brushes: int) -> int:
    """Default number of layers of a plan with this many strokes towards a picture."""
    return max(LAYERS, brushes) if strokes >= FEWEST_FOR_LAYERS else 1


def usual_shares(layers: int) -> tuple[float, ...]:
    """Returns the default share of the strokes for each layer."""
    if layers <= 1:
        return (1.0,) * layers
    return (1 - RESERVE, *([RESERVE / (layers - 1)] * (layers - 1)))


def layer_sizes(strokes: int, shares: Sequence[float]) -> tuple[int, ...]:
    """Returns the number of strokes of each layer, by its share. Raises ConfigError if a layer gets no stroke."""
    if not 1 <= len(shares) <= strokes:
        raise ConfigError(f"{len(shares)} layers for {strokes} strokes were asked for; give from 1 layer to {strokes}.")
    total = sum(shares)
    later = max(len(shares) - 1, round(strokes * (total - shares[0]) / total)) if len(shares) > 1 else 0
    later = min(later, strokes - 1)
    rest = list(itertools.accumulate(shares[1:]))
    ends = [int(later * end / rest[-1] + 1e-9) for end in rest]
    sizes = [end - before for before, end in itertools.pairwise([0, *ends])]
    if 0 in sizes:
        number = sizes.index(0) + 1
        raise ConfigError(
            f"Layer {number + 1} gets {shares[number] / total:.1%} of {strokes} strokes, which is not one stroke; give "
            "it a larger share, or leave its brush out."
        )
    return (strokes - later, *sizes)
