import os
import time
from pathlib import Path

import pytest

from frida_painter.errors import RobotStopped
from frida_painter.hardware.latch import Latch, latch_path
from frida_painter_studio import security as presence_module
from frida_painter_studio.security import Presence
from frida_painter_studio.studio_folder import PaintingFolder
from frida_painter_studio.web_app_easel import WebAppEasel


@pytest.fixture
def folder(tmp_path: Path) -> PaintingFolder:
    return PaintingFolder(tmp_path)


def test_a_simulated_robot_moves_without_a_press(folder: PaintingFolder) -> None:
    Presence().allow(WebAppEasel(folder.path / "record.json"))


@pytest.mark.parametrize("robot", ["xarm:10.0.0.1", "axidraw"])
def test_a_real_robot_moves_only_after_a_press_and_each_press_is_good_for_one_thing(
    folder: PaintingFolder, robot: str
) -> None:
    presence, easel = Presence(possible=True), WebAppEasel(folder.path / "record.json", robot)
    with pytest.raises(RobotStopped, match="press Enter"):
        presence.allow(easel)
    presence.press()
    presence.allow(easel)
    with pytest.raises(RobotStopped):
        presence.allow(easel)


def test_a_press_is_forgotten_after_a_minute(folder: PaintingFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    presence = Presence()
    presence.press()
    now = time.monotonic()
    monkeypatch.setattr(presence_module.time, "monotonic", lambda: now + presence_module.GOOD_FOR + 1)
    with pytest.raises(RobotStopped, match="in a terminal"):
        presence.allow(WebAppEasel(folder.path / "record.json", "axidraw"))


def test_a_simulated_robot_that_was_stopped_needs_nobody_who_has_looked(folder: PaintingFolder) -> None:
    latch = Latch(latch_path(folder.easel, "virtual studio 0"), "virtual studio 0")
    latch.engage("an earlier version latched simulated robots as well")
    Presence().allow(WebAppEasel(folder.path / "record.json"))


def test_presses_are_heard_from_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    presence = Presence()
    read, write = os.pipe()
    presence.listen(read)
    os.write(write, b"\n")
    deadline = time.monotonic() + 10
    while presence._pressed is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert presence.possible and presence.use() and not presence.use()
    os.close(write)
    while presence.possible and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not presence.possible
    os.close(read)
