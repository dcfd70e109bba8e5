"""Names of the package; each is loaded at its first use."""

from frida_painter import plugins as plugins
from frida_painter.brush.kinds import StrokeModel as StrokeModel
from frida_painter.brush.library import StrokeLibrary as StrokeLibrary
from frida_painter.brush.weights import load_stroke_model as load_stroke_model
from frida_painter.errors import FridaError as FridaError
from frida_painter.hardware.robot import Camera as Camera
from frida_painter.hardware.robot import Robot as Robot
from frida_painter.objectives.objective import Objective as Objective
from frida_painter.planning.planner import Planner as Planner
from frida_painter.planning.settings import PlannerSettings as PlannerSettings
from frida_painter.render.exporter import export_plan as export_plan
from frida_painter.render.painting import render_batch as render_batch
from frida_painter.render.painting import render_plan as render_plan
from frida_painter.render.painting import render_strokes as render_strokes
from frida_painter.runs.goals import make_goal as make_goal
from frida_painter.runs.run import PaintingRun as PaintingRun
from frida_painter.runs.run import paint as paint
from frida_painter.runs.settle import make_planner as make_planner
from frida_painter.runs.spec import RunSpec as RunSpec
from frida_painter.session import events as events
from frida_painter.strokes.palette import Palette as Palette
from frida_painter.strokes.plan import Plan as Plan
from frida_painter.strokes.strokes import Strokes as Strokes
from frida_painter.system.images import load as load_picture
from frida_painter.system.images import save as save_picture
from frida_painter.virtual.studio import open_studio as open_virtual_studio
from frida_painter_lab.env import make_env as make_env
from frida_painter_lab.records import record as record
from frida_painter_lab.sweeps.runner import sweep as sweep

__all__ = ["load_picture", "open_virtual_studio", "save_picture"]  # whose names differ; "as" exports the others

__version__: str
