"""The request for a painting from the page: goals with weights and settings, checked before planning begins."""

import json
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, model_validator

from frida_painter.canvas_size import CanvasSize
from frida_painter.objectives.kind import Gives, goal_kinds
from frida_painter.runs.fields import AUTO, Focus, Ground, brush_shares
from frida_painter.runs.spec import RunSpec

Identifier = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{32}$")]
Words = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=300)]
_CANVAS: CanvasSize = RunSpec.model_fields["canvas"].default
_LARGEST, _SMALLEST = 2000.0, 60.0  # mm


def _as_described(name: str) -> Any:
    """A field with the default and the limits that RunSpec has for it."""
    field = RunSpec.model_fields[name]
    bounds = {bound: getattr(part, bound) for part in field.metadata for bound in ("ge", "le") if hasattr(part, bound)}
    return Field(field.default, allow_inf_nan=False, **bounds)


def _known(kind: str) -> str:
    known = goal_kinds().by_name
    if kind not in known:
        raise ValueError(f"There is no such kind of goal; there are {', '.join(known)}.")
    return kind


Kind = Annotated[str, AfterValidator(_known)]


def _shares(text: str) -> str:
    if text:
        brush_shares(text)
    return text


_BRUSH = r"(fine|medium|broad)(:\d{1,3}%)?"
Brushes = Annotated[str, StringConstraints(pattern=rf"^({AUTO}|{_BRUSH}(,{_BRUSH}){{0,7}})?$"), AfterValidator(_shares)]


class _Checked(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class GoalRequest(_Checked):
    """One goal: words or the id of an uploaded picture, as its kind asks for; weight: how much it matters."""

    kind: Kind
    picture: Identifier | None = None
    words: Words | None = None
    weight: float = Field(1.0, ge=0.01, le=100, allow_inf_nan=False)

    @model_validator(mode="after")
    def _is_one_thing(self) -> Self:
        given, other = (self.words, self.picture) if self._is_of_words else (self.picture, self.words)
        if given is None or other is not None:
            raise ValueError("A goal is either words or a picture; say which words, or choose a picture.")
        if self.words is not None and not self.words.isprintable():
            raise ValueError("The words hold characters that cannot be printed; type them anew.")
        return self

    @property
    def _is_of_words(self) -> bool:
        return goal_kinds()[self.kind].gives is Gives.WORDS

    @property
    def toml(self) -> str:
        """The lines of a goal file's table for this term; pictures lie beside it under their id."""
        value = self.words if self._is_of_words else f"{self.picture}.png"
        return f"{self.kind} = {json.dumps(value, ensure_ascii=False)}\nweight = {self.weight}\n"


class PaintingRequest(_Checked):
    """A person's request for a painting: goals, initial items and settings of the run; width and height in mm."""

    title: Annotated[str, StringConstraints(strip_whitespace=True, max_length=80)] = ""
    terms: tuple[GoalRequest, ...] = Field(max_length=8)
    initial: tuple[GoalRequest, ...] = Field((), max_length=2)
    strokes: int = _as_described("strokes")
    colors: int = _as_described("colors")
    width: float = Field(_CANVAS.width * 1000, ge=_SMALLEST, le=_LARGEST, allow_inf_nan=False)
    height: float = Field(_CANVAS.height * 1000, ge=_SMALLEST, le=_LARGEST, allow_inf_nan=False)
    brushes: Brushes = ""
    """Of the layers; "" for the usual ones."""
    replans: int = _as_described("replans")
    ground: Ground = None
    """None for the usual one."""
    on_canvas: bool = False
    focus: Focus = RunSpec.model_fields["focus"].default
    sharpness: float = _as_described("sharpness")
    drying: float = _as_described("drying")
    minutes: float | None = _as_described("minutes")
    effort: float = _as_described("effort")
    seed: int = _as_described("seed")

    @model_validator(mode="before")
    @classmethod
    def _renewed(cls, given: Any) -> Any:
        """As requests were kept that knew of one brush only."""
        if not isinstance(given, dict) or "brush" not in given:
            return given
        known = {name: value for name, value in given.items() if name != "brush"}
        return {"brushes": given["brush"], **known}

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        if not self.terms:
            raise ValueError("There is nothing to paint yet: give a picture, or words, or draw something.")
        if not self.title.isprintable():
            raise ValueError("The title holds characters that cannot be printed; type it anew.")
        if self.on_canvas and self.ground not in (None, "white"):
            raise ValueError("A canvas that is painted on as it is cannot be toned; choose one of them.")
        if not 1 / 4 <= self.width / self.height <= 4:
            raise ValueError("The canvas is too narrow: its longer side is at most four times the shorter one.")
        return self

    @property
    def pictures(self) -> frozenset[str]:
        """The ids of the pictures that are needed."""
        return frozenset(term.picture for term in (*self.terms, *self.initial) if term.picture is not None)

    @property
    def toml(self) -> str:
        """The goal file (TOML) that says the same to the command line."""
        goals = [f"[[goal]]\n{term.toml}" for term in self.terms]
        return "\n".join(goals + [f"[[initial]]\n{term.toml}" for term in self.initial])
