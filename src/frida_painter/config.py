"""What a person may set about a painting: from the command line, or from a TOML file; all faults named at once."""

import tomllib
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, ValidationError, model_validator
from pydantic.fields import FieldInfo

from frida_painter import storage
from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize

_MOST_BYTES = 2**20


def _canvas(value: Any) -> CanvasSize:
    if isinstance(value, CanvasSize):
        return value
    try:
        return CanvasSize.parse(str(value))
    except ConfigError as error:
        raise ValueError(str(error)) from error


Canvas = Annotated[
    CanvasSize,
    BeforeValidator(_canvas),
    PlainSerializer(lambda size: f"{size.width * 1000:g}x{size.height * 1000:g}mm"),
]


class PaintingSettings(BaseModel):
    """How one picture is to be painted. Raises ConfigError through `of` and `from_toml`.

    strokes: exactly how many are painted; colors: how many paints are mixed; canvas: its size;
    brush: name of a brush, or a file of learned weights; render_height: rows of the picture in
    which is planned; replans: how often the painter looks and plans the rest again; effort: 1 is
    the default amount of planning, 2 twice as much; seed: of every random choice; clip: a CLIP to see
    words and meaning through, a folder, a name on the hub, or a file; None: what was fetched.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True)

    strokes: int = Field(300, ge=1, le=20_000)
    colors: int = Field(12, ge=1, le=24)
    canvas: Canvas = CanvasSize(14 * 0.0254, 11 * 0.0254)
    brush: str = Field("broad", min_length=1)
    render_height: int = Field(256, ge=64, le=2048)
    replans: int = Field(4, ge=0)
    effort: float = Field(1.0, ge=0.05, le=20, allow_inf_nan=False)
    seed: int = Field(0, ge=0, le=2**31 - 1)
    clip: str | None = Field(None, min_length=1)

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        given = self.model_fields_set
        if "colors" in given and self.colors > self.strokes:
            raise ValueError(f"{self.colors} colors for {self.strokes} strokes; give at most as many colors as strokes")
        if "replans" in given and self.replans >= self.strokes:
            raise ValueError(
                f"{self.replans} replans for {self.strokes} strokes; "
                f"there is a look between strokes only, so give at most {self.strokes - 1}"
            )
        return self

    @classmethod
    def of(cls, **values: Any) -> Self:
        """Checked settings; of few strokes, as few colors and replans as fit where none were asked for.

        Raises ConfigError naming every fault.
        """
        try:
            chosen = cls(**values)
        except ValidationError as error:
            raise ConfigError("; ".join(_sentence(fault) for fault in error.errors()) + ".") from error
        fitting = {"colors": min(chosen.colors, chosen.strokes), "replans": min(chosen.replans, chosen.strokes - 1)}
        return chosen.model_copy(update={name: value for name, value in fitting.items() if name not in values})

    @classmethod
    def from_toml(cls, path: Path, **overrides: Any) -> Self:
        """Settings from a TOML file, with `overrides` on top. Raises ConfigError."""
        content = storage.read_bytes(path, "a settings file (TOML)", _MOST_BYTES, ConfigError)
        try:
            values = tomllib.loads(content.decode("utf-8-sig"))
        except (ValueError, RecursionError) as error:
            raise ConfigError(f"{path} is not TOML ({error}); write lines such as: strokes = 300") from error
        return cls.of(**{**values, **overrides})


def _sentence(fault: Any) -> str:
    """One fault of pydantic's in the words of the command line."""
    message = fault["msg"].removeprefix("Value error, ").removesuffix(".")
    if not fault["loc"]:
        return message
    field = str(fault["loc"][0])
    if fault["type"] == "extra_forbidden":
        known = ", ".join(sorted(PaintingSettings.model_fields))
        return f"{field[:40]!r} is not a setting; there are {known}"
    name = f"--{field.replace('_', '-')}"
    if fault["type"] == "value_error":
        return f"{name}: {message}"
    return f"{name} was given {_shortly(fault['input'])}; it is {_allowed(PaintingSettings.model_fields[field])}"


def _allowed(field: FieldInfo) -> str:
    """The values that a setting may have, in words."""
    bounds = {name: getattr(part, name) for part in field.metadata for name in ("ge", "le") if hasattr(part, name)}
    if not bounds:
        return "a name or a path"
    kind = "a whole number" if field.annotation is int else "a number"
    if "le" not in bounds:
        return f"{kind} of at least {bounds['ge']}"
    return f"{kind} from {bounds['ge']} to {bounds['le']}"


def _shortly(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
