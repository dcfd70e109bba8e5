"""The renderer as an environment: right pictures, the same bytes for the same seed, sentences for wrong use."""

import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv

import frida_painter as fp
from frida_painter.brush.table import cached_table
from frida_painter.errors import ConfigError, FridaError, ImageError, StepRefused
from frida_painter.render.painting import render
from frida_painter_lab.env.renderer_env import RendererEnv, RendererVectorEnv

SMALL = {"canvas": "9x7cm", "brush": "fine", "paints": ["#eeddaa", "#aa3333", "#222233"], "rows": 28, "strokes": 5}
GOAL = torch.rand(3, 40, 50, generator=torch.Generator().manual_seed(3))


@pytest.fixture
def env():
    return gymnasium.make("renderer/strokes-v1", goal=GOAL, **SMALL)


def same(one, other):
    assert one.keys() == other.keys()
    for name in one:
        assert np.asarray(one[name]).tobytes() == np.asarray(other[name]).tobytes(), name


def test_gymnasium_finds_no_fault_with_it():
    with np.errstate(all="raise"):
        check_env(gymnasium.make("renderer/strokes-v1", render_mode="rgb_array", **SMALL).unwrapped)


def test_a_painted_canvas_is_the_renderers_picture_on_every_place_of_the_stack(env):
    """Each canvas gets its own strokes alone, none of its neighbours'."""
    several = gymnasium.make_vec("renderer/strokes-v1", 6, goal=GOAL, **SMALL)
    several.reset(seed=1)
    several.action_space.seed(4)
    task = several.unwrapped.task
    model = cached_table(fp.load_stroke_model("fine"))
    wanted = [torch.ones(3, task.grid.rows, task.grid.columns) for _ in range(6)]
    for _ in range(4):
        action = several.action_space.sample()
        observed, *_ = several.step(action)
        for at in range(6):
            strokes, _ = task.code.decode(action[at : at + 1], task.palettes[0])
            wanted[at] = render(strokes, model, wanted[at], task.grid.size)
    pictures = torch.stack(wanted).permute(0, 2, 3, 1).numpy()
    assert np.abs(observed["canvas"] / 255 - pictures).max() <= 0.5 / 255 + 1e-4


def test_the_rewards_are_the_gain_of_the_judge(env):
    observed, before = env.reset(seed=0)
    env.action_space.seed(0)
    gains = []
    for _ in range(SMALL["strokes"]):
        observed, reward, ended, cut, info = env.step(env.action_space.sample())
        gains.append(reward)
    error = np.square((observed["canvas"].astype(float) - observed["goal"]) / 255).mean()
    assert info["score"] == pytest.approx(-10 * np.log10(error), abs=0.02)
    assert sum(gains) == pytest.approx(info["score"] - before["score"])
    assert cut and not ended and observed["strokes_left"] == [0]


def test_one_environment_of_several_is_the_single_one_with_its_seed():
    several = gymnasium.make_vec("renderer/strokes-v1", 3, **SMALL)
    seen, _ = several.reset(seed=[7, 9, 11])
    several.action_space.seed(2)
    alone = gymnasium.make("renderer/strokes-v1", **SMALL)
    own, _ = alone.reset(seed=9)
    same(own, {name: part[1] for name, part in seen.items()})
    for _ in range(3):
        action = several.action_space.sample()
        seen, reward, *_ = several.step(action)
        own, gain, *_ = alone.step(action[1])
    assert np.abs(own["canvas"].astype(int) - seen["canvas"][1]).max() <= 1
    assert gain == pytest.approx(reward[1], abs=1e-3)


def test_an_episode_that_is_over_begins_again_at_the_next_step_and_nothing_is_painted():
    several = gymnasium.make_vec("renderer/strokes-v1", 2, goal=GOAL, **SMALL)
    first, start = several.reset(seed=0)
    for _ in range(SMALL["strokes"]):
        _, _, _, cut, _ = several.step(several.action_space.sample())
    assert cut.all()
    again, reward, _, cut, info = several.step(several.action_space.sample())
    same(first, again)
    assert not reward.any() and not cut.any() and (info["score"] == start["score"]).all()


def test_the_same_seed_gives_the_same_bytes(env):
    action = np.linspace(-0.9, 0.9, 7).astype(np.float32)
    found = []
    for seed in (5, 6, 5):
        first, _ = env.reset(seed=seed)
        found.append({**first, **{f"after {name}": part for name, part in env.step(action)[0].items()}})
    same(found[0], found[2])


def test_goals_are_drawn_by_the_seed_and_one_may_be_given_for_an_episode(env):
    shipped = gymnasium.make("renderer/strokes-v1", **SMALL)
    goals = {shipped.reset(seed=seed)[0]["goal"].tobytes() for seed in range(12)}
    assert len(goals) > 2
    black = np.zeros((30, 40, 3), np.uint8)
    assert not env.reset(options={"goal": black})[0]["goal"].any()
    assert env.reset()[0]["goal"].any(), "the next episode has the usual goal"


def test_the_brush_runs_dry_and_is_dipped(env):
    env.reset(seed=0)
    action = np.array([0, 0, 0, -0.5, 0, 0, -1], np.float32)
    held, loads = zip(
        *((int(seen["held"]), float(seen["load"][0])) for seen, *_ in (env.step(action) for _ in range(5))), strict=True
    )
    assert held == (1,) * 5 and min(loads) < loads[0] and len(set(loads)) > 1


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({"canvas": "1x1mm"}, ConfigError),
        ({"brush": "mop"}, ConfigError),
        ({"paints": 0}, ConfigError),
        ({"paints": 65}, ConfigError),
        ({"paints": []}, ConfigError),
        ({"paints": "#222"}, ConfigError),
        ({"paints": ["#22"]}, ConfigError),
        ({"paints": [[0.1, 0.2, float("nan")]]}, ConfigError),
        ({"strokes": 0}, ConfigError),
        ({"strokes": True}, ConfigError),
        ({"strokes": 2.5}, ConfigError),
        ({"minutes": float("nan")}, ConfigError),
        ({"minutes": -1}, ConfigError),
        ({"judge": "taste"}, ConfigError),
        ({"rows": 10**6}, ConfigError),
        ({"ground": "white-ish"}, ConfigError),
        ({"goal": "no-such-picture.jpg"}, ImageError),
        ({"goal": []}, ConfigError),
        ({"goal": torch.full((3, 20, 20), float("nan"))}, ImageError),
        ({"goal": np.zeros((20, 20), np.uint8)}, ImageError),
        ({"seed": -1}, ConfigError),
        ({"colour": 3}, ConfigError),
        ({"num_envs": 0}, ConfigError),
        ({"num_envs": 2.0}, ConfigError),
    ],
)
def test_a_wrong_setting_is_refused_with_a_sentence(settings, error):
    with pytest.raises(error) as refusal:
        fp.make_env("renderer/strokes-v1", **{**SMALL, **settings})
    assert len(str(refusal.value)) < 320


def test_a_wrong_render_mode_is_refused():
    for kind in (RendererEnv, RendererVectorEnv):
        with pytest.raises(ConfigError, match="render mode 'human' was given"):
            kind(render_mode="human", **SMALL)


def test_a_wrong_name_is_refused():
    with pytest.raises(ConfigError, match="There is no environment 'studio/strokes-v2'; take studio/strokes-v1"):
        fp.make_env("studio/strokes-v2")


def test_a_step_before_the_beginning_or_after_the_end_is_refused(env):
    action = np.zeros(7, np.float32)
    with pytest.raises(StepRefused, match="call reset before step"):
        env.step(action)
    env.reset(seed=0)
    for _ in range(SMALL["strokes"]):
        env.step(action)
    with pytest.raises(StepRefused, match="over after 5 strokes"):
        env.step(action)
    env.reset()
    env.step(action)


def test_a_refused_action_changes_nothing(env):
    first, _ = env.reset(seed=0)
    with pytest.raises(StepRefused):
        env.step(np.full(7, 2.0, np.float32))
    same(first, env.reset(seed=0)[0])
    action = np.full(7, 0.3, np.float32)
    with pytest.raises(StepRefused):
        env.step(action * np.nan)
    assert env.step(action)[4]["strokes"] == 1


@pytest.mark.parametrize("options", [{"gaol": 1}, {"goal": 3}])
def test_a_wrong_option_of_a_reset_is_refused(env, options):
    with pytest.raises(FridaError):
        env.reset(options=options)


@pytest.mark.parametrize("seeds", [[1], [1, -2], [1, 2.5]])
def test_wrong_seeds_are_refused(seeds):
    with pytest.raises(ConfigError):
        gymnasium.make_vec("renderer/strokes-v1", 2, **SMALL).reset(seed=seeds)


def test_the_judge_of_structure_ranks_the_goal_first(env):
    it = gymnasium.make("renderer/strokes-v1", goal=GOAL, judge="ssim", **SMALL)
    _, start = it.reset(seed=0)
    _, reward, _, _, info = it.step(np.zeros(7, np.float32))
    assert -1 <= info["score"] <= 1 and info["score"] - start["score"] == pytest.approx(reward)


def test_the_judge_of_structure_needs_room_for_its_windows():
    narrow = {**SMALL, "canvas": "9x21cm", "goal": GOAL, "judge": "ssim"}
    with pytest.raises(
        ConfigError, match=r"windows of 11 x 11 pixels, and the observed pictures are 10 x 23; give more"
    ):
        gymnasium.make("renderer/strokes-v1", **{**narrow, "rows": 23})
    it = gymnasium.make("renderer/strokes-v1", **{**narrow, "rows": 26})  # 11 columns
    assert np.isfinite(it.reset(seed=0)[1]["score"])


def test_many_processes_paint_as_one_does(env):
    """Processes are forked after this one has painted, with its threads and compiled loops."""
    env.reset(seed=0)
    env.step(np.zeros(7, np.float32))
    several = AsyncVectorEnv([lambda: gymnasium.make("renderer/strokes-v1", goal=GOAL, **SMALL)] * 2)
    seen, _ = several.reset(seed=3)
    action = np.tile(np.linspace(-0.5, 0.5, 7).astype(np.float32), (2, 1))
    for _ in range(3):
        seen, *_ = several.step(action)
    several.close()
    env.reset(seed=4)
    for _ in range(3):
        own, *_ = env.step(action[1])
    same(own, {name: part[1] for name, part in seen.items()})


FORKED = """
import multiprocessing, sys
import gymnasium
import frida_painter as fp
from frida_painter.system import images
from gymnasium.vector import AsyncVectorEnv

first, second = sys.argv[1:]
SMALL = {"canvas": "20x16cm", "paints": 3, "strokes": 5}

def make():
    return gymnasium.make("studio/strokes-v1", goal=second, **SMALL)

def paint(number):
    plan = fp.make_planner(second, strokes=3, colors=2, render_height=64, effort=0.05).plan()
    layered = images.load_with_opacity(open(second, "rb").read(), second, longest=100)
    assert layered.shape == (4, 80, 100)
    return float(fp.render_plan(plan).mean())

alone = fp.make_env("studio/strokes-v1", goal=first, **SMALL)  # with libvips, and with threads of PyTorch
alone.reset(seed=0)
here = paint(0)
several = AsyncVectorEnv([make] * 2, context="fork")
several.reset(seed=0)
several.step(several.action_space.sample())
several.close()
with multiprocessing.get_context("fork").Pool(2) as pool:
    assert all(abs(there - here) < 0.01 for there in pool.map(paint, range(2)))
print("all there")
"""


def test_forked_processes_read_pictures_plan_and_paint(tmp_path):
    """They would wait for ever for threads of libvips and of PyTorch, which a fork leaves behind."""
    paths = [tmp_path / "first.png", tmp_path / "second.png"]
    for path in paths:
        fp.save_picture(torch.rand(3, 400, 500, generator=torch.Generator().manual_seed(0)), path)
    several = {**os.environ, "OMP_NUM_THREADS": "2"}
    said = subprocess.run(
        [sys.executable, "-c", FORKED, *map(str, paths)], capture_output=True, text=True, timeout=280, env=several
    )
    assert said.stdout.endswith("all there\n"), said.stderr
