"""Everything that a package of your own parts needs, in one module: `from frida_painter.plugins import GoalKind`.

The names here are a promise. Versions are semantic: a name, or what it promises, changes only in a version that says
so in its notes, and what goes away still works, with a DeprecationWarning, for two minor versions. `check` tries the
parts of a package.

    >>> import frida_painter as fp
    >>> [finding.name for finding in fp.plugins.check("frida-painter", kinds=["exporters"])]
    ['svg', 'gcode', 'csv', 'png']

Each name is loaded at its first use, so that a part may import this module where it may not load PyTorch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from frida_painter.brush.kinds import BrushKind, BrushModel, FamilyPart, StrokeFunction, StrokeModel
    from frida_painter.canvas_size import CanvasSize
    from frida_painter.easel.kinds import EaselKind, OpenEasel
    from frida_painter.errors import (
        CameraError,
        ConfigError,
        FridaError,
        ImageError,
        Interrupted,
        MakingFailed,
        PluginError,
        RobotError,
    )
    from frida_painter.exporter import ExporterKind, ExportOptions
    from frida_painter.frames import MapFrame, PixelGrid
    from frida_painter.hardware.cameras.shutter import Shutter
    from frida_painter.hardware.easel import Easel, PersonStroke
    from frida_painter.hardware.interlock import Interlock
    from frida_painter.hardware.kinds import CameraKind, MachineName, Needed, RobotKind, require_home, yes_or_no
    from frida_painter.hardware.robot import (
        Camera,
        Frame,
        MotionReport,
        Point,
        Robot,
        Waypoints,
        Workspace,
    )
    from frida_painter.mixing import Finish
    from frida_painter.mixing.recipe import MixerKind
    from frida_painter.objectives.encoders.base import Encoder, PictureLibrary, Reader, Seer
    from frida_painter.objectives.objective import (
        Gives,
        Goal,
        GoalKind,
        Objective,
        ObjectiveContext,
        ObjectiveTerm,
        Term,
        require_weight,
    )
    from frida_painter.palette import Palette
    from frida_painter.picture_makers.making import PictureMaker, PictureMakerKind, PictureRequest
    from frida_painter.plan import Layer, Plan
    from frida_painter.planning.planner import PlannerKind, PlanningTask
    from frida_painter.plugins.conformance import PartFinding, check
    from frida_painter.session.events import Event, Notify
    from frida_painter.session.replan_policy import CanvasSeen, ReplanPolicy
    from frida_painter.strokes import StrokeLimits, Strokes
    from frida_painter.together.policies import TurnAnswer, TurnPolicy, TurnTaken
    from frida_painter.virtual.studio import ArmAndTable, StudioArm
    from frida_painter.virtual.tabletop import HandNoise, StudioLayout

_HOMES = {
    "brush.kinds": ("BrushKind", "BrushModel", "FamilyPart", "StrokeFunction", "StrokeModel"),
    "canvas_size": ("CanvasSize",),
    "easel.kinds": ("EaselKind", "OpenEasel"),
    "errors": (
        *("CameraError", "ConfigError", "FridaError", "ImageError", "Interrupted", "MakingFailed", "PluginError"),
        "RobotError",
    ),
    "exporter": ("ExportOptions", "ExporterKind"),
    "frames": ("MapFrame", "PixelGrid"),
    "hardware.cameras.shutter": ("Shutter",),
    "hardware.interlock": ("Interlock",),
    "hardware.easel": ("Easel", "PersonStroke"),
    "hardware.kinds": ("CameraKind", "MachineName", "Needed", "RobotKind", "require_home", "yes_or_no"),
    "hardware.robot": ("Camera", "Frame", "MotionReport", "Point", "Robot", "Waypoints", "Workspace"),
    "mixing": ("Finish",),
    "mixing.recipe": ("MixerKind",),
    "objectives.encoders.base": ("Encoder", "PictureLibrary", "Reader", "Seer"),
    "objectives.objective": (
        *("Gives", "Goal", "GoalKind", "Objective", "ObjectiveContext", "ObjectiveTerm", "Term", "require_weight"),
    ),
    "palette": ("Palette",),
    "picture_makers.making": ("PictureMaker", "PictureMakerKind", "PictureRequest"),
    "plan": ("Layer", "Plan"),
    "planning.planner": ("PlannerKind", "PlanningTask"),
    "plugins.conformance": ("PartFinding", "check"),
    "session.events": ("Event", "Notify"),
    "session.replan_policy": ("CanvasSeen", "ReplanPolicy"),
    "strokes": ("StrokeLimits", "Strokes"),
    "together.policies": ("TurnAnswer", "TurnPolicy", "TurnTaken"),
    "virtual.studio": ("ArmAndTable", "StudioArm"),
    "virtual.tabletop": ("HandNoise", "StudioLayout"),
}
"""Names by the module that they come from."""
_MODULES = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "ArmAndTable",
    "BrushKind",
    "BrushModel",
    "Camera",
    "CameraError",
    "CameraKind",
    "CanvasSeen",
    "CanvasSize",
    "ConfigError",
    "Easel",
    "EaselKind",
    "Encoder",
    "Event",
    "ExportOptions",
    "ExporterKind",
    "FamilyPart",
    "Finish",
    "Frame",
    "FridaError",
    "Gives",
    "Goal",
    "GoalKind",
    "HandNoise",
    "ImageError",
    "Interlock",
    "Interrupted",
    "Layer",
    "MachineName",
    "MakingFailed",
    "MapFrame",
    "MixerKind",
    "MotionReport",
    "Needed",
    "Notify",
    "Objective",
    "ObjectiveContext",
    "ObjectiveTerm",
    "OpenEasel",
    "Palette",
    "PartFinding",
    "PersonStroke",
    "PictureLibrary",
    "PictureMaker",
    "PictureMakerKind",
    "PictureRequest",
    "PixelGrid",
    "Plan",
    "PlannerKind",
    "PlanningTask",
    "PluginError",
    "Point",
    "Reader",
    "ReplanPolicy",
    "Robot",
    "RobotError",
    "RobotKind",
    "Seer",
    "Shutter",
    "StrokeFunction",
    "StrokeLimits",
    "StrokeModel",
    "Strokes",
    "StudioArm",
    "StudioLayout",
    "Term",
    "TurnAnswer",
    "TurnPolicy",
    "TurnTaken",
    "Waypoints",
    "Workspace",
    "check",
    "require_home",
    "require_weight",
    "yes_or_no",
]  # fmt: skip

if not TYPE_CHECKING:  # a type checker would take any name, and a typo, for one of the module

    def __getattr__(name: str) -> Any:
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it offers {', '.join(__all__)}")
        found = getattr(import_module(f"frida_painter.{_MODULES[name]}"), name)
        globals()[name] = found
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
