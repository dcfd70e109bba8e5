from pathlib import Path

import pytest

from frida_painter.easel.kinds import state_folder
from frida_painter.errors import ConfigError
from frida_painter.hardware.workcell import example
from frida_painter.runs.painting_easel import order
from frida_painter_studio.painter import Asker
from frida_painter_studio.stop import StopWatch
from frida_painter_studio.studio_folder import Feed, PaintingFolder, PaintingRequest
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_studio.worker import Job


@pytest.mark.parametrize(
    ("robot", "says"), [("toaster", "no robot 'toaster'"), ("axidraw", "workspace file"), ("xarm:10.0.0.1", "camera")]
)
def test_what_cannot_paint_is_refused_before_the_page_opens(tmp_path: Path, robot: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        WebAppEasel(tmp_path / "record.json", robot).validate()


@pytest.mark.parametrize(
    ("robot", "simulated", "dangerous"),
    [("virtual", True, False), ("sawyer-sim", True, False), ("human", False, False), ("axidraw", False, True)],
)
def test_whose_stops_hold_where(tmp_path: Path, robot: str, simulated: bool, dangerous: bool) -> None:
    easel = WebAppEasel(tmp_path / "record.json", robot, "opencv:0", tmp_path / "easel.toml", 0.5)
    assert (easel.simulated, easel.drives_machine) == (simulated, dangerous)
    assert WebAppEasel.from_json(easel.to_json()) == easel
    folder = PaintingFolder(tmp_path)
    feed, stop = Feed(folder), StopWatch(folder.stop, folder.path.parent)
    plan = folder.begin_plan(PaintingRequest.model_validate({"terms": [{"kind": "text", "words": "a sea"}]}), tmp_path)
    job = Job(folder, easel, feed, stop, Asker(folder, feed, stop))
    wanted = order(job.spec(plan), "broad", folder.painting, job.state)
    assert wanted.state == (folder.easel if simulated else state_folder())
    assert wanted.pace == (0.5 if simulated else 0.0) and wanted.folder == folder.painting


def test_the_canvas_is_the_one_of_the_workspace_file(tmp_path: Path) -> None:
    file = tmp_path / "easel.toml"
    file.write_text(example().replace("width = 0.3556", "width = 0.3"))
    easel = WebAppEasel(tmp_path / "record.json", "xarm:10.0.0.1", "opencv:0", file).validate()
    assert easel.canvas == pytest.approx((300, 279.4))
    file.write_text("canvas = 3")
    with pytest.raises(ConfigError, match="is no workspace"):
        easel.validate()


def test_a_record_counts_once_it_is_there(tmp_path: Path) -> None:
    easel = WebAppEasel(tmp_path / "record.json")
    assert easel.known is None and easel.canvas is None
    easel.record.write_text("{}")
    assert easel.known == easel.record
