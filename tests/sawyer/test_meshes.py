import struct

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.virtual.bristles import find_brush
from frida_painter.virtual.tabletop import sawyer_layout
from frida_painter_drivers.sawyer.surroundings import PARTS, Meshes

CANVAS = CanvasSize(0.2, 0.15)
CORNERS = [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def obj(scale=1.0, color=""):
    corners = "".join("v {} {} {}\n".format(*(scale * part for part in corner)) for corner in CORNERS)
    return f"usemtl {color}\n" * bool(color) + corners + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES)


def stl():
    faces = b"".join(struct.pack("<12fH", *[0] * 3, *(x for k in face for x in CORNERS[k]), 0) for face in FACES)
    return b"\0" * 80 + struct.pack("<I", len(FACES)) + faces


@pytest.fixture
def folder(tmp_path):
    """Every part as a tetrahedron: most as one OBJ file, the head in two pieces, l6 as STL."""
    for part in PARTS:
        (tmp_path / f"{part}.obj").write_text(obj())
    (tmp_path / "head.obj").unlink()
    (tmp_path / "head").mkdir()
    for k, color in enumerate(("red", "unknown")):
        (tmp_path / "head" / f"head_{k}.obj").write_text(obj(color=color))
    (tmp_path / "head.mtl").write_text("newmtl red\nKd 0.8 0.1 0.1\nd 1.0\n")
    (tmp_path / "l6.obj").unlink()
    (tmp_path / "l6.stl").write_bytes(stl())
    return tmp_path


def model(folder):
    pytest.importorskip("mink")
    from frida_painter_drivers.sawyer.surroundings import Surroundings

    return Surroundings(sawyer_layout(CANVAS, find_brush("broad")).workspace, CANVAS, Meshes.in_folder(folder)).model()


def test_the_makers_shapes_take_the_place_of_our_own_and_the_brush_stays(folder):
    import mujoco

    arm = model(folder)
    meshes = np.flatnonzero(arm.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    assert len(meshes) == len(PARTS) + 1 and (arm.geom_contype[meshes] == 0).all()
    red = arm.mat_rgba[arm.geom_matid[meshes]]
    assert np.isclose(red[:, :3], (0.8, 0.1, 0.1), atol=1e-6).all(1).sum() == 1
    seen = arm.geom_group < 3
    assert seen[meshes].all() and seen[arm.geom("bristles").id] and not seen[arm.geom("upper_arm").id]
    assert arm.nv == 7


def test_a_folder_that_does_not_fit_is_refused_in_a_sentence(folder):
    for part in ("l2", "base"):
        (folder / f"{part}.obj").unlink()
    with pytest.raises(ConfigError, match="has no mesh of base, l2; of every part"):
        Meshes.in_folder(folder)
    with pytest.raises(ConfigError, match="is no folder"):
        Meshes.in_folder(folder / "nowhere")


@pytest.mark.parametrize(
    ("content", "says"), [(obj(scale=1000.0), "meshes are in metres"), ("no mesh", "cannot be used")]
)
def test_what_is_no_mesh_or_in_millimetres_is_refused(folder, content, says):
    (folder / "l3.obj").write_text(content)
    with pytest.raises(ConfigError, match=says):
        model(folder)
