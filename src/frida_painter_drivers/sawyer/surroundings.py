"""The surroundings of the arm: table, canvas, paint wells, water and rag, added to the arm's model.

Only the table matters for the physics: the arm must not touch it. All other objects are only visible.
"""

from importlib import resources

import mujoco
import numpy as np
from mujoco import mjtGeom
from numpy.typing import NDArray

from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.robot import Point, Workspace

CANVAS, CANVAS_PIXELS = "canvas", 1024
_PLANKS, _PLANK_PIXELS = "planks", 512
"""Textures of sawyer.xml, and the pixels along their sides."""
_THICKNESS = 0.018
_FLOOR = -0.78
_WELL_RADIUS, _WELL_WALL = 0.0175, 0.0025
# Objects of this group are not drawn.
_UNUSED = 4
_EMPTY = (0.93, 0.92, 0.90, 1.0)


def make_model(workspace: Workspace, canvas: CanvasSize) -> mujoco.MjModel:
    """Returns the model of the arm in its surroundings, for simulation and rendering."""
    spec = mujoco.MjSpec.from_string(resources.files(__package__).joinpath("sawyer.xml").read_text("utf-8"))
    table_top = workspace.canvas_origin[2] - _THICKNESS
    _add_table(spec, workspace, table_top)
    _add_canvas(spec, workspace, canvas)
    for number, well in enumerate(workspace.wells):
        _add_bowl(spec, f"well {number}", well, table_top, _WELL_RADIUS, group=_UNUSED)
    _add_bowl(spec, "water", workspace.water, table_top, 0.042, rgba=(0.55, 0.68, 0.74, 1))
    _add_rag(spec, workspace, table_top)
    model = spec.compile()
    paper(model, _PLANKS, _planks())
    return model


def _add_table(spec: mujoco.MjSpec, workspace: Workspace, table_top: float) -> None:
    lower, upper = np.array(workspace.lower), np.array(workspace.upper)
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    near = max(0.16, lower[0])  # the table ends in front of the pedestal
    half[0], middle[0] = (upper[0] - near) / 2, (upper[0] + near) / 2
    top = (middle[0], middle[1], table_top - 0.018)
    board = _stand(spec, mjtGeom.mjGEOM_BOX, (half[0], half[1], 0.018), top, material="table", name="table")
    board.contype = board.conaffinity = 1
    tall = (table_top - 0.036 - _FLOOR) / 2
    for x in (-1, 1):
        for y in (-1, 1):
            leg = (middle[0] + x * (half[0] - 0.05), middle[1] + y * (half[1] - 0.05), _FLOOR + tall)
            _stand(spec, mjtGeom.mjGEOM_BOX, (0.022, 0.022, tall), leg, material="wood")


def _add_canvas(spec: mujoco.MjSpec, workspace: Workspace, size: CanvasSize) -> None:
    x, y = workspace.to_robot(np.array([[size.width / 2, size.height / 2]]), np.zeros(1))[0, :2]
    z = workspace.canvas_origin[2]
    turned = (np.cos(workspace.canvas_angle / 2), 0, 0, np.sin(workspace.canvas_angle / 2))
    half = (size.width / 2, size.height / 2)
    board, place = (half[0] + 0.001, half[1] + 0.001, _THICKNESS / 2), (x, y, z - _THICKNESS / 2 - 0.0008)
    _stand(spec, mjtGeom.mjGEOM_BOX, board, place, quat=turned, rgba=(0.90, 0.88, 0.84, 1))
    _stand(spec, mjtGeom.mjGEOM_PLANE, (*half, 0.01), (x, y, z), quat=turned, material=CANVAS)


def _add_bowl(
    spec: mujoco.MjSpec, name: str, place: Point, table_top: float, radius: float,
    rgba: tuple[float, ...] = _EMPTY, group: int = 1,
) -> None:  # fmt: skip
    """Adds a bowl of glazed clay named "NAME bowl"; `name` itself is the surface of its content."""
    x, y, z = place
    tall = (z - 0.002 - table_top) / 2
    clay, content = (x, y, table_top + tall), (x, y, table_top + 2 * tall)
    size = (radius + _WELL_WALL, tall)
    _stand(spec, mjtGeom.mjGEOM_CYLINDER, size, clay, name=f"{name} bowl", material="white", group=group)
    _stand(spec, mjtGeom.mjGEOM_CYLINDER, (radius, 0.001), content, name=name, rgba=rgba, group=group)


def _add_rag(spec: mujoco.MjSpec, workspace: Workspace, table_top: float) -> None:
    x, y, z = workspace.rag
    cloth = (0.80, 0.79, 0.74, 1)
    half = workspace.rag_width / 2 + 0.02
    tall = z - table_top
    pad = (x, y, table_top + tall / 2 - 0.001)
    _stand(spec, mjtGeom.mjGEOM_BOX, (half, 0.045, tall / 2), pad, rgba=cloth)
    for number, turn in enumerate((0.04, -0.06)):
        size, place = (half - 0.006, 0.04 - 0.004 * number, 0.001), (x, y, z - 0.0005 + 0.001 * number)
        _stand(spec, mjtGeom.mjGEOM_BOX, size, place, quat=(np.cos(turn), 0, 0, np.sin(turn)), rgba=cloth)


def _stand(
    spec: mujoco.MjSpec, kind: mjtGeom, size: tuple[float, ...], place: tuple[float, ...], **look: object
) -> mujoco.MjsGeom:
    """Adds an object without collisions."""
    full = (*size, *(0.0,) * (3 - len(size)))
    return spec.worldbody.add_geom(type=kind, size=full, pos=place, contype=0, conaffinity=0, **{"group": 1, **look})


def paper(model: mujoco.MjModel, texture: str, picture: NDArray[np.uint8]) -> int:
    """Copies a picture [n, n, 3], with its first row at the lower edge, to a named texture; returns its id."""
    number = model.texture(texture).id
    first = model.tex_adr[number]
    model.tex_data[first : first + picture.size] = picture[::-1].reshape(-1)  # MuJoCo's first row is the upper one
    return int(number)


def fill(model: mujoco.MjModel, well: int) -> None:
    """Makes the bowl of a paint well visible; empty ones are not drawn."""
    for thing in (f"well {well}", f"well {well} bowl"):
        model.geom_group[model.geom(thing).id] = 1


def _planks() -> NDArray[np.uint8]:
    """Returns a table top of light planks [512, 512, 3] with grain, each a little different."""
    random = np.random.default_rng(7)
    row = np.arange(_PLANK_PIXELS)
    plank = row // 86
    tone = random.normal(0, 0.035, plank.max() + 1)[plank][:, None]
    grain = np.cumsum(random.normal(0, 1, (_PLANK_PIXELS, _PLANK_PIXELS)), axis=1)
    grain -= np.linspace(0, 1, _PLANK_PIXELS) * grain[:, -1:]
    grain = 0.018 * grain / grain.std()
    seam = np.where(row % 86 < 2, -0.18, 0.0)[:, None]
    color = np.array([0.62, 0.47, 0.33]) * (1 + tone + grain + seam)[..., None]
    return np.asarray(np.clip(255 * color, 0, 255), np.uint8)
