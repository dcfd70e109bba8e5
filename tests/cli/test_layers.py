"""Paintings of two brushes that break off while the first layer dries, or when it is dry; real processes."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from frida_painter.system.event_log import EventLog
from killing import ForkedCommand, kill_when
from session.easel_errands import until
from support import data

SMALL = (
    *("--strokes", "8", "--brushes", "broad:50%,medium:50%", "--colors", "2", "--replans", "1", "--no-film"),
    *("--canvas", "120x90mm", "--fit", "crop", "--render-height", "64", "--effort", "0.05"),
)
Command = Callable[..., ForkedCommand]


@pytest.fixture
def begin(tmp_path: Path) -> Iterator[Command]:
    Image.fromarray(data.coffee()).resize((300, 200)).save(tmp_path / "cup.png")
    begun: list[ForkedCommand] = []

    def beginning(*words: str) -> ForkedCommand:
        begun.append(ForkedCommand(tmp_path, *words, env={"XDG_STATE_HOME": str(tmp_path / "state")}))
        return begun[-1]

    yield beginning
    for command in begun:
        command.close()


def written(folder: Path) -> list[dict[str, Any]]:
    return EventLog.read(folder / "journal") if (folder / "journal").exists() else []


def require_whole(folder: Path) -> None:
    """Eight strokes were painted, each once, the last four with the medium brush after the first had dried."""
    done = [one["done"] for one in written(folder) if one["kind"] == "stroke_painted"]
    kinds = [one["kind"] for one in written(folder)]
    assert done == list(range(1, 9)) and kinds.count("finished") == 1 and kinds[-1] == "result_found"
    begun = [
        (kinds[:number].count("stroke_painted"), one["brush"])
        for number, one in enumerate(written(folder))
        if one["kind"] == "layer_begun"
    ]
    assert begun[0] == (0, "broad") and set(begun[1:]) == {(4, "medium")}
    did = EventLog.read(folder / "studio.diary")
    held = [one["name"] for one in did if one.get("did") == "brush"]
    assert held == ["medium"], "the right brush was in the holder, and was put there once"
    told = [one["left"] for one in written(folder) if one["kind"] == "drying"]
    assert told[-1] == 0 and sum(one.get("did") == "wait" for one in did) >= 120


@pytest.mark.parametrize(
    "moment",
    [
        lambda one: one["kind"] == "drying" and one["left"] == 600,
        lambda one: one["kind"] == "layer_begun" and one["layer"] == 2,
    ],
    ids=["while it dries", "when the brush was changed"],
)
def test_killed_between_two_brushes_it_is_completed_with_the_right_one(
    begin: Command, tmp_path: Path, moment: Callable[[dict[str, Any]], bool]
) -> None:
    """Fault F1: the painting process is killed."""
    folder = tmp_path / "painted"

    def paint() -> None:
        os.chdir(tmp_path)
        os.environ["XDG_STATE_HOME"] = str(tmp_path / "state")
        sys.argv = ["frida-painter", "paint", "cup.png", *SMALL, "--out", str(folder)]
        from frida_painter_cli import commands

        commands.main()

    kill_when(folder / "journal", moment, paint)
    until(lambda: not (folder / ".studio.diary-reserve").exists(), 60)  # the easel's process ends by itself
    resumed = begin("resume", "painted", "--yes")
    _, err = resumed.communicate(timeout=300)
    assert resumed.returncode == 0, err
    require_whole(folder)


def test_ctrl_c_while_paint_dries_ends_at_once_and_the_rest_is_painted_later(begin: Command, tmp_path: Path) -> None:
    """Fault F34: a signal ends the program at any moment."""
    folder = tmp_path / "painted"
    painter = begin("paint", "cup.png", *SMALL, "--out", "painted", "--pace", "0.3")
    until(lambda: painter.poll() is not None or any(one["kind"] == "drying" for one in written(folder)), 300)
    assert painter.poll() is None, painter.communicate()
    time.sleep(1)
    asked = time.monotonic()
    painter.send_signal(signal.SIGINT)
    _, err = painter.communicate(timeout=200)
    assert painter.returncode == 130 and "Traceback" not in err, err
    assert time.monotonic() - asked < 60, "and not the six minutes of drying"
    left = [one["left"] for one in written(folder) if one["kind"] == "drying"]
    assert left and left[-1] > 900 and sum(one["kind"] == "stroke_painted" for one in written(folder)) == 4
    resumed = begin("resume", "painted", "--yes")
    _, err = resumed.communicate(timeout=300)
    assert resumed.returncode == 0, err
    require_whole(folder)
