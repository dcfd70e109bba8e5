"""Settings of a painting by name, in the forms that Python takes; `make reference` writes this file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict

from frida_painter.canvas_size import CanvasSize
from frida_painter.runs.goal_item import GoalItem

class Settings(TypedDict, total=False):
    goal: Sequence[GoalItem | Mapping[str, Any]]
    initial: Sequence[GoalItem | Mapping[str, Any]]
    clip: str | None
    pictures: str | Path | None
    beginning: Literal["auto", "scene", "colors", "nothing"]
    avoid: str
    freedom: float
    canvas: str | CanvasSize
    fit: Literal["canvas", "crop", "pad"]
    ground: str | Sequence[float] | None
    colors: int
    new_paints: bool | None
    paints: str | Path
    darkest: str | Sequence[float] | None
    palette: str | Path | None
    strokes: int
    brushes: str | Path | Sequence[str | Path] | None
    strokes_of: str | Path | Sequence[str | Path] | None
    layers: int | None
    focus: str | Sequence[str]
    form: float
    render_height: int
    effort: float
    planner: str
    seed: int
    robot: str
    camera: str
    workspace: str | Path | None
    calibration: str | Path | None
    refill: float | None
    placement_error: str | None
    pace: float
    on_canvas: bool
    studio_canvas: str | Path | None
    title: str
    together: bool
    minutes: float | None
    replans: int
    replan_policy: str | None
    drying: float
    film: bool
    version: Literal[1]
    brush: str | Path | Sequence[str | Path] | None
