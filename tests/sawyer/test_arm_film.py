import subprocess

import imageio_ffmpeg
import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.robot import Waypoints
from frida_painter_drivers.sawyer.arm_film import headless_opengl
from virtual.hand import Hand

pytest.importorskip("mink")
from frida_painter_drivers.sawyer.arm_film import ArmFilm, ArmView
from frida_painter_drivers.sawyer.surroundings import CANVAS_PIXELS, make_model

CANVAS = CanvasSize(0.2, 0.15)


@pytest.fixture(scope="module")
def hand():
    return Hand([0.05, 0.1, 0.7], canvas=CANVAS, arm="sawyer", noise=None)


@pytest.fixture(scope="module")
def drawn(hand):
    """A function from a canvas's grey value to a small picture of the arm."""
    model = make_model(hand.easel.workspace, CANVAS)
    try:
        view = ArmView(model, 90, 160)
    except ConfigError as cause:
        pytest.skip(f"no OpenGL draws here: {cause}")

    neutral = model.key("neutral").qpos.copy()

    def draw(grey, angles=neutral, rows=slice(None), columns=slice(None)):
        canvas = np.full((CANVAS_PIXELS, CANVAS_PIXELS, 3), 255, np.uint8)
        canvas[rows, columns] = grey
        view.lay_canvas(canvas)
        return view.draw(angles).copy()

    yield draw
    view.close()


def test_the_painting_lies_before_the_arm(drawn):
    change = (drawn(255).astype(int) - drawn(20)).max(-1)
    assert 50 < (change > 40).sum() < 0.15 * change.size  # the canvas, and nothing else


def test_the_painting_lies_the_right_way_round_before_whoever_stands_opposite(drawn):
    def middle(**part):
        """Where a dark part of the canvas is seen: row and column of the picture."""
        return np.argwhere((drawn(255).astype(int) - drawn(20, **part)).max(-1) > 40).mean(0)

    half = CANVAS_PIXELS // 2
    lower, upper = middle(rows=slice(None, half)), middle(rows=slice(half, None))
    assert lower[0] > upper[0] + 1
    left, right = middle(columns=slice(None, half)), middle(columns=slice(half, None))
    assert left[1] < right[1] - 3


def test_the_arm_moves_in_the_picture(drawn):
    other = np.array([0.5, -1.18, 0, 2.18, 0, 0.57, 1.5708])
    assert (np.abs(drawn(255).astype(int) - drawn(255, other)).max(-1) > 30).mean() > 0.03


def test_a_film_shows_every_motion_and_the_arm_does_not_feel_it(drawn, hand, tmp_path):
    path = tmp_path / "arm.mp4"
    plain = Hand([0.05, 0.1, 0.7], canvas=CANVAS, arm="sawyer", noise=None)
    filmed = Hand([0.05, 0.1, 0.7], canvas=CANVAS, arm="sawyer", noise=None)
    film = ArmFilm(path, filmed.easel.workspace, CANVAS, filmed.studio.table)
    filmed.studio.robot.watcher = film
    film.open()
    for one in (plain, filmed):
        for step in (0.05, -0.05):
            aside = one.easel.robot.pose() + np.array([0.0, step, 0.0])
            one.easel.robot.follow(Waypoints("aside", aside[None], 0.1))
    film.close()
    assert (plain.easel.robot.pose() == filmed.easel.robot.pose()).all()
    counting = ("-v", "error", "-stats", "-i", str(path), "-f", "null", "-")
    said = subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), *counting], capture_output=True, text=True, check=True)
    frames = int(said.stderr.split("frame=")[-1].split()[0])
    assert frames == pytest.approx(filmed.studio.clock.now / 0.25 + 2 + 48, abs=1)


def test_without_opengl_the_film_is_missing_and_nothing_else(hand, tmp_path, monkeypatch):
    monkeypatch.setattr("frida_painter_drivers.sawyer.arm_film.headless_opengl", lambda: None)
    film = ArmFilm(tmp_path / "arm.mp4", hand.easel.workspace, CANVAS, hand.studio.table)
    hand.studio.robot.watcher = film
    film.open()
    hand.easel.robot.home()
    film.close()
    assert list(tmp_path.iterdir()) == []


def test_what_draws_is_found_or_told_by_the_environment(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert headless_opengl() == "osmesa"
    monkeypatch.delenv("MUJOCO_GL")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("ctypes.util.find_library", lambda name: None)
    assert headless_opengl() is None
    monkeypatch.setattr("ctypes.util.find_library", lambda name: "it" if name == "EGL" else None)
    assert headless_opengl() == "egl"
