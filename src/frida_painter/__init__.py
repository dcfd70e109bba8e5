"""FRIDA painter: a robot that paints with people.

`import frida_painter as fp` offers the names below. Each name is loaded at its first use, so the import is
fast. docs/reference/python.md lists the other modules.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from frida_painter import plugins
    from frida_painter.brush.kinds import StrokeModel
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.brush.weights import load_stroke_model
    from frida_painter.errors import FridaError
    from frida_painter.exporter import export_plan
    from frida_painter.hardware.robot import Camera, Robot
    from frida_painter.images import load as load_picture
    from frida_painter.images import save as save_picture
    from frida_painter.objectives.objective import Objective
    from frida_painter.palette import Palette
    from frida_painter.plan import Plan
    from frida_painter.planning.planner import Planner
    from frida_painter.planning.settings import PlannerSettings
    from frida_painter.render.painting import render_batch, render_plan, render_strokes
    from frida_painter.runs.goals import make_goal
    from frida_painter.runs.run import PaintingRun, paint
    from frida_painter.runs.settle import make_planner
    from frida_painter.runs.spec import RunSpec
    from frida_painter.session import events
    from frida_painter.strokes import Strokes
    from frida_painter.virtual.studio import open_studio as open_virtual_studio
    from frida_painter_lab.env import make_env
    from frida_painter_lab.records import record
    from frida_painter_lab.sweeps.runner import sweep

    __version__: str


__all__ = [
    "Camera",
    "FridaError",
    "Objective",
    "PaintingRun",
    "Palette",
    "Plan",
    "Planner",
    "PlannerSettings",
    "Robot",
    "RunSpec",
    "StrokeLibrary",
    "StrokeModel",
    "Strokes",
    "events",
    "export_plan",
    "load_picture",
    "load_stroke_model",
    "make_env",
    "make_goal",
    "make_planner",
    "open_virtual_studio",
    "paint",
    "plugins",
    "record",
    "render_batch",
    "render_plan",
    "render_strokes",
    "save_picture",
    "sweep",
]

# Module and name inside it for each public name; "" for the module itself
_HOMES = {
    "Camera": ("frida_painter.hardware.robot", "Camera"),
    "FridaError": ("frida_painter.errors", "FridaError"),
    "Objective": ("frida_painter.objectives.objective", "Objective"),
    "PaintingRun": ("frida_painter.runs.run", "PaintingRun"),
    "Palette": ("frida_painter.palette", "Palette"),
    "Plan": ("frida_painter.plan", "Plan"),
    "Planner": ("frida_painter.planning.planner", "Planner"),
    "PlannerSettings": ("frida_painter.planning.settings", "PlannerSettings"),
    "Robot": ("frida_painter.hardware.robot", "Robot"),
    "RunSpec": ("frida_painter.runs.spec", "RunSpec"),
    "StrokeLibrary": ("frida_painter.brush.library", "StrokeLibrary"),
    "StrokeModel": ("frida_painter.brush.kinds", "StrokeModel"),
    "Strokes": ("frida_painter.strokes", "Strokes"),
    "events": ("frida_painter.session.events", ""),
    "export_plan": ("frida_painter.exporter", "export_plan"),
    "load_picture": ("frida_painter.images", "load"),
    "load_stroke_model": ("frida_painter.brush.weights", "load_stroke_model"),
    "make_env": ("frida_painter_lab.env", "make_env"),
    "make_goal": ("frida_painter.runs.goals", "make_goal"),
    "make_planner": ("frida_painter.runs.settle", "make_planner"),
    "open_virtual_studio": ("frida_painter.virtual.studio", "open_studio"),
    "paint": ("frida_painter.runs.run", "paint"),
    "plugins": ("frida_painter.plugins", ""),
    "record": ("frida_painter_lab.records", "record"),
    "render_batch": ("frida_painter.render.painting", "render_batch"),
    "render_plan": ("frida_painter.render.painting", "render_plan"),
    "render_strokes": ("frida_painter.render.painting", "render_strokes"),
    "save_picture": ("frida_painter.images", "save"),
    "sweep": ("frida_painter_lab.sweeps.runner", "sweep"),
}


if not TYPE_CHECKING:  # a type checker would take any name, and a typo, for one of the package

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            from importlib.metadata import version

            found = version("frida-painter")
        elif name in _HOMES:
            from frida_painter.python_process import prepare_forks

            module, inside = _HOMES[name]
            prepare_forks()
            home = import_module(module)
            found = getattr(home, inside) if inside else home
        else:
            from difflib import get_close_matches

            near = get_close_matches(name, __all__, 1)
            meant = f"did you mean {near[0]}? It" if near else "it"
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}; {meant} offers {', '.join(__all__)}")
        globals()[name] = found  # the next access does not come here
        return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
