"""Types of a description's settings as keyword arguments, so that an editor and a type checker see a typo.

A test compares them with the fields of RunSpec. This module loads no PyTorch at run time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict

from frida_painter.canvas_size import AnyCanvas

if TYPE_CHECKING:
    from frida_painter.palette import AnyColor
    from frida_painter.runs.goal_item import GoalItem


class RunSettings(TypedDict, total=False):
    """Settings of a painting, as `paint`, `make_planner` and `RunSpec.of` take them; see RunSpec for each."""

    version: Literal[1]
    title: str
    goal: Sequence[GoalItem | Mapping[str, Any]]
    initial: Sequence[GoalItem | Mapping[str, Any]]
    together: bool
    strokes: int
    minutes: float | None
    layers: int | None
    colors: int
    canvas: AnyCanvas
    fit: Literal["canvas", "crop", "pad"]
    brush: str | Path | Sequence[str | Path] | None
    brushes: str | Path | Sequence[str | Path] | None
    strokes_of: str | Path | Sequence[str | Path] | None
    new_paints: bool | None
    render_height: int
    replans: int
    replan_policy: str | None
    ground: AnyColor | None
    darkest: AnyColor | None
    paints: str | Path
    focus: Literal["faces", "subject", "none"]
    sharpness: float
    freedom: float
    drying: float
    effort: float
    planner: str
    initialiser: str
    listener: str | None
    seed: int
    clip: str | None
    beginning: Literal["auto", "scene", "colors", "nothing"]
    avoid: str
    phrases: str
    guide: str | None
    pictures: str | Path | None
    palette: str | Path | None
    film: bool
    timelapse_frames: int
    robot: str
    camera: str
    workspace: str | Path | None
    calibration: str | Path | None
    placement_error: str | None
    pace: float
    arm_meshes: str | Path | None
    on_canvas: bool
    studio_canvas: str | Path | None
