from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import pytest
import torch

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import is_simulated
from frida_painter.easel.open import machines, make_camera, make_robot, open_easel
from frida_painter.easel.order import EaselOrder, SimulationOrder
from frida_painter.errors import ConfigError, PluginError
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter.session.observer import CanvasObserver, CanvasStart
from frida_painter_drivers.axidraw import AxidrawRobot
from frida_painter_drivers.cameras import FolderCamera, GphotoCamera, OpencvCamera
from frida_painter_drivers.gcode import GcodeRobot
from frida_painter_drivers.rosbridge import RosRobot
from frida_painter_drivers.xarm import XarmRobot
from plugins import install

AS_SEEN = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))  # a map of colours that changes nothing


@pytest.fixture
def workcell(tmp_path: Path) -> WorkcellConfig:
    (tmp_path / "easel.toml").write_text(example())
    return WorkcellConfig.load(tmp_path / "easel.toml")


@pytest.mark.parametrize(
    ("name", "kind", "settings"),
    [
        ("xarm:192.168.1.10, brush_length=0.12", XarmRobot, {"address": "192.168.1.10", "brush_length": 0.12}),
        ("gcode:/dev/ttyUSB0,homing=yes", GcodeRobot, {"homing": True, "gcode.flavour": "grbl"}),
        ("gcode:/dev/x,servo=-0.002/100/0.01/900", GcodeRobot, {"gcode.servo.high": (0.01, 900)}),
        ("marlin:/dev/ttyACM0,baud=250000", GcodeRobot, {"baud": 250_000, "gcode.flavour": "marlin"}),
        ("axidraw", AxidrawRobot, {}),
        ("rosbridge:10.0.0.2:9091,namespace=/left/brush", RosRobot, {"namespace": "/left/brush"}),
        ("opencv:2", OpencvCamera, {"name": "camera 2"}),
        ("opencv:/dev/video1", OpencvCamera, {"name": "camera '/dev/video1'"}),
        ("folder:shots", FolderCamera, {"name": "the camera that fills 'shots'"}),
        ("gphoto", GphotoCamera, {}),
    ],
)
def test_each_machine_and_camera_is_built_as_it_is_named(
    workcell: WorkcellConfig, name: str, kind: type, settings: dict[str, object]
) -> None:
    made = make_camera(name) if kind.__name__.endswith("Camera") else make_robot(name, workcell.workspace)
    assert isinstance(made, kind)
    for setting, value in settings.items():
        assert attrgetter(setting)(made) == value  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("kuka:1", r"no robot 'kuka:1'; take one of xarm:ADDRESS"),
        ("xarm", r"without where it is; write xarm:ADDRESS"),
        ("xarm:1.2.3.4,color=red", "xarm does not know color"),
        ("xarm:1.2.3.4,brush_length=long", "brush_length=long is not understood"),
        ("xarm:1.2.3.4,brush_length", "write name=value"),
        ("xarm:1.2.3.4,brush_length=nan", "a brush length of nan m"),
        ("gcode:/dev/x,homing=perhaps", "homing=perhaps is not understood"),
        ("gcode:/dev/x,servo=1/2", "servo=1/2 is not understood"),
        ("gcode:/dev/x,servo=0.01/2/0.01/3", "the first lies below the second"),
        ("rosbridge:host:port", "'port' is no port"),
        ("rosbridge:host:99999", "'99999' is no port, which is from 1 to 65535"),
        ("rosbridge:host,ros=1", "does not know ros"),
    ],
)
def test_names_that_mean_nothing_are_told(workcell: WorkcellConfig, name: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        make_robot(name, workcell.workspace)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("", "take one of opencv:NUMBER, gphoto, folder:PATH"),
        ("webcam", "no camera 'webcam'; take one of opencv:NUMBER, gphoto, folder:PATH"),
        ("folder", "without where it is; write folder:PATH"),
        ("folder:", "without where it is; write folder:PATH"),
        ("gphoto:2", "given '2', .*; write gphoto"),
    ],
)
def test_cameras_that_mean_nothing_are_told(name: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        make_camera(name)


def order(tmp_path: Path, **values: object) -> EaselOrder:
    (tmp_path / "easel.toml").write_text(example())
    known: dict[str, object] = {
        "robot": "xarm:1.2.3.4,brush_length=0.1", "canvas": CanvasSize(0.3556, 0.2794), "brushes": ("broad",),
        "state": tmp_path, "workspace": tmp_path / "easel.toml", "camera": "opencv:0",
    }  # fmt: skip
    return EaselOrder(**{**known, **values})  # type: ignore[arg-type]


@pytest.mark.parametrize("ground", [(0.7, 0.5, 0.15), (0.2, 0.25, 0.7)])
def test_a_studio_is_delivered_with_a_camera_that_sees_a_deep_ground_as_it_is(
    tmp_path: Path, ground: tuple[float, float, float]
) -> None:
    """A camera whose bands leak sees the first one 0.04 too blue: a plan would be replanned against that."""
    easel = open_easel(order(tmp_path, robot="virtual", workspace=None, camera="", simulation=SimulationOrder(7))).easel
    easel.robot.connect()
    easel.camera.connect()
    off = []
    for known in (easel, replace(easel, calibration=replace(easel.calibration, color=AS_SEEN))):
        observer = CanvasObserver(known, CanvasStart(ground))
        observer.look(easel.robot.home().finished_at, 120)  # white, which teaches it the light
        easel.operator.tone(ground)
        seen = observer.look(easel.robot.home().finished_at, 120).mean((1, 2))
        easel.operator.tone((1.0, 1.0, 1.0))
        off.append(float((seen - torch.tensor(ground)).abs().max()))
    delivered, uncorrected = off
    assert delivered < 0.008
    assert uncorrected > 2 * delivered and uncorrected > 0.015


def test_a_real_easel_is_put_together_from_its_workspace(tmp_path: Path) -> None:
    easel = open_easel(order(tmp_path)).easel
    assert easel.calibration.easel == "my easel" and easel.calibration.camera == "opencv:0"
    assert not easel.simulated and easel.reach is not None
    assert machines(order(tmp_path)) == {"1.2.3.4"}
    assert not easel.operator.lay_paper()


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"workspace": None}, r"needs a workspace file \(--workspace FILE\): `frida-painter setup` writes one[^.]*\.$"),
        (
            {"camera": ""},
            r"needs a camera \(--camera opencv.*\)\. Without a camera, say --camera none: the plan is then painted",
        ),
        ({"workspace": None, "camera": ""}, r"needs a workspace file .* It also needs a camera"),
        ({"canvas": CanvasSize(0.3, 0.2)}, "for a canvas of 300 x 200 mm, and the one in .* is 356 x 279 mm"),
        ({"robot": "kuka"}, "no robot 'kuka'; take .*virtual"),
        ({"robot": "human", "camera": ""}, "which camera looks at the canvas"),
    ],
)
def test_a_real_easel_with_something_missing_is_told(tmp_path: Path, values: dict[str, object], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        open_easel(order(tmp_path, **values))


EASELS_OF_OTHERS = """
from dataclasses import replace
from operator import attrgetter
from frida_painter.easel.kinds import EaselKind
from frida_painter.easel.virtual_easel import VIRTUAL_KIND as VIRTUAL

def _open(order):
    return VIRTUAL.open(replace(order, simulation=replace(order.simulation, seed=order.simulation.seed + 1)))

ATELIER = EaselKind("atelier", "a studio of somebody else's", _open, simulated=True)
BROKEN = 3
"""


def test_a_whole_easel_of_another_package_is_opened_and_a_broken_one_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = {registry.EASELS: {"atelier": "atelier:ATELIER", "broken": "atelier:BROKEN"}}
    install(tmp_path / "installed", monkeypatch, "atelier-easel", points, {"atelier": EASELS_OF_OTHERS})
    wanted = order(
        tmp_path,
        robot="atelier",
        brushes=("fine",),
        simulation=SimulationOrder(4),
        canvas=CanvasSize(0.12, 0.09),
        camera="",
    )
    opened = open_easel(wanted)
    assert opened.easel.simulated and opened.easel.calibration.easel == "virtual studio 5"
    assert is_simulated("atelier") and machines(wanted) == frozenset()
    for look in (open_easel, machines):
        with pytest.raises(PluginError, match=r"'broken' of frida_painter\.easels, which the package atelier-easel"):
            look(order(tmp_path, robot="broken"))
    with pytest.raises(ConfigError, match=r"no robot 'virtual:5'; take human, .*, atelier, broken, or"):
        open_easel(order(tmp_path, robot="virtual:5"))
