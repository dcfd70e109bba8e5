"""The surroundings of the arm: table, canvas, paint wells, water and rag, added to the arm's model.

Only the table matters for the physics: the arm must not touch it. All other objects are only visible.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Self

import mujoco
import numpy as np
from mujoco import mjtGeom
from numpy.typing import NDArray

from frida_painter import storage
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.robot import Point, Workspace

# The maker's meshes, from a folder of the user. They are for the film only; the physics does not need them.
# The mesh of a part is PART.obj or PART.stl, or all such files in a folder PART, as robosuite has them. PART.mtl, if
# it exists, contains the colours that OBJ files name.

Color = tuple[float, float, float]

PARTS = ("base", "head", "l0", "l1", "l2", "l3", "l4", "l5", "l6")
_KINDS = (".obj", ".stl")
_MAX_BYTES = 300 * 2**20
_HEAD_LINES = 100  # of an OBJ file, in which it names its colour
_GREY: Color = (0.45, 0.45, 0.47)


@dataclass(frozen=True)
class Piece:
    """Mesh of a part of the arm.

    part: name of the part
    path: of the file; metres in the frame of the part's body
    color: sRGB in [0, 1]
    """

    part: str
    path: Path
    color: Color


@dataclass(frozen=True)
class Meshes:
    """Meshes of a whole arm."""

    pieces: tuple[Piece, ...]

    @classmethod
    def in_folder(cls, folder: Path) -> Self:
        """Returns the meshes in a folder. Raises ConfigError if a part is missing, unreadable, or all are too large."""
        if not folder.is_dir():
            raise ConfigError(f"{folder} is no folder; give the one with the meshes {', '.join(PARTS)}.")
        found = {part: list(_files(folder, part)) for part in PARTS}
        missing = [part for part, files in found.items() if not files]
        if missing:
            raise ConfigError(
                f"{folder} has no mesh of {', '.join(missing)}; of every part ({', '.join(PARTS)}) there must be "
                "PART.obj or PART.stl, or a folder PART of such files."
            )
        try:
            size = sum(path.stat().st_size for files in found.values() for path in files)
            if size > _MAX_BYTES:
                most = _MAX_BYTES / 2**20
                raise ConfigError(
                    f"The meshes in {folder} have {size / 2**20:.0f} MB; at most {most:.0f} MB are taken."
                )
            return cls(
                tuple(
                    Piece(part, path, _color(path, colors))
                    for part, files in found.items()
                    for colors in [_colors(folder / f"{part}.mtl")]
                    for path in files
                )
            )
        except OSError as cause:
            raise ConfigError(f"A mesh in {folder} cannot be read ({cause}).") from cause


def _files(folder: Path, part: str) -> Iterator[Path]:
    inside = folder / part
    if inside.is_dir():
        yield from sorted(path for path in inside.iterdir() if path.suffix.lower() in _KINDS)
    else:
        yield from [path for kind in _KINDS if (path := folder / f"{part}{kind}").is_file()][:1]


def _colors(path: Path) -> dict[str, Color]:
    """Returns the diffuse colours of an MTL file by their names; empty if the file does not exist."""
    if not path.is_file():
        return {}
    colors, name = {}, ""
    content = storage.read_bytes(path, "the colours of a mesh (MTL)", _MAX_BYTES, ConfigError)
    for line in content.decode("utf-8", "replace").splitlines():
        if named := re.match(r"\s*newmtl\s+(\S+)", line):
            name = named[1]
        elif diffuse := re.match(r"\s*Kd\s+([\d.]+)\s+([\d.]+)\s+([\d.]+)", line):
            red, green, blue = (min(1.0, float(part)) for part in diffuse.groups())
            colors[name] = (red, green, blue)
    return colors


def _color(path: Path, colors: dict[str, Color]) -> Color:
    """Returns the first colour that an OBJ file names."""
    if not colors or path.suffix.lower() != ".obj":
        return _GREY
    with storage.open_checked(path, "a mesh (OBJ)", _MAX_BYTES, ConfigError) as lines:
        for _, line in zip(range(_HEAD_LINES), lines, strict=False):
            if named := re.match(r"\s*usemtl\s+(\S+)", line.decode("utf-8", "replace")):
                return colors.get(named[1], _GREY)
    return _GREY


CANVAS, CANVAS_PIXELS = "canvas", 1024
_PLANKS, _PLANK_PIXELS = "planks", 512
"""Textures of sawyer.xml, and the pixels along their sides."""
_THICKNESS = 0.018
_FLOOR = -0.78
_HEAD = (0.0, 0.0, 0.2965)  # of its joint, in the frame of l0 (sawyer_description)
_LARGEST = 0.5  # half the length of a part of the arm
_WELL_RADIUS, _WELL_WALL = 0.0175, 0.0025
# Objects of this group are not drawn.
_UNUSED = 4
_EMPTY = (0.93, 0.92, 0.90, 1.0)


@dataclass(frozen=True)
class Surroundings:
    """Surroundings of one arm.

    workspace: positions of the objects
    canvas: size of the canvas
    meshes: the maker's meshes, for the film only; None for the simple shapes of the model
    """

    workspace: Workspace
    canvas: CanvasSize
    meshes: Meshes | None = None

    def model(self) -> mujoco.MjModel:
        """Returns the model of the arm in these surroundings, for simulation and rendering.

        Raises ConfigError if its meshes cannot be used.
        """
        spec = mujoco.MjSpec.from_string(resources.files(__package__).joinpath("sawyer.xml").read_text("utf-8"))
        self._add_table(spec)
        self._add_canvas(spec)
        for number, well in enumerate(self.workspace.wells):
            self._add_bowl(spec, f"well {number}", well, _WELL_RADIUS, group=_UNUSED)
        self._add_bowl(spec, "water", self.workspace.water, 0.042, rgba=(0.55, 0.68, 0.74, 1))
        self._add_rag(spec)
        model = spec.compile() if self.meshes is None else _dress(spec, self.meshes)
        paper(model, _PLANKS, _planks())
        return model

    @property
    def _table_top(self) -> float:
        return self.workspace.canvas_origin[2] - _THICKNESS

    def _add_table(self, spec: mujoco.MjSpec) -> None:
        lower, upper = np.array(self.workspace.lower), np.array(self.workspace.upper)
        middle, half = (lower + upper) / 2, (upper - lower) / 2
        near = max(0.16, lower[0])  # the table ends in front of the pedestal
        half[0], middle[0] = (upper[0] - near) / 2, (upper[0] + near) / 2
        top = (middle[0], middle[1], self._table_top - 0.018)
        board = self._stand(spec, mjtGeom.mjGEOM_BOX, (half[0], half[1], 0.018), top, material="table", name="table")
        board.contype = board.conaffinity = 1
        for x in (-1, 1):
            for y in (-1, 1):
                leg = (middle[0] + x * (half[0] - 0.05), middle[1] + y * (half[1] - 0.05))
                tall = (self._table_top - 0.036 - _FLOOR) / 2
                self._stand(spec, mjtGeom.mjGEOM_BOX, (0.022, 0.022, tall), (*leg, _FLOOR + tall), material="wood")

    def _add_canvas(self, spec: mujoco.MjSpec) -> None:
        workspace, size = self.workspace, self.canvas
        x, y = workspace.to_robot(np.array([[size.width / 2, size.height / 2]]), np.zeros(1))[0, :2]
        z = workspace.canvas_origin[2]
        turned = (np.cos(workspace.canvas_angle / 2), 0, 0, np.sin(workspace.canvas_angle / 2))
        half = (size.width / 2, size.height / 2)
        self._stand(
            spec, mjtGeom.mjGEOM_BOX, (half[0] + 0.001, half[1] + 0.001, _THICKNESS / 2),
            (x, y, z - _THICKNESS / 2 - 0.0008), quat=turned, rgba=(0.90, 0.88, 0.84, 1),
        )  # fmt: skip
        self._stand(spec, mjtGeom.mjGEOM_PLANE, (*half, 0.01), (x, y, z), quat=turned, material=CANVAS)

    def _add_bowl(
        self, spec: mujoco.MjSpec, name: str, place: Point, radius: float, rgba: tuple[float, ...] = _EMPTY,
        group: int = 1,
    ) -> None:  # fmt: skip
        """Adds a bowl of glazed clay named "NAME bowl"; `name` itself is the surface of its content."""
        x, y, z = place
        tall = (z - 0.002 - self._table_top) / 2
        at = (x, y, self._table_top + tall)
        surface = (x, y, self._table_top + 2 * tall)
        look: dict[str, Any] = {"group": group}
        clay = look | {"name": f"{name} bowl", "material": "white"}
        self._stand(spec, mjtGeom.mjGEOM_CYLINDER, (radius + _WELL_WALL, tall), at, **clay)
        self._stand(spec, mjtGeom.mjGEOM_CYLINDER, (radius, 0.001), surface, **look, name=name, rgba=rgba)

    def _add_rag(self, spec: mujoco.MjSpec) -> None:
        x, y, z = self.workspace.rag
        cloth = (0.80, 0.79, 0.74, 1)
        half = self.workspace.rag_width / 2 + 0.02
        tall = z - self._table_top
        pad = (x, y, self._table_top + tall / 2 - 0.001)
        self._stand(spec, mjtGeom.mjGEOM_BOX, (half, 0.045, tall / 2), pad, rgba=cloth)
        for number, turn in enumerate((0.04, -0.06)):
            size, place = (half - 0.006, 0.04 - 0.004 * number, 0.001), (x, y, z - 0.0005 + 0.001 * number)
            self._stand(spec, mjtGeom.mjGEOM_BOX, size, place, quat=(np.cos(turn), 0, 0, np.sin(turn)), rgba=cloth)

    @staticmethod
    def _stand(
        spec: mujoco.MjSpec, kind: mjtGeom, size: tuple[float, ...], place: tuple[float, ...], **look: object
    ) -> mujoco.MjsGeom:
        """Adds an object without collisions."""
        full = (*size, *(0.0,) * (3 - len(size)))
        return spec.worldbody.add_geom(
            type=kind, size=full, pos=place, contype=0, conaffinity=0, **{"group": 1, **look}
        )


def _dress(spec: mujoco.MjSpec, meshes: Meshes) -> mujoco.MjModel:
    """Returns the model with the maker's meshes instead of its simple shapes."""
    spec.body("l0").add_body(name="head", pos=_HEAD)
    for part in PARTS:
        for shape in spec.body(part).geoms:
            shape.group = _UNUSED
    for number, piece in enumerate(meshes.pieces):
        name = f"{piece.part} {number}"
        spec.add_mesh(name=name, file=str(piece.path.absolute()), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        spec.add_material(name=name, rgba=(*piece.color, 1), specular=0.4, shininess=0.4)
        spec.body(piece.part).add_geom(
            type=mjtGeom.mjGEOM_MESH, meshname=name, material=name, group=1, contype=0, conaffinity=0, mass=0
        )
    try:
        model = spec.compile()
    except ValueError as cause:
        raise ConfigError(f"The meshes of the arm cannot be used: {cause}") from cause
    largest = float(model.geom_rbound[model.geom_type == mjtGeom.mjGEOM_MESH].max())
    if not largest <= _LARGEST:
        raise ConfigError(
            f"A mesh of the arm is {2 * largest:.3g} m long; meshes are in metres, and no part is longer than "
            f"{2 * _LARGEST:g} m. Scale them, then try again."
        )
    return model


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
