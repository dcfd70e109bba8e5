import gymnasium
import numpy as np
import pytest
import torch
from policies import GreedyPolicy, PlannerPolicy, RandomPolicy, play

import frida_painter_lab.env  # noqa: F401, registers

SMALL = {"canvas": "9x7cm", "brush": "fine", "paints": ["#eeddaa", "#aa3333", "#222233"], "rows": 28, "strokes": 8}
# Dark below, light above
GOAL = torch.cat((torch.full((3, 20, 50), 0.85), torch.full((3, 20, 50), 0.15)), 1)

pytestmark = pytest.mark.usefixtures("small_world")


@pytest.fixture(scope="module")
def env():
    return gymnasium.make("renderer/strokes-v1", goal=GOAL, **SMALL)


def test_the_greedy_one_is_nearer_than_chance_and_the_planner_than_the_greedy_one(env):
    task = env.unwrapped.task
    policies = RandomPolicy(0), GreedyPolicy(task, 32), PlannerPolicy(task, every=4, effort=0.2)
    chance, greedy, planned = (np.mean([each.score for each in play(env, policy, (0, 1))]) for policy in policies)
    assert chance + 1 < greedy < planned


def test_the_greedy_choice_lowers_the_error(env):
    policy = GreedyPolicy(env.unwrapped.task, 16, seed=3)
    observed, _ = env.reset(seed=0)
    for _ in range(4):
        observed, reward, *_ = env.step(policy(observed))
        assert reward > 0


@pytest.mark.parametrize("paint", [0, 1, 2])
def test_the_greedy_choice_takes_the_paint_of_the_goal(env, paint):
    task = env.unwrapped.task
    observed, _ = env.reset(options={"goal": task.palettes[0][paint][:, None, None].expand(3, 20, 50)})
    action = GreedyPolicy(task, 16, seed=3)(observed)
    assert task.code.decode(action[None], task.palettes[0])[1].tolist() == [paint]


def test_the_same_seed_gives_the_same_strokes(env):
    one, other = (play(env, GreedyPolicy(env.unwrapped.task, 8, seed=1), (0,)) for _ in range(2))
    assert one == other and one[0].minutes is None and one[0].strokes == 8
    assert one[0].score - one[0].gain == pytest.approx(env.reset(seed=0)[1]["score"])


def test_the_planner_paints_batches_in_the_studio():
    env = gymnasium.make("studio/plans-v1", goal=GOAL, batch=4, **SMALL)
    (painted,) = play(env, PlannerPolicy(env.unwrapped.task, every=1, effort=0.2, batch=4), (0,))
    (chance,) = play(env, RandomPolicy(0, batch=4), (0,))
    assert painted.score > chance.score + 1 and painted.strokes == 8 and painted.minutes > 0
    env.close()


def test_the_planner_paints_fewer_strokes_than_there_are_paints():
    env = gymnasium.make("renderer/strokes-v1", goal=GOAL, **{**SMALL, "strokes": 2})
    assert play(env, PlannerPolicy(env.unwrapped.task, effort=0.05), (0,))[0].strokes == 2
