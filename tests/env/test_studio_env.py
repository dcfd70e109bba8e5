"""The virtual studio as an environment: the studio of paintings, the same bytes for the same seed, sentences."""

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

import frida_painter as fp
from frida_painter.errors import ConfigError, StepRefused

SMALL = {
    "canvas": "9x7cm", "brush": "fine", "paints": ["#eeddaa", "#aa3333", "#222233"], "rows": 28, "strokes": 6,
    "goal": torch.full((3, 30, 40), 0.2),
}  # fmt: skip
ACROSS = np.array([0, 0, 0, 1, 0, 0.6, 1], np.float32)

pytestmark = pytest.mark.usefixtures("small_world")


@pytest.fixture
def env():
    made = gymnasium.make("studio/strokes-v1", **SMALL)
    yield made
    made.close()


@pytest.mark.parametrize("name", ["studio/strokes-v1", "studio/plans-v1"])
def test_gymnasium_finds_no_fault_with_it(name):
    batch = {"batch": 3} if name == "studio/plans-v1" else {}
    check_env(gymnasium.make(name, render_mode="rgb_array", **SMALL, **batch).unwrapped)


def test_the_same_seed_gives_the_same_bytes_and_another_one_another_studio(env):
    found = []
    for seed in (5, 6, 5):
        env.reset(seed=seed)
        observed, reward, *_, info = env.step(ACROSS)
        found.append((observed["canvas"].tobytes(), reward, info["score"], info["minutes"]))
    assert found[0] == found[2] and found[0][0] != found[1][0]


def test_a_stroke_darkens_the_canvas_where_it_goes_and_the_judge_sees_it(env):
    first, start = env.reset(seed=1)
    seen, reward, ended, cut, info = env.step(ACROSS)
    middle = seen["canvas"][14, 8:32].astype(int)
    assert middle.mean() < first["canvas"][14, 8:32].mean() - 30
    assert reward == pytest.approx(info["score"] - start["score"]) and reward > 0, "the goal is dark"
    assert seen["held"] == 3 and 0 < seen["load"][0] < 1
    assert seen["strokes_left"] == [5] and 0 < seen["minutes_left"][0] < 120 and not (ended or cut)
    assert np.abs(seen["canvas"] / 255 - env.unwrapped.studio.truth(28).permute(1, 2, 0).numpy()).mean() < 0.04


def test_a_batch_is_its_strokes_one_after_another(env):
    """The camera's trips pass time, so the paint is a little drier; the marks are the same."""
    several = gymnasium.make("studio/plans-v1", batch=3, **SMALL)
    actions = np.stack([ACROSS, ACROSS * [0, 0, 0, 1, 1, 0, 0.0], ACROSS * [0, 0, 0, -1, 1, 1, -1]]).astype(np.float32)
    env.reset(seed=2)
    for action in actions:
        *_, alone = env.step(action)
    several.reset(seed=2)
    *_, together = several.step(actions)
    assert together["strokes"] == 3 and together["minutes"] < alone["minutes"]
    truths = [each.unwrapped.studio.truth(28) for each in (env, several)]
    assert float((truths[0] - truths[1]).abs().mean()) < 0.01


def test_the_budget_of_minutes_ends_an_episode():
    env = gymnasium.make("studio/strokes-v1", **{**SMALL, "minutes": 0.25})
    env.reset(seed=0)
    cuts = []
    while not (cuts and cuts[-1]):
        seen, *_, cut, info = env.step(ACROSS)
        cuts.append(cut)
    assert len(cuts) < SMALL["strokes"] and info["minutes"] >= 0.25 and seen["minutes_left"] == [0]
    with pytest.raises(StepRefused, match="over after"):
        env.step(ACROSS)


def test_a_refused_action_moves_nothing(env):
    env.reset(seed=0)
    before, clock = env.unwrapped.studio.truth(28), env.unwrapped.studio.clock.now
    with pytest.raises(StepRefused, match="nothing was painted"):
        env.step(ACROSS * 2)
    assert torch.equal(before, env.unwrapped.studio.truth(28)) and clock == env.unwrapped.studio.clock.now


def test_a_step_before_a_reset_is_refused(env):
    for use in (lambda: env.step(ACROSS), lambda: env.unwrapped.studio):
        with pytest.raises(StepRefused, match="call reset"):
            use()


@pytest.mark.parametrize("batch", [0, 4, 7, 2.0, True])
def test_a_batch_that_does_not_divide_the_strokes_is_refused(batch):
    with pytest.raises(ConfigError, match="batch"):
        fp.make_env("studio/plans-v1", **SMALL, batch=batch)


def test_it_can_be_closed_twice_and_opened_again(env):
    env.reset(seed=0)
    env.close()
    env.close()
    assert env.reset(seed=0)[0]["strokes_left"] == [6]


def test_a_toned_canvas_is_seen(env):
    toned = gymnasium.make("studio/strokes-v1", **SMALL, ground="#c8a878")
    seen = toned.reset(seed=0)[0]["canvas"].reshape(-1, 3).mean(0)
    assert seen == pytest.approx([0xC8, 0xA8, 0x78], abs=8)
