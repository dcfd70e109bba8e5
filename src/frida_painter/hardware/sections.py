"""The sections of a workspace file: which entries each has, and what each may be on its own."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from frida_painter.frames import LARGEST_CANVAS, SMALLEST_CANVAS
from frida_painter.hardware.limits import FASTEST
from frida_painter.palette import MOST_COLORS

MOST_BRUSHES = 16
"""In a rack."""
FARTHEST = 10.0
"""Metres: what is more is a slip of the unit."""

Metre = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]
Position = Annotated[tuple[Metre, Metre, Metre], Field(strict=False)]
Side = Annotated[float, Field(ge=SMALLEST_CANVAS, le=LARGEST_CANVAS, allow_inf_nan=False)]
Speed = Annotated[float, Field(gt=0, le=FASTEST, allow_inf_nan=False)]


class Section(BaseModel):
    """Entries that are all known, all of their kind, and never changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Bounds(Section):
    """The box that the tip never leaves."""

    lower: Position
    upper: Position


class CanvasPlace(Section):
    """Size and place of the canvas; turn in degrees."""

    width: Side
    height: Side
    corner: Position
    turn: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]


class BrushHeights(Section):
    """Robot z of the lightest touch and of the hardest press."""

    touch_height: Metre
    press_height: Metre


class PaintPlaces(Section):
    """Wells, water and rag."""

    wells: Annotated[tuple[Position, ...], Field(strict=False, min_length=1, max_length=MOST_COLORS)]
    water: Position
    rag: Position
    rag_width: Annotated[float, Field(ge=0.01, le=1, allow_inf_nan=False)]


class RackPlaces(Section):
    """Forks in which brushes stand, by the names of the brushes; left out where a person changes the brush."""

    places: Annotated[dict[str, Position], Field(min_length=1, max_length=MOST_BRUSHES)]
    slide: Annotated[tuple[Metre, Metre], Field(strict=False)]
    lift: Annotated[float, Field(ge=0.005, le=0.5, allow_inf_nan=False)]


class Travel(Section):
    """How high, how fast, and where to wait."""

    hover: Annotated[float, Field(ge=0.005, le=0.5, allow_inf_nan=False)]
    painting_speed: Speed
    travel_speed: Speed
    home: Position | None = None


class ArmReach(Section):
    """How far the arm gets around its shoulder; left out where it gets everywhere within the bounds."""

    shoulder: Position
    nearest: Annotated[float, Field(ge=0, le=FARTHEST, allow_inf_nan=False)]
    farthest: Annotated[float, Field(gt=0, le=FARTHEST, allow_inf_nan=False)]
